"""Films of a robot's attempts: two cameras that see what it does, for data sets of policies."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from numpy.typing import NDArray

from simulate.world.camera import Camera, Lighting
from simulate.world.world import World

__all__ = ["FILM_HZ", "Frames", "filming"]

FILM_HZ = 10.0
_SIZE = (160, 120)
_ABOVE_M = 0.50
_BACK_M = 0.05
"""From the middle of the table towards the robot: the camera above looks down at a slant."""

Frames = list[NDArray[np.uint8]]


@contextmanager
def filming(
    world: World, camera: Camera, lighting: Lighting | None, side: str
) -> Iterator[dict[str, Frames]]:
    """Film what happens in a world, in simulated seconds; yield the frames by camera.

    ``overhead`` looks down on the half of the table, ``front`` from opposite the robot.

    Parameters
    ----------
    side
        ``left`` or ``right`` half of the table.
    """
    place = world.workplace
    x, y, z = place.target
    eyes = {"overhead": (x - _BACK_M, y, z + _ABOVE_M), "front": place.eye}
    films: dict[str, Frames] = {name: [] for name in eyes}
    began, before = world.time, world.on_step

    def shoot() -> None:
        while world.time - began >= len(films["front"]) / FILM_HZ:
            for name, eye in eyes.items():
                png = camera.snapshot(lighting, _SIZE, side, eye, place.target)
                image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
                assert image is not None  # it was encoded just now
                films[name].append(np.ascontiguousarray(image[..., ::-1]).astype(np.uint8))

    def step() -> None:
        before()
        shoot()

    shoot()
    world.on_step = step
    try:
        yield films
    finally:
        world.on_step = before
