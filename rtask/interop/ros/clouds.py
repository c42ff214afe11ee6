"""Clouds and images of a camera as views, and views as clouds; knows no ROS."""

from __future__ import annotations

import base64
import logging
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec import decode
from features.codec.limits import Limits
from features.codec.ros import image_bytes, pcd_from_point_cloud
from features.geometry import Frame
from features.imaging.camera import doubtful_size, frame_of_grid, lens_from_message, lens_of_size
from features.imaging.described import stamp_of
from features.imaging.doubts import (
    doubtful_bytes,
    doubtful_camera,
    doubtful_distortion,
    doubtful_inverse,
    doubtful_steps,
    implausible_depth,
    upright_frame,
)
from features.imaging.photo import read_photo
from features.imaging.pictures import PAIRED_S, depth_of_message, view_of_images
from rtask.errors import DataError, UsageError
from rtask.interop.ros.convert import bytes_like, make_message, raw_mapping

__all__ = [
    "cloud_message",
    "cloud_rows",
    "doubts_of_cloud",
    "frame_of",
    "frame_of_images",
    "packed_cloud",
]

log = logging.getLogger(__name__)

_FLOAT32 = 7
_MAX_BYTES = 256 * 2**20
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])


def frame_of(cloud: Any) -> Frame:
    """Return the view that an organised, coloured PointCloud2 shows.

    Raises
    ------
    DataError
        The message is malformed, or no picture can be made of it.
    """
    try:
        data = pcd_from_point_cloud(raw_mapping(cloud), Limits(stored_bytes=_MAX_BYTES))
        seen = decode(data, Limits(stored_bytes=_MAX_BYTES))
        frame = seen if isinstance(seen, Frame) else frame_of_grid(seen)
    except ValueError as error:
        raise DataError(f"the cloud in {cloud.header.frame_id}: {error}") from error
    if frame is not None:
        frame = replace(frame, doubts=doubts_of_cloud(frame, cloud.header.frame_id))
        for doubt in frame.doubts:
            _warn_once(str(cloud.header.frame_id), doubt)
    if frame is None or frame.rgb is None:
        raise DataError(
            f"the cloud in {cloud.header.frame_id} ({cloud.height} x {cloud.width}) is not "
            "organised or has no colours, which recognition needs; publish the registered cloud of "
            "the camera (depth_registered/points)"
        )
    return frame


def doubts_of_cloud(frame: Frame, frame_id: str = "") -> tuple[str, ...]:
    """Return what is doubtful of a view that came as a cloud.

    The axes of a frame are not looked at here: its points were laid on the pixels of a camera.
    """
    found = (implausible_depth(frame.depth_m), upright_frame(frame_id))
    return tuple(doubt for doubt in found if doubt)


def frame_of_images(
    depth: Mapping[str, Any],
    colour: Mapping[str, Any],
    info: Mapping[str, Any],
    is_rectified: bool = False,
    *,
    is_registered: bool = False,
) -> Frame:
    """Return the view that a depth image and a colour image show, with what of it is doubtful.

    Parameters
    ----------
    depth, colour
        The fields of an Image or CompressedImage, registered.
    info
        The fields of a CameraInfo.
    is_rectified
        Whether both were rectified before they were published.
    is_registered
        Whether the caller knows that depth was laid over colour, whatever their frames say.

    Raises
    ------
    DataError
        A message is malformed, or they do not fit together.
    """
    header = depth.get("header")
    where = header.get("frame_id", "") if isinstance(header, Mapping) else ""
    try:
        noted: list[str] = []
        pixels = depth_of_message(depth, is_depth_topic=True, say=noted.append)
        if pixels is None:
            kind = depth.get("encoding", depth.get("format", ""))
            raise DataError(
                f"the depth image in {where} has the encoding {kind!r}; expected 16UC1 (mm) or "
                "32FC1 (m)"
            )
        lens = lens_from_message(info, is_rectified)
        noted += [
            doubtful_bytes(depth) or implausible_depth(pixels) or _doubtful_numbers(depth, pixels),
            doubtful_camera(lens.intrinsics),
            doubtful_size(lens, info, pixels.shape),
            _of_another_camera(depth, info),
            "" if is_registered else _apart(depth, colour),
            doubtful_inverse(pixels),
        ]
        photo = read_photo(image_bytes(colour))
        view = view_of_images(pixels, lens_of_size(lens, info, pixels.shape), photo.rgb)
        noted.append(doubtful_distortion(pixels, view.depth_m))
        doubts = tuple(doubt for doubt in noted if doubt)
        for doubt in doubts:
            _warn_once(str(where), doubt)
        return replace(view, doubts=doubts)
    except (ValueError, KeyError) as error:
        raise DataError(f"depth and colour in {where}: {error}") from error


def _doubtful_numbers(depth: Mapping[str, Any], depth_m: NDArray[np.float32]) -> str:
    """Return why whole numbers may be no millimetres; floats are metres."""
    if str(depth.get("encoding", depth.get("format", ""))).startswith(("32", "64")):
        return ""
    return doubtful_steps(np.rint(depth_m * 1000).astype(np.int64))


def _of_another_camera(depth: Mapping[str, Any], info: Mapping[str, Any]) -> str:
    """Return why a CameraInfo may not describe a depth image: they are in different frames."""
    frames = _frame_of(depth), _frame_of(info)
    if not all(frames) or frames[0] == frames[1]:
        return ""
    return f"its depth is described by a CameraInfo in the frame {frames[1]}: is it its own?"


def _apart(depth: Mapping[str, Any], colour: Mapping[str, Any]) -> str:
    """Return why a picture may not lie on a depth image: taken from elsewhere, or at another time.

    Depth that was laid over colour is in the frame of colour, so that two frames are two places.
    """
    frames = _frame_of(depth), _frame_of(colour)
    if all(frames) and frames[0] != frames[1]:
        return (
            f"its colour is in the frame {frames[1]}, depth in {frames[0]}: taken for registered; "
            "is depth laid over colour (depth_registered, aligned_depth_to_color)?"
        )
    stamps = _stamp_of(depth), _stamp_of(colour)
    apart_s = abs(stamps[0] - stamps[1])
    if not all(stamps) or apart_s <= PAIRED_S:
        return ""
    return f"its colour was taken {apart_s:.3g} s from its depth: did anything move in between?"


def _frame_of(message: Mapping[str, Any]) -> str:
    header = message.get("header")
    return str(header.get("frame_id", "")).lstrip("/") if isinstance(header, Mapping) else ""


def _stamp_of(message: Mapping[str, Any]) -> float:
    """Return the time of a message's header, s, by the names of ROS 1 or ROS 2; 0 = not said."""
    header = message.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else None
    if isinstance(stamp, Mapping):
        parts = stamp.get("sec", stamp.get("secs", 0)), stamp.get("nanosec", stamp.get("nsecs", 0))
        return float(parts[0] or 0) + float(parts[1] or 0) * 1e-9
    return stamp_of(message) if hasattr(stamp, "nanosec") else 0.0


@lru_cache(128)
def _warn_once(where: str, doubt: str) -> None:
    """Log a doubt about a camera once: it would come with each of its views."""
    if doubt:
        log.warning("the camera in %s: %s", where, doubt)


def packed_cloud(cloud: Any, path: str) -> str:
    """Return a PointCloud2 as base64 of the compressed cloud that the server reads."""
    try:
        import zstandard

        packed = zstandard.compress(pcd_from_point_cloud(raw_mapping(cloud)))
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from error
    return base64.b64encode(packed).decode("ascii")


def cloud_message(
    points: NDArray[np.floating[Any]], rgb: NDArray[np.uint8] | None, header: Any
) -> Any:
    """Return a sensor_msgs/PointCloud2 of points (h, w, 3) or (n, 3), m; 16 bytes a point.

    Parameters
    ----------
    points
        NaN where missing.
    rgb
        Colours of the same leading shape.
    header
        A std_msgs/Header.
    """
    grid = points if points.ndim == 3 else points[None]
    cloud = make_message("sensor_msgs/PointCloud2")
    cloud.header, (cloud.height, cloud.width) = header, grid.shape[:2]
    names = "xyz" if rgb is None else ("x", "y", "z", "rgb")
    for k, name in enumerate(names):
        field = make_message("sensor_msgs/PointField")
        field.name, field.offset, field.datatype, field.count = name, 4 * k, _FLOAT32, 1
        cloud.fields.append(field)
    cloud.point_step, cloud.row_step = _POINT.itemsize, _POINT.itemsize * cloud.width
    cloud.data = bytes_like(cloud.data, cloud_rows(grid, rgb))
    cloud.is_dense = bool(np.isfinite(grid).all())
    return cloud


def cloud_rows(points: NDArray[np.floating[Any]], rgb: NDArray[np.uint8] | None) -> bytes:
    """Return points (..., 3), m, as the data of a PointCloud2: x, y, z and rgb, 16 bytes each."""
    table = np.zeros(points.shape[:-1], _POINT)
    for k, axis in enumerate("xyz"):
        table[axis] = points[..., k]
    if rgb is not None:
        red, green, blue = (rgb.reshape(points.shape)[..., k].astype(np.uint32) for k in range(3))
        table["rgb"] = red << 16 | green << 8 | blue
    return table.tobytes()
