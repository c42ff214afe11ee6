"""The moving picture of sharing, from the recorded demo and from runs that have none to show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rtask.errors import RobotError
from simulate.study.film.sharing import film_sharing, scenes_of, write_recorded


def _attempt(run: int, held: bool, source: str = "candidate") -> dict[str, Any]:
    return {"run": run, "held": held, "reason": "ok" if held else "missed", "source": source,
            "hand": None}  # fmt: skip


def _met(robot: str, *attempts: dict[str, Any]) -> dict[str, Any]:
    held = attempts[-1]["held"]
    return {"robot": robot, "product": "carton-1", "attempts": list(attempts), "held": held,
            "placed": held, "tries": len(attempts),
            "tries_to_success": len(attempts) if held else None}  # fmt: skip


def _pictures(folder: Path, robot: str, *names: str) -> None:
    (folder / robot).mkdir()
    for name in names:
        cv2.imwrite(str(folder / robot / f"{name}.png"), np.full((36, 48, 3), 90, np.uint8))


def test_one_robot_fails_and_writes_and_the_next_one_holds_at_once(tmp_path: Path) -> None:
    _pictures(tmp_path, "nao-1", "01-1-pre_grasp", "01-2-closed", "02-1-pre_grasp", "02-2-held")
    _pictures(tmp_path, "nao-2", "01-1-pre_grasp", "01-2-held")
    first = _met("nao-1", _attempt(1, False), _attempt(2, True))
    second = _met("nao-2", _attempt(1, True, "memory"))
    scenes = list(scenes_of(tmp_path, first, second, "With the graph nao-2 needed 1 attempt."))
    assert [scene.outcome for scene in scenes] == [
        "", "Failed: the hand closed without holding it.", "", "Held.", "", "", "Held.", "",
    ]  # fmt: skip
    assert [scene.right is not None for scene in scenes] == [False] * 5 + [True] * 3
    assert scenes[-1].words == ("With the graph nao-2 needed 1 attempt.",)


def test_a_run_in_which_nobody_failed_first_has_no_film(tmp_path: Path) -> None:
    robots = [{"name": "nao-1"}, {"name": "nao-2"}]
    told, own = (_met("nao-2", _attempt(1, True, source)) for source in ("memory", "candidate"))
    failed = _met("nao-1", _attempt(1, False), _attempt(2, True))
    at_once = _met("nao-1", _attempt(1, True))
    for objects in ([at_once, told], [failed, own], [failed]):
        with pytest.raises(RobotError, match="no robot failed"):
            film_sharing(tmp_path, {"robots": robots, "objects": objects, "gains": []})


def test_the_recorded_demo_has_a_film_that_is_small(tmp_path: Path) -> None:
    path = tmp_path / "sharing.webp"
    write_recorded(path)
    assert path.stat().st_size < 1_500_000
    _, animation = cv2.imreadanimation(str(path))
    assert len(animation.frames) > 5
