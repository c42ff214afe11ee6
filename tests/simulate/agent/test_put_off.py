"""An agent takes what it can on both sides before it pushes or leaves alone what it cannot."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from features.geometry import Frame
from features.perception import Perceived, Seen
from simulate.agent import agent as agents
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.second_look import View
from simulate.agent.tracking import TrackedObject
from tests.simulate.agent.doubles import CAMERA, seen_at

FRAME = Frame(np.full((12, 16), 0.3, np.float32), CAMERA, np.zeros((12, 16, 3), np.uint8))


class _NothingWorks(Agent):
    """Puts off what may wait, and gives up the rest; notes both."""

    done: list[tuple[int, str]]

    def _attempt(self, track: TrackedObject, *seen: Any) -> None:
        *_, may_wait = seen
        if may_wait and not track.waiting:
            track.waiting = True
            self.done.append((track.number, "put off"))
        else:
            track.finished = True
            self.done.append((track.number, "given up"))


def _order(monkeypatch: pytest.MonkeyPatch, takes_poses: bool, *tracks: Seen) -> list[Any]:
    def look(body: Any, tracker: Any, handled: Any, side: str) -> View:
        sign = -1 if side == "right" else 1
        tracker.update([one for one in tracks if one.position[1] * sign >= 0], handled, sign)
        return View(FRAME, np.eye(4), Perceived("ok", 0.27, tracks))

    monkeypatch.setattr(agents, "look_at_side", look)
    body = SimpleNamespace(
        takes_poses=takes_poses, base_frame="base", gripper_ids={"right": "r", "left": "l"}
    )
    server = SimpleNamespace(plan_on_scene=lambda **request: {"segments": [], "grasps": []})
    robot = _NothingWorks(cast(Any, body), cast(Any, server), AgentConfig())
    robot.done = []
    robot.clear_table()
    return robot.done


@pytest.mark.parametrize("takes_poses", [True, False])
def test_a_crowd_waits_until_both_sides_are_cleared(
    monkeypatch: pytest.MonkeyPatch, takes_poses: bool
) -> None:
    two, far = (seen_at(0.40, -0.10), seen_at(0.41, -0.10)), seen_at(0.40, 0.10)
    done = _order(monkeypatch, takes_poses, *two, far)
    assert done[:3] == [(1, "put off"), (2, "put off"), (3, "given up")]
    # Nothing is left to wait for but each other.
    assert done[3:] == [(1, "put off"), (2, "given up"), (1, "given up")]


@pytest.mark.parametrize("takes_poses", [True, False])
def test_what_stands_free_waits_for_its_own_side_only(
    monkeypatch: pytest.MonkeyPatch, takes_poses: bool
) -> None:
    apart = seen_at(0.40, -0.20), seen_at(0.40, -0.10), seen_at(0.40, 0.10)
    done = _order(monkeypatch, takes_poses, *apart)
    assert done == [(1, "put off"), (2, "given up"), (1, "given up"), (3, "given up")]
