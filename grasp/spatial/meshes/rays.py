"""Lines through triangle meshes: a bounding volume hierarchy and its compiled traversal.

A gripper closes along a line. What matters on it are the first and the last crossing within the
opening, which one traversal finds together; a general ray caster needs two rays for them.
Intersections after Moeller and Trumbore 1997.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from grasp.arrays import FloatArray, IntArray

__all__ = ["MAX_HITS", "NOTHING", "Tree", "build_tree", "crossings", "first_and_last"]


NOTHING = -1
"""Face index of a line that meets no face."""

MAX_HITS = 64
"""Crossings of one line that are kept, sorted."""

_LEAF = 2
_BINS = 12
_STACK = 128
_SAH_DEPTH = 60
_EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class Tree:
    """Triangles in the order of the leaves, and the boxes around them.

    Parameters
    ----------
    corners, edge_1, edge_2, normals : (f, 3)
        First corner, both edges from it, unit normal.
    faces : (f,)
        Index of each triangle in the mesh.
    boxes : (n, 6)
        Lowest and highest corner of each node.
    nodes : (n, 2)
        Inner node: index of the first of its two children, 0; leaf: first triangle, how many.
    """

    corners: FloatArray
    edge_1: FloatArray
    edge_2: FloatArray
    normals: FloatArray
    faces: IntArray
    boxes: FloatArray
    nodes: IntArray

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
        """Corners, edges, boxes and nodes, as the kernels take them."""
        return self.corners, self.edge_1, self.edge_2, self.boxes, self.nodes


def build_tree(vertices: FloatArray, faces: IntArray, normals: FloatArray) -> Tree:
    """Return the hierarchy of a mesh, split by the surface area heuristic (Wald 2007).

    Parameters
    ----------
    vertices : (v, 3)
    faces : (f, 3)
    normals : (f, 3)
    """
    triangles = np.ascontiguousarray(vertices[faces])
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    order, boxes, nodes = _split(low, high)
    corners = triangles[order, 0]
    return Tree(
        corners,
        triangles[order, 1] - corners,
        triangles[order, 2] - corners,
        np.ascontiguousarray(normals[order]),
        order,
        boxes,
        nodes,
    )


def first_and_last(
    tree: Tree, origins: FloatArray, directions: FloatArray, half: float
) -> tuple[FloatArray, IntArray]:
    """Return where lines first and last meet the mesh.

    Parameters
    ----------
    origins, directions : (n, 3)
        Directions of unit length.
    half
        Only crossings within this distance of the origin count, m.

    Returns
    -------
    distances : (n, 2)
        Along the direction, m; not defined without a crossing.
    faces : (n, 2)
        Of the mesh; :data:`NOTHING` without a crossing.
    """
    if not len(tree.faces):
        return np.zeros((len(origins), 2)), np.full((len(origins), 2), NOTHING)
    lines = np.ascontiguousarray(np.hstack([origins, directions]), dtype=np.float64)
    at, index = _ends_of_lines(*tree.arrays, lines, half)
    return at, np.where(index >= 0, tree.faces[index], NOTHING)


def crossings(
    tree: Tree, origins: FloatArray, directions: FloatArray, low: float, high: float
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return every crossing of lines with the mesh, sorted along each line.

    Parameters
    ----------
    origins, directions : (n, 3)
    low, high
        Range of distances from the origin along the direction, m.

    Returns
    -------
    distances : (n, 64), index : (n, 64)
        Of the tree's triangles; at most :data:`MAX_HITS` are kept.
    counts : (n,)
    """
    if not len(tree.faces):
        none = np.zeros((len(origins), MAX_HITS))
        return none, np.full(none.shape, -1), np.zeros(len(origins), np.int64)
    lines = np.ascontiguousarray(np.hstack([origins, directions]), dtype=np.float64)
    hits: tuple[FloatArray, IntArray, IntArray] = _all_of_lines(*tree.arrays, lines, low, high)
    return hits


_FAST = {"nnan", "nsz", "arcp", "contract"}


@njit(cache=True, nogil=True)
def _split(low, high):  # type: ignore[no-untyped-def]
    """Return order of the triangles, boxes (n, 6) and nodes (n, 2) over their boxes (f, 3)."""
    count = len(low)
    order = np.arange(count)
    boxes, nodes = np.zeros((2 * count + 1, 6)), np.zeros((2 * count + 1, 2), np.int64)
    middle = (low + high) / 2
    stack = np.empty((_STACK, 4), np.int64)
    stack[0] = 0, 0, count, 0
    top, used = 1, 1
    bins, areas = np.zeros(_BINS, np.int64), np.zeros(_BINS)
    around = np.empty((_BINS, 6))
    # The order of the faces on either side stays, so that the tree is the same on every machine.
    scratch = np.empty(count, np.int64)
    while top > 0:
        top -= 1
        node, start, end, depth = stack[top]
        _bound(low, high, order, start, end, boxes[node])
        nodes[node] = start, end - start
        if end - start <= _LEAF:
            continue
        axis, at = _best_plane(low, high, middle, order, start, end, bins, areas, around)
        left = start
        # Halves below some depth, so that no mesh makes the tree deeper than a stack.
        if axis >= 0 and depth < _SAH_DEPTH:
            right = 0
            for k in range(start, end):
                if middle[order[k], axis] < at:
                    order[left], left = order[k], left + 1
                else:
                    scratch[right], right = order[k], right + 1
            order[left:end] = scratch[:right]
        # All middles on one side, as of equal faces: halves by number end the splitting all the
        # same.
        if left in (start, end):
            left = (start + end) // 2
        nodes[node] = used, 0
        stack[top] = used, start, left, depth + 1
        stack[top + 1] = used + 1, left, end, depth + 1
        used, top = used + 2, top + 2
    return order, boxes[:used].copy(), nodes[:used].copy()


@njit(cache=True, nogil=True)
def _bound(low, high, order, start, end, box):  # type: ignore[no-untyped-def]
    """Write the box around some triangles into ``box`` (6,)."""
    for i in range(3):
        box[i], box[3 + i] = np.inf, -np.inf
    for k in range(start, end):
        for i in range(3):
            box[i] = min(box[i], low[order[k], i])
            box[3 + i] = max(box[3 + i], high[order[k], i])


@njit(cache=True, nogil=True)
def _half_area(box):  # type: ignore[no-untyped-def]
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return x * y + y * z + z * x if x >= 0.0 else 0.0


@njit(cache=True, nogil=True)
def _grow(box, other):  # type: ignore[no-untyped-def]
    for i in range(3):
        box[i], box[3 + i] = min(box[i], other[i]), max(box[3 + i], other[3 + i])


@njit(cache=True, nogil=True)
def _best_plane(low, high, middle, order, start, end, bins, areas, around):  # type: ignore[no-untyped-def]
    """Return axis and place of the cheapest split; axis -1 when the centres coincide."""
    best, best_axis, best_at = np.inf, -1, 0.0
    box = np.empty(6)
    for axis in range(3):
        least, most = np.inf, -np.inf
        for k in range(start, end):
            least, most = min(least, middle[order[k], axis]), max(most, middle[order[k], axis])
        if most <= least:
            continue
        scale = _BINS / (most - least)
        bins[:] = 0
        around[:, :3], around[:, 3:] = np.inf, -np.inf
        for k in range(start, end):
            j = order[k]
            b = min(int((middle[j, axis] - least) * scale), _BINS - 1)
            bins[b] += 1
            for i in range(3):
                around[b, i] = min(around[b, i], low[j, i])
                around[b, 3 + i] = max(around[b, 3 + i], high[j, i])
        box[:3], box[3:] = np.inf, -np.inf
        seen = 0
        for b in range(_BINS - 1):
            _grow(box, around[b])
            seen += bins[b]
            areas[b] = seen * _half_area(box)
        box[:3], box[3:] = np.inf, -np.inf
        seen = 0
        for b in range(_BINS - 1, 0, -1):
            _grow(box, around[b])
            seen += bins[b]
            cost = areas[b - 1] + seen * _half_area(box)
            if cost < best:
                best, best_axis, best_at = cost, axis, least + b / scale
    return best_axis, best_at


@njit(cache=True, nogil=True, inline="always")
def _inverse(x):  # type: ignore[no-untyped-def]
    """Return 1 / x, large instead of infinite: 0 times it must not be NaN."""
    if abs(x) < 1e-15:
        # An infinite inverse times 0 is no number where a line lies in the plane of a box's side.
        return 1e15 if x >= 0.0 else -1e15
    return 1.0 / x


@njit(cache=True, nogil=True, inline="always", fastmath=_FAST)
def _meets_box(boxes, k, ox, oy, oz, ix, iy, iz, low, high):  # type: ignore[no-untyped-def]
    """Return whether the part from ``low`` to ``high`` of a line passes a node's box."""
    a, b = (boxes[k, 0] - ox) * ix, (boxes[k, 3] - ox) * ix
    t0, t1 = max(low, min(a, b)), min(high, max(a, b))
    a, b = (boxes[k, 1] - oy) * iy, (boxes[k, 4] - oy) * iy
    t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
    a, b = (boxes[k, 2] - oz) * iz, (boxes[k, 5] - oz) * iz
    t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
    return t0 <= t1 + 1e-12


@njit(cache=True, nogil=True, inline="always", fastmath=_FAST)
def _meets_triangle(c, e1, e2, j, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Return the distance at which a line meets triangle ``j``, or infinity.

    Edges belong to both of their triangles: a line through one never slips between them.
    """
    ax, ay, az = e1[j, 0], e1[j, 1], e1[j, 2]
    bx, by, bz = e2[j, 0], e2[j, 1], e2[j, 2]
    px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
    det = ax * px + ay * py + az * pz
    if det == 0.0:
        return np.inf
    inverse = 1.0 / det
    sx, sy, sz = ox - c[j, 0], oy - c[j, 1], oz - c[j, 2]
    u = (sx * px + sy * py + sz * pz) * inverse
    # A little wider than the face: between two neighbours no line may slip through by rounding.
    if u < -_EDGE or u > 1.0 + _EDGE:
        return np.inf
    qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
    v = (dx * qx + dy * qy + dz * qz) * inverse
    if v < -_EDGE or u + v > 1.0 + _EDGE:
        return np.inf
    return (bx * qx + by * qy + bz * qz) * inverse


@njit(cache=True, nogil=True)
def line_ends(c, e1, e2, boxes, nodes, ox, oy, oz, dx, dy, dz, half, stack):  # type: ignore[no-untyped-def]
    """Return (first, its triangle, last, its triangle) on a line within ``half`` of its origin."""
    first, last, i, j = np.inf, -np.inf, -1, -1
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        a, b = nodes[stack[top], 0], nodes[stack[top], 1]
        if b == 0:
            if _meets_box(boxes, a, ox, oy, oz, ix, iy, iz, -half, half):
                stack[top] = a
                top += 1
            if _meets_box(boxes, a + 1, ox, oy, oz, ix, iy, iz, -half, half):
                stack[top] = a + 1
                top += 1
            continue
        for m in range(a, a + b):
            t = _meets_triangle(c, e1, e2, m, ox, oy, oz, dx, dy, dz)
            if -half <= t <= half:
                if t < first:
                    first, i = t, m
                if t > last:
                    last, j = t, m
    return first, i, last, j


@njit(cache=True, nogil=True)
def _ends_of_lines(c, e1, e2, boxes, nodes, lines, half):  # type: ignore[no-untyped-def]
    n = len(lines)
    at, index = np.empty((n, 2)), np.empty((n, 2), np.int64)
    stack = np.empty(_STACK, np.int64)
    for k in range(n):
        o = lines[k]
        at[k, 0], index[k, 0], at[k, 1], index[k, 1] = line_ends(
            c, e1, e2, boxes, nodes, o[0], o[1], o[2], o[3], o[4], o[5], half, stack
        )
    return at, index


@njit(cache=True, nogil=True)
def _all_of_lines(c, e1, e2, boxes, nodes, lines, low, high):  # type: ignore[no-untyped-def]
    n = len(lines)
    at, index = np.zeros((n, MAX_HITS)), np.full((n, MAX_HITS), -1, np.int64)
    counts = np.zeros(n, np.int64)
    stack = np.empty(_STACK, np.int64)
    for k in range(n):
        ox, oy, oz, dx, dy, dz = lines[k]
        ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
        stack[0], top, count = 0, 1, 0
        while top > 0:
            top -= 1
            a, b = nodes[stack[top], 0], nodes[stack[top], 1]
            if b == 0:
                for child in (a, a + 1):
                    if _meets_box(boxes, child, ox, oy, oz, ix, iy, iz, low, high):
                        stack[top] = child
                        top += 1
                continue
            for m in range(a, a + b):
                t = _meets_triangle(c, e1, e2, m, ox, oy, oz, dx, dy, dz)
                if not low <= t <= high or count == MAX_HITS:
                    continue
                p = count
                while p > 0 and at[k, p - 1] > t:
                    at[k, p], index[k, p] = at[k, p - 1], index[k, p - 1]
                    p -= 1
                at[k, p], index[k, p] = t, m
                count += 1
        counts[k] = count
    return at, index, counts
