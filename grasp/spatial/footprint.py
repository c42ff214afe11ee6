"""Outline of an object's base, and its width between two jaws.

All coordinates lie in the support plane of one frame with z up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["ROUND", "Contacts", "Footprint", "JawLines", "Kind"]

ROUND = 0.85
"""Roundness from which on a footprint counts as a circle."""

_ELONGATED = 2.5
_FILLED = 0.75
_CIRCLE_CORNERS = 48

Kind = Literal["round", "rectangle", "elongated", "irregular"]


@dataclass(frozen=True)
class Contacts:
    """Contacts of two jaws with the outline.

    Parameters
    ----------
    centre : (2,), m
        Midway between the jaws.
    width
        Distance between the jaws, m.
    deviations
        Angles between the closing direction and the outline's normals at both jaws, rad.
    """

    centre: NDArray[np.float64]
    width: float
    deviations: tuple[float, float]


@dataclass(frozen=True, eq=False)
class JawLines:
    """Contacts of jaws with the outline, for many closing lines at once.

    Parameters
    ----------
    centres : (n, 2) float64, m
        Midway between the jaws; NaN where they close on nothing.
    widths : (n,) float64, m
        Distance between the jaws; NaN where they close on nothing.
    deviations : (n, 2) float64, rad
        Angles between the closing direction and the outline's normals at both jaws.
    """

    centres: NDArray[np.float64]
    widths: NDArray[np.float64]
    deviations: NDArray[np.float64]

    def of(self, index: NDArray[np.intp]) -> JawLines:
        """Return some of the lines, by index (m,)."""
        return JawLines(self.centres[index], self.widths[index], self.deviations[index])


@dataclass(frozen=True)
class Footprint:
    """A measured object on a horizontal support.

    Parameters
    ----------
    centre : (2,), m
        Of the footprint.
    yaw
        Direction of the longer side about +z, rad.
    length, width, height
        Longer side, shorter side, height over the support, m.
    roundness
        0 (a box) .. 1 (a circle).
    outline : (k, 2) or None, m
        Counter-clockwise corners; used where neither circle nor rectangle describes the shape.

    Examples
    --------
    >>> can = Footprint((0.15, -0.1), 0.0, 0.04, 0.04, 0.08, roundness=1.0)
    >>> can.kind, round(can.contacts((0.15, -0.1), 0.3, 0.012).width, 3)
    ('round', 0.04)
    """

    centre: tuple[float, float]
    yaw: float
    length: float
    width: float
    height: float
    roundness: float = 0.0
    outline: NDArray[np.float64] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if not np.isfinite([*self.centre, self.yaw, self.roundness]).all():
            raise ValueError(
                "a footprint needs a finite centre, yaw and roundness, got "
                f"{self.centre}, {self.yaw}, {self.roundness}"
            )
        sizes = (self.length, self.width, self.height)
        if not all(np.isfinite(s) and s > 0 for s in sizes) or self.width > self.length * 1.001:
            raise ValueError(
                "a footprint needs finite length >= width > 0 and height > 0 m, got "
                f"{self.length} x {self.width} x {self.height}"
            )
        ring = self.outline
        if ring is not None and (ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3):
            raise ValueError(f"an outline has shape (k >= 3, 2), got {ring.shape}")
        if ring is not None and not np.isfinite(ring).all():
            raise ValueError("an outline has finite corners")

    @property
    def kind(self) -> Kind:
        """Rule of closing directions that applies."""
        if self.roundness >= ROUND:
            return "round"
        if self.length >= _ELONGATED * self.width:
            return "elongated"
        if self.outline is not None and _area(self.outline) < _FILLED * self.length * self.width:
            return "irregular"
        return "rectangle"

    @property
    def size(self) -> float:
        """Largest extent, m: the scale on which two grasps count as near."""
        return max(self.length, self.width, self.height)

    def boundary(self) -> NDArray[np.float64]:
        """Return the corners (k, 2), m, counter-clockwise, of the shape that jaws will meet."""
        if self.kind == "irregular" and self.outline is not None:
            ring = np.asarray(self.outline, dtype=np.float64)
            return ring if _signed_area(ring) > 0 else ring[::-1]
        if self.kind == "round":
            angles = np.arange(_CIRCLE_CORNERS) * (2 * np.pi / _CIRCLE_CORNERS)
            # Circumscribed, so that no direction measures narrower than the true diameter.
            radius = (self.length + self.width) / 4 / np.cos(np.pi / _CIRCLE_CORNERS)
            ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        else:
            half = np.array([self.length, self.width]) / 2
            ring = half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
            c, s = np.cos(self.yaw), np.sin(self.yaw)
            ring = ring @ np.array([[c, s], [-s, c]])
        return np.asarray(ring + np.asarray(self.centre), dtype=np.float64)

    def contacts(
        self, through: tuple[float, float], theta: float, jaw_width: float
    ) -> Contacts | None:
        """Return how jaws of ``jaw_width`` m meet the outline, closing along ``theta``.

        Parameters
        ----------
        through
            A point (x, y), m, on the line midway along the jaws' faces.

        Returns
        -------
        None when the jaws close on nothing.
        """
        met = self.contacts_along(
            np.array([through], dtype=np.float64), np.array([theta]), jaw_width
        )
        if np.isnan(met.widths[0]):
            return None
        left, right = met.deviations[0].tolist()
        return Contacts(met.centres[0], float(met.widths[0]), (left, right))

    def contacts_along(
        self, through: NDArray[np.float64], thetas: NDArray[np.float64], jaw_width: float
    ) -> JawLines:
        """Return how jaws of ``jaw_width`` m meet the outline along many closing lines.

        Parameters
        ----------
        through : (n, 2), m
            A point of each line, midway along the jaws' faces.
        thetas : (n,), rad
            Closing directions about +z.
        """
        boundary, is_round, half = self.boundary(), self.kind == "round", jaw_width / 2
        centres, widths = np.full((len(thetas), 2), np.nan), np.full(len(thetas), np.nan)
        deviations = np.zeros((len(thetas), 2))
        for i, (point, theta) in enumerate(zip(through, thetas, strict=True)):
            closing = np.array([np.cos(theta), np.sin(theta)])
            across = np.array([-closing[1], closing[0]])
            local = (boundary - point) @ np.stack([closing, across], axis=1)
            inside = _cut(_cut(local, half, 1.0), half, -1.0)
            if len(inside) < 2:
                continue
            low, high = inside[:, 0].min(), inside[:, 0].max()
            centres[i], widths[i] = point + closing * (low + high) / 2, high - low
            if not is_round:
                deviations[i] = _normal_deviation(local, -1), _normal_deviation(local, 1)
        return JawLines(centres, widths, deviations)


def _signed_area(ring: NDArray[np.float64]) -> float:
    x, y = ring[:, 0], ring[:, 1]
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def _area(ring: NDArray[np.float64]) -> float:
    return abs(_signed_area(np.asarray(ring, dtype=np.float64)))


def _cut(ring: NDArray[np.float64], limit: float, sign: float) -> NDArray[np.float64]:
    """Keep the part of a ring (k, 2) where ``sign * y <= limit``."""
    if len(ring) == 0:
        return ring
    after = np.roll(ring, -1, axis=0)
    here, there = limit - sign * ring[:, 1], limit - sign * after[:, 1]
    points = []
    for p, q, a, b in zip(ring, after, here, there, strict=True):
        if a >= 0:
            points.append(p)
        if (a > 0 > b) or (a < 0 < b):
            points.append(p + (q - p) * (a / (a - b)))
    return np.array(points).reshape(-1, 2)


def _normal_deviation(local: NDArray[np.float64], side: int) -> float:
    """Return the angle between the x axis and the outline's normal where y = 0 on one side, rad.

    ``local`` has the closing direction along x; ``side`` +1 looks at the largest x, -1 at the
    smallest.
    """
    after = np.roll(local, -1, axis=0)
    best, angle = -np.inf, np.pi / 2
    for p, q in zip(local, after, strict=True):
        if (p[1] > 0) == (q[1] > 0) or p[1] == q[1]:
            continue
        x = p[0] + (q[0] - p[0]) * (-p[1] / (q[1] - p[1]))
        if side * x > best:
            best = side * x
            edge = q - p
            outward = np.array([edge[1], -edge[0]]) / np.hypot(*edge)
            angle = float(np.arccos(np.clip(side * outward[0], -1.0, 1.0)))
    return angle
