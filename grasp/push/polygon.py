"""Polygonal parts: validity, size, and fewer vertices.

A part is a simple polygon, (n, 2), counter-clockwise, in any unit of length, extruded and lying on
a plane (Kehoe 2014, 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from grasp.arrays import FloatArray

__all__ = [
    "MAX_VERTICES",
    "Part",
    "as_part",
    "as_polygon",
    "crossing",
    "filter_polygon",
    "plate_centroid",
    "simplify",
    "triangles",
]


MAX_VERTICES = 512
"""Planning on more is refused: at such a density the tolerance of a vertex exceeds its edges."""

_DUPLICATE = 1e-12
_COLLINEAR = 1e-9
_SHORT = 1e-6
_FIRST_STEP, _FINER = 1e-4, 4


@dataclass(frozen=True)
class Part:
    """A part and its sizes.

    Parameters
    ----------
    vertices : (n, 2)
        Counter-clockwise.
    com : (2,)
        Centre of mass.
    centroid : (2,)
    area
    radius
        Centroid to the farthest vertex.
    diameter
        Distance of the farthest pair of vertices.
    """

    vertices: FloatArray
    com: FloatArray
    centroid: FloatArray
    area: float
    radius: float
    diameter: float


def as_polygon(points: ArrayLike) -> FloatArray:
    """Return a simple polygon counter-clockwise, without repeated neighbouring vertices.

    Parameters
    ----------
    points : (n, 2)
        In order, either way round; the first may be repeated at the end.

    Raises
    ------
    ValueError
        When the shape is wrong, a number is not finite, fewer than three vertices differ, the
        vertices are collinear, or the boundary touches or crosses itself (the pair of edges is
        named).

    Examples
    --------
    >>> as_polygon([(0, 0), (0, 1), (2, 1), (2, 0)])[1].tolist()
    [2.0, 1.0]
    """
    try:
        ring = np.array(points, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError("a polygon is an array (n, 2) of numbers") from error
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise ValueError(f"a polygon has shape (n, 2), got {ring.shape}")
    if not np.all(np.isfinite(ring)):
        bad = int(np.flatnonzero(~np.isfinite(ring).all(axis=1))[0])
        raise ValueError(f"vertex {bad} of the polygon is not finite: {ring[bad].tolist()}")
    size = float(np.ptp(ring, axis=0).max()) if len(ring) else 0.0
    if len(ring):
        # Sizes whose squares leave the range of a double would end as NaN far from here.
        if size and not 1e-100 < size < 1e100:
            raise ValueError(f"the polygon's extent {size:g} is out of range; change the unit")
        apart = np.abs(np.diff(ring, axis=0)).max(axis=1) > _DUPLICATE * size
        ring = ring[np.concatenate([[True], apart])]
        if len(ring) > 1 and np.abs(ring[-1] - ring[0]).max() <= _DUPLICATE * size:
            ring = ring[:-1]
    if len(ring) < 3:
        raise ValueError(f"a polygon needs three different vertices, got {len(ring)}")
    spread = np.linalg.svd(ring - ring.mean(axis=0), compute_uv=False)
    if spread[1] <= _COLLINEAR * spread[0]:
        raise ValueError("the polygon's vertices are collinear: it has no area")
    first, second = crossing(np.ascontiguousarray((ring - ring.mean(axis=0)) / size))
    if first >= 0:
        n = len(ring)
        raise ValueError(
            f"the polygon touches or crosses itself: edge {first} ({first}-{(first + 1) % n}) and "
            f"edge {second} ({second}-{(second + 1) % n})"
        )
    return np.ascontiguousarray(ring if _area(ring) > 0 else ring[::-1])


def as_part(points: ArrayLike, com: ArrayLike | None = None) -> Part:
    """Return a checked part; its centre of mass is the centroid unless given.

    >>> part = as_part([(0, 0), (2, 0), (2, 1), (0, 1)])
    >>> part.com.tolist(), part.area, round(part.diameter, 3)
    ([1.0, 0.5], 2.0, 2.236)
    """
    ring = as_polygon(points)
    middle = centroid(ring)
    if com is None:
        mass = middle
    else:
        mass = np.asarray(com, dtype=np.float64)
        if mass.shape != (2,) or not np.all(np.isfinite(mass)):
            raise ValueError(f"a centre of mass is two finite numbers, got {com!r}")
    radius = float(np.hypot(*(ring - middle).T).max())
    return Part(ring, mass, middle, float(_area(ring)), radius, _diameter(ring))


def centroid(ring: FloatArray) -> FloatArray:
    """Return the centroid (2,) of a polygon (n, 2)."""
    origin = ring[0]
    p = ring - origin
    q = np.roll(p, -1, axis=0)
    cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    return np.asarray(origin + ((p + q) * cross[:, None]).sum(axis=0) / (3 * cross.sum()))


def plate_centroid(ring: FloatArray, holes: Sequence[FloatArray]) -> FloatArray:
    """Return the centre of mass (2,) of a plate of even thickness with holes.

    >>> square = np.array([(0.0, 0), (4, 0), (4, 4), (0, 4)])
    >>> plate_centroid(square, [square / 4 + (2, 1.5)]).round(3).tolist()
    [1.967, 2.0]
    """
    areas = np.array([abs(_area(ring)), *(-abs(_area(hole)) for hole in holes)])
    middles = np.array([centroid(ring), *(centroid(hole) for hole in holes)])
    return np.asarray(areas @ middles / areas.sum())


def simplify(points: ArrayLike, max_vertices: int = 64, tolerance: float = 0.0) -> FloatArray:
    """Return a polygon of at most ``max_vertices``, as near to the outline as that allows.

    Parameters
    ----------
    tolerance
        Fraction of the outline's extent by which it may at least be off; doubled (from 1e-4) until
        the outline is short enough.

    Notes
    -----
    For dense outlines (contours of images, scans). Where the result touches itself, the next finer
    one that does not is taken, of at most :data:`MAX_VERTICES` vertices. The filter of the planner,
    which tries every edge as the start, is `filter_polygon`.
    """
    ring = np.asarray(points, dtype=np.float64)
    if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 or not np.all(np.isfinite(ring)):
        return as_polygon(ring)  # says what is wrong
    if max_vertices < 3:
        raise ValueError(f"max_vertices must be at least 3, got {max_vertices}")
    first = int(np.argmax(np.hypot(*(ring - ring.mean(axis=0)).T)))
    ring = _without_short_edges(np.roll(ring, -first, axis=0))
    rings = [ring]
    if tolerance > 0:
        shares = 2.0 ** np.arange(-_FINER, 1)
        rings += [_reduced(ring, share * tolerance) for share in shares.tolist()]
    step = _FIRST_STEP
    while len(rings[-1]) > max_vertices:
        fewer = _reduced(rings[-1], step)
        if len(fewer) < 3:
            break
        rings.append(fewer)
        step *= 2
    # Two sides of a narrow neck may meet in what is left; the next finer one keeps them apart.
    most = max(max_vertices, MAX_VERTICES)
    for finer in rings[-2::-1]:
        try:
            return as_polygon(rings[-1])
        except ValueError:
            if len(finer) > most:
                raise
            rings.pop()
    return as_polygon(rings[-1])


def _reduced(ring: FloatArray, tolerance: float) -> FloatArray:
    """Return the vertices that are left at a tolerance, as a fraction of the extent."""
    size = float(np.ptp(ring, axis=0).max())
    return np.asarray(ring[_open_rdp(np.vstack([ring, ring[:1]]), tolerance * size)[:-1]])


def _without_short_edges(ring: FloatArray) -> FloatArray:
    """Return the ring without vertices that repeat the one before, to within 1e-6 of the extent."""
    size = float(np.ptp(ring, axis=0).max())
    apart = np.abs(ring - np.roll(ring, 1, axis=0)).max(axis=1) > _SHORT * size
    return ring[apart] if apart.sum() >= 3 else ring


def filter_polygon(ring: FloatArray, distance: float) -> NDArray[np.int64]:
    """Return the indices of the vertices that the filter keeps, ascending.

    Every edge is removed in turn, the open polyline simplified after Ramer, Douglas and Peucker,
    and closed again; the result with the fewest edges counts (Kehoe 2014, 3.4, Fig. 3.7). Among
    equals it is the one nearest to the outline.

    Parameters
    ----------
    ring : (n, 2)
    distance
        Largest distance of a removed vertex; 0 merges collinear edges only.

    Examples
    --------
    >>> filter_polygon(np.array([(0.0, 0), (1, 0), (2, 0), (2, 1), (0, 1)]), 0.0).tolist()
    [0, 2, 3, 4]
    """
    size = float(np.ptp(ring, axis=0).max())
    vertices: NDArray[np.int64] = _closed_rdp(ring, max(distance, _COLLINEAR * size))
    return vertices


def triangles(ring: FloatArray) -> list[FloatArray]:
    """Cut a simple polygon (n, 2), counter-clockwise, into triangles by its ears.

    >>> len(triangles(np.array([(0.0, 0), (2, 0), (2, 2), (1, 1), (0, 2)])))
    3
    """

    def cross(o: FloatArray, a: FloatArray, b: FloatArray) -> float:
        return float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]))

    left, out = list(range(len(ring))), []
    while len(left) > 3:
        for k in range(len(left)):
            i, j, m = left[k - 1], left[k], left[(k + 1) % len(left)]
            a, b, c = ring[i], ring[j], ring[m]
            if cross(a, b, c) <= 0:
                continue
            others = (ring[q] for q in left if q not in (i, j, m))
            if any(
                cross(a, b, p) >= 0 and cross(b, c, p) >= 0 and cross(c, a, p) >= 0 for p in others
            ):
                continue
            out.append(np.stack([a, b, c]))
            del left[k]
            break
        else:
            raise ValueError("the outline cannot be cut into triangles: it is not simple")
    out.append(ring[left])
    return out


def _area(ring: FloatArray) -> float:
    """Return the signed area."""
    p = ring - ring[0]
    q = np.roll(p, -1, axis=0)
    return float((p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]).sum() / 2)


def _diameter(ring: FloatArray) -> float:
    from scipy.spatial import ConvexHull

    # Qhull gives up on what is far from the origin.
    corners = ring[ConvexHull(ring - ring[0]).vertices]
    return float(max(np.hypot(*(corners - c).T).max() for c in corners))


@njit(cache=True, nogil=True)
def _side(ax, ay, bx, by, cx, cy):  # type: ignore[no-untyped-def]
    """Return twice the area of a, b, c: positive when c is left of a to b."""
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@njit(cache=True, nogil=True)
def crossing(ring):  # type: ignore[no-untyped-def]
    """Return the first two edges that touch or cross without being neighbours, or fold back.

    Returns
    -------
    Indices of two edges, or (-1, -1) for a simple polygon.
    """
    n = ring.shape[0]
    for i in range(n):
        k = i + 1 if i + 1 < n else 0
        ax, ay, bx, by = ring[i, 0], ring[i, 1], ring[k, 0], ring[k, 1]
        left, right = min(ax, bx), max(ax, bx)
        low, high = min(ay, by), max(ay, by)
        m = k + 1 if k + 1 < n else 0
        cx, cy = ring[m, 0], ring[m, 1]
        folds = (bx - ax) * (cx - bx) + (by - ay) * (cy - by) < 0.0
        if folds and abs(_side(ax, ay, bx, by, cx, cy)) < 1e-14:
            return i, k
        for j in range(i + 2, n):
            if i == 0 and j == n - 1:
                continue
            o = j + 1 if j + 1 < n else 0
            px, py, qx, qy = ring[j, 0], ring[j, 1], ring[o, 0], ring[o, 1]
            if max(px, qx) < left or min(px, qx) > right or max(py, qy) < low:
                continue
            if min(py, qy) > high:
                continue
            s, t = _side(ax, ay, bx, by, px, py), _side(ax, ay, bx, by, qx, qy)
            u, v = _side(px, py, qx, qy, ax, ay), _side(px, py, qx, qy, bx, by)
            if ((s > 0) != (t > 0) or s == 0 or t == 0) and (
                (u > 0) != (v > 0) or u == 0 or v == 0
            ):
                return i, j
    return -1, -1


@njit(cache=True, nogil=True)
def _rdp(px, py, first, count, distance, keep, stack):  # type: ignore[no-untyped-def]
    """Mark what an open polyline keeps: ``count`` vertices of a ring from ``first`` on.

    Returns
    -------
    How many are kept, and the largest distance of a removed vertex.
    """
    n = px.size
    for i in range(count):
        keep[i] = False
    keep[0] = True
    keep[count - 1] = True
    count_left, off = 2, 0.0
    stack[0, 0], stack[0, 1] = 0, count - 1
    top = 1
    while top > 0:
        top -= 1
        a, b = stack[top, 0], stack[top, 1]
        if b - a < 2:
            continue
        ax, ay = px[(first + a) % n], py[(first + a) % n]
        dx, dy = px[(first + b) % n] - ax, py[(first + b) % n] - ay
        square = dx * dx + dy * dy
        worst, at = -1.0, -1
        for i in range(a + 1, b):
            ex, ey = px[(first + i) % n] - ax, py[(first + i) % n] - ay
            t = 0.0
            if square > 0.0:
                t = min(max((ex * dx + ey * dy) / square, 0.0), 1.0)
            d = np.hypot(ex - t * dx, ey - t * dy)
            if d > worst:
                worst, at = d, i
        if worst <= distance:
            off = max(off, worst)
            continue
        keep[at] = True
        count_left += 1
        stack[top, 0], stack[top, 1] = a, at
        stack[top + 1, 0], stack[top + 1, 1] = at, b
        top += 2
    return count_left, off


@njit(cache=True, nogil=True)
def _open_rdp(line, distance):  # type: ignore[no-untyped-def]
    """Return the indices that an open polyline (n, 2) keeps."""
    n = line.shape[0]
    keep = np.zeros(n, np.bool_)
    stack = np.empty((n + 2, 2), np.int64)
    _rdp(line[:, 0].copy(), line[:, 1].copy(), 0, n, distance, keep, stack)
    return np.flatnonzero(keep)


@njit(cache=True, nogil=True)
def _closed_rdp(ring, distance):  # type: ignore[no-untyped-def]
    n = ring.shape[0]
    px, py = ring[:, 0].copy(), ring[:, 1].copy()
    keep = np.zeros(n, np.bool_)
    best = np.ones(n, np.bool_)
    stack = np.empty((n + 2, 2), np.int64)
    fewest, nearest = n + 1, np.inf
    for first in range(n):
        count_left, off = _rdp(px, py, first, n, distance, keep, stack)
        if count_left < 3 or count_left > fewest or (count_left == fewest and off >= nearest):
            continue
        fewest, nearest = count_left, off
        for i in range(n):
            best[(first + i) % n] = keep[i]
    return np.flatnonzero(best)
