"""A table with a box on it, as a depth camera sees it, with noise: made here, by rays."""

from __future__ import annotations

import numpy as np

from features.geometry import Intrinsics, look_at, transform

CAMERA = Intrinsics(160, 120, 140.0, 140.0, 79.0, 60.5)
BASE_FROM_CAMERA = look_at(np.array([0.0, -0.6, 0.55]), np.array([0.0, 0.02, 0.0]))
"""The frame of the robot: on the table, z up."""
LOW, HIGH = np.array([-0.08, -0.06, 0.0]), np.array([0.08, 0.06, 0.12])


def rays() -> np.ndarray:
    """Return the directions (h, w, 3) of the pixels, z = 1, in the camera's frame."""
    v, u = np.indices((CAMERA.height, CAMERA.width), np.float64)
    across, down = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    return np.stack([across, down, np.ones_like(across)], axis=-1)


def depth_of_table(noise_m: float = 0.0015, seed: int = 0) -> np.ndarray:
    """Return the depth (h, w), m, of the table and the box; beyond the table is nothing (0)."""
    eye = BASE_FROM_CAMERA[:3, 3]
    ways = rays() @ BASE_FROM_CAMERA[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (LOW - eye) / ways, (HIGH - eye) / ways
        near = np.minimum(first, second).max(axis=-1)
        far = np.maximum(first, second).min(axis=-1)
        table = -eye[2] / ways[..., 2]
    depth = np.where(near < far, near, table)
    places = eye + depth[..., None] * ways
    depth[(np.abs(places[..., :2]) > 0.5).any(axis=-1) | (depth <= 0)] = 0
    noise = np.random.default_rng(seed).normal(0, noise_m, depth.shape)
    return np.where(depth > 0, depth + noise, 0)


def points_of_table(noise_m: float = 0.0015) -> np.ndarray:
    """Return the organised cloud (h, w, 3), m, in the camera's frame; NaN where nothing is."""
    depth = depth_of_table(noise_m)
    return np.where(depth > 0, depth, np.nan)[..., None] * rays()


def in_base(points: np.ndarray) -> np.ndarray:
    """Return points of the camera's frame in that of the robot."""
    return transform(BASE_FROM_CAMERA, points)
