"""Cut a view of a table into objects, by one of the named ways."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rtask.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from features.codec.types import Cloud
    from features.geometry import Frame
    from features.perception import Seen
    from features.segmentation import Scene, SegmentedObject, SegmentParams, SeveralViews

__all__ = ["as_seen", "cut", "cut_in_base", "cut_together", "refuse_doubtful"]


def as_seen(seen: Frame | Cloud) -> tuple[Frame | Cloud, tuple[str, ...]]:
    """Return a view in the frame of its camera, and what was done for it or remains doubtful.

    A client sends clouds from any program, as files come from any: they are read by one rule.
    """
    from features.geometry import Frame
    from features.imaging.doubts import implausible_cloud, implausible_depth
    from features.imaging.placed import in_camera_frame

    if isinstance(seen, Frame):
        return seen, tuple(filter(None, [implausible_depth(seen.depth_m)]))
    doubt = implausible_cloud(seen.positions)
    moved, note = in_camera_frame(seen)
    return moved, tuple(filter(None, [doubt, note]))


def cut(seen: Frame | Cloud, preset: str = "auto", min_points: int | None = None) -> Scene:
    """Segment a view; labels come in the shape of the frame, or of the cloud as it was read.

    Raises
    ------
    DataError
        The view cannot be segmented: wrong units, too large.
    """
    from dataclasses import replace

    from features.geometry import Frame
    from features.segmentation import SegmentParams, segment_scene

    points, colours = (seen.points(), seen.rgb) if isinstance(seen, Frame) else seen.grid()
    params = _params(preset)
    if min_points is not None:
        params = replace(params or SegmentParams(), min_points=min_points)
    try:
        scene = segment_scene(points, colours, params)
    except ValueError as error:
        raise DataError(str(error)) from error
    if not scene.objects:
        refuse_doubtful(seen)
    return scene


def refuse_doubtful(seen: Frame | Cloud) -> None:
    """Refuse a view in which nothing was found if its unit is doubtful: that is why, then.

    Raises
    ------
    DataError
        Depth or points lie as far apart as in another unit than metres.
    """
    from features.geometry import Frame
    from features.imaging.doubts import implausible_cloud, implausible_depth

    doubt = (
        implausible_depth(seen.depth_m)
        if isinstance(seen, Frame)
        else implausible_cloud(seen.positions)
    )
    if doubt:
        raise DataError(f"no object was found; {doubt}")


def _params(preset: str) -> SegmentParams | None:
    from features.segmentation import SegmentParams

    presets: dict[str, Any] = {
        "auto": lambda: None,
        "default": SegmentParams,
        "near": SegmentParams.near,
        "concave": lambda: SegmentParams(tolerance_deg=35, bad_sanity=0.10),
        "components": lambda: SegmentParams(method="components", tolerance_deg=12),
        "euclidean": lambda: SegmentParams(method="euclidean"),
    }
    params: SegmentParams | None = presets[preset]()
    return params


def cut_in_base(
    frame: Frame,
    base_from_camera: NDArray[np.float64],
    min_points: int = 1,
    body: NDArray[np.bool_] | None = None,
) -> tuple[Scene, float]:
    """Segment a view as robots and nodes of ROS do that know where their camera is.

    Parameters
    ----------
    frame
        With colours.
    base_from_camera : (4, 4), m
        Pose of the optical frame in a frame of the robot with z up.
    min_points
        Smaller objects are left out.
    body : (h, w) bool or None
        Pixels of the robot's own body.

    Returns
    -------
    The scene, with places in the frame of the robot, objects from the nearest to the farthest, and
    neither plane nor prism; and the height of the table there, m, NaN without one.

    Raises
    ------
    DataError
        The view cannot be segmented: wrong units, too large.
    """
    from features.perception import perceive
    from features.segmentation import Scene

    try:
        seen = perceive(frame, base_from_camera, body=body)
    except ValueError as error:
        raise DataError(str(error)) from error
    if not seen.objects:
        refuse_doubtful(frame)
    large = [each for each in seen.objects if len(each.points) >= min_points]
    labels = np.zeros(frame.depth_m.shape, np.int32)
    for number, each in enumerate(large, start=1):
        labels[each.mask] = number
    objects = tuple(_in_base(each, number) for number, each in enumerate(large, start=1))
    return Scene(seen.status, None, None, labels, objects), seen.table_height


def cut_together(
    views: Sequence[tuple[Frame | Cloud, NDArray[np.float64]]], min_points: int | None = None
) -> SeveralViews:
    """Segment several views of one table, each with the pose of its camera in one frame with z up.

    Raises
    ------
    DataError
        The views cannot be segmented: wrong units, too large; or nothing is found for that reason.
    """
    from dataclasses import replace

    from features.geometry import Frame
    from features.segmentation import PlacedView, placed_frame, segment_views
    from features.segmentation.several import level_params

    placed = [
        placed_frame(seen, pose) if isinstance(seen, Frame) else PlacedView(*_grid(seen, pose))
        for seen, pose in views
    ]
    try:
        params = level_params(placed)
        if min_points is not None:
            params = replace(params, min_points=min_points)
        together = segment_views(placed, params)
    except ValueError as error:
        raise DataError(str(error)) from error
    if not together.objects:
        for seen, _ in views:
            refuse_doubtful(seen)
    return together


def _grid(
    seen: Cloud, pose: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.uint8] | None]:
    points, colours = seen.grid()
    return points, pose, colours


def _in_base(seen: Seen, number: int) -> SegmentedObject:
    from features.segmentation import SegmentedObject

    box = np.array([seen.points.min(axis=0), seen.points.max(axis=0)])
    return SegmentedObject(
        number, np.flatnonzero(seen.mask), seen.points.mean(axis=0), box, seen.touches_border
    )
