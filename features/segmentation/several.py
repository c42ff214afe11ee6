"""Several views of one table as one cloud, of several cameras or of one that moves.

Gatto 2016, 3.3.3 compares grasps from one and from two sensors.

What one camera sees of an object is half of it, and what stands behind another object is not seen
at all. Points that were measured from known places are joined in a frame with z up, as if a level
camera above all of them had measured them; only which side of a surface is outside is told by the
camera that saw it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, transform
from features.segmentation.scene import SegmentedObject, segment_scene
from features.segmentation.segment import SegmentParams, check_cloud

__all__ = ["PlacedView", "SeveralViews", "level_params", "placed_frame", "segment_views"]

_DOWN = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class PlacedView:
    """A view whose camera has a known place.

    Parameters
    ----------
    points : (h, w, 3) or (n, 3) float, m, optical frame
        NaN = missing.
    frame_from_camera : (4, 4), m
        Pose of the optical frame in a frame with z up, one for all views.
    colours : same leading shape, uint8 RGB, or None
    """

    points: NDArray[np.floating[Any]]
    frame_from_camera: NDArray[np.float64]
    colours: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class SeveralViews:
    """What stands on a table, by all views together.

    Parameters
    ----------
    status
        As of :class:`~features.segmentation.Scene`.
    table_height
        Of the table in the common frame, m; NaN without one.
    labels
        Of each view, in the shape of its points; 0 = no object. One object has one number.
    objects
        By falling size, in the common frame; indices count the points of all views in their order.
    points : (n, 3) float32, m, common frame
        Of all views, one behind the other.
    """

    status: str
    table_height: float
    labels: tuple[NDArray[np.int32], ...]
    objects: tuple[SegmentedObject, ...]
    points: NDArray[np.float32]

    def seen_by(self, label: int) -> tuple[int, ...]:
        """Return the numbers of the views that show an object."""
        return tuple(k for k, each in enumerate(self.labels) if (each == label).any())


def placed_frame(frame: Frame, frame_from_camera: NDArray[np.float64]) -> PlacedView:
    """Return a frame with depth as a view to be joined with others."""
    return PlacedView(frame.points(), frame_from_camera, frame.rgb)


def segment_views(views: Sequence[PlacedView], params: SegmentParams | None = None) -> SeveralViews:
    """Find the table and the objects on it in several views together.

    Thin things and what hangs over the edge, which are told by the picture of one camera, are not
    looked for.

    Parameters
    ----------
    views
        At least one. Poses that are wrong by more than a voxel (5 mm) split objects.
    params
        None = those that suit the height of the cameras.

    Raises
    ------
    ValueError
        No views, shapes that do not fit, or depths that are no metres.

    Examples
    --------
    >>> x, y = np.meshgrid(np.linspace(-0.3, 0.3, 160), np.linspace(-0.2, 0.2, 120))
    >>> z = np.where((abs(x) < 0.03) & (abs(y) < 0.03), 0.55, 0.6)
    >>> above = np.diag([1.0, -1.0, -1.0, 1.0])  # z of the camera looks down
    >>> seen = segment_views([PlacedView(np.stack([x, y, z], axis=-1), above)] * 2)
    >>> seen.status, len(seen.objects), round(seen.table_height, 3), seen.seen_by(1)
    ('ok', 1, -0.6, (0, 1))
    """
    if not views:
        raise ValueError("at least one view is needed")
    for view in views:
        check_cloud(view.points, view.colours, None)
    eyes = np.array([view.frame_from_camera[:3, 3] for view in views])
    middle = np.array([*eyes[:, :2].mean(axis=0), eyes[:, 2].max()])
    flat = [view.points.reshape(-1, 3) for view in views]
    placed = np.concatenate(
        [transform(view.frame_from_camera, own.astype(np.float64))
         for view, own in zip(views, flat, strict=True)]
    )  # fmt: skip
    sizes = [len(own) for own in flat]
    inks = [view.colours.reshape(-1, 3) for view in views if view.colours is not None]
    colours = np.concatenate(inks) if len(inks) == len(views) else None
    level = ((placed - middle) @ _DOWN.T).astype(np.float32)
    scene = segment_scene(
        level, colours, replace(params or level_params(views), overhang_m=0.0),
        np.array([0.0, 0.0, 1.0]), np.repeat((eyes - middle) @ _DOWN.T, sizes, axis=0),
    )  # fmt: skip
    height = np.nan if scene.plane is None else float(middle[2] - scene.plane.offset)
    ends = np.cumsum(sizes)[:-1]
    labels = tuple(
        part.reshape(view.points.shape[:-1])
        for part, view in zip(np.split(scene.labels, ends), views, strict=True)
    )
    objects = tuple(_moved(each, middle) for each in scene.objects)
    return SeveralViews(scene.status, height, labels, objects, placed.astype(np.float32))


def level_params(views: Sequence[PlacedView]) -> SegmentParams:
    """Return the parameters that suit how far the cameras are over what they see."""
    away = [_height_over(view) for view in views]
    return SegmentParams.for_distance(max(away, default=1.0))


def _height_over(view: PlacedView) -> float:
    """Return how high a camera is over the middle of what it sees, m."""
    points = view.points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return 1.0
    down = -view.frame_from_camera[2, :3]
    return float(np.median(points @ down))


def _moved(each: SegmentedObject, middle: NDArray[np.float64]) -> SegmentedObject:
    """Return an object in the common frame."""
    corners = np.asarray(each.box, np.float64) @ _DOWN.T + middle
    box = np.array([corners.min(axis=0), corners.max(axis=0)])
    return replace(each, centroid=np.asarray(each.centroid) @ _DOWN.T + middle, box=box)
