"""The animated picture of robots, written and read back."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from rtask.errors import UsageError
from simulate.study.film.robots import Film, write_film
from simulate.world.camera import Camera
from simulate.world.portrait import portrait
from simulate.world.world import World

# The command at a size and with physics that take seconds instead of minutes.
_QUICK_FILM = """
import functools
from rtask.cli import main
from simulate.study.film import robots as film

film.Film = functools.partial(film.Film, size=(64, 36), frames_per_s=0.5)
film.film_robot.__defaults__ = ("fast",)
main()
"""


def _frames(count: int, grey: int) -> list[np.ndarray]:
    return [np.full((18, 32, 3), grey + k, np.uint8) for k in range(count)]


def test_the_robot_that_has_finished_stands_still(tmp_path: Path) -> None:
    path = tmp_path / "robots.png"
    write_film(path, [_frames(2, 10), _frames(4, 100)], Film())
    _, animation = cv2.imreadanimation(str(path))
    assert len(animation.frames) == 4
    last = animation.frames[-1]
    assert last.shape[:2] == (18, 64)
    assert (last[0, 0, 0], last[0, -1, 0]) == (11, 103)


def test_another_suffix_and_an_empty_film_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="webp"):
        write_film(tmp_path / "robots.mp4", [_frames(1, 0)], Film())
    with pytest.raises(UsageError, match="make it first"):
        write_film(tmp_path / "none" / "robots.webp", [_frames(1, 0)], Film())
    with pytest.raises(UsageError, match="no pictures"):
        write_film(tmp_path / "robots.webp", [], Film())


@pytest.mark.slow
def test_the_command_prints_json_and_nothing_else_and_its_film_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "panda.png"
    words = ("simulate", "film", str(path), "--robot", "panda", "--objects", "1", "--json")
    done = subprocess.run(
        [sys.executable, "-c", _QUICK_FILM, *words], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"path": str(path)}
    _, animation = cv2.imreadanimation(str(path))
    assert animation.frames[0].shape[:2] == (36, 64)
    assert len(animation.frames) > 1


@pytest.mark.slow
def test_a_portrait_has_a_floor_that_is_gone_afterwards() -> None:
    world = World("fast")
    try:
        world.add_table()
        bodies = world.client.getNumBodies()
        image = portrait(world, Camera(world.client), (160, 90))
        assert image.shape == (90, 160, 3)
        assert not np.any(np.all(image == 255, axis=2))  # the renderer's empty white is covered
        assert world.client.getNumBodies() == bodies
    finally:
        world.close()
