"""Measure the contact of two pads when a hand closes, by a grid of lines through them.

One line through the middle of the pads says whether they meet an object; how it is held depends on
the patches that they press: how their mean normals lean, how far they reach, and where they are to
the centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import line_ends

__all__ = ["PadContacts", "pad_contacts", "pad_grid"]

ACROSS, ALONG = 3, 7
_COMPLIANCE_M = 0.001
_COLUMNS = 15


@dataclass(frozen=True, eq=False)
class PadContacts:
    """The patches of both pads under each error of the pose; all arrays start with (c, K).

    Parameters
    ----------
    met : (c, K) bool
        Whether both pads meet the object within the opening.
    normals : (c, K, 2, 3)
        Mean unit normal of each patch, out of the object, along the gripper's x, y and z.
    radius : (c, K, 2), m
        Root mean square distance of a patch's points from its middle.
    rays : (c, K, 2)
        How many lines each patch holds, by their share of the pressure.
    lever : (c, K, 3), m
        From the middle of the patches to the centre of mass, along the gripper's x, y and z.
    gap : (c, K), m
        Between the pads when they meet it.
    """

    met: NDArray[np.bool_]
    normals: FloatArray
    radius: FloatArray
    rays: FloatArray
    lever: FloatArray
    gap: FloatArray


def pad_grid(gripper: ParallelGripper) -> FloatArray:
    """Return places (n, 2) on a pad, m: along the gripper's y and z, evenly over the finger."""
    wide, low = gripper.finger_width, gripper.fingertip - gripper.finger_length
    y = wide * ((np.arange(ACROSS) + 0.5) / ACROSS - 0.5)
    z = low + gripper.finger_length * (np.arange(ALONG) + 0.5) / ALONG
    return np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1).reshape(-1, 2)


def pad_contacts(
    mesh: Mesh,
    poses: FloatArray,
    gripper: ParallelGripper,
    errors: FloatArray,
    openings: FloatArray,
    errors_in_object: bool = False,
) -> PadContacts:
    """Return what the pads meet.

    Parameters
    ----------
    mesh
        Of the object; its centre of mass counts.
    poses : (c, 4, 4)
        ``mesh_from_gripper``.
    errors : (K, 4, 4)
        Of the gripper, in its own frame; or in the object's frame with ``errors_in_object``.
    openings : (c,), m
        Between the jaws before closing.
    """
    places = pad_grid(gripper)
    out = np.zeros((len(poses), len(errors), _COLUMNS))
    if len(poses) and len(errors) and len(mesh.faces):
        _press(
            *mesh.tree.arrays, mesh.tree.normals, np.ascontiguousarray(poses, dtype=np.float64),
            np.ascontiguousarray(errors, dtype=np.float64), errors_in_object,
            np.ascontiguousarray(openings, dtype=np.float64), places, mesh.com, _COMPLIANCE_M, out,
        )  # fmt: skip
    normals = out[..., 9:].reshape(*out.shape[:2], 2, 3)
    return PadContacts(
        out[..., 0] > 0, normals, out[..., 2:4], out[..., 4:6], out[..., 6:9], out[..., 1]
    )


@njit(cache=True, nogil=True)
def _press(  # type: ignore[no-untyped-def]
    c, e1, e2, boxes, nodes, normals, poses, errors, in_object, openings, grid, com, soft, out
):
    """Fill ``out`` (c, K, 15) with what :class:`PadContacts` holds."""
    stack = np.empty(128, np.int64)
    rays = len(grid)
    at = np.empty((rays, 2))
    face = np.empty((rays, 2), np.int64)
    m = np.empty((3, 4))
    for g in range(len(poses)):
        p, half = poses[g], openings[g] / 2
        for k in range(len(errors)):
            e = errors[k]
            for i in range(3):
                for j in range(4):
                    a, b = (e, p) if in_object else (p, e)
                    m[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
                m[i, 3] += a[i, 3]
            first, last = np.inf, -np.inf
            for r in range(rays):
                y, z = grid[r]
                at[r, 0], face[r, 0], at[r, 1], face[r, 1] = line_ends(
                    c, e1, e2, boxes, nodes,
                    m[0, 3] + y * m[0, 1] + z * m[0, 2],
                    m[1, 3] + y * m[1, 1] + z * m[1, 2],
                    m[2, 3] + y * m[2, 1] + z * m[2, 2],
                    m[0, 0], m[1, 0], m[2, 0], half, stack,
                )  # fmt: skip
                if face[r, 0] >= 0:
                    first, last = min(first, at[r, 0]), max(last, at[r, 1])
            if not last - first > 1e-4:
                continue
            out[g, k, 0], out[g, k, 1] = 1.0, last - first
            middle_y, middle_z = 0.0, 0.0
            for jaw in range(2):
                total, sy, sz, syy = 0.0, 0.0, 0.0, 0.0
                nx, ny, nz = 0.0, 0.0, 0.0
                for r in range(rays):
                    if face[r, jaw] < 0:
                        continue
                    gap = at[r, 0] - first if jaw == 0 else last - at[r, 1]
                    w = 1.0 - gap / soft
                    if w <= 0.0:
                        continue
                    y, z = grid[r]
                    n = normals[face[r, jaw]]
                    total += w
                    sy += w * y
                    sz += w * z
                    syy += w * (y * y + z * z)
                    nx += w * n[0]
                    ny += w * n[1]
                    nz += w * n[2]
                length = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
                for i in range(3):
                    along = nx * m[0, i] + ny * m[1, i] + nz * m[2, i]
                    out[g, k, 9 + 3 * jaw + i] = along / length
                sy, sz = sy / total, sz / total
                out[g, k, 2 + jaw] = np.sqrt(max(syy / total - sy * sy - sz * sz, 0.0))
                out[g, k, 4 + jaw] = total
                middle_y += sy / 2
                middle_z += sz / 2
            dx, dy, dz = com[0] - m[0, 3], com[1] - m[1, 3], com[2] - m[2, 3]
            out[g, k, 6] = dx * m[0, 0] + dy * m[1, 0] + dz * m[2, 0] - (first + last) / 2
            out[g, k, 7] = dx * m[0, 1] + dy * m[1, 1] + dz * m[2, 1] - middle_y
            out[g, k, 8] = dx * m[0, 2] + dy * m[1, 2] + dz * m[2, 2] - middle_z
