"""Perturbed parts: Gaussian deviations of the vertices and the centre of mass (Kehoe 2014, 3.3).

They are independent, or those of a smooth warp of the plane (6.2).

Perturbation i of a part is a function of (seed, part, i) alone, so that any shard of a run can be
made anywhere, in any order. Standard normals are drawn once and scaled: two tolerances are compared
on the same draws. Instead of independent draws the points of a Sobol sequence may be used.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit, uint64

from grasp.arrays import FloatArray
from grasp.push.polygon import Part, crossing

__all__ = ["Tolerance", "normals", "part_key", "perturbed", "sobol_normals", "valid_outlines"]

VERTEX_SCALE, COM_SCALE = 0.045, 0.084
"""Default standard deviations in part radii: the thesis's "vertex variance of 0.2 times the maximum
shape radius" and ".7" for the centre of mass (3.5), read as variances in pixels of an outline of
about 100 pixels radius. Read as standard deviations they give a fifth of the published qualities.
"""

MAX_WARP = 0.4
"""Largest standard deviation of a warp, in correlation lengths; up to .23 no outline crossed."""

_MIN_VARIANCE = 1e-6


@dataclass(frozen=True)
class Tolerance:
    """Standard deviations of a real part from the nominal one.

    Parameters
    ----------
    vertex_std
        Of each vertex in x and in y: one number, or one for each vertex.
    com_std
        Of the centre of mass in x and in y.
    pose_std
        Lateral position (a length) and rotation (rad) of the part before the push.
    com_follows
        The centre of mass is the centroid of each perturbed part, plus its own deviation (as in the
        tolerancing tests of Kehoe 2014, 3.5).
    correlation
        Length over which deviations resemble each other: the plane is warped smoothly and carries
        vertices and centre of mass with it, so that close vertices keep their order (Kehoe 2014,
        6.2). None = each vertex deviates on its own.
    """

    vertex_std: float | FloatArray
    com_std: float = 0.0
    pose_std: tuple[float, float] = (0.0, 0.0)
    com_follows: bool = False
    correlation: float | None = None

    def __post_init__(self) -> None:
        given = np.concatenate([np.atleast_1d(self.vertex_std), [self.com_std, *self.pose_std]])
        if not np.all(np.isfinite(given)) or np.any(given < 0):
            raise ValueError(f"standard deviations must be finite and at least 0, got {given}")
        if self.correlation is not None:
            _check_warp(self.vertex_std, self.correlation)

    @classmethod
    def default(cls, part: Part) -> Tolerance:
        """Return the tolerance of the thesis's experiments for a part of this size."""
        return cls(VERTEX_SCALE * part.radius, COM_SCALE * part.radius)


def _check_warp(vertex_std: float | FloatArray, length: float) -> None:
    """Refuse a warp that is not smooth, or that may fold the plane.

    Raises
    ------
    ValueError
        Saying which.
    """
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"the correlation length is positive and finite, got {length}")
    if np.ptp(vertex_std) > 0:
        raise ValueError("correlated deviations take one vertex_std for all vertices")
    if float(np.max(vertex_std)) > MAX_WARP * length:
        raise ValueError(
            f"vertex_std {float(np.max(vertex_std)):.4g} is more than {MAX_WARP} of the "
            f"correlation length {length:.4g}: such a warp folds the outline"
        )


def part_key(part: Part, seed: int) -> int:
    """Return the key of a part's perturbations: equal for a part moved or scaled."""
    shape = np.vstack([part.vertices, part.com]) - part.centroid
    digest = hashlib.sha256(np.round(shape / part.radius, 6).tobytes())
    digest.update(int(seed).to_bytes(16, "little", signed=True))
    return int.from_bytes(digest.digest()[:8], "little") >> 1


@njit(cache=True, nogil=True)
def _uniform(key, counter):  # type: ignore[no-untyped-def]
    """Return a number in (0, 1): SplitMix64 at a position of its sequence (Steele et al. 2014)."""
    z = key + (counter + uint64(1)) * uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> uint64(30))) * uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> uint64(27))) * uint64(0x94D049BB133111EB)
    z = z ^ (z >> uint64(31))
    return (float(z >> uint64(11)) + 0.5) / 9007199254740992.0


@njit(cache=True, nogil=True)
def normals(key, first, count, pairs):  # type: ignore[no-untyped-def]
    """Return standard normals (count, pairs, 2) of the perturbations from ``first`` on.

    >>> bool(np.all(normals(5, 3, 2, 4)[0] == normals(5, 0, 9, 4)[3]))
    True
    """
    out = np.empty((count, pairs, 2))
    for i in range(count):
        for j in range(pairs):
            at = uint64(2 * ((first + i) * pairs + j))
            radius = math.sqrt(-2.0 * math.log(_uniform(uint64(key), at)))
            angle = 2.0 * math.pi * _uniform(uint64(key), at + uint64(1))
            out[i, j, 0] = radius * math.cos(angle)
            out[i, j, 1] = radius * math.sin(angle)
    return out


def sobol_normals(key: int, first: int, count: int, pairs: int) -> FloatArray:
    """Return standard normals (count, pairs, 2) at points ``first`` on of a Sobol sequence.

    Scrambled by the key (Owen 1995), so that each point is uniform, and mapped by the inverse
    distribution. Powers of two of them are spread most evenly.

    >>> draws = sobol_normals(5, 0, 64, 4)
    >>> bool(np.all(sobol_normals(5, 48, 2, 4) == draws[48:50])), bool(abs(draws.mean()) < 0.03)
    (True, True)
    """
    from scipy.special import ndtri
    from scipy.stats.qmc import Sobol

    points = Sobol(2 * pairs, scramble=True, seed=np.random.default_rng(key))
    if first:
        points.fast_forward(first)
        drawn = points.random(count)
    else:
        # The first call asks for a power of two.
        drawn = points.random_base2(max(count - 1, 0).bit_length())[:count]
    inside = np.clip(drawn, 2.0**-33, 1.0 - 2.0**-33)
    return np.asarray(ndtri(inside)).reshape(count, pairs, 2)


@njit(cache=True, nogil=True)
def valid_outlines(vx, vy):  # type: ignore[no-untyped-def]
    """Return which outlines (N, n) are simple and counter-clockwise, (N,) bool."""
    count, n = vx.shape
    out = np.empty(count, np.bool_)
    ring = np.empty((n, 2))
    for k in range(count):
        area = 0.0
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            area += vx[k, i] * vy[k, j] - vx[k, j] * vy[k, i]
            ring[i, 0], ring[i, 1] = vx[k, i], vy[k, i]
        out[k] = area > 0.0 and crossing(ring)[0] < 0
    return out


def _centroids(vx: FloatArray, vy: FloatArray) -> FloatArray:
    """Return the centroids (N, 2) of outlines (N, n)."""
    wx, wy = np.roll(vx, -1, axis=1), np.roll(vy, -1, axis=1)
    cross = vx * wy - wx * vy
    area = cross.sum(axis=1)
    area = np.where(np.abs(area) < 1e-12, 1e-12, area)
    cx = ((vx + wx) * cross).sum(axis=1) / (3 * area)
    cy = ((vy + wy) * cross).sum(axis=1) / (3 * area)
    return np.column_stack([cx, cy])


@lru_cache(maxsize=16)
def _warp_basis(points: bytes, length: float) -> FloatArray:
    """Return A (p, q) with A A' = exp(-d^2 / 2 l^2) of the distances d between points (p, 2).

    The directions of largest variance come first; those below a millionth of the largest carry
    nothing but rounding and are left out. q < p, so that the last point's own draw stays free.
    """
    at = np.frombuffer(points, dtype=np.float64).reshape(-1, 2)
    apart = ((at[:, None] - at[None]) ** 2).sum(axis=2)
    values, vectors = np.linalg.eigh(np.exp(-apart / (2 * length**2)))
    order = np.argsort(-values, kind="stable")[: len(at) - 1]
    order = order[values[order] > _MIN_VARIANCE * values.max()]
    # A vector's sign is free: the largest entry is positive, so that every machine draws alike.
    leading = vectors[:, order]
    signs = np.sign(leading[np.argmax(np.abs(leading), axis=0), np.arange(leading.shape[1])])
    return np.asarray(leading * signs * np.sqrt(values[order]))


def perturbed(
    ring: FloatArray, com: FloatArray, tolerance: Tolerance, draws: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return perturbed parts.

    Parameters
    ----------
    ring : (n, 2)
    com : (2,)
    tolerance
        In the unit of ``ring``.
    draws : (N, n + 3, 2)
        Standard normals: vertices, centre of mass, position, rotation.

    Returns
    -------
    x and y of the vertices (N, n), centres of mass (N, 2).
    """
    n = len(ring)
    spread = np.broadcast_to(np.asarray(tolerance.vertex_std, dtype=np.float64), (n,))
    if tolerance.correlation is None:
        vx = ring[:, 0] + draws[:, :n, 0] * spread
        vy = ring[:, 1] + draws[:, :n, 1] * spread
        middle = com
    else:
        basis = _warp_basis(np.vstack([ring, com]).tobytes(), tolerance.correlation)
        moved = np.matmul(basis, draws[:, : basis.shape[1]]) * spread[0]
        vx, vy = ring[:, 0] + moved[:, :n, 0], ring[:, 1] + moved[:, :n, 1]
        middle = com + moved[:, n]
    if tolerance.com_follows:
        middle = _centroids(vx, vy)
    mass = middle + draws[:, n] * tolerance.com_std
    lateral, turn = tolerance.pose_std
    if lateral or turn:
        angle = draws[:, n + 2, 0] * turn
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        ax, ay = vx - mass[:, :1], vy - mass[:, 1:]
        mass = mass + draws[:, n + 1] * lateral
        vx, vy = c * ax - s * ay + mass[:, :1], s * ax + c * ay + mass[:, 1:]
    return np.ascontiguousarray(vx), np.ascontiguousarray(vy), np.ascontiguousarray(mass)
