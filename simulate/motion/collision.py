"""Clearance of an arm: spheres on its links against rounded boxes around it.

The arm is covered by spheres, everything else is a box with rounded edges (a sphere and a capsule
are such boxes too), so that the signed distance of many postures to the whole surrounding is a
handful of array operations. No simulator is involved: obstacles are what the robot perceived and
what it knows about its own body.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simulate.motion.kinematics import Chain
from simulate.robots.description import (
    Arm,
    Floats,
    Joint,
    RobotDescription,
    Shape,
    rotation_from_rpy,
    transform_from,
)
from simulate.robots.mesh_cover import cover_mesh, cover_surface, hull_boxes

__all__ = ["ArmSpheres", "Obstacle", "PointField", "Surroundings", "body_obstacles", "link_poses"]

_BALL = 0.2
_COARSE_M = 0.12
"""Radius of a sphere from which on a body is covered by boxes instead."""
_BOX_SPHERE = 0.0125
_CELL_M, _FIELD_PAD_M, _MAX_CELLS = 0.006, 0.10, 8e6
_PRISM_ANGLES = np.deg2rad(np.arange(0, 90, 5))


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A box with rounded edges in the base frame.

    Parameters
    ----------
    name
        For messages and for slack: ``table``, ``target``, ``neighbour`` ...
    centre : (3,) float, m
    half : (3,) float, m
        Half sizes without the rounding; zeros make a sphere or a capsule.
    rotation : (3, 3) float
    radius
        Rounding, m.
    is_cylinder
        Round about its z axis, ``half[0]`` being the radius: a can has a sharp rim.
    """

    name: str
    centre: Floats
    half: Floats
    rotation: Floats
    radius: float = 0.0
    is_cylinder: bool = False

    @classmethod
    def box(
        cls,
        name: str,
        centre: Sequence[float],
        size: Sequence[float],
        yaw: float = 0.0,
    ) -> Obstacle:
        """Return an upright box of full ``size`` (m), turned by ``yaw`` (rad)."""
        half = np.asarray(size, dtype=np.float64) / 2
        return cls(name, np.asarray(centre, float), half, rotation_from_rpy((0, 0, yaw)))

    @classmethod
    def around(cls, name: str, points: Floats, floor: float, margin: float = 0.0) -> Obstacle:
        """Return the upright prism over the smallest rectangle around seen points.

        Parameters
        ----------
        name
            Of the obstacle.
        points : (n, 3) float, m, base frame
        floor
            Height (m) down to which the object extends unseen: that of the table.
        margin
            m, added on every side.
        """
        points = np.asarray(points, dtype=np.float64)
        points = points[np.isfinite(points).all(axis=1)] if points.ndim == 2 else points
        if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
            raise ValueError(f"expected points of shape (n, 3) in m, got {points.shape}")
        cos, sin = np.cos(_PRISM_ANGLES), np.sin(_PRISM_ANGLES)
        axes = np.stack([np.stack([cos, sin], 1), np.stack([-sin, cos], 1)], axis=1)
        along = axes @ points[:, :2].T
        low, high = along.min(axis=2), along.max(axis=2)
        best = int(np.argmin(np.prod(high - low, axis=1)))
        middle = (low[best] + high[best]) / 2 @ axes[best]
        top = max(float(points[:, 2].max()), floor)
        size = [*(high[best] - low[best] + 2 * margin), top - floor + margin]
        centre = [*middle, floor + size[2] / 2]
        return cls.box(name, centre, size, float(_PRISM_ANGLES[best]))

    @classmethod
    def upright(
        cls, name: str, x: float, y: float, floor: float, size: Sequence[float]
    ) -> Obstacle:
        """Return an upright round obstacle of (diameter, height) m at (x, y) on a floor.

        If it is as high as it is wide it is a ball, otherwise a cylinder.
        """
        diameter, height = size
        centre = np.array([x, y, floor + height / 2])
        if abs(height - diameter) < _BALL * diameter:
            return cls(name, centre, np.zeros(3), np.eye(3), diameter / 2)
        half = np.array([diameter / 2, diameter / 2, height / 2])
        return cls(name, centre, half, np.eye(3), is_cylinder=True)


@dataclass(frozen=True, eq=False)
class PointField:
    """Seen points as an obstacle of any shape: the distance to the nearest, on a grid.

    Parameters
    ----------
    name
        As of an :class:`Obstacle`.
    origin : (3,) float, m
        Centre of the first cell, base frame.
    cell
        Edge of a cell, m.
    away : (nx, ny, nz) float, m
        Distance of each cell to the surface of the nearest occupied one.
    """

    name: str
    origin: Floats
    cell: float
    away: Floats

    @classmethod
    def of(
        cls, name: str, points: Floats, floor: float | None = None, cell: float = _CELL_M
    ) -> PointField:
        """Return the field around points.

        Parameters
        ----------
        points : (n, 3) float, m, base frame
            At least one.
        floor
            Height (m) down to which everything below a point counts as occupied, because no camera
            saw it; None = the points alone.
        """
        points = np.asarray(points, dtype=np.float64)
        points = points[np.isfinite(points).all(axis=1)] if points.ndim == 2 else points
        if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
            raise ValueError(f"expected points of shape (n, 3) in m, got {points.shape}")
        low = points.min(axis=0)
        if floor is not None:
            low[2] = min(low[2], floor)
        low = low - _FIELD_PAD_M
        shape = np.ceil((points.max(axis=0) + _FIELD_PAD_M - low) / cell).astype(int) + 1
        if np.prod(shape.astype(float)) > _MAX_CELLS:
            raise ValueError(
                f"points spread over {np.ptp(points, axis=0).round(2)} m are too many cells of "
                f"{cell} m: cut the scene to the workplace"
            )
        taken = np.zeros(shape, dtype=bool)
        taken[tuple(np.rint((points - low) / cell).astype(int).T)] = True
        if floor is not None:
            below = np.flip(np.logical_or.accumulate(np.flip(taken, axis=2), axis=2), axis=2)
            heights = low[2] + cell * np.arange(shape[2])
            taken = below & (heights >= min(floor, float(points[:, 2].min())))[None, None]
        # Here, because servers import this file at their start and keep no distances yet.
        from scipy.ndimage import distance_transform_edt

        away = distance_transform_edt(~taken, sampling=cell) - cell / 2
        return cls(name, low, cell, np.asarray(away, dtype=np.float64))

    def distances(self, points: Floats) -> Floats:
        """Return the distance (n,) of points (n, 3), m; a lower bound outside the grid."""
        last = np.array(self.away.shape) - 1
        place = (points - self.origin) / self.cell
        inside = np.clip(place, 0, last)
        index = np.rint(inside).astype(np.int64)
        beyond = self.cell * np.linalg.norm(place - inside, axis=1)
        distances = self.away[index[:, 0], index[:, 1], index[:, 2]]
        return np.asarray(np.where(beyond > 0, beyond + _FIELD_PAD_M - self.cell, distances))


@dataclass(frozen=True)
class Surroundings:
    """Everything that an arm can hit, with the distance to all of it at once."""

    obstacles: tuple[Obstacle, ...]
    fields: tuple[PointField, ...] = ()

    def with_obstacles(self, more: Iterable[Obstacle | PointField]) -> Surroundings:
        """Return the surroundings with further obstacles."""
        more = tuple(more)
        boxes = tuple(obstacle for obstacle in more if isinstance(obstacle, Obstacle))
        fields = tuple(obstacle for obstacle in more if isinstance(obstacle, PointField))
        return Surroundings((*self.obstacles, *boxes), (*self.fields, *fields))

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each row of :meth:`distances`: the obstacles, then the fields."""
        return (*(o.name for o in self.obstacles), *(f.name for f in self.fields))

    def distances(self, points: Floats) -> Floats:
        """Return signed distances (m obstacles and fields, n) of points (n, 3), m, base frame."""
        boxes = self._box_distances(points)
        return np.vstack([boxes, *(field.distances(points) for field in self.fields)])

    def _box_distances(self, points: Floats) -> Floats:
        if not self.obstacles:
            return np.empty((0, len(points)))
        inverse = np.concatenate([o.rotation.T for o in self.obstacles])
        local = (inverse @ points.T).reshape(len(self.obstacles), 3, len(points))
        centres = np.stack([o.rotation.T @ o.centre for o in self.obstacles])
        halves = np.stack([o.half for o in self.obstacles])
        local = local - centres[:, :, None]
        outside = np.abs(local) - halves[:, :, None]
        for row, obstacle in enumerate(self.obstacles):
            if obstacle.is_cylinder:
                outside[row, 0] = np.hypot(local[row, 0], local[row, 1]) - obstacle.half[0]
                outside[row, 1] = -np.inf
        positive = np.maximum(outside, 0.0)
        away = np.sqrt(np.einsum("mdn,mdn->mn", positive, positive))
        radii = np.array([o.radius for o in self.obstacles])[:, None]
        distances: Floats = away + np.minimum(outside.max(axis=1), 0.0) - radii
        return distances


@dataclass(frozen=True)
class ArmSpheres:
    """Spheres that cover an arm, its hand at one opening, and what it carries.

    Parameters
    ----------
    chain
        The arm.
    link : (n,) int
        Index of the chain's link that a sphere rides on.
    centres : (n, 3) float, m
        In the frame of that link.
    radii : (n,) float, m
    group : (n,) str
        ``upper`` (up to the elbow), ``forearm``, ``palm``, ``finger`` or ``load``.
    """

    chain: Chain
    link: NDArray[np.int64]
    centres: Floats
    radii: Floats
    group: NDArray[np.str_]

    @classmethod
    def of(cls, robot: RobotDescription, arm: Arm, opening: float) -> ArmSpheres:
        """Cover an arm whose hand is open by a fraction 0 (closed) to 1.

        The wrist behind a cup, which is short and thin, is covered by small spheres: large ones
        would reach almost as far as the lip. It counts as forearm, since it may touch nothing.
        """
        chain = Chain.of(robot, arm.name)
        rows: list[tuple[int, Floats, float, str]] = []
        last = chain.dof - 1
        for index, name in enumerate(chain.links):
            group = "palm" if index == last else "forearm" if index == last - 1 else "upper"
            for shape in robot.link(name).shapes:
                fine = arm.cup is not None and index == last and shape.kind == "mesh"
                part = "forearm" if fine else group
                rows += [(index, c, r, part) for c, r in _spheres(shape, fine)]
        fingers = [joint for joint in robot.joints if joint.name in arm.fingers]
        finger_poses = link_poses(arm.wrist, fingers, arm.finger_values(opening))
        for name, wrist_from_link in finger_poses.items():
            for shape in robot.link(name).shapes:
                for centre, radius in _spheres(shape):
                    moved = wrist_from_link[:3, :3] @ centre + wrist_from_link[:3, 3]
                    rows.append((last, moved, radius, "finger"))
        link, centres, radii, group_names = zip(*rows, strict=True)
        return cls(chain, np.array(link), np.array(centres), np.array(radii), np.array(group_names))

    def carrying(self, centres: Floats, radii: Floats) -> ArmSpheres:
        """Return the arm with a load: spheres (k, 3) m in the wrist frame, radii (k,) m."""
        k = len(radii)
        return replace(
            self,
            link=np.concatenate([self.link, np.full(k, self.chain.dof - 1)]),
            centres=np.concatenate([self.centres, centres]),
            radii=np.concatenate([self.radii, radii]),
            group=np.concatenate([self.group, np.full(k, "load")]),
        )

    def slack(self, surroundings: Surroundings, allowed: Mapping[tuple[str, str], float]) -> Floats:
        """Return the allowed penetration (m obstacles, n spheres), m.

        ``allowed`` maps (obstacle name, sphere group) to m; ``inf`` ignores the pair.
        """
        names = np.array(surroundings.names)
        slack = np.zeros((len(names), len(self.radii)))
        for (name, group), depth in allowed.items():
            slack[np.ix_(names == name, self.group == group)] = depth
        return slack

    def clearances(self, q: Floats, surroundings: Surroundings, slack: Floats) -> Floats:
        """Return the smallest distance less the allowed one, per posture.

        Parameters
        ----------
        q : (b, dof) float, rad
        surroundings
            What to stay clear of.
        slack : (m, n) float, m
            From :meth:`slack`.

        Returns
        -------
        (b,) float, m
            Negative = collision.
        """
        return np.asarray(self._pairs(q, surroundings, slack).min(axis=(1, 2)))

    def forgiving(self, q: Floats, surroundings: Surroundings, slack: Floats) -> Floats:
        """Return the slack (m, n), m, with what a posture (dof,) overlaps already allowed as well.

        With it a way out of an overlap is free if it gets no deeper and nothing else is touched.
        """
        pairs = self._pairs(q[None], surroundings, slack)[0]
        return np.asarray(slack + np.maximum(-pairs, 0.0))

    def nearest(self, q: Floats, surroundings: Surroundings, slack: Floats) -> tuple[str, str]:
        """Return (obstacle name, sphere group) of the tightest pair of one posture (dof,)."""
        pairs = self._pairs(q[None], surroundings, slack)[0]
        row, column = np.unravel_index(int(np.argmin(pairs)), pairs.shape)
        return surroundings.names[int(row)], str(self.group[column])

    def shows(self, q: Floats, points: Floats, margin: float) -> NDArray[np.bool_]:
        """Tell which points (n, 3), m, base frame, lie on the arm in a posture (dof,), or near."""
        on_arm = np.zeros(len(points), dtype=np.bool_)
        for centre, radius in zip(self.places(q[None])[0], self.radii, strict=True):
            on_arm |= np.square(points - centre).sum(axis=1) < (radius + margin) ** 2
        return on_arm

    def places(self, q: Floats) -> Floats:
        """Return the middles (b, n, 3) of the spheres, m, base frame."""
        rotations, positions = self.chain.link_frames(q)
        rotated = (rotations[:, self.link] @ self.centres[None, :, :, None])[..., 0]
        return np.asarray(rotated + positions[:, self.link])

    def _pairs(self, q: Floats, surroundings: Surroundings, slack: Floats) -> Floats:
        points = self.places(q)
        batch, count = points.shape[:2]
        distances = surroundings.distances(points.reshape(-1, 3)).reshape(-1, batch, count)
        pairs: Floats = (distances - self.radii + slack[:, None, :]).transpose(1, 0, 2)
        return pairs


def link_poses(
    root: str, joints: Sequence[Joint], values: Mapping[str, float]
) -> dict[str, Floats]:
    """Return ``root_from_link`` (4, 4) of every link below ``root`` over the given joints.

    Parameters
    ----------
    root
        Name of the link to start from.
    joints
        In an order in which parents come first.
    values
        Joint values, rad (prismatic: m); 0 where absent.
    """
    poses: dict[str, Floats] = {root: np.eye(4)}
    for joint in joints:
        if joint.parent not in poses:
            continue
        pose = poses[joint.parent] @ transform_from(joint.pose.xyz, joint.pose.rpy)
        angle = values.get(joint.name, 0.0)
        if joint.kind == "prismatic":
            pose = pose @ transform_from(tuple(angle * np.array(joint.axis)))
        elif joint.kind != "fixed" and angle:
            spin = np.eye(4)
            x, y, z = np.array(joint.axis) / np.linalg.norm(joint.axis)
            skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            spin[:3, :3] += np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
            pose = pose @ spin
        poses[joint.child] = pose
    del poses[root]
    return poses


def body_obstacles(
    robot: RobotDescription, arm: Arm, values: Mapping[str, float]
) -> tuple[Obstacle, ...]:
    """Return the robot's own body as obstacles to one of its arms.

    The links of that arm are left out. Obstacles are called ``body``, those that carry the
    shoulder ``trunk``: the upper arm always touches them.
    """
    own = {joint.child for joint in robot.path(arm.wrist)} | {
        joint.child for joint in robot.joints if joint.name in arm.fingers
    }
    base_from_root = robot.base_from_root.matrix
    poses = link_poses(robot.root, robot.joints, values)
    poses[robot.root] = np.eye(4)
    obstacles: list[Obstacle] = []
    for link in robot.links:
        if link.name in own:
            continue
        name = "trunk" if link.name == robot.root else "body"
        pose = base_from_root @ poses[link.name]
        obstacles += [o for shape in link.shapes for o in _rounded(name, shape, pose)]
    return tuple(obstacles)


def _rounded(name: str, shape: Shape, base_from_link: Floats) -> list[Obstacle]:
    """Return a shape as rounded boxes; the end spheres of a capsule are in its cylinder already."""
    pose = base_from_link @ transform_from(shape.pose.xyz, shape.pose.rpy)
    if shape.kind == "mesh":
        spheres = _spheres(shape)
        if max(radius for _, radius in spheres) > _COARSE_M:
            return [
                Obstacle(name, pose[:3, :3] @ c + pose[:3, 3], half, pose[:3, :3])
                for c, half in zip(*hull_boxes(shape.path, shape.size), strict=True)
            ]
        return [
            Obstacle(
                name, base_from_link[:3, :3] @ c + base_from_link[:3, 3], np.zeros(3), np.eye(3), r
            )
            for c, r in spheres
        ]
    if shape.kind == "box":
        return [Obstacle(name, pose[:3, 3], np.array(shape.size) / 2, pose[:3, :3])]
    half = np.zeros(3)
    if shape.kind == "cylinder":
        half[2] = shape.size[1] / 2
    return [Obstacle(name, pose[:3, 3], half, pose[:3, :3], shape.size[0])]


def _spheres(shape: Shape, fine: bool = False) -> list[tuple[Floats, float]]:
    """Cover a shape with spheres: (centre (3,) m in the link frame, radius m)."""
    pose = transform_from(shape.pose.xyz, shape.pose.rpy)
    if shape.kind == "sphere":
        return [(pose[:3, 3], shape.size[0])]
    if shape.kind == "mesh":
        centres, radii = (cover_surface if fine else cover_mesh)(shape.path, shape.size)
        moved = centres @ pose[:3, :3].T + pose[:3, 3]
        return list(zip(moved, (float(r) for r in radii), strict=True))
    if shape.kind == "cylinder":
        radius, length = shape.size
        count = max(int(np.ceil(length / radius)), 1)
        local = np.zeros((count, 3))
        local[:, 2] = (np.arange(count) + 0.5) * length / count - length / 2
    else:
        radius = min(_BOX_SPHERE, min(shape.size) / 2)
        # Centres sit deeper than the face by less than the radius: faces bulge by a third of it,
        # edges lack as much.
        reach = np.maximum(np.array(shape.size) / 2 - 0.7 * radius, 0.0)
        counts = np.ceil(2 * reach / (1.4 * radius)).astype(int) + 1
        grids = np.meshgrid(
            *[
                np.linspace(-r, r, n) if n > 1 else np.zeros(1)
                for r, n in zip(reach, counts, strict=True)
            ]
        )
        local = np.stack([g.ravel() for g in grids], axis=1)
    return [(pose[:3, :3] @ point + pose[:3, 3], float(radius)) for point in local]
