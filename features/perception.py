"""Perception of objects on a table in an RGB-D frame, in the robot's base frame.

A frame and the pose of its camera are the only inputs (Gatto 2016, 2.4 and 2.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray, Frame, transform
from features.segmentation import Scene, segment_scene
from features.tabletop import TabletopShape, measure

__all__ = ["Ignored", "Perceived", "Seen", "neighbour_points", "perceive"]

_CROP_MARGIN_PX = 12
_MAX_HEIGHT_M = 0.20
_STANDS_M = 0.05
"""Of a tall can seen from above little is near the table; the hands at home are twice as high."""
_HANGS_M, _OVERLAP = 0.04, 0.005
"""What is nowhere lower and reaches over the box rests on its wall; what leans on that wall from
outside stands on the table, and is lower there."""
_MARGIN_M = 0.01
_MAX_NEIGHBOUR_POINTS = 400
_NEIGHBOUR_RADIUS_M = 0.12


@dataclass(frozen=True)
class Ignored:
    """Rectangle of the base frame in which segments are ignored, such as the robot's box.

    Parameters
    ----------
    x, y
        Ranges (low, high), m, base frame.
    """

    x: tuple[float, float]
    y: tuple[float, float]

    def holds(self, point: NDArray[np.floating[Any]]) -> bool:
        """Return whether a point (x, y, ...), m, base frame, is in the rectangle or its margin."""
        return bool(
            self.x[0] - _MARGIN_M <= point[0] <= self.x[1] + _MARGIN_M
            and self.y[0] - _MARGIN_M <= point[1] <= self.y[1] + _MARGIN_M
        )

    def overlaps(self, points: FloatArray) -> bool:
        """Return whether some points (n, 3), m, base frame, lie over the rectangle itself."""
        low, high = np.array([self.x, self.y]).T
        inside = ((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1)
        return bool(inside.mean() > _OVERLAP)


@dataclass(frozen=True)
class Seen:
    """One object in one frame.

    Parameters
    ----------
    crop
        The object's part of the frame, optical frame of the camera.
    mask : (h, w) bool
        Its pixels in the whole frame.
    points : (n, 3), m, base frame
    shape
        Footprint and height, base frame.
    touches_border
        Cut off by the image border or the edge of the table.
    """

    crop: Frame
    mask: NDArray[np.bool_]
    points: FloatArray
    shape: TabletopShape
    touches_border: bool

    @property
    def position(self) -> NDArray[np.float64]:
        """Centre of the footprint (2,), m, base frame."""
        return np.asarray(self.shape.centre, dtype=np.float64)


@dataclass(frozen=True)
class Perceived:
    """Table and objects found in one frame.

    Parameters
    ----------
    status
        ``ok``, or why there are no objects: ``empty``, ``no_table``, ``table_only``.
    table_height
        m, base frame; NaN without a table.
    objects
        From the nearest to the farthest.
    table : (k, 2) float, m
        Corners of the visible part of the table, base frame, in turn; empty without a table.
    """

    status: str
    table_height: float
    objects: tuple[Seen, ...]
    table: FloatArray = field(default_factory=lambda: np.zeros((0, 2)), repr=False)


def perceive(
    frame: Frame,
    base_from_camera: NDArray[np.float64],
    ignored: Sequence[Ignored] = (),
    body: NDArray[np.bool_] | None = None,
) -> Perceived:
    """Find the table and the objects on it; what shows one upright face alone is left out.

    Parameters
    ----------
    frame
        RGB-D frame, optical frame of the camera.
    base_from_camera : (4, 4)
        Pose of the optical frame, from the robot's own joint angles.
    ignored
        Regions whose segments are left out.
    body : (h, w) bool or None
        Pixels of the robot's own body and of what is fixed to it, which are no object.

    Raises
    ------
    ValueError
        When the frame holds no RGB image.
    """
    if frame.rgb is None:
        raise ValueError("perceive needs a frame with colour")
    down = base_from_camera[:3, :3].T @ np.array([0.0, 0.0, -1.0])
    scene = segment_scene(frame.points(), frame.rgb, gravity=down, body=body)
    if scene.plane is None:
        return Perceived(scene.status, float("nan"), ())
    on_plane = -scene.plane.offset * np.asarray(scene.plane.normal, dtype=np.float64)
    table_height = float(transform(base_from_camera, on_plane)[2])
    cloud = frame.points()
    objects = []
    for segment in scene.objects:
        mask = scene.labels == segment.label
        points = transform(base_from_camera, cloud[mask].astype(np.float64))
        centre = np.median(points, axis=0)
        lowest, low = np.percentile(points[:, 2], (1, 5)) - table_height
        if low > _STANDS_M or any(region.holds(centre) for region in ignored):
            continue  # the robot's own arm, or the inside of its own box
        if lowest > _HANGS_M and any(region.overlaps(points) for region in ignored):
            continue  # an end of something in the box that sticks out of it
        try:
            shape = measure(points, table_height)
        except ValueError:
            continue  # one upright face has no footprint
        if shape.height > _MAX_HEIGHT_M:
            continue
        objects.append(
            Seen(frame.crop(mask, _CROP_MARGIN_PX), mask, points, shape, segment.touches_border)
        )
    objects.sort(key=lambda seen: float(np.linalg.norm(seen.position)))
    return Perceived(scene.status, table_height, tuple(objects), _corners(scene, base_from_camera))


def _corners(scene: Scene, base_from_camera: FloatArray) -> FloatArray:
    if scene.plane is None or scene.prism is None or not len(scene.prism.hull):
        return np.zeros((0, 2))
    normal = np.asarray(scene.plane.normal, dtype=np.float64)
    corners = scene.prism.hull @ scene.prism.basis - scene.plane.offset * normal
    return np.asarray(transform(base_from_camera, corners)[:, :2])


def neighbour_points(seen: Seen, view: Perceived) -> list[list[float]]:
    """Return points of the objects near one of a view, m, base frame."""
    others = [other.points for other in view.objects if other is not seen]
    if not others:
        return []
    points = np.concatenate(others)
    near = points[np.linalg.norm(points[:, :2] - seen.position, axis=1) < _NEIGHBOUR_RADIUS_M]
    step = max(1, -(-len(near) // _MAX_NEIGHBOUR_POINTS))
    return [[round(float(x), 4) for x in point] for point in near[::step]]
