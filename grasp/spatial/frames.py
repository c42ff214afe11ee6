"""Planar grasps (X, Y, theta) and poses, and how they move between frames.

A planar grasp approaches straight down; theta is the direction in which the jaws close, about the
surface normal (Gatto 2016, 3.3.4). Gripper frame: z = approach, x = closing direction, origin
midway between the fingertips. Transforms are ``target_from_source``, quaternions (x, y, z, w).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray

__all__ = [
    "angle_between_axes",
    "closing_yaw",
    "matrix_from_pose",
    "move_planar",
    "planar_from_pose",
    "pose_from_matrix",
    "pose_from_planar",
    "surface_from_object",
    "tilt",
    "wrap_2pi",
    "wrap_axis",
    "yaw_of",
]


_MAX_TILT_RAD = float(np.deg2rad(20))


def wrap_2pi(angle: float) -> float:
    """Return an angle in [0, 2 pi), rad.

    >>> wrap_2pi(-np.pi / 2) == 1.5 * np.pi
    True
    """
    turned = float(np.mod(angle, 2 * np.pi))
    return 0.0 if turned >= 2 * np.pi else turned


def wrap_axis(angle: float) -> float:
    """Return the direction of an axis, which has no sign, in [0, pi), rad.

    >>> round(wrap_axis(-0.1), 3)
    3.042
    """
    turned = float(np.mod(angle, np.pi))
    return 0.0 if turned >= np.pi else turned


def angle_between_axes(a: float, b: float) -> float:
    """Return the smallest angle between two axes in a plane, in [0, pi/2], rad.

    >>> round(angle_between_axes(0.05, np.pi - 0.05), 3)
    0.1
    """
    return abs(float((a - b + np.pi / 2) % np.pi - np.pi / 2))


def pose_from_planar(x: float, y: float, z: float, theta: float) -> FloatArray:
    """Return ``frame_from_gripper`` (4, 4) of a grasp straight down.

    Parameters
    ----------
    x, y, z
        Tool centre point, m.
    theta
        Closing direction about +z, rad.
    """
    c, s = np.cos(theta), np.sin(theta)
    pose = np.eye(4)
    pose[:3, :3] = [[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]]
    pose[:3, 3] = x, y, z
    return pose


def planar_from_pose(frame_from_gripper: FloatArray) -> tuple[float, float, float, float]:
    """Return (x, y, z, theta) of a pose that approaches nearly straight down.

    Raises
    ------
    ValueError
        When the approach is more than 20 degrees off the vertical.
    """
    if frame_from_gripper.shape != (4, 4):
        raise ValueError(f"expected a (4, 4) transform, got {frame_from_gripper.shape}")
    off = float(np.arccos(np.clip(-frame_from_gripper[2, 2], -1.0, 1.0)))
    if off > _MAX_TILT_RAD:
        raise ValueError(
            f"the approach is {np.rad2deg(off):.0f} deg off the vertical: no planar grasp"
        )
    x, y, z = (float(v) for v in frame_from_gripper[:3, 3])
    closing = frame_from_gripper[:2, 0]
    return x, y, z, wrap_2pi(float(np.arctan2(closing[1], closing[0])))


def move_planar(
    target_from_source: FloatArray, planar: NDArray[np.float64], inverse: bool = False
) -> NDArray[np.float64]:
    """Return planar grasps (n, 3), x, y, m and theta, rad, in another frame with the same vertical.

    Parameters
    ----------
    target_from_source : (4, 4), m
        A translation and a rotation about z.
    planar : (n, 3)
        x, y, m and closing direction about +z, rad, in the source frame.
    inverse
        They are given in the target frame and wanted in the source frame.

    Examples
    --------
    >>> moved = move_planar(surface_from_object(1.0, 0.0, 0.0, np.pi / 2), np.array([[0.5, 0, 0]]))
    >>> moved.round(3).tolist()
    [[1.0, 0.5, 1.571]]
    """
    pose, yaw, height = target_from_source, yaw_of(target_from_source), 0.0
    if inverse:
        # The yaw is negated, not read from the inverse: theta - yaw is exactly 0 along the x axis.
        inverted = np.asarray(np.linalg.inv(pose), dtype=np.float64)
        pose, yaw, height = inverted, -yaw, float(pose[2, 3])
    ones = np.ones(len(planar))
    points = np.stack([planar[:, 0], planar[:, 1], height * ones, ones], axis=1)
    moved = (pose @ points[:, :, None])[:, :2, 0]
    theta = np.mod(planar[:, 2] + yaw, 2 * np.pi)
    return np.column_stack([moved, np.where(theta >= 2 * np.pi, 0.0, theta)])


def closing_yaw(frame_from_gripper: FloatArray) -> float:
    """Return the closing direction about z of any pose (4, 4), in [0, 2 pi), rad; 0 if vertical.

    >>> closing_yaw(pose_from_planar(0.1, 0.2, 0.0, 0.5)).__round__(6)
    0.5
    """
    x, y = (float(v) for v in frame_from_gripper[:2, 0])
    return wrap_2pi(float(np.arctan2(y, x))) if np.hypot(x, y) > 1e-6 else 0.0


def surface_from_object(x: float, y: float, z: float, yaw: float) -> FloatArray:
    """Return the pose (4, 4) of a thing that stands upright at (x, y, z), turned by ``yaw``."""
    c, s = np.cos(yaw), np.sin(yaw)
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = x, y, z
    return pose


def tilt(target_from_source: FloatArray) -> float:
    """Return the angle between both frames' z axes, rad."""
    return float(np.arccos(np.clip(target_from_source[2, 2], -1.0, 1.0)))


def yaw_of(target_from_source: FloatArray) -> float:
    """Return the rotation about +z of a nearly upright transform, in [0, 2 pi), rad."""
    return wrap_2pi(float(np.arctan2(target_from_source[1, 0], target_from_source[0, 0])))


def matrix_from_pose(position: FloatArray, quaternion: FloatArray) -> FloatArray:
    """Return the (4, 4) transform of a position (3,), m and a quaternion (x, y, z, w).

    Raises
    ------
    ValueError
        When the quaternion's norm is not 1 within 1 %: a message that is wrong, not imprecise.
    """
    q = np.asarray(quaternion, dtype=np.float64)
    norm = float(np.linalg.norm(q))
    if q.shape != (4,) or not 0.99 <= norm <= 1.01:
        raise ValueError(f"expected a unit quaternion (x, y, z, w), got {quaternion}")
    x, y, z, w = q / norm
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = np.asarray(position, dtype=np.float64)
    return pose


def pose_from_matrix(target_from_source: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return position (3,), m and unit quaternion (x, y, z, w) with w >= 0 of a transform."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(target_from_source[:3, :3]).as_quat(canonical=True)
    return target_from_source[:3, 3].copy(), np.asarray(quaternion, dtype=np.float64)
