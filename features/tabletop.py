"""Size and place of one object on a table, measured from the points that one view gives.

The *object frame* has its origin at the centre of the footprint at the height of the support, x
along the longer side of the footprint, z up (Gatto 2016, 3.3.4 grasps in the plane of the table).
A camera that looks down steeply sees the whole top of a standing object, so its footprint is the
projection of what is visible; what overhangs or hides below is not guessed.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray

__all__ = ["TabletopShape", "measure"]

_CELL_M = 0.002
_MIN_POINTS = 12
# Boxes reach 0.72; a bottle seen at a slant, its neck hiding part of the shoulder, 0.84.
_ROUND = 0.79
_TOP_PERCENTILE = 98.0
_TRIM_PERCENT = 0.5


@dataclass(frozen=True)
class TabletopShape:
    """Footprint and height of an object that lies or stands on a support.

    Parameters
    ----------
    centre : (2,) float, m
        Of the footprint, in the z-up frame of the points.
    yaw
        Direction of the longer side, rad, in [0, pi); 0 for a round footprint.
    length, width
        Longer and shorter side of the footprint, m; both the diameter when it is round.
    height
        Above the support, m.
    support_height
        Of the table, m.
    outline : (k, 2) float, m
        Convex outline of the footprint, counter-clockwise.
    roundness
        Area of the outline over that of its smallest enclosing circle: 1 for a disc, about 0.7
        for a square, less for anything longer.
    """

    centre: NDArray[np.float64]
    yaw: float
    length: float
    width: float
    height: float
    support_height: float
    outline: NDArray[np.float64]
    roundness: float

    @property
    def is_round(self) -> bool:
        """Whether the footprint is a disc."""
        return self.roundness >= _ROUND

    def frame_from_object(self) -> NDArray[np.float64]:
        """Return the pose (4, 4) of the object frame in the frame of the points."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        pose = np.eye(4)
        pose[:2, :2] = [[c, -s], [s, c]]
        pose[:3, 3] = [self.centre[0], self.centre[1], self.support_height]
        return pose


def measure(points: FloatArray, support_height: float) -> TabletopShape:
    """Measure an object from its visible points.

    Parameters
    ----------
    points : (n, 3) float, m
        In a frame with z up; not finite ones are left out.
    support_height
        Height of the table in that frame, m.

    Raises
    ------
    ValueError
        With fewer than 12 finite points, or points that span no area.

    Examples
    --------
    >>> side = np.linspace(-0.5, 0.5, 40)
    >>> x, y = np.meshgrid(0.06 * side, 0.03 * side)
    >>> top = np.stack([x.ravel() + 0.2, y.ravel(), np.full(x.size, 0.35)], axis=-1)
    >>> shape = measure(top, support_height=0.30)
    >>> round(shape.length, 3), round(shape.width, 3), round(shape.height, 3), shape.is_round
    (0.06, 0.03, 0.05, False)
    """
    cloud: NDArray[np.float64] = np.asarray(points).astype(np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise ValueError(f"expected points of shape (n, 3) in m, got {cloud.shape}")
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if len(cloud) < _MIN_POINTS:
        raise ValueError(f"{len(cloud)} finite points; at least {_MIN_POINTS} make a shape")
    outline = _outline(cloud[:, :2])
    height = float(np.percentile(cloud[:, 2], _TOP_PERCENTILE)) - support_height
    (_, _), radius = cv2.minEnclosingCircle(_as_float32(outline))
    roundness = min(_area(outline) / (np.pi * max(radius, 1e-9) ** 2), 1.0)
    if roundness >= _ROUND:
        centre, diameter = _circle(outline)
        yaw, length, width = 0.0, diameter, diameter
    else:
        centre, yaw, length, width = _rectangle(outline)
    return TabletopShape(
        centre, yaw, length, width, max(height, 1e-3), support_height, outline, float(roundness)
    )


def _outline(flat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the convex outline (k, 2) without the stray points that range sensors make.

    A cell of 2 mm that holds one point while the average cell holds many is noise at the
    silhouette; so are the outermost half per cent along any direction.
    """
    dense = _without_stray_cells(flat)
    hull = cv2.convexHull(_as_float32(dense))[:, 0].astype(np.float64)
    directions = np.linspace(0, np.pi, 24, endpoint=False)
    inside = np.ones(len(dense), bool)
    for angle in directions:
        along = dense @ np.array([np.cos(angle), np.sin(angle)])
        low, high = np.percentile(along, [_TRIM_PERCENT / 2, 100 - _TRIM_PERCENT / 2])
        inside &= (along >= low) & (along <= high)
    if np.count_nonzero(inside) >= _MIN_POINTS:
        hull = cv2.convexHull(_as_float32(dense[inside]))[:, 0].astype(np.float64)
    if len(hull) < 3 or _area(hull) < 1e-8:
        raise ValueError("the points span no area on the table")
    return hull if _signed_area(hull) > 0 else hull[::-1]


def _without_stray_cells(flat: NDArray[np.float64]) -> NDArray[np.float64]:
    cells = np.floor(flat / _CELL_M).astype(np.int64)
    _, inverse, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    enough = counts >= max(1, round(float(np.median(counts)) / 4))
    dense = flat[enough[inverse.ravel()]]
    return dense if len(dense) >= _MIN_POINTS else flat


def _as_float32(points: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.ascontiguousarray(points, dtype=np.float32)


def _signed_area(outline: NDArray[np.float64]) -> float:
    x, y = (outline - outline.mean(axis=0)).T
    return float(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _area(outline: NDArray[np.float64]) -> float:
    return abs(_signed_area(outline))


def _circle(outline: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return centre and diameter of the circle of least squares through the outline's edges."""
    samples = _along(outline, 96)
    offset = samples.mean(axis=0)
    x, y = (samples - offset).T
    a = np.stack([x, y, np.ones_like(x)], axis=-1)
    solution, *_ = np.linalg.lstsq(a, x**2 + y**2, rcond=None)
    centre = solution[:2] / 2
    radius = float(np.sqrt(max(solution[2] + centre @ centre, 1e-12)))
    return centre + offset, 2 * radius


def _along(outline: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return points (count, 2) at equal steps along a closed outline."""
    closed = np.concatenate([outline, outline[:1]])
    steps = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0, way[-1], count, endpoint=False)
    return np.stack([np.interp(at, way, closed[:, axis]) for axis in range(2)], axis=-1)


def _rectangle(outline: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float, float]:
    """Return centre, yaw of the longer side, length and width of the smallest rectangle."""
    centre = outline.mean(axis=0)
    # Millimetres around the centre: OpenCV computes in single precision.
    box = cv2.boxPoints(cv2.minAreaRect(_as_float32((outline - centre) * 1000))) / 1000
    first, second = box[1] - box[0], box[2] - box[1]
    if np.linalg.norm(first) < np.linalg.norm(second):
        first, second = second, first
    yaw = float(np.arctan2(first[1], first[0]) % np.pi)
    if np.isclose(yaw, np.pi):
        yaw = 0.0
    return (
        box.mean(axis=0) + centre,
        yaw,
        float(np.linalg.norm(first)),
        float(np.linalg.norm(second)),
    )
