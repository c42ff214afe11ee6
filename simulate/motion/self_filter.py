"""Self filter: points of a cloud on the robot's own body, or hidden behind it.

The body is the union of the collision shapes of its links, placed by the joint values. A camera
that knows its own pose never sees a point behind a closed body, so what lies there comes from
noise at the outline, from joints that were read late, or from a body that is bigger than its model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from features.geometry import transform
from rtask.errors import RobotError, nearest
from simulate.motion.collision import link_poses
from simulate.robots.description import Floats, Joint, Link, Shape
from simulate.robots.mesh_files import load_mesh

if TYPE_CHECKING:
    import open3d

__all__ = ["Body", "SelfSeen"]

_ROUND_SECTIONS = 48
_BALL_SUBDIVISIONS = 3
_HOUSING_M = 0.05
"""Nearer parts are what the camera is mounted in; depth cameras measure nothing so near."""
_HIT_M = 1e-4
"""A ray that meets the body so shortly before a point ends on the body."""


@dataclass(frozen=True)
class SelfSeen:
    """Two masks (n,) over the points of a cloud, which exclude each other."""

    on_body: NDArray[np.bool_]
    """not further from a surface of the body than the padding"""
    behind: NDArray[np.bool_]
    """inside the body or hidden by it"""


@dataclass(frozen=True)
class _Surface:
    """Triangles of one shape in the frame of its link."""

    link: str
    vertices: Floats
    faces: NDArray[np.uint32]


class Body:
    """The surface of a robot.

    Parameters
    ----------
    root
        Name of the link that others hang on.
    links
        With their collision shapes.
    joints
        Parents before children.

    Raises
    ------
    RobotError
        No link has a shape, or a mesh cannot be read.
    """

    def __init__(self, root: str, links: Sequence[Link], joints: Sequence[Joint]) -> None:
        self.root = root
        self._joints = tuple(joints)
        self._parent = {joint.child: joint for joint in joints}
        self._surfaces = [
            _Surface(link.name, *_triangles(shape)) for link in links for shape in link.shapes
        ]
        if not self._surfaces:
            raise RobotError("the model has no collision shapes, so nothing tells its body")
        self._links = {link.name for link in links}

    def has_link(self, name: str) -> bool:
        """Tell whether there is a link of that name."""
        return name in self._links

    def poses(self, values: Mapping[str, float], camera: str | None = None) -> dict[str, Floats]:
        """Return ``root_from_link`` (4, 4) of each link.

        Parameters
        ----------
        values
            Of the joints, rad, or m of prismatic ones. Joints that follow another need none.
        camera
            Link whose pose is needed beside those of the links with shapes; None = none.

        Raises
        ------
        RobotError
            A joint that moves the body or the camera has no value, or there is no such joint.
        """
        joint_of_name = {joint.name: joint for joint in self._joints}
        for name in values:
            if name not in joint_of_name:
                raise RobotError(
                    f"the robot has no joint {name!r}{nearest(name, list(joint_of_name))}"
                )
        complete = dict(values)
        for joint in self._joints:
            if joint.mimic is not None and joint.mimic[0] in complete:
                source, factor = joint.mimic
                complete.setdefault(joint.name, factor * complete[source] + joint.mimic_offset)
        missing = [name for name in self._movers(camera) if name not in complete]
        if missing:
            raise RobotError(f"no position of {', '.join(missing)}; without it the body is unknown")
        return {self.root: np.eye(4), **link_poses(self.root, self._joints, complete)}

    def _movers(self, camera: str | None) -> list[str]:
        """Return the joints that move a shape or the camera."""
        movers = set()
        for link in {*(surface.link for surface in self._surfaces), *([camera] if camera else [])}:
            while link in self._parent:
                joint = self._parent[link]
                if joint.kind != "fixed":
                    movers.add(joint.name)
                link = joint.parent
        return [joint.name for joint in self._joints if joint.name in movers]

    def seen(
        self,
        points: Floats,
        poses: Mapping[str, Floats],
        root_from_camera: Floats,
        padding_m: float,
    ) -> SelfSeen:
        """Tell which points show the body.

        Parameters
        ----------
        points : (n, 3) float, m
            Camera frame, finite.
        poses
            ``root_from_link`` (4, 4) of each link, from :meth:`poses`.
        root_from_camera : (4, 4) float
            Pose of the frame that the points are in.
        padding_m
            How far from the surface a point still belongs to the body.
        """
        camera_from_root = np.linalg.inv(root_from_camera)
        placed = [
            _moved(camera_from_root @ poses[surface.link], surface.vertices)
            for surface in self._surfaces
        ]
        distances = _distances(points, placed, self._surfaces)
        on_body = distances <= padding_m
        behind = np.zeros(len(points), dtype=bool)
        # What the camera is mounted in or on does not hide anything from it.
        hiding = [
            (vertices, surface)
            for vertices, surface in zip(placed, self._surfaces, strict=True)
            if not _houses_camera(vertices, surface)
        ]
        if hiding and not on_body.all():
            rest = ~on_body
            vertices_hiding, surfaces = zip(*hiding, strict=True)
            behind[rest] = _hidden(points[rest], vertices_hiding, surfaces)
        return SelfSeen(on_body, behind)


def _triangles(shape: Shape) -> tuple[Floats, NDArray[np.uint32]]:
    """Return vertices (v, 3), m, frame of the link, and faces (f, 3) of a shape."""
    import trimesh

    creation = trimesh.creation
    if shape.kind == "mesh":
        mesh = load_mesh(Path(shape.path))
    elif shape.kind == "box":
        mesh = creation.box(extents=shape.size)
    elif shape.kind == "sphere":
        mesh = creation.icosphere(subdivisions=_BALL_SUBDIVISIONS, radius=shape.size[0])
    else:
        mesh = creation.cylinder(shape.size[0], shape.size[1], sections=_ROUND_SECTIONS)
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if shape.kind == "mesh":
        vertices = vertices * np.array(shape.size)
    return _moved(shape.pose.matrix, vertices), np.asarray(mesh.faces, dtype=np.uint32)


def _moved(target_from_source: Floats, points: Floats) -> Floats:
    return np.asarray(transform(target_from_source, points), dtype=np.float64)


def _scene(
    placed: Sequence[Floats], surfaces: Sequence[_Surface]
) -> open3d.t.geometry.RaycastingScene:
    """Return the triangles as a scene of Open3D (Embree)."""
    import open3d

    # One thread: the workers of a service share the machine's cores already.
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    offsets = np.cumsum([0, *(len(vertices) for vertices in placed)])
    faces = [surface.faces + offset for surface, offset in zip(surfaces, offsets, strict=False)]
    scene.add_triangles(
        open3d.core.Tensor.from_numpy(np.concatenate(placed).astype(np.float32)),
        open3d.core.Tensor.from_numpy(np.concatenate(faces).astype(np.uint32)),
    )
    return scene


def _distances(points: Floats, placed: Sequence[Floats], surfaces: Sequence[_Surface]) -> Floats:
    """Return the distances (n,), m, from points to the nearest surface."""
    import open3d

    queries = open3d.core.Tensor.from_numpy(points.astype(np.float32))
    distances = _scene(placed, surfaces).compute_distance(queries, nthreads=1)
    return np.asarray(distances.numpy(), dtype=np.float64)


def _hidden(
    points: Floats, placed: Sequence[Floats], surfaces: Sequence[_Surface]
) -> NDArray[np.bool_]:
    """Return which points (n,) lie behind a surface as seen from the origin."""
    import open3d

    depths = np.linalg.norm(points, axis=1)
    ways = points / np.maximum(depths, _HIT_M)[:, None]
    rays = np.concatenate([np.zeros_like(ways), ways], axis=1).astype(np.float32)
    met = _scene(placed, surfaces).cast_rays(open3d.core.Tensor.from_numpy(rays), nthreads=1)
    return np.asarray(met["t_hit"].numpy() < depths - _HIT_M)


def _houses_camera(vertices: Floats, surface: _Surface) -> bool:
    """Return whether the origin lies in a shape, or nearly on it.

    Inside is where the triangles, seen from the origin, cover more than half of the sphere around
    it: the winding number by solid angles (Van Oosterom and Strackee 1983), which bears meshes
    with small holes.
    """
    low, high = vertices.min(axis=0) - _HOUSING_M, vertices.max(axis=0) + _HOUSING_M
    if (low > 0).any() or (high < 0).any():
        return False
    if _distances(np.zeros((1, 3)), [vertices], [surface])[0] <= _HOUSING_M:
        return True
    a, b, c = (vertices[surface.faces[:, k]] for k in range(3))
    la, lb, lc = (np.linalg.norm(edge, axis=1) for edge in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a))]
    flat = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    turns = np.arctan2(volume, flat).sum() / (2 * np.pi)
    return bool(abs(turns) > 0.5)
