"""The inner loop of the features between the fingers (compiled)."""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["SUMS", "sum_between"]

SUMS = 14
"""Numbers that :func:`sum_between` returns of each grasp."""


@numba.njit(cache=True, nogil=True)
def sum_between(points, normals, completed, poses, signs, boxes, cos):  # type: ignore[no-untyped-def]
    """Return sums (n, 14) over the points between the fingers of each grasp.

    Number of all; number in the left, middle and right third of the width and sums of their z, m;
    number whose normal opposes the left jaw, the right one, faces the palm; number completed; sums
    of the normals' x, y, z. All in the gripper's frame, x turned by ``signs``.

    Parameters
    ----------
    points, normals, completed : (m, 3), m; (m, 3); (m,) bool
    poses : (n, 4, 4)
        frame_from_gripper.
    signs : (n,)
        1, or -1 where x is turned.
    boxes : (n, 5), m
        Half the opening, half the slice across the fingers, z of the palm's and of the tips' end
        of the fingers, a sixth of the width.
    cos
        Cosine below which a normal is no longer opposed.
    """
    out = np.zeros((len(poses), SUMS))
    for k in range(len(poses)):
        pose, sign = poses[k], signs[k]
        half, slice_, low, high, third = boxes[k]
        for i in range(len(points)):
            x = y = z = 0.0
            for j in range(3):
                away = points[i, j] - pose[j, 3]
                x += away * pose[j, 0]
                y += away * pose[j, 1]
                z += away * pose[j, 2]
            if not (abs(y) < slice_ and abs(x) < half and low < z < high):
                continue
            x *= sign
            part = 1 if abs(x) <= third else (0 if x < 0 else 2)
            nx = ny = nz = 0.0
            for j in range(3):
                nx += normals[i, j] * pose[j, 0]
                ny += normals[i, j] * pose[j, 1]
                nz += normals[i, j] * pose[j, 2]
            nx *= sign
            out[k, 0] += 1
            out[k, 1 + part] += 1
            out[k, 4 + part] += z
            out[k, 7] += nx < -cos
            out[k, 8] += nx > cos
            out[k, 9] += nz < -cos
            out[k, 10] += completed[i]
            out[k, 11] += nx
            out[k, 12] += ny
            out[k, 13] += nz
    return out
