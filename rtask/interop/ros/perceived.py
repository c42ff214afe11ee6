"""What perception saw as poses and boxes in the terms of ROS."""

from __future__ import annotations

import base64
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec import encode_frame
from features.geometry import FloatArray
from features.perception import Perceived, Seen, neighbour_points
from grasp.messages import pose_message
from rtask.interop.ros.convert import JsonObject
from rtask.interop.ros.looking import Board, Look, ViewedObject

__all__ = ["box_of", "look_of", "points_of"]

_THICK_M = 0.02


def look_of(
    perceived: Perceived,
    base_from_camera: NDArray[np.float64],
    stamp: Any,
    doubts: tuple[str, ...] = (),
) -> Look:
    """Return what was perceived as a front of ROS shows it.

    Parameters
    ----------
    base_from_camera : (4, 4)
        Pose of the camera in the frame of the robot.
    stamp
        Time of the view, as ROS has it.
    doubts
        About the view (:attr:`features.geometry.Frame.doubts`).
    """
    objects = []
    for seen in perceived.objects:
        pose, size = box_of(seen)
        data = base64.b64encode(encode_frame(seen.crop)).decode("ascii")
        objects.append(ViewedObject(pose, size, data, neighbour_points(seen, perceived)))
    return Look(
        stamp,
        pose_message(base_from_camera),
        perceived.status,
        perceived.table_height,
        _board(perceived.table, perceived.table_height),
        tuple(objects),
        doubts,
    )


def box_of(seen: Seen) -> tuple[JsonObject, tuple[float, float, float]]:
    """Return the box around an object: Pose of its middle, and its sides, m."""
    shape = seen.shape
    middle = np.eye(4)
    middle[2, 3] = shape.height / 2
    size = (float(shape.length), float(shape.width), float(shape.height))
    return pose_message(shape.frame_from_object() @ middle), size


def points_of(seen: Seen) -> tuple[NDArray[np.floating[Any]], NDArray[np.uint8] | None]:
    """Return the points (n, 3) of an object, m, in the frame of the camera, and their colours."""
    crop = seen.crop
    inside = crop.mask if crop.mask is not None else crop.depth_m > 0
    return crop.points()[inside], None if crop.rgb is None else crop.rgb[inside]


def _board(corners: FloatArray, height: float) -> Board | None:
    """Return the smallest board below the visible table; None if none is seen."""
    if len(corners) < 3 or not np.isfinite(height):
        return None
    (x, y), (length, width), degrees = cv2.minAreaRect(np.asarray(corners, dtype=np.float32))
    half = np.deg2rad(degrees) / 2
    pose = {
        "position": {"x": float(x), "y": float(y), "z": height - _THICK_M / 2},
        "orientation": {"x": 0.0, "y": 0.0, "z": float(np.sin(half)), "w": float(np.cos(half))},
    }
    return Board(pose, (float(length), float(width), _THICK_M))
