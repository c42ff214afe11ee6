"""Boxes of a gripper against triangles and points: compiled tests in the gripper frame."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["boxes_meet_mesh", "distance_to_points"]

_DEPTH = 128


@njit(cache=True, nogil=True)
def _separated(px, py, pz, ax, ay, az, h, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether the axis (x, y, z) parts a triangle from a box of half size ``h``."""
    a = px[0] * x + py[0] * y + pz[0] * z
    b = px[1] * x + py[1] * y + pz[1] * z
    c = px[2] * x + py[2] * y + pz[2] * z
    middle = ax * x + ay * y + az * z
    r = h[0] * abs(x) + h[1] * abs(y) + h[2] * abs(z)
    return min(a, b, c) - middle > r or max(a, b, c) - middle < -r


@njit(cache=True, nogil=True)
def _meets(px, py, pz, low, high, h):  # type: ignore[no-untyped-def]
    """Return whether a triangle and a box overlap: separating axes (Akenine-Moeller 2001)."""
    for p, i in ((px, 0), (py, 1), (pz, 2)):
        if min(p[0], p[1], p[2]) > high[i] or max(p[0], p[1], p[2]) < low[i]:
            return False
    for i in range(3):
        h[i] = (high[i] - low[i]) / 2
    ax, ay, az = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2
    ux, uy, uz = px[1] - px[0], py[1] - py[0], pz[1] - pz[0]
    vx, vy, vz = px[2] - px[0], py[2] - py[0], pz[2] - pz[0]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    if _separated(px, py, pz, ax, ay, az, h, nx, ny, nz):
        return False
    for ex, ey, ez in ((ux, uy, uz), (vx, vy, vz), (vx - ux, vy - uy, vz - uz)):
        if (
            _separated(px, py, pz, ax, ay, az, h, 0.0, -ez, ey)
            or _separated(px, py, pz, ax, ay, az, h, ez, 0.0, -ex)
            or _separated(px, py, pz, ax, ay, az, h, -ey, ex, 0.0)
        ):
            return False
    return True


@njit(cache=True, nogil=True)
def _near(node, r, back, boxes, middle, half):  # type: ignore[no-untyped-def]
    """Return whether a node's box (6,), turned into the gripper frame, comes near some box."""
    for i in range(3):
        m, h = -back[i], 0.0
        for k in range(3):
            m += r[k, i] * (node[k] + node[3 + k]) / 2
            h += abs(r[k, i]) * (node[3 + k] - node[k]) / 2
        middle[i], half[i] = m, h
    for b in range(len(boxes)):
        apart = False
        for i in range(3):
            if middle[i] + half[i] < boxes[b, 0, i] or middle[i] - half[i] > boxes[b, 1, i]:
                apart = True
        if not apart:
            return True
    return False


@njit(cache=True, nogil=True)
def boxes_meet_mesh(corners, edge_1, edge_2, tree_boxes, nodes, poses, boxes):  # type: ignore[no-untyped-def]
    """Return which grippers touch a mesh.

    Parameters
    ----------
    corners, edge_1, edge_2, tree_boxes, nodes
        Of a :class:`grasp.spatial.meshes.rays.Tree`.
    poses : (c, 4, 4)
        ``mesh_from_gripper``.
    boxes : (c, b, 2, 3)
        Of each gripper in its own frame, m.

    Returns
    -------
    (c,) bool
    """
    out = np.zeros(len(poses), np.bool_)
    stack = np.empty(_DEPTH, np.int64)
    px, py, pz, h, back = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    middle, half = np.empty(3), np.empty(3)
    for g in range(len(poses)):
        r = poses[g, :3, :3]
        for i in range(3):
            back[i] = r[0, i] * poses[g, 0, 3] + r[1, i] * poses[g, 1, 3] + r[2, i] * poses[g, 2, 3]
        stack[0], top = 0, 1
        while top > 0 and not out[g]:
            top -= 1
            node = stack[top]
            if not _near(tree_boxes[node], r, back, boxes[g], middle, half):
                continue
            a, count = nodes[node, 0], nodes[node, 1]
            if count == 0:
                stack[top], stack[top + 1] = a, a + 1
                top += 2
                continue
            for m in range(a, a + count):
                for j in range(3):
                    x, y, z = corners[m, 0], corners[m, 1], corners[m, 2]
                    if j == 1:
                        x, y, z = x + edge_1[m, 0], y + edge_1[m, 1], z + edge_1[m, 2]
                    elif j == 2:
                        x, y, z = x + edge_2[m, 0], y + edge_2[m, 1], z + edge_2[m, 2]
                    px[j] = r[0, 0] * x + r[1, 0] * y + r[2, 0] * z - back[0]
                    py[j] = r[0, 1] * x + r[1, 1] * y + r[2, 1] * z - back[1]
                    pz[j] = r[0, 2] * x + r[1, 2] * y + r[2, 2] * z - back[2]
                for b in range(boxes.shape[1]):
                    if not out[g]:
                        out[g] = _meets(px, py, pz, boxes[g, b, 0], boxes[g, b, 1], h)
    return out


@njit(cache=True, nogil=True)
def distance_to_points(points, poses, boxes, far):  # type: ignore[no-untyped-def]
    """Return the distance (c,) from each gripper's boxes to the nearest point, at most ``far``.

    Parameters
    ----------
    points : (n, 3)
        In the frame of ``poses``.
    poses : (c, 4, 4)
    boxes : (c, b, 2, 3)
    far
        m.

    Returns
    -------
    (c,), m
        0 where a point lies in a box.
    """
    out = np.full(len(poses), far)
    for g in range(len(poses)):
        r, t = poses[g, :3, :3], poses[g, :3, 3]
        best = far * far
        for k in range(len(points)):
            dx, dy, dz = points[k, 0] - t[0], points[k, 1] - t[1], points[k, 2] - t[2]
            x = r[0, 0] * dx + r[1, 0] * dy + r[2, 0] * dz
            y = r[0, 1] * dx + r[1, 1] * dy + r[2, 1] * dz
            z = r[0, 2] * dx + r[1, 2] * dy + r[2, 2] * dz
            for b in range(boxes.shape[1]):
                box = boxes[g, b]
                ex = max(box[0, 0] - x, 0.0, x - box[1, 0])
                ey = max(box[0, 1] - y, 0.0, y - box[1, 1])
                ez = max(box[0, 2] - z, 0.0, z - box[1, 2])
                best = min(best, ex * ex + ey * ey + ez * ez)
        out[g] = np.sqrt(best)
    return out
