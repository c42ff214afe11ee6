"""Surroundings of an object's crop, filled in with the table.

A robot sends only the pixels of one object. A model that extends beyond them contradicts a pose
only if the background there is known; for an object on a table, seen from above, it is the table.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from features.geometry import Frame
    from rtask.engine.observation import Observation

__all__ = ["surrounded", "table_plane", "with_table"]

_MARGIN = 0.35
_RIM_PX = 4
_FARTHEST_M = 6.0


def table_plane(seen: Observation) -> NDArray[np.float64] | None:
    """Return unit normal and offset (4,) of the table in the camera's frame, or None."""
    if seen.shape is None or not seen.is_posed:
        return None
    up = seen.frame_from_camera[2, :3]
    height = float(seen.frame_from_camera[2, 3] - seen.shape.support_height)
    return np.array([*up, height]) if height > 0 else None


def surrounded(seen: Observation) -> tuple[Frame, NDArray[np.float64] | None]:
    """Return the frame with the table around the object, and the table's plane (4,).

    Nothing is added without a pose of the camera, or if the image was rendered from a cloud.
    """
    plane = table_plane(seen)
    return (seen.frame if seen.is_rendered else with_table(seen.frame, plane)), plane


def with_table(frame: Frame, plane: NDArray[np.float64] | None) -> Frame:
    """Return a crop with a margin around it, filled with the table where depth is unknown.

    A few pixels beside the mask stay unknown, since segments tend to end slightly early.

    Parameters
    ----------
    plane : (4,) float64 or None
        Unit normal, towards the camera, and offset in the camera's frame, m.
    """
    if plane is None or not frame.object_mask().any():
        return frame
    import cv2

    wide = _padded(frame)
    mask = wide.object_mask()
    v, u = np.mgrid[0 : mask.shape[0], 0 : mask.shape[1]]
    lens = frame.intrinsics
    slope = (
        plane[0] * ((u + wide.x0 - lens.cx) / lens.fx)
        + plane[1] * ((v + wide.y0 - lens.cy) / lens.fy)
        + plane[2]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        table = np.where(slope < 0, -plane[3] / slope, 0.0)
    rim = cv2.dilate(mask.astype(np.uint8), np.ones((2 * _RIM_PX + 1,) * 2, np.uint8)) > 0
    unknown = ~rim & ~(wide.depth_m > 0) & (table > 0) & (table < _FARTHEST_M)
    return replace(wide, depth_m=np.where(unknown, table, wide.depth_m).astype(np.float32))


def _padded(frame: Frame) -> Frame:
    """Return the frame with a margin, as far as the image extends, without colours."""
    height, width = frame.depth_m.shape
    pad = int(_MARGIN * max(height, width))
    lens = frame.intrinsics
    left, top = min(pad, frame.x0), min(pad, frame.y0)
    right = min(pad, max(lens.width - frame.x0 - width, 0))
    bottom = min(pad, max(lens.height - frame.y0 - height, 0))
    room = ((top, bottom), (left, right))
    return replace(
        frame,
        depth_m=np.pad(frame.depth_m, room),
        rgb=None if frame.rgb is None else np.pad(frame.rgb, (*room, (0, 0))),
        mask=np.pad(frame.object_mask(), room),
        x0=frame.x0 - left,
        y0=frame.y0 - top,
    )
