"""Single depth views of meshes on a table, and the labels of grasps found on them.

A view corresponds to a robot's camera. Whether a candidate is correct is decided on the whole mesh:
both jaws must meet it within their friction cones, and the gripper must get there without touching
anything (Gatto 2016, 3.3.3; ten Pas and Platt 2015, 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, look_at, transform
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support, Surroundings, room_around
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import NOTHING, crossings, first_and_last
from simulate.robots.description import Floats
from simulate.world.camera import INTRINSICS
from simulate.world.noise import SensorNoise

__all__ = ["TABLE", "View", "correct", "depth_frame", "depth_view", "sample_camera"]

TABLE = np.array([0.0, 0.0, 1.0, 0.0])
"""Plane on which meshes stand: z = 0."""

_MARGIN_PX = 24
_TABLE_EDGE_M = 0.06
_SAME_M = 1e-4


@dataclass(frozen=True)
class View:
    """View of an object on a table by one camera.

    Parameters
    ----------
    points : (n, 3), m
        Object and the table near it, frame of the mesh.
    viewpoint : (3,), m
    """

    points: Floats
    viewpoint: Floats


def sample_camera(rng: np.random.Generator) -> Floats:
    """Return a camera position like a small humanoid's, m: 35 to 55 cm away, 30 to 60 deg up."""
    distance, elevation = rng.uniform(0.35, 0.55), np.deg2rad(rng.uniform(30, 60))
    azimuth = rng.uniform(0, 2 * np.pi)
    return distance * np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )


def depth_frame(
    mesh: Mesh,
    viewpoint: Floats,
    noise: SensorNoise | None = None,
    seed: int = 0,
) -> tuple[Frame, Floats]:
    """Render a mesh on the table z = 0 as a frame around the mesh.

    Parameters
    ----------
    viewpoint : (3,), m
        Of the camera, which looks at the mesh's middle.
    noise
        None = exact depth.
    seed
        Of the noise.

    Returns
    -------
    Frame
        Its mask has the pixels whose lines meet the mesh before the table.
    world_from_camera : (4, 4), m
    """
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    world_from_camera = look_at(viewpoint, middle)
    rotation = world_from_camera[:3, :3]
    corners = (mesh.vertices - viewpoint) @ rotation
    camera = INTRINSICS
    u = camera.fx * corners[:, 0] / corners[:, 2] + camera.cx
    v = camera.fy * corners[:, 1] / corners[:, 2] + camera.cy
    x0, x1 = (
        int(np.clip(e, 0, camera.width)) for e in (u.min() - _MARGIN_PX, u.max() + _MARGIN_PX)
    )
    y0, y1 = (
        int(np.clip(e, 0, camera.height)) for e in (v.min() - _MARGIN_PX, v.max() + _MARGIN_PX)
    )
    columns, rows = np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))
    rays = np.stack(
        [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)],
        axis=-1,
    ).reshape(-1, 3)
    scale = np.linalg.norm(rays, axis=1)
    lines = (rays / scale[:, None]) @ rotation.T
    # The first crossing within a range around the object is what the camera sees.
    half = float(np.linalg.norm(mesh.extent)) + 0.01
    away = float(np.linalg.norm(middle - viewpoint))
    at, face = first_and_last(mesh.tree, viewpoint + away * lines, lines, half)
    distance = np.where(face[:, 0] != NOTHING, away + at[:, 0], np.inf)
    down = lines[:, 2] < -1e-6
    table = np.where(down, -viewpoint[2] / np.where(down, lines[:, 2], -1.0), np.inf)
    depth = np.minimum(distance, table) / scale
    depth = np.where(np.isfinite(depth) & (depth < 5.0), depth, 0.0).reshape(rows.shape)
    mask = (np.isfinite(distance) & (distance < table)).reshape(rows.shape)
    frame = Frame(depth.astype(np.float32), camera, x0=x0, y0=y0, mask=mask)
    if noise is not None:
        frame = noise.apply(frame, np.random.default_rng(seed))
    return frame, world_from_camera


def depth_view(
    mesh: Mesh,
    viewpoint: Floats,
    noise: SensorNoise | None = None,
    seed: int = 0,
) -> View:
    """Return the points that a camera sees of a mesh on the table z = 0, as :func:`depth_frame`."""
    frame, world_from_camera = depth_frame(mesh, viewpoint, noise, seed)
    points = frame.points().reshape(-1, 3)
    points = transform(world_from_camera, points[np.isfinite(points).all(axis=1)].astype(float))
    low, high = mesh.vertices.min(axis=0) - _TABLE_EDGE_M, mesh.vertices.max(axis=0) + _TABLE_EDGE_M
    near = np.all((points[:, :2] > low[:2]) & (points[:, :2] < high[:2]), axis=1)
    return View(np.asarray(points[near], np.float64), np.asarray(viewpoint, np.float64))


def correct(
    candidates: Sequence[GraspCandidate],
    mesh: Mesh,
    gripper: ParallelGripper,
) -> NDArray[np.bool_]:
    """Return which candidates (n,) hold the whole mesh.

    Both jaws, coming from outside along the closing line, meet the surface within the friction
    cone, and the open gripper gets there along its approach free of object and table.

    Parameters
    ----------
    mesh
        On the table z = 0, in the candidates' frame.
    """
    if len(candidates) == 0:
        return np.empty(0, bool)
    poses = np.stack([c.frame_from_gripper for c in candidates])
    openings = np.array([c.opening or gripper.max_opening for c in candidates])
    closing = np.ascontiguousarray(poses[:, :3, 0])
    centres = np.ascontiguousarray(poses[:, :3, 3])
    half = gripper.max_opening / 2
    at, face, counts = crossings(mesh.tree, centres, closing, -half, half)
    between = np.arange(at.shape[1]) < counts[:, None]
    between &= np.abs(at) <= openings[:, None] / 2
    first = np.argmax(between, axis=1)
    last = at.shape[1] - 1 - np.argmax(between[:, ::-1], axis=1)
    along = np.einsum("nki,ni->nk", mesh.tree.normals[face], closing)
    rows = np.arange(len(poses))
    least = np.cos(np.arctan(gripper.friction))
    held = between.any(axis=1) & (at[rows, last] - at[rows, first] > _SAME_M)
    held &= (-along[rows, first] >= least) & (along[rows, last] >= least)
    room = room_around(poses, openings, gripper, Surroundings(Support()), mesh=mesh)
    return np.asarray(held & room.free)
