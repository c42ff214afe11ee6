"""A moving picture of a crew at one table, with what each robot does in words below."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simulate.tasks.arms.bench import Bench
from simulate.world.animation import write_animation
from simulate.world.camera import Camera
from simulate.world.portrait import portrait

__all__ = ["BenchFilm"]

_SIZE = (480, 270)
_EVERY_S, _PAUSE_MS = 2.4, 240
"""Simulated time between two pictures, and for how long each is shown: ten times as fast."""
_BAR_PX, _MARGIN_PX, _FONT_SCALE = 40, 8, 0.38
_PAPER, _INK = (250, 248, 247), (36, 36, 27)


class BenchFilm:
    """Takes a picture of a bench at regular simulated times.

    Parameters
    ----------
    bench
        Its world calls back after each step.
    goal
        In words, which stand below the picture.
    """

    def __init__(self, bench: Bench, goal: str) -> None:
        self._bench, self._goal = bench, goal
        self._camera = Camera(bench.world.client)
        self._frames: list[NDArray[np.uint8]] = []
        self._next_s = bench.world.time
        self.doing = ""
        """What happens, in words."""
        bench.world.on_step = self._step

    def write(self, path: Path, last: str) -> None:
        """Write the film, which ends with a sentence."""
        self.doing = last
        self._take()
        write_animation(path, self._frames, _PAUSE_MS)

    def _step(self) -> None:
        if self._bench.world.time >= self._next_s:
            self._next_s += _EVERY_S
            self._take()

    def _take(self) -> None:
        picture = portrait(self._bench.world, self._camera, _SIZE)
        bar = np.full((_BAR_PX, _SIZE[0], 3), _PAPER, np.uint8)
        for row, text in enumerate((self._goal, self.doing)):
            at = _MARGIN_PX, 16 + 17 * row
            cv2.putText(bar, text, at, cv2.FONT_HERSHEY_SIMPLEX, _FONT_SCALE, _INK, 1, cv2.LINE_AA)
        self._frames.append(np.vstack([picture, bar]).astype(np.uint8))
