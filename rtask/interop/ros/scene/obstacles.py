"""What of a planning scene stands in the way of a hand, in the frame of the robot."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.scene.matrix import CollisionMatrix
from rtask.interop.ros.scene.shapes import Solid
from rtask.interop.ros.scene.state import SceneObject, SceneState

__all__ = ["OURS", "HandRules", "SceneObstacles"]

Floats = NDArray[np.float64]
FrameLookup = Callable[[str], Floats]
"""Return robot_from_frame (4, 4); raises UsageError where TF does not know it."""

OURS = "rtask"
"""Database of the types of objects that a node put into the scene, and start of their names."""
_CELLS_M = (0.008, 0.012)
_AROUND_M, _ABOVE_M, _ON_SUPPORT_M = 0.10, 0.12, 0.01
_SAME_M, _SAME_SIZE = 0.015, 2.0
_MOST_FAULTS = 3


@dataclass(frozen=True)
class HandRules:
    """What the hand may touch.

    Parameters
    ----------
    links
        Of the hand, as MoveIt names them; empty if nobody said.
    """

    links: tuple[str, ...] = ()

    def may_touch(self, each: SceneObject, matrix: CollisionMatrix | None) -> bool:
        """Return whether the matrix allows every link of the hand to touch an object.

        Where nobody said which links are the hand's, only the object's own default counts.
        """
        if matrix is None:
            return False
        if not self.links:
            return matrix.defaults.get(each.id, False)
        return all(
            link == each.link or link in each.touch_links or matrix.allows(link, each.id)
            for link in self.links
        )


class SceneObstacles:
    """The solids of a scene at one time, in the frame of the robot.

    Parameters
    ----------
    lookup
        Poses of frames at that time.
    ours
        Names of objects that the node put into the scene itself: what it sees now counts instead.
        None where nothing is seen: then all of them count.

    Raises
    ------
    UsageError
        Part of the scene cannot be read, or TF does not say where it is.
    """

    def __init__(
        self,
        scene: SceneState,
        lookup: FrameLookup,
        hand: HandRules,
        ours: Collection[str] | None = (),
    ) -> None:
        faults = [f"{name}: {words}" for name, words in scene.faults.items()]
        self.notes: list[str] = []
        if scene.has_octomap:
            self.notes.append("the octomap of the scene is not used")
        if not scene.is_complete:
            self.notes.append("only changes of the scene were heard, never the whole of it")
        self._solids: list[tuple[str, Solid, Floats]] = []
        frames = _Frames(scene, lookup)
        for each in self._standing(scene, hand, ours):
            try:
                pose = frames.pose(each.frame) @ each.pose
            except UsageError as error:
                faults.append(f"{each.id}: {error}")
                continue
            self._solids += [(each.id, solid, pose @ solid.pose) for solid in each.solids]
        if faults:
            more = f"; and {len(faults) - _MOST_FAULTS} more" if len(faults) > _MOST_FAULTS else ""
            raise UsageError(
                f"MoveIt's planning scene cannot be kept clear of: "
                f"{'; '.join(faults[:_MOST_FAULTS])}{more}"
            )
        balls = [(pose[:3, :3] @ ball[0] + pose[:3, 3], ball[1]) for _, pose, ball in self._balls()]
        self._middles = np.array([middle for middle, _ in balls]).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in balls])

    def __len__(self) -> int:
        return len(self._solids)

    def solids(self) -> Iterator[tuple[str, Solid, Floats]]:
        """Yield the name of each object, one of its shapes, and robot_from_shape (4, 4)."""
        yield from self._solids

    def _balls(self) -> Iterator[tuple[str, Floats, tuple[Floats, float]]]:
        for name, solid, pose in self._solids:
            yield name, pose, solid.ball()

    def _standing(
        self, scene: SceneState, hand: HandRules, ours: Collection[str] | None
    ) -> Iterator[SceneObject]:
        """Yield what the hand must not touch; note what it holds."""
        for each in scene.objects.values():
            is_ours = ours is not None and (
                each.id in ours or each.source == OURS or each.id.startswith(f"{OURS}/")
            )
            if not is_ours and not hand.may_touch(each, scene.matrix):
                yield each
        for each in scene.attached.values():
            if each.link in hand.links:
                self.notes.append(f"the hand holds {each.id}, which moves with it")
            elif not hand.may_touch(each, scene.matrix):
                yield each

    def near(
        self, pose: Any, size: tuple[float, float, float], support_height: float, most: int
    ) -> list[list[float]]:
        """Return points (n, 3), m, of what stands around an object and is not that object.

        They are the middles of cells that a solid reaches into, nearest first; at most ``most``.
        What is lower than 1 cm over the support is the support's own matter.

        Parameters
        ----------
        pose
            geometry_msgs/Pose of the middle of the object's box, as a mapping; z up.
        size
            Of the box, m.
        """
        box_from_robot, half = _box_of(pose, size)
        middle: Floats = np.asarray(np.linalg.inv(box_from_robot)[:3, 3], dtype=np.float64)
        reach = half + np.array([_AROUND_M, _AROUND_M, _ABOVE_M])
        far = np.linalg.norm(self._middles - middle, axis=1) - self._radii
        close = [self._solids[i] for i in np.flatnonzero(far < np.linalg.norm(reach))]
        around = [part for part in close if not _is_same(part, box_from_robot, half)]
        if not around or most < 1:
            return []
        cells: Floats = np.zeros((0, 3))
        for cell in _CELLS_M:
            cells = _cells(around, middle, reach, support_height, cell)
            if len(cells) <= most:
                break
        local = cells @ box_from_robot[:3, :3].T + box_from_robot[:3, 3]
        beside = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0), axis=1)
        order = np.argsort(beside, kind="stable")[:most]
        return [[round(float(v), 4) for v in point] for point in cells[order]]


class _Frames:
    """Poses of frames, each looked up once."""

    def __init__(self, scene: SceneState, lookup: FrameLookup) -> None:
        self._scene, self._lookup = scene, lookup
        self._poses: dict[str, Floats | UsageError] = {}

    def pose(self, frame: str) -> Floats:
        if frame not in self._poses:
            try:
                self._poses[frame] = self._find(frame)
            except UsageError as error:
                self._poses[frame] = error
        pose = self._poses[frame]
        if isinstance(pose, UsageError):
            raise pose
        return pose

    def _find(self, frame: str) -> Floats:
        if frame in self._scene.frames:
            parent, parent_from_frame = self._scene.frames[frame]
            return self._lookup(parent) @ parent_from_frame
        return self._lookup(frame)


def _box_of(pose: Any, size: tuple[float, float, float]) -> tuple[Floats, Floats]:
    """Return box_from_robot (4, 4) and the half sides (3,) of a box."""
    turn = pose["orientation"]
    x, y, z, w = (float(turn[axis]) for axis in "xyzw")
    robot_from_box = np.eye(4)
    robot_from_box[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    robot_from_box[:3, 3] = [float(pose["position"][axis]) for axis in "xyz"]
    box_from_robot = np.asarray(np.linalg.inv(robot_from_box), dtype=np.float64)
    return box_from_robot, np.asarray(size, dtype=np.float64) / 2


def _is_same(part: tuple[str, Solid, Floats], box_from_robot: Floats, half: Floats) -> bool:
    """Return whether a solid is the seen object itself, under another name.

    It is where its middle lies in the seen box, or the box's middle in it, and it is not much
    larger: a shelf or a bin around the object is none.
    """
    _, solid, robot_from_solid = part
    centre, radius = solid.ball()
    if radius > _SAME_SIZE * float(np.linalg.norm(half + _SAME_M)):
        return False
    box_from_solid = box_from_robot @ robot_from_solid
    middle = box_from_solid[:3, :3] @ centre + box_from_solid[:3, 3]
    if (np.abs(middle) <= half + _SAME_M).all():
        return True
    origin: Floats = np.asarray(np.linalg.inv(box_from_solid)[:3, 3], dtype=np.float64)
    return bool(solid.distance(origin[None])[0] < 0)


def _cells(
    around: list[tuple[str, Solid, Floats]],
    middle: Floats,
    reach: Floats,
    support_height: float,
    cell: float,
) -> Floats:
    """Return the middles (n, 3) of cells near an object that a solid's surface reaches into."""
    low, high = middle - np.linalg.norm(reach[:2]), middle + np.linalg.norm(reach[:2])
    low[2] = (support_height if np.isfinite(support_height) else middle[2] - reach[2]) + (
        _ON_SUPPORT_M + cell / 2
    )
    high[2] = middle[2] + reach[2]
    axes = [np.arange(a, b, cell) for a, b in zip(low, high, strict=True)]
    if not all(map(len, axes)):
        return np.zeros((0, 3))
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    hit = np.zeros(len(grid), dtype=np.bool_)
    for _, solid, robot_from_solid in around:
        if solid.corners is not None:
            hit |= _meshed(solid, robot_from_solid, axes, cell)
            continue
        centre, radius = solid.ball()
        place = robot_from_solid[:3, :3] @ centre + robot_from_solid[:3, 3]
        left = np.flatnonzero(~hit & (np.linalg.norm(grid - place, axis=1) <= radius + cell))
        if not len(left):
            continue
        local = (grid[left] - robot_from_solid[:3, 3]) @ robot_from_solid[:3, :3]
        # The surface alone: no hand comes from the inside, and the points are few. Half a cell to
        # either side leaves no gap in any direction.
        hit[left[np.abs(solid.distance(local)) <= cell * 0.51]] = True
    return np.asarray(grid[hit])


def _meshed(
    solid: Solid, robot_from_solid: Floats, axes: list[Floats], cell: float
) -> NDArray[np.bool_]:
    """Return which cells of a grid hold a point of a mesh."""
    low, high = (np.array([axis[end] for axis in axes]) for end in (0, -1))
    corners = np.stack(np.meshgrid(*zip(low - cell, high + cell, strict=True), indexing="ij"), -1)
    local = (corners.reshape(-1, 3) - robot_from_solid[:3, 3]) @ robot_from_solid[:3, :3]
    points = solid.samples(local.min(axis=0), local.max(axis=0), cell / 2)
    places = points @ robot_from_solid[:3, :3].T + robot_from_solid[:3, 3]
    counts = np.array([len(axis) for axis in axes])
    at = np.round((places - low) / cell).astype(np.int64)
    at = at[((at >= 0) & (at < counts)).all(axis=1)]
    hit = np.zeros(int(counts.prod()), dtype=np.bool_)
    hit[np.ravel_multi_index(tuple(at.T), tuple(counts))] = True
    return hit
