"""Cut a view of a table into objects, by one of the named ways."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rtask.errors import DataError

if TYPE_CHECKING:
    from features.codec.types import Cloud
    from features.geometry import Frame
    from features.segmentation import Scene, SegmentParams

__all__ = ["cut"]


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
        return segment_scene(points, colours, params)
    except ValueError as error:
        raise DataError(str(error)) from error


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
