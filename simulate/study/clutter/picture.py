"""The robot's view of a pile with the best grasps drawn into it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from features.geometry import Frame
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import ParallelGripper
from simulate.robots.description import Floats

__all__ = ["draw_grasps"]

_SIZE_PX = 420
"""Side of the square at the bottom of the view: above it is the robot itself."""
_FIRST, _OTHERS = (0, 0, 230), (40, 160, 40)
_SHOWN = 5


def draw_grasps(
    path: Path,
    frame: Frame,
    base_from_camera: Floats,
    grasps: Sequence[GraspCandidate],
    gripper: ParallelGripper,
    chosen: GraspCandidate | None,
) -> None:
    """Write the view as a PNG: fingers and closing lines of the best grasps, red the chosen one.

    Parameters
    ----------
    grasps
        In the base frame, best first; five are shown.
    chosen
        The one that the arm carries out.
    """
    assert frame.rgb is not None
    image = np.ascontiguousarray(frame.rgb[..., ::-1])
    shown = [(grasp, _OTHERS) for grasp in list(grasps)[:_SHOWN] if grasp is not chosen]
    if chosen is not None:
        shown.append((chosen, _FIRST))
    camera_from_base = np.linalg.inv(base_from_camera)
    for grasp, colour in shown:
        half = (gripper.max_opening if grasp.opening is None else grasp.opening) / 2
        wide = gripper.finger_width / 2
        corners = [
            (-half, -wide),
            (-half, wide),
            (half, -wide),
            (half, wide),
            (-half, 0),
            (half, 0),
        ]
        local = np.c_[np.array(corners, dtype=np.float64), np.zeros(6), np.ones(6)]
        placed = local @ (camera_from_base @ grasp.frame_from_gripper).T
        lens = frame.intrinsics
        x = lens.fx * placed[:, 0] / placed[:, 2] + lens.cx
        y = lens.fy * placed[:, 1] / placed[:, 2] + lens.cy
        lines = np.rint(np.stack([x, y], axis=1)).astype(np.int32).reshape(3, 2, 2)
        cv2.polylines(image, list(lines[:2]), isClosed=False, color=colour, thickness=4,
                      lineType=cv2.LINE_AA)  # fmt: skip
        cv2.polylines(image, list(lines[2:]), isClosed=False, color=colour, thickness=1,
                      lineType=cv2.LINE_AA)  # fmt: skip
    height, width = image.shape[:2]
    left = (width - _SIZE_PX) // 2
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image[height - _SIZE_PX :, left : left + _SIZE_PX])
