"""Placement of an object on its support: the object's frame in the robot's frame.

Grasps are given in the object's frame. Its origin is the centre of the footprint at the height of
the support; z points up and x along the longer side. A round object has no longer side: its x axis
points away from the robot, so that a grasp keeps its angle to the direction of the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.footprint import ROUND, Footprint
from grasp.spatial.frames import surface_from_object, tilt, wrap_2pi, yaw_of

if TYPE_CHECKING:
    from features.tabletop import TabletopShape
    from rtask.engine.observation import Observation

__all__ = [
    "MAX_TILT", "Placement", "classify_shape", "footprint_of", "is_lying", "oriented", "place",
]  # fmt: skip

MAX_TILT = np.deg2rad(20)
"""Largest angle to the vertical at which an object counts as upright, rad."""

MAX_SHIFT_M = 0.02
_SNAP = np.deg2rad(15)
MIN_M = 0.002
_LOWER, _LONG, _SLENDER = 0.7, 0.7, 1.4
"""Shares of its height up to which a lying thing is high and from which it is long, and how much
longer than wide a thing is at least that is taken for a lying one."""
_PEN_M, _BAR_M = 0.023, 0.03
"""Below which a long thing is called a pen, and a bar, m."""


@dataclass(frozen=True)
class Placement:
    """The object's frame in the robot's frame.

    Parameters
    ----------
    frame_from_object : (4, 4)
    is_round
        Whether the x axis is defined by the robot and not by the object.
    is_verified
        Whether the yaw agrees with the frame in which the object was stored, because this is the
        first view or a rigid match of features determined it.
    """

    frame_from_object: NDArray[np.float64]
    is_round: bool
    is_verified: bool

    @property
    def yaw(self) -> float:
        """Rotation about +z, rad."""
        return yaw_of(self.frame_from_object)

    def to_frame(self, x: float, y: float, theta: float) -> tuple[float, float, float]:
        """Return (x, y, theta) of a planar grasp in the robot's frame."""
        point = self.frame_from_object @ np.array([x, y, 0.0, 1.0])
        return float(point[0]), float(point[1]), wrap_2pi(theta + self.yaw)

    def to_object(self, x: float, y: float, theta: float) -> tuple[float, float, float]:
        """Return (x, y, theta) of a planar grasp in the object's frame."""
        height = self.frame_from_object[2, 3]
        point = np.linalg.inv(self.frame_from_object) @ np.array([x, y, height, 1.0])
        return float(point[0]), float(point[1]), wrap_2pi(theta - self.yaw)


def place(
    observation: Observation,
    is_round: bool | None = None,
    query_from_view: NDArray[np.float64] | None = None,
    object_from_view: NDArray[np.float64] | None = None,
    heading: float | None = None,
) -> Placement | None:
    """Return the placement of an observed object.

    Parameters
    ----------
    is_round
        Value stored in the graph; None to use the measured one.
    query_from_view : (4, 4) or None
        Rigid motion from a stored view's optical frame to this one's.
    object_from_view : (4, 4) or None
        Pose of the stored view's optical frame in the object's frame.
    heading
        Of the object's x axis when the robot saw it last, rad, in its frame; None if unknown. It
        decides which end is which where nothing that is seen tells.

    Returns
    -------
    The placement, or None if the object could not be measured.
    """
    shape = observation.shape
    if shape is None:
        return None
    centre = np.asarray(shape.centre, dtype=np.float64)
    upright = surface_from_object(centre[0], centre[1], shape.support_height, 0.0)
    if is_round if is_round is not None else shape.is_round:
        bearing = float(np.arctan2(centre[1], centre[0]))
        return Placement(_turned(upright, bearing), is_round=True, is_verified=True)
    if query_from_view is not None and object_from_view is not None:
        matched = observation.frame_from_camera @ query_from_view @ np.linalg.inv(object_from_view)
        shift = float(np.linalg.norm(matched[:2, 3] - centre))
        if tilt(matched) < MAX_TILT and shift < MAX_SHIFT_M:
            yaw = _snapped(yaw_of(matched), float(shape.yaw))
            return Placement(_turned(upright, yaw), is_round=False, is_verified=True)
    is_first = is_round is None
    yaw = float(shape.yaw)
    # What was thrown over shows a side that nobody stored, but it rolls about its length: of three
    # cartons of a NAO none turned by more than 15 degrees. Either end may be right without that.
    if heading is not None and np.cos(yaw - heading) < 0:
        yaw = wrap_2pi(yaw + np.pi)
    return Placement(_turned(upright, yaw), is_round=False, is_verified=is_first)


def is_lying(shape: TabletopShape, size: tuple[float, float, float] | None) -> bool:
    """Return whether a thing that is stored standing lies on its side now.

    Parameters
    ----------
    shape
        As it is measured now.
    size
        Extents (x, y, z) with which it is stored, m; z is its height.
    """
    if size is None:
        return False
    height, (width, length) = size[2], sorted((float(shape.width), float(shape.length)))
    was_slender = height > _SLENDER * max(size[:2])
    is_slender = length > _SLENDER * width and length > _LONG * height
    return was_slender and is_slender and float(shape.height) < _LOWER * height


def oriented(placement: Placement, matched: NDArray[np.float64]) -> Placement:
    """Return the placement with the yaw of an accepted pose, if the object stands upright.

    A yaw from keypoints or measured sides is kept if the pose agrees, since a side measured over
    its whole length is more exact. A round object keeps the robot's direction.

    Parameters
    ----------
    matched : (4, 4) float64, m
        Pose of the object in the robot's frame.
    """
    if placement.is_round:
        return placement
    shift = float(np.linalg.norm(matched[:2, 3] - placement.frame_from_object[:2, 3]))
    if tilt(matched) >= MAX_TILT or shift >= MAX_SHIFT_M:
        return placement
    yaw = _snapped(yaw_of(matched), placement.yaw)
    return Placement(_turned(placement.frame_from_object, yaw), is_round=False, is_verified=True)


def _turned(pose: FloatArray, yaw: float) -> NDArray[np.float64]:
    turned = np.array(pose, dtype=np.float64)
    turned[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    return turned


def _snapped(matched_yaw: float, measured_yaw: float) -> float:
    """Return the measured direction nearest to the matched one, since it is more exact.

    If no side is near, the match is returned, since the measurement may cover only one side.
    """
    steps = np.arange(4) * (np.pi / 2)
    off = (measured_yaw + steps - matched_yaw + np.pi) % (2 * np.pi) - np.pi
    best = int(np.argmin(np.abs(off)))
    return wrap_2pi(matched_yaw + float(off[best])) if abs(off[best]) < _SNAP else matched_yaw


def footprint_of(shape: TabletopShape, placement: Placement) -> Footprint:
    """Return the measured shape for :mod:`grasp`: in the robot's frame, z above the support.

    The longer side of a round object is defined by its frame, so that candidates keep their angles
    from one observation to the next.
    """
    length = max(float(shape.length), float(shape.width), MIN_M)
    width = min(float(shape.length), float(shape.width))
    return Footprint(
        centre=(float(shape.centre[0]), float(shape.centre[1])),
        yaw=placement.yaw if placement.is_round else float(shape.yaw),
        length=length,
        width=float(np.clip(width, MIN_M, length)),
        height=max(float(shape.height), MIN_M),
        roundness=1.0 if placement.is_round else min(float(shape.roundness), ROUND - 1e-9),
        outline=None if shape.outline is None else np.asarray(shape.outline, dtype=np.float64),
    )


def classify_shape(shape: TabletopShape, points: NDArray[np.float64]) -> tuple[str, float] | None:
    """Return the class that a shape suggests, if the geometry is clear.

    Parameters
    ----------
    points : (n, 3), m
        Points of the object in the frame of ``shape``.

    Returns
    -------
    Local name of a class of the ontology and a confidence 0..1, or None. It is a guess at the kind
    of object and does not identify the object.
    """
    length, width, height = float(shape.length), float(shape.width), float(shape.height)
    if shape.is_round:
        slender = height / max(length, MIN_M)
        top = _top_width(shape, points)
        if top is None:
            return None
        if 0.75 <= slender <= 1.3 and top < 0.8:
            return "Ball", 0.8
        if slender >= 1.5 and top < 0.75:
            return "Bottle", 0.7
        return ("Cylinder", 0.8) if top >= 0.8 else None
    if length >= 3 * width and width < _BAR_M and height < _BAR_M:
        is_pen = max(width, height) < _PEN_M
        return ("Pen", 0.7) if is_pen else ("Bar", 0.7)
    if length < 3 * width and _fill(shape) >= 0.8:
        return "Box", 0.7
    return None


def _top_width(shape: TabletopShape, points: NDArray[np.float64]) -> float | None:
    """Return the ratio of the widths at the top and in the middle, or None if not visible."""
    level = (points[:, 2] - shape.support_height) / max(float(shape.height), MIN_M)
    radius = np.linalg.norm(points[:, :2] - np.asarray(shape.centre), axis=1)
    top, middle = radius[(level > 0.85) & (level < 0.97)], radius[(level > 0.3) & (level < 0.6)]
    if len(top) < 5 or len(middle) < 5:
        return None
    return float(np.percentile(top, 90) / max(float(np.percentile(middle, 90)), MIN_M))


def _fill(shape: TabletopShape) -> float:
    """Return the area of the outline as a fraction of its bounding rectangle."""
    if shape.outline is None or len(shape.outline) < 3:
        return 0.0
    x, y = np.asarray(shape.outline, dtype=np.float64).T
    area = abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) / 2
    return area / max(float(shape.length) * float(shape.width), 1e-9)
