"""Frames as a tree in the graph: a map, rooms, tables, the bases of robots, their cameras.

A frame stands in its parent for ever (``rt:parentFrame`` and ``rt:poseInParent``), or from one time
to another (an ``rt:Placement`` of the frame). A pose is stored in the frame in which it was
measured and resolved when asked. What was measured from a robot that moves is resolved with the
pose that the robot had then; what was measured from a table moves along when the table is moved.

Where frames stand in a ring, or one of them in two others at a time, no pose is computed along
them, and the reason is given in words: which of two statements is right cannot be known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import CORA, RDF, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.world.placement import Placement, pose_of

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["MAX_DEPTH", "FrameTree", "Rooted", "Way"]

MAX_DEPTH = 64
"""Frames that are followed from one to its root."""
_MAX_RESOLVED = 1_000
PlacementAt = Callable[[str, float], Placement | None]


@dataclass(frozen=True, eq=False)
class Rooted:
    """A frame's pose in the root of its tree, and in each frame on the way.

    Parameters
    ----------
    path
        IRIs from the frame to its root; the frame alone if it has no parent.
    poses : list of (4, 4) float64, m
        ``path_from_frame`` for each frame of the path.
    variances_m2
        Variance of the position per axis that the way adds up to each frame of the path.
    is_cut
        The way to the root is longer than what is followed; ``path`` is where that ended.
    fault
        Why there is no root, in words: a ring, or two parents; empty if there is one.
    """

    path: list[str]
    poses: list[NDArray[np.float64]] = field(default_factory=lambda: [np.eye(4)])
    variances_m2: list[float] = field(default_factory=lambda: [0.0])
    is_cut: bool = False
    fault: str = ""

    @property
    def root(self) -> str:
        """IRI of the root, or of the last frame that was followed."""
        return self.path[-1]


@dataclass(frozen=True, eq=False)
class Way:
    """The pose of one frame in another.

    Parameters
    ----------
    target_from_source : (4, 4) float64, m
        None if it is not known.
    variance_m2
        Variance of the position per axis that the frames on the way add.
    reason
        Why it is not known, in words.
    """

    target_from_source: NDArray[np.float64] | None
    variance_m2: float = 0.0
    reason: str = ""


@dataclass(frozen=True, eq=False)
class _Step:
    """The parent of a frame; "" for a root."""

    parent: str = ""
    parent_from_frame: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    variance_m2: float = 0.0
    fault: str = ""


@dataclass(eq=False)
class _Resolved:
    """What was resolved after a commit, for which nothing that is stored later counts."""

    seq: int
    bulk_loads: int
    rooted: dict[tuple[str, float, float | None], Rooted] = field(default_factory=dict)
    robots: dict[str, bool] = field(default_factory=dict)


class FrameTree:
    """The frames of a knowledge base at any instant.

    Parameters
    ----------
    placement_at
        Returns the placement of a frame at a time, or None.
    rival_at
        Returns another placement that holds at a time and began together with that one, or None.
    """

    def __init__(self, kb: GraphCore, placement_at: PlacementAt, rival_at: PlacementAt) -> None:
        self._kb = kb
        self._placement_at = placement_at
        self._rival_at = rival_at
        self._memo = _Resolved(-1, -1)

    def _memo_now(self) -> _Resolved:
        """Return what was resolved since the last commit: a report asks the same many times."""
        memo, state = self._memo, (self._kb.seq, self._kb.bulk_loads)
        if (memo.seq, memo.bulk_loads) != state or len(memo.rooted) >= _MAX_RESOLVED:
            memo = self._memo = _Resolved(*state)
        return memo

    def rooted(self, frame: str, asked_s: float, measured_s: float | None = None) -> Rooted:
        """Return the pose of a frame in the root of its tree.

        Parameters
        ----------
        asked_s, measured_s
            Unix time at which frames count, and at which those of robots count; default: the same.
        """
        memo, key = self._memo_now().rooted, (frame, asked_s, measured_s)
        rooted = memo.get(key)
        if rooted is None:
            rooted = memo[key] = self._resolve(frame, asked_s, measured_s)
        return rooted

    def _resolve(self, frame: str, asked_s: float, measured_s: float | None) -> Rooted:
        rooted = Rooted([frame])
        while not rooted.fault:
            count_s = self.instant(frame, asked_s, asked_s if measured_s is None else measured_s)
            step = self._step(frame, count_s)
            if step.fault or not step.parent:
                return replace(rooted, fault=step.fault)
            if step.parent in rooted.path:
                ring = rooted.path[rooted.path.index(step.parent) :]
                return replace(rooted, fault=f"frames stand in a ring: {self._names(ring)}")
            if len(rooted.path) > MAX_DEPTH:
                return replace(rooted, is_cut=True, fault=self._depth(rooted.path[0]))
            rooted.path.append(step.parent)
            rooted.poses.append(step.parent_from_frame @ rooted.poses[-1])
            rooted.variances_m2.append(rooted.variances_m2[-1] + step.variance_m2)
            frame = step.parent
        return rooted

    def way(self, target: str, source: str, asked_s: float, measured_s: float) -> Way:
        """Return the pose of one frame in another, or why it is not known.

        Parameters
        ----------
        asked_s, measured_s
            Unix time at which the target is asked for, and at which the source was measured in.
        """
        if target == source and self.instant(source, asked_s, measured_s) == asked_s:
            return Way(np.eye(4))
        there = self.rooted(source, asked_s, measured_s)
        here = self.rooted(target, asked_s)
        for up, frame in enumerate(there.path):
            # The frame of a robot that walked meanwhile is elsewhere than it was.
            is_same = frame == there.root or self.instant(frame, asked_s, measured_s) == asked_s
            if is_same and frame in here.path:
                down = here.path.index(frame)
                pose = np.linalg.inv(here.poses[down]) @ there.poses[up]
                variance = there.variances_m2[up] + here.variances_m2[down]
                return Way(np.asarray(pose, np.float64), variance)
        reason = there.fault or here.fault
        if not reason:
            names = (self.name_of(name) for name in (source, target, there.root, here.root))
            reason = "no frame leads from {} to {}: their roots are {} and {}".format(*names)
        return Way(None, 0.0, reason)

    def target_from_source(
        self, target: str, source: str, asked_s: float, measured_s: float
    ) -> tuple[NDArray[np.float64], float] | None:
        """Return the pose (4, 4), m, of one frame in another, and the variance that it adds.

        Returns
        -------
        None if it is not known; :meth:`way` says why.
        """
        way = self.way(target, source, asked_s, measured_s)
        return None if way.target_from_source is None else (way.target_from_source, way.variance_m2)

    def instant(self, frame: str, asked_s: float, measured_s: float) -> float:
        """Return the time at which a frame counts for what was measured in it."""
        return measured_s if self.is_of_robot(frame) else asked_s

    def is_of_robot(self, frame: str) -> bool:
        """Whether a frame belongs to a robot, which may move while what it saw stays."""
        # By its IRI, which has the robot's as its beginning: this is asked for every frame on every
        # way.
        robot, located, _ = frame.rpartition("/frame/")
        if not located:
            return False
        robots = self._memo_now().robots
        if robot not in robots:
            robots[robot] = bool(self._kb.match(iri(robot), RDF.type, CORA.Robot))
        return robots[robot]

    def find(self, name: str) -> list[str]:
        """Return the frames of an IRI, a name in tf, or ``robot/name``, sorted."""
        by_id = {
            quad.subject.value
            for quad in self._kb.match(None, RT.frameId, name)
            if isinstance(quad.subject, NamedNode)
        }
        if by_id:
            return sorted(by_id)
        if ":" in name:
            return [name]
        robot, _, frame_id = name.partition("/")
        return sorted(
            quad.subject.value
            for quad in self._kb.match(None, RT.frameId, frame_id)
            if isinstance(quad.subject, NamedNode) and f"/{robot}/frame/" in quad.subject.value
        )

    def name_of(self, frame: str) -> str:
        """Return the name of a frame in tf, or its IRI if it has none."""
        for quad in self._kb.match(iri(frame), RT.frameId) if frame else ():
            return str(getattr(quad.object, "value", frame))
        return frame

    def _step(self, frame: str, time_s: float) -> _Step:
        """Return where a frame stands at a time."""
        placement = self._placement_at(frame, time_s)
        # Two poses that began at once contradict each other: neither is the more recent one.
        rival = None if placement is None else self._rival_at(frame, time_s)
        node = iri(frame)
        parents = {parent.value for parent in self._named(node, RT.parentFrame)}
        if placement is not None and placement.frame:
            parents.add(placement.frame)
        if rival is not None and rival.frame:
            parents.add(rival.frame)
        if len(parents) > 1:
            return _Step(fault=f"frame {self.name_of(frame)} stands in several frames at that time:"
                         f" {self._names(sorted(parents))}")  # fmt: skip
        if placement is not None and placement.frame_from_subject is not None:
            if rival is not None:
                return _Step(fault=f"frame {self.name_of(frame)} has two poses at that time")
            pose, sigma_m = placement.frame_from_subject, placement.sigma_m
            return _Step(placement.frame, pose, sigma_m**2)
        poses = self._named(node, RT.poseInParent)
        if len(poses) > 1:
            return _Step(fault=f"frame {self.name_of(frame)} has two poses at that time")
        for stored in poses if parents else ():
            parent, pose_in_parent = pose_of(self._kb, stored)
            if pose_in_parent is not None and parent in parents:
                return _Step(parent, pose_in_parent)
        return _Step()

    def _named(self, node: NamedNode, predicate: NamedNode) -> set[NamedNode]:
        objects = (quad.object for quad in self._kb.match(node, predicate))
        return {value for value in objects if isinstance(value, NamedNode)}

    def _depth(self, frame: str) -> str:
        return f"frame {self.name_of(frame)} is below more than {MAX_DEPTH} frames"

    def _names(self, frames: Iterable[str]) -> str:
        return ", ".join(self.name_of(frame) for frame in frames)
