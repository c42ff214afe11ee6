"""The state of MoveIt's planning scene, kept up to date by full messages and by changes.

Rules of moveit_msgs/PlanningScene as MoveIt follows them: shapes without a pose lie at that of
their object, a matrix in a change replaces the former one, and ADD replaces an object of that name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import members_of
from rtask.interop.ros.scene.matrix import CollisionMatrix
from rtask.interop.ros.scene.shapes import Solid, mesh_of, plane_of, pose_of, primitive_of

__all__ = ["SceneObject", "SceneState"]

Floats = NDArray[np.float64]
_ADD, _REMOVE, _APPEND, _MOVE = range(4)
_MATRIX = "allowed collision matrix"
MAX_OBJECTS = 10_000


@dataclass(frozen=True, eq=False)
class SceneObject:
    """An object of the world, or one that is attached to a link.

    Parameters
    ----------
    frame
        In which it has its pose.
    pose : (4, 4)
        frame_from_object.
    source
        Database of its type.
    link
        To which it is attached; empty for an object of the world.
    touch_links
        Which may touch it, beside that link.
    """

    id: str
    frame: str
    pose: Floats
    solids: tuple[Solid, ...]
    source: str = ""
    link: str = ""
    touch_links: tuple[str, ...] = ()


class SceneState:
    """Objects of the world, attached objects, and what may touch what.

    What cannot be read is kept in :attr:`faults`, by the name of its object, until it is replaced
    or removed: an obstacle that nobody can place is not an absent one.
    """

    def __init__(self) -> None:
        self.objects: dict[str, SceneObject] = {}
        self.attached: dict[str, SceneObject] = {}
        self.matrix: CollisionMatrix | None = None
        self.faults: dict[str, str] = {}
        self.has_octomap = False
        self.planning_frame = ""
        self.frames: dict[str, tuple[str, Floats]] = {}
        """Frames that only the scene knows: parent, and parent_from_frame (4, 4)."""
        self.is_complete = False

    def take(self, scene: Any) -> None:
        """Take a moveit_msgs/PlanningScene: a full one replaces everything."""
        if not scene.is_diff:
            self.__init__()  # type: ignore[misc]
            self.is_complete = True
        self._take_frames(scene.fixed_frame_transforms)
        matrix = scene.allowed_collision_matrix
        if matrix.entry_names or (not scene.is_diff and matrix.default_entry_names):
            with self._naming(_MATRIX):
                self.matrix = CollisionMatrix.of(matrix)
        octomap = scene.world.octomap.octomap
        self.has_octomap = bool(len(octomap.data)) or (scene.is_diff and self.has_octomap)
        state = scene.robot_state
        if not state.is_diff and (state.attached_collision_objects or state.joint_state.name):
            self._forget(self.attached)
        if self._fits(scene.world.collision_objects, self.objects):
            for each in scene.world.collision_objects:
                with self._naming(str(each.id)):
                    self._change(each)
        if self._fits(state.attached_collision_objects, self.attached):
            for each in state.attached_collision_objects:
                with self._naming(str(each.object.id)):
                    self._attach(each)

    def _naming(self, name: str) -> _Naming:
        return _Naming(self.faults, name or "an object without a name")

    def _forget(self, objects: dict[str, SceneObject]) -> None:
        for name in objects:
            self.faults.pop(name, None)
        objects.clear()

    def _fits(self, more: Any, objects: dict[str, SceneObject]) -> bool:
        """Return whether so many objects are read; more of them are a fault of the scene."""
        number = len(more) + len(objects)
        if number > MAX_OBJECTS:  # those that come again, as in a change, count once
            names = {str(getattr(each, "object", each).id) for each in more}
            number = max(len(more), len(names | objects.keys()))
        if number <= MAX_OBJECTS:
            return True
        self.faults["the scene"] = f"{number} objects; at most {MAX_OBJECTS} are read"
        return False

    def _take_frames(self, transforms: Iterable[Any]) -> None:
        for stamped in transforms:
            move, turn = stamped.transform.translation, stamped.transform.rotation
            parent = str(stamped.header.frame_id).lstrip("/")
            self.planning_frame = self.planning_frame or parent
            child = str(stamped.child_frame_id).lstrip("/")
            with self._naming(f"frame {child}"):
                pose = pose_of(_Pose(move, turn), "the transform")
                if child != parent:
                    self.frames[child] = parent, pose

    def _change(self, message: Any) -> None:
        """Carry out the operation of a moveit_msgs/CollisionObject."""
        name, operation = str(message.id), _number(message.operation)
        if operation == _REMOVE:
            if name:
                self.objects.pop(name, None)
            else:
                self._forget(self.objects)
            return
        if not name:
            raise UsageError("it has no id")
        if operation in (_ADD, _APPEND):
            self.objects.pop(name, None) if operation == _ADD else None
            made = self._read(message)
            former = self.objects.get(name)
            if former is not None:
                made = _joined(former, made)
            self.objects[name] = made
        elif operation == _MOVE:
            if name not in self.objects:
                raise UsageError("it was moved and is not in the scene")
            self.objects[name] = _moved(self.objects[name], message, self._frame(message))
        else:
            raise UsageError(f"operation {operation}; expected ADD, REMOVE, APPEND or MOVE")

    def _attach(self, message: Any) -> None:
        """Carry out a moveit_msgs/AttachedCollisionObject."""
        name, link = str(message.object.id), str(message.link_name).lstrip("/")
        operation = _number(message.object.operation)
        if operation == _REMOVE:
            for own, each in list(self.attached.items()):
                if name in ("", own) and link in ("", each.link):
                    del self.attached[own]
            return
        if operation not in (_ADD, _APPEND):
            raise UsageError(f"operation {operation} of an attached object")
        if not link:
            raise UsageError("it is attached to no link")
        made = self._read(message.object)
        former = self.attached.get(name) if operation == _APPEND else None
        self.objects.pop(name, None)
        self.attached[name] = replace(
            made if former is None else _joined(former, made),
            link=link,
            touch_links=tuple(str(each).lstrip("/") for each in message.touch_links),
        )

    def _frame(self, message: Any) -> str:
        frame = str(message.header.frame_id).lstrip("/") or self.planning_frame
        if not frame:
            raise UsageError("it has no frame")
        return frame

    def _read(self, message: Any) -> SceneObject:
        """Return an object with its shapes."""
        solids = tuple(_solids(message))
        if not solids:
            raise UsageError("it has no shapes: no primitives, meshes or planes")
        pose = pose_of(message.pose, "it") if hasattr(message, "pose") else np.eye(4)
        source = str(message.type.db)
        return SceneObject(str(message.id), self._frame(message), pose, solids, source)


class _Naming:
    """Keeps what is wrong with an object under its name; forgets it where it is right again."""

    def __init__(self, faults: dict[str, str], name: str) -> None:
        self._faults, self._name = faults, name

    def __enter__(self) -> None:
        self._faults.pop(self._name, None)

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if isinstance(error, UsageError):
            self._faults[self._name] = str(error)
            return True
        return False


@dataclass(frozen=True)
class _Pose:
    """A transform in the terms of geometry_msgs/Pose."""

    position: Any
    orientation: Any


def _number(operation: Any) -> int:
    """Return a byte as a number: rosidl carries bytes, genpy a number."""
    return operation[0] if isinstance(operation, bytes) else int(operation)


def _solids(message: Any) -> Iterator[Solid]:
    for kind, read in (("primitive", primitive_of), ("mesh", mesh_of), ("plane", plane_of)):
        shapes = getattr(message, "meshes" if kind == "mesh" else f"{kind}s")
        poses = getattr(message, f"{kind}_poses")
        if len(poses) > len(shapes):
            raise UsageError(f"{len(poses)} {kind} poses for {len(shapes)} of them")
        for number, shape in enumerate(shapes):
            pose = pose_of(poses[number], f"its {kind}") if number < len(poses) else np.eye(4)
            yield read(shape, pose)


def _joined(former: SceneObject, more: SceneObject) -> SceneObject:
    """Return an object with the shapes of another message added, in the first one's pose."""
    if former.frame != more.frame:
        raise UsageError(f"shapes in {more.frame} were appended to an object in {former.frame}")
    onto = np.linalg.inv(former.pose) @ more.pose
    added = (replace(solid, pose=onto @ solid.pose) for solid in more.solids)
    return replace(former, solids=(*former.solids, *added))


def _moved(former: SceneObject, message: Any, frame: str) -> SceneObject:
    """Return an object at the poses of a MOVE, whose shapes have to be those it has."""
    poses = [
        pose_of(pose, "it")
        for kind in ("primitive", "mesh", "plane")
        for pose in getattr(message, f"{kind}_poses")
    ]
    if poses and len(poses) != len(former.solids):
        raise UsageError(
            f"it was moved with {len(poses)} poses and has {len(former.solids)} shapes"
        )
    solids = former.solids
    if poses:
        solids = tuple(replace(s, pose=pose) for s, pose in zip(solids, poses, strict=True))
    has_pose = any(name == "pose" for name, _ in members_of(message) or ())
    pose = pose_of(message.pose, "it") if has_pose else np.eye(4)
    return replace(former, frame=frame, pose=pose, solids=solids)
