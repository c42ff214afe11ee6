"""Depth images of posed meshes, for metrics that compare what can be seen."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray, Intrinsics

__all__ = ["render_depth"]

_NEAR_M = 0.01


def render_depth(
    vertices: FloatArray,
    faces: NDArray[np.integer[Any]],
    camera: Intrinsics,
    camera_from_object: FloatArray,
) -> NDArray[np.float32]:
    """Return the depth (h, w), m, of a posed mesh; 0 where there is none.

    Faces are seen from both sides; a face that reaches nearer than 1 cm to the camera is left out.

    Parameters
    ----------
    vertices : (v, 3) float, m, object frame
    faces : (f, 3) int
    camera_from_object : (4, 4) float, m

    Examples
    --------
    >>> square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.1
    >>> pose = np.eye(4); pose[2, 3] = 0.5
    >>> camera = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    >>> depth = render_depth(square, np.array([[0, 1, 2], [0, 2, 3]]), camera, pose)
    >>> round(float(depth[24, 32]), 3), int((depth > 0).sum())
    (0.5, 576)
    """
    pose = np.asarray(camera_from_object, np.float64)
    places = np.asarray(vertices, np.float64) @ pose[:3, :3].T + pose[:3, 3]
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    size = (camera.height, camera.width)
    depth: NDArray[np.float32] = _filled(places, np.asarray(faces, np.int64), lens, size)
    return depth


@numba.njit(cache=True, nogil=True)
def _filled(
    places: NDArray[np.float64],
    faces: NDArray[np.int64],
    lens: NDArray[np.float64],
    size: tuple[int, int],
) -> NDArray[np.float32]:
    """Return the nearest depth of all triangles at the pixel centres (perspective correct)."""
    height, width = size
    depth = np.zeros((height, width), np.float32)
    for f in range(faces.shape[0]):
        a, b, c = places[faces[f, 0]], places[faces[f, 1]], places[faces[f, 2]]
        if min(a[2], b[2], c[2]) < _NEAR_M:
            continue
        ua, va = lens[0] * a[0] / a[2] + lens[2], lens[1] * a[1] / a[2] + lens[3]
        ub, vb = lens[0] * b[0] / b[2] + lens[2], lens[1] * b[1] / b[2] + lens[3]
        uc, vc = lens[0] * c[0] / c[2] + lens[2], lens[1] * c[1] / c[2] + lens[3]
        area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
        if abs(area) < 1e-12:
            continue
        left = max(int(np.ceil(min(ua, ub, uc))), 0)
        right = min(int(np.floor(max(ua, ub, uc))), width - 1)
        top = max(int(np.ceil(min(va, vb, vc))), 0)
        bottom = min(int(np.floor(max(va, vb, vc))), height - 1)
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                p = ((ub - u) * (vc - v) - (uc - u) * (vb - v)) / area
                q = ((uc - u) * (va - v) - (ua - u) * (vc - v)) / area
                r = 1.0 - p - q
                if p < -1e-9 or q < -1e-9 or r < -1e-9:
                    continue
                z = np.float32(1.0 / (p / a[2] + q / b[2] + r / c[2]))
                if depth[v, u] == 0 or z < depth[v, u]:
                    depth[v, u] = z
    return depth
