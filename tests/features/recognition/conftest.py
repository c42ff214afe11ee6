"""Printed cards seen by a pinhole camera: objects whose every pose is known exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from features.geometry import Intrinsics
from features.recognition import ViewFeatures, describe_view

CAMERA = Intrinsics(200, 200, 467.7, 467.7, 99.5, 99.5)
SIZE_M = (0.06, 0.045)
TABLE_GREY = 120


@dataclass(frozen=True)
class Shot:
    """An image of a card and everything that is true about it."""

    image: NDArray[np.uint8]
    mask: NDArray[np.bool_]
    depth: NDArray[np.float32]
    camera_from_card: NDArray[np.float64]

    def describe(self) -> ViewFeatures:
        return describe_view(self.image, self.mask, self.depth, CAMERA)


def print_of(seed: int) -> NDArray[np.uint8]:
    """Paint coloured polygons, discs and bars, all from a seed."""
    rng = np.random.default_rng([7, seed])
    width, height = 480, 360
    palette = rng.integers(0, 256, (5, 3))
    image = np.full((height, width, 3), palette[0], np.uint8)
    for radius in np.sort(rng.uniform(6, 45, 110))[::-1]:
        centre = rng.uniform((0, 0), (width, height))
        angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 7))))
        corners = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        colour = palette[rng.integers(5)].tolist()
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], colour, cv2.LINE_AA)
    return image


def photograph(
    texture: NDArray[np.uint8],
    yaw: float = 0.0,
    tilt: float = 0.4,
    distance: float = 0.3,
    light: float = 1.0,
    seed: int = 0,
) -> Shot:
    """Look at a card from ``distance`` m, turned by ``yaw`` and tilted by ``tilt`` rad."""
    rng = np.random.default_rng([11, seed])
    cy, sy, ct, st = np.cos(yaw), np.sin(yaw), np.cos(tilt), np.sin(tilt)
    turn = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1.0]])
    lean = np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = lean @ turn, (0.002, -0.001, distance)

    height, width = texture.shape[:2]
    half_x, half_y = SIZE_M[0] / 2, SIZE_M[1] / 2
    corners = np.array(
        [[-half_x, -half_y, 0], [half_x, -half_y, 0], [half_x, half_y, 0], [-half_x, half_y, 0]]
    )
    seen = corners @ pose[:3, :3].T + pose[:3, 3]
    pixels = seen[:, :2] / seen[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy)
    source = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]])
    warp = cv2.getPerspectiveTransform(source.astype(np.float32), pixels.astype(np.float32) * 4)
    # Drawn four times as large and averaged: a camera's pixel is an area, not a point.
    size = (4 * CAMERA.width, 4 * CAMERA.height)
    large = cv2.warpPerspective(texture, warp, size, borderValue=(TABLE_GREY,) * 3)
    cover = cv2.warpPerspective(np.full((height, width), 255, np.uint8), warp, size)
    small = (CAMERA.width, CAMERA.height)
    image = cv2.resize(large, small, interpolation=cv2.INTER_AREA).astype(np.float64)
    mask = cv2.resize(cover, small, interpolation=cv2.INTER_AREA) > 127
    noisy = np.clip(image * light + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)

    normal = pose[:3, 2]
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1
    )
    z = (normal @ pose[:3, 3]) / (rays @ normal)
    z = z + rng.normal(0, 0.0015, z.shape)
    return Shot(noisy, mask, np.where(mask, z, 0).astype(np.float32), pose)


Photograph = Callable[..., Shot]


@pytest.fixture
def photo() -> Photograph:
    """Photograph card number ``card``; other arguments as in ``photograph``."""
    return lambda card, **how: photograph(print_of(card), **how)


@pytest.fixture(scope="session")
def print_image() -> Callable[[int], NDArray[np.uint8]]:
    """Return the print of a card."""
    return print_of


@pytest.fixture(scope="session")
def photograph_print() -> Photograph:
    """Photograph any print."""
    return photograph


@pytest.fixture(scope="session")
def card_views() -> Callable[[int, int], list[ViewFeatures]]:
    """Return the first views of a card, each from elsewhere; described once a session."""
    known: dict[tuple[int, int], ViewFeatures] = {}

    def views(card: int, count: int) -> list[ViewFeatures]:
        for k in range(count):
            if (card, k) not in known:
                shot = photograph(print_of(card), yaw=0.9 * k, tilt=0.3 + 0.1 * (k % 3), seed=k)
                known[card, k] = shot.describe()
        return [known[card, k] for k in range(count)]

    return views
