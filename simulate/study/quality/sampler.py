"""The trivial grasp that a planner has to beat: vertical, antipodal, near the centre of mass.

It shares nothing with the planner but the gripper's sizes: meshes come from trimesh, rays are
intersected with all triangles, and room is tested on points of the surface.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import trimesh

from features.geometry import pose_matrix
from grasp.arrays import IntArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.gripper import ParallelGripper
from simulate.robots.description import Floats

__all__ = ["sampled_grasp"]

_RAYS, _POINTS, _ROLLS, _TRIED = 2000, 3000, 24, 60
_BACK_M, _TABLE_M, _AIR_M = 0.05, 0.002, 1e-4


def sampled_grasp(
    vertices: Floats,
    faces: IntArray,
    com: Floats,
    gripper: ParallelGripper,
    table: float,
    seed: int,
) -> GraspCandidate | None:  # fmt: skip
    """Return the most antipodal pair of 2,000 rays nearest to the centre of mass, from above.

    Antipodality is rounded to .01; the roll is the most vertical of 24 that touches nothing, the
    hand fully open. Pads that would reach into the table are drawn back, as far as they still hold.

    Parameters
    ----------
    vertices, faces
        Of the object as it stands, z up, m.
    com : (3,), m
    table
        Height of the table, m.
    """
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    points, face = trimesh.sample.sample_surface(mesh, _RAYS, seed=seed)
    inward = -mesh.face_normals[face]
    far, hit = _last_hits(mesh.triangles, points, inward, gripper.max_opening)
    cosine = np.einsum("ij,ij->i", mesh.face_normals[hit], inward)
    middle = points + far[:, None] / 2 * inward
    grips = (far > 1e-3) & (far < gripper.max_opening - 0.008)
    grips &= cosine >= np.cos(np.arctan(gripper.friction))
    away = np.linalg.norm(middle - com, axis=1)
    surface, _ = trimesh.sample.sample_surface(mesh, _POINTS, seed=seed + 1)
    for i in np.lexsort((away, -np.round(cosine, 2), ~grips))[:_TRIED]:
        if not grips[i]:
            break
        pose = _free_roll(inward[i], middle[i], gripper, surface, table)
        if pose is not None:
            return GraspCandidate(pose, float(far[i]), opening=gripper.max_opening)
    return None


def _last_hits(
    triangles: Floats, start: Floats, way: Floats, reach: float
) -> tuple[Floats, IntArray]:
    """Return how far (n,) the last triangle within reach is on each ray, and which (n,)."""
    a, u, v = triangles[:, 0], *(triangles[:, k] - triangles[:, 0] for k in (1, 2))
    far, which = np.zeros(len(start)), np.zeros(len(start), dtype=np.int64)
    for i, (o, d) in enumerate(zip(start, way, strict=True)):
        p = np.cross(d, v)
        det = np.einsum("ij,ij->i", u, p)
        scale = np.where(np.abs(det) > 1e-15, 1 / np.where(det == 0, 1, det), 0.0)
        q = np.cross(o - a, u)
        b, c = np.einsum("ij,ij->i", o - a, p) * scale, q @ d * scale
        t = np.einsum("ij,ij->i", v, q) * scale
        meets = (scale != 0) & (b >= 0) & (c >= 0) & (b + c <= 1) & (t > 0) & (t <= reach)
        if meets.any():
            which[i] = np.argmax(np.where(meets, t, -1.0))
            far[i] = t[which[i]]
    return far, which


def _free_roll(
    x: Floats, at: Floats, gripper: ParallelGripper, surface: Floats, table: float
) -> Floats | None:
    """Return the most vertical free pose (4, 4) that closes along ``x`` at a point."""
    down = np.array([0.0, 0.0, -1.0]) - x * -x[2]
    if np.linalg.norm(down) < 0.05:
        down = np.cross(x, [1.0, 0.0, 0.0])
    down /= np.linalg.norm(down)
    boxes = gripper.boxes(gripper.max_opening, _BACK_M)
    corners = np.array([c for box in boxes for c in product(*box.T)])
    for angle in sorted(2 * np.pi * np.arange(_ROLLS) / _ROLLS, key=lambda a: -np.cos(a)):
        z = np.cos(angle) * down + np.sin(angle) * np.cross(x, down)
        pose = pose_matrix(np.stack([x, np.cross(z, x), z], axis=1), at)
        lack = table + _TABLE_M - at[2] - float((corners @ pose[2, :3]).min())
        if lack > 0:
            if -z[2] < 0.5 or lack > (gripper.fingertip - 0.002) * -z[2]:
                continue
            pose[:3, 3] += lack / z[2] * z
        local = (surface - pose[:3, 3]) @ pose[:3, :3]
        inside = (local[:, None] > boxes[:, 0] + _AIR_M) & (local[:, None] < boxes[:, 1] - _AIR_M)
        if not inside.all(axis=2).any():
            return pose
    return None
