"""Candidate grasps on the nominal outline (Kehoe 2014, 3.4, Algorithm 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from grasp.arrays import FloatArray
from grasp.push.mechanics.contact import NOTHING, highest, lowest
from grasp.push.polygon import Part, filter_polygon

__all__ = ["Grasps", "approach", "make_grasps", "needed_openings", "sample_grasps"]

_MAX_GRASPS = 200_000


@dataclass(frozen=True)
class Grasps:
    """Push grasps on a nominal part (Kehoe 2014, 3.3).

    A grasp fixes the direction of a jaw that comes from infinity and its lateral place, nothing
    else. The jaw's left corner (seen along the approach) meets the contact where the angle is
    positive, its right corner otherwise: the jaw never cuts into the edge it touches.

    Parameters
    ----------
    contacts : (g, 2)
        On the nominal boundary.
    angles : (g,), rad
        From the inward normal to the approach, clockwise positive.
    approaches : (g, 2)
        Unit vectors.
    left : (g,) bool
        The left corner is at the contact.
    points, turns : (g,) int
        Number of the contact along the boundary and of the angle.
    """

    contacts: FloatArray
    angles: FloatArray
    approaches: FloatArray
    left: NDArray[np.bool_]
    points: NDArray[np.int64]
    turns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.angles)

    def take(self, indices: ArrayLike) -> Grasps:
        """Return some of the grasps."""
        i = np.atleast_1d(np.asarray(indices, dtype=np.int64))
        return Grasps(
            self.contacts[i], self.angles[i], self.approaches[i], self.left[i],
            self.points[i], self.turns[i],
        )  # fmt: skip

    def rows(self, part: Part) -> FloatArray:
        """Return the grasps (g, 5) for the kernels: origin at the centroid, unit the radius."""
        contacts = (self.contacts - part.centroid) / part.radius
        return np.column_stack([contacts, self.approaches, np.where(self.left, 1.0, -1.0)])

    def jaw(self, index: int, width: float) -> FloatArray:
        """Return the ends (2, 2) of the first jaw's face at the nominal contact."""
        dx, dy = self.approaches[index]
        along = np.array([dy, -dx]) * (width if self.left[index] else -width)
        return np.stack([self.contacts[index], self.contacts[index] + along])


def approach(normal: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Return directions of approach (..., 2) at angles, rad, clockwise from inward normals.

    >>> approach((0.0, 1.0), np.pi / 2).round(9).tolist()
    [1.0, 0.0]
    """
    n, phi = np.asarray(normal, dtype=np.float64), np.asarray(angle, dtype=np.float64)[..., None]
    clockwise = np.stack([n[..., 1], -n[..., 0]], axis=-1)
    return np.asarray(np.cos(phi) * n + np.sin(phi) * clockwise)


def make_grasps(
    contacts: ArrayLike, normals: ArrayLike, angles: ArrayLike, points: ArrayLike | None = None
) -> Grasps:
    """Return every contact with every angle.

    Parameters
    ----------
    contacts, normals : (p, 2)
        Points of the boundary and its inward unit normals there.
    angles : (a,), rad
    """
    at, inward = np.atleast_2d(contacts).astype(float), np.atleast_2d(normals).astype(float)
    phi = np.atleast_1d(np.asarray(angles, dtype=np.float64))
    if not np.all(np.isfinite(phi)) or np.any(np.abs(phi) > np.pi / 2):
        raise ValueError("angles of approach lie within 90 degrees of the inward normal")
    number = np.arange(len(at)) if points is None else np.asarray(points)
    return Grasps(
        np.repeat(at, len(phi), axis=0),
        np.tile(phi, len(at)),
        approach(inward[:, None, :], phi[None, :]).reshape(-1, 2),
        np.tile(phi > 0, len(at)),
        np.repeat(number, len(phi)).astype(np.int64),
        np.tile(np.arange(len(phi)), len(at)),
    )


def sample_grasps(
    part: Part,
    *,
    filter_distance: float = 0.0,
    density: float = 1.5,
    angles: int = 5,
    max_angle_deg: float = 15.0,
) -> Grasps:
    """Spread candidate grasps over the boundary.

    Parameters
    ----------
    filter_distance
        In part radii; contacts are counted on the filtered outline and lie on the real one.
    density
        Contacts on an edge of mean length.
    angles
        How many directions at each contact, odd, evenly over +-``max_angle_deg``.

    Examples
    --------
    >>> from grasp.push.polygon import as_part
    >>> len(sample_grasps(as_part([(0, 0), (2, 0), (2, 1), (0, 1)])))
    30
    """
    if not (np.isfinite(filter_distance) and filter_distance >= 0):
        raise ValueError(f"filter_distance must be at least 0, got {filter_distance}")
    if not (np.isfinite(density) and density > 0):
        raise ValueError(f"density must be positive, got {density}")
    if angles < 1 or angles % 2 == 0:
        raise ValueError(f"angles must be an odd number, so that 0 is among them, got {angles}")
    if not 0 <= max_angle_deg <= 90:
        raise ValueError(f"max_angle_deg must lie in 0..90, got {max_angle_deg}")
    ring = part.vertices
    n = len(ring)
    vertices = filter_polygon(ring, filter_distance * part.radius)
    after = np.roll(vertices, -1)
    lengths = np.hypot(*(ring[after] - ring[vertices]).T)
    # Half up, and not at the mercy of rounding: equal outlines get equal counts.
    counts = np.maximum(np.floor(density * lengths / lengths.mean() + 0.5 + 1e-9), 1).astype(int)
    if counts.sum() * angles > _MAX_GRASPS:
        raise ValueError(
            f"{counts.sum() * angles} candidates are too many (at most {_MAX_GRASPS}); "
            "lower density or angles"
        )
    contacts, inward = [], []
    for first, last, count in zip(vertices, after, counts, strict=True):
        chain = ring[np.arange(first, last + 1 if last > first else last + n + 1) % n]
        steps = np.diff(chain, axis=0)
        spans = np.hypot(*steps.T)
        ends = np.concatenate([[0.0], np.cumsum(spans)])
        for place in (np.arange(count) + 0.5) / count * ends[-1]:
            k = min(int(np.searchsorted(ends, place, side="right")) - 1, len(spans) - 1)
            along = steps[k] / spans[k]
            contacts.append(chain[k] + (place - ends[k]) * along)
            inward.append((-along[1], along[0]))
    turns = np.deg2rad(np.linspace(-max_angle_deg, max_angle_deg, angles))
    turns[angles // 2] = 0.0
    return make_grasps(np.array(contacts), np.array(inward), turns)


def needed_openings(part: Part, grasps: Grasps, jaw_width: float) -> FloatArray:
    """Return how far apart the jaws must be to pass the nominal part, (g,).

    The extent along the approach of what lies in the jaws' window.
    """
    out: FloatArray = _openings(part.vertices - part.centroid, _absolute(part, grasps), jaw_width)
    return out


def _absolute(part: Part, grasps: Grasps) -> FloatArray:
    contacts = grasps.contacts - part.centroid
    return np.column_stack([contacts, grasps.approaches, np.where(grasps.left, 1.0, -1.0)])


@njit(cache=True, nogil=True)
def _openings(ring, rows, width):  # type: ignore[no-untyped-def]
    n = ring.shape[0]
    x, y, out = np.empty(n), np.empty(n), np.zeros(rows.shape[0])
    for g in range(rows.shape[0]):
        dx, dy = rows[g, 2], rows[g, 3]
        for i in range(n):
            ax, ay = ring[i, 0] - rows[g, 0], ring[i, 1] - rows[g, 1]
            x[i], y[i] = ax * dy - ay * dx, ax * dx + ay * dy
        lo = 0.0 if rows[g, 4] > 0.0 else -width
        kind, _, _, low = lowest(x, y, n, lo, lo + width)
        if kind != NOTHING:
            out[g] = highest(x, y, n, lo, lo + width)[3] - low
    return out
