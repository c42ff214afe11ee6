"""Pictures of a world for people: antialiased, with sky, light and shadows.

A portrait also has a floor, without a collision shape and only while the picture is taken, so that
neither the physics nor the robot's own camera knows of it.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simulate.world.camera import Camera, Lighting
from simulate.world.world import World

__all__ = ["LIGHT", "photograph", "portrait"]

LIGHT = Lighting(direction=(0.5, -0.9, 1.4), ambient=0.6, diffuse=0.5, specular=0.08)
_OVERSAMPLED = 2
_FLOOR_HALF_M = (3.0, 3.0, 0.005)
_FLOOR_COLOUR = (0.82, 0.84, 0.85, 1.0)
_FLOOR_BELOW_TABLE_M = 0.28
_SKY = (np.array([236.0, 241.0, 244.0]), np.array([206.0, 216.0, 222.0]))


def portrait(
    world: World,
    camera: Camera,
    size: tuple[int, int] = (1280, 720),
    side: str = "right",
) -> NDArray[np.uint8]:
    """Return a picture (h, w, 3) RGB of a world from in front of its robot.

    Parameters
    ----------
    camera
        Of the same world.
    size : (width, height), px
    side
        ``left`` or ``right``: the half of the table to look at.
    """
    floor = _add_floor(world.client, world.table_height - _FLOOR_BELOW_TABLE_M)
    try:
        return photograph(world, camera, size, side, LIGHT)
    finally:
        world.client.removeBody(floor)


def photograph(
    world: World, camera: Camera, size: tuple[int, int], side: str, lighting: Lighting | None
) -> NDArray[np.uint8]:
    """Return a picture as :func:`portrait` does, without a floor: the world stays as it is."""
    place = world.workplace
    large = (size[0] * _OVERSAMPLED, size[1] * _OVERSAMPLED)
    png = camera.snapshot(lighting, large, side, place.eye, place.target)
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None  # it was encoded just now
    rgb = np.ascontiguousarray(image[..., ::-1]).astype(np.uint8)
    return cv2.resize(_with_sky(rgb), size, interpolation=cv2.INTER_AREA).astype(np.uint8)


def _add_floor(client: Any, top_m: float) -> int:
    shape = client.createVisualShape(
        client.GEOM_BOX, halfExtents=_FLOOR_HALF_M, rgbaColor=_FLOOR_COLOUR
    )
    at = [0.0, 0.0, top_m - _FLOOR_HALF_M[2]]
    return int(client.createMultiBody(baseVisualShapeIndex=shape, basePosition=at))


def _with_sky(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Replace what shows nothing, which the renderer leaves white, by a soft gradient."""
    height = len(rgb)
    share = np.linspace(0.0, 1.0, height)[:, None]
    sky = (_SKY[0] * (1 - share) + _SKY[1] * share).astype(np.uint8)
    empty = np.all(rgb == 255, axis=2)
    out = rgb.copy()
    out[empty] = np.broadcast_to(sky[:, None, :], rgb.shape)[empty]
    return out
