"""Cameras on stands around a workplace."""

from __future__ import annotations

import numpy as np

from simulate.robots.description import (
    CameraMount,
    Floats,
    Pose,
    Workplace,
    rpy_from_rotation,
)

__all__ = ["camera_pose", "standing_cameras"]

_BEYOND_M, _ABOVE_M = 0.11, 0.34
_BOX_OFFSET = np.array([0.14, 0.0, 0.40])


def standing_cameras(
    root: str, place: Workplace, base_from_root: Pose | None = None
) -> dict[str, CameraMount]:
    """Return a camera opposite the robot, steeply over the area, and one over each box.

    Parameters
    ----------
    root
        Root link, to which the mounts are fixed.
    place
        The workplace, base frame.
    base_from_root
        Pose of the root link; None = the base frame's.
    """
    root_from_base = np.linalg.inv(base_from_root.matrix if base_from_root else np.eye(4))
    middle = np.array([sum(place.area_x) / 2, 0.0, place.table_height])
    seen_from = middle + np.array([_BEYOND_M, 0.0, _ABOVE_M])
    views = {"camera_depth": (seen_from, middle - np.array([0.01, 0.0, 0.0]))}
    x, y = place.box_centre
    for side, sign in (("left", 1), ("right", -1)):
        box = np.array([x, sign * y, place.table_height])
        views[f"box_{side}"] = (box + _BOX_OFFSET, box)
    mounts = {}
    for name, (position, target) in views.items():
        pose = Pose.of(root_from_base @ camera_pose(position, target).matrix)
        frame = f"{name}_optical_frame" if name == "camera_depth" else f"{name}_depth_optical_frame"
        look: dict[str, tuple[float, ...]] = {}
        if name == "camera_depth":
            look = {"left": (), "right": (), "ahead": ()}
        mounts[name] = CameraMount(name, root, pose, frame, look=look)
    return mounts


def camera_pose(position: Floats, target: Floats) -> Pose:
    """Return the pose of a camera mount whose x axis points at a target (3,) m, z upwards."""
    forward = (target - position) / np.linalg.norm(target - position)
    left = np.cross([0.0, 0.0, 1.0], forward)
    left /= np.linalg.norm(left)
    rotation = np.stack([forward, left, np.cross(forward, left)], axis=1)
    x, y, z = (round(float(v), 9) for v in position)
    return Pose((x, y, z), rpy_from_rotation(rotation))
