"""Frames as a tree in the graph: a map, rooms, tables, the bases of robots, their cameras.

A frame stands in its parent for ever (``rt:parentFrame`` and ``rt:poseInParent``), or from one time
to another (an ``rt:Placement`` of the frame). A pose is stored in the frame in which it was
measured and resolved when asked. What was measured from a robot that moves is resolved with the
pose that the robot had then; what was measured from a table moves along when the table is moved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import CORA, RDF, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.world.placement import Placement, pose_of

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["MAX_DEPTH", "FrameTree", "Rooted"]

MAX_DEPTH = 64
"""Frames that are followed from one to its root."""
PlacementAt = Callable[[str, float], Placement | None]


@dataclass(frozen=True, eq=False)
class Rooted:
    """A frame's pose in the root of its tree.

    Parameters
    ----------
    root
        IRI of the root; the frame itself if it has no parent.
    root_from_frame : (4, 4) float64, m
    variance_m2
        Variance of the position per axis that the frames on the way add.
    is_cut
        The way to the root is longer than what is followed; ``root`` is where that ended.
    """

    root: str
    root_from_frame: NDArray[np.float64]
    variance_m2: float = 0.0
    is_cut: bool = False


class FrameTree:
    """The frames of a knowledge base at any instant.

    Parameters
    ----------
    placement_at
        Returns the placement of a frame at a time, or None.
    """

    def __init__(self, kb: GraphCore, placement_at: PlacementAt) -> None:
        self._kb = kb
        self._placement_at = placement_at

    def rooted(self, frame: str, time_s: float) -> Rooted:
        """Return the pose of a frame in the root of its tree at a time.

        A ring of frames ends where it closes.
        """
        pose, variance, seen = np.eye(4), 0.0, {frame}
        while True:
            parent, parent_from_frame, added = self._parent(frame, time_s)
            if not parent or parent in seen:
                return Rooted(frame, pose, variance)
            if len(seen) > MAX_DEPTH:
                return Rooted(frame, pose, variance, is_cut=True)
            pose, variance, frame = parent_from_frame @ pose, variance + added, parent
            seen.add(parent)

    def target_from_source(
        self, target: str, source: str, asked_s: float, measured_s: float
    ) -> tuple[NDArray[np.float64], float] | None:
        """Return the pose (4, 4), m, of one frame in another, and the variance that it adds.

        Parameters
        ----------
        asked_s, measured_s
            Unix time at which the target is asked for, and at which the source was measured in.

        Returns
        -------
        None if the frames are in different trees, or that is not decided because one of them is
        deeper in its tree than what is followed.
        """
        if target == source:
            return np.eye(4), 0.0
        there = self.rooted(source, self.instant(source, asked_s, measured_s))
        here = self.rooted(target, asked_s)
        if there.root != here.root:
            return None
        pose = np.linalg.inv(here.root_from_frame) @ there.root_from_frame
        return np.asarray(pose, np.float64), there.variance_m2 + here.variance_m2

    def instant(self, frame: str, asked_s: float, measured_s: float) -> float:
        """Return the time at which a frame counts for what was measured in it."""
        return measured_s if self.is_of_robot(frame) else asked_s

    def is_of_robot(self, frame: str) -> bool:
        """Whether a frame belongs to a robot, which may move while what it saw stays."""
        robot, located, _ = frame.rpartition("/frame/")
        return bool(located) and bool(self._kb.match(iri(robot), RDF.type, CORA.Robot))

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

    def _parent(self, frame: str, time_s: float) -> tuple[str, NDArray[np.float64], float]:
        """Return the parent, parent_from_frame and variance of a frame; "" for a root."""
        placement = self._placement_at(frame, time_s)
        if placement is not None and placement.frame_from_subject is not None:
            return placement.frame, placement.frame_from_subject, placement.sigma_m**2
        node = iri(frame)
        parents = [q.object for q in self._kb.match(node, RT.parentFrame)]
        poses = [q.object for q in self._kb.match(node, RT.poseInParent)]
        if parents and poses and isinstance(poses[0], NamedNode):
            parent, pose = pose_of(self._kb, poses[0])
            if pose is not None and parent == getattr(parents[0], "value", ""):
                return parent, pose, 0.0
        return "", np.eye(4), 0.0
