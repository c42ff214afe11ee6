"""State of the world in a knowledge base: things, their places, and frames, at any instant."""

from __future__ import annotations

import itertools
import math
import weakref
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import PROV, RDF, RT
from rtask.rdf.terms import NamedNode, Triple, iri, python_value
from rtask.world.frames import FrameTree, Way
from rtask.world.index import PlacementIndex
from rtask.world.index.tail import Entry
from rtask.world.placement import Placement, seconds
from rtask.world.uncertainty import NEARBY_M, Spread, spread_of

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["WorldState"]

_NEVER = float("inf")
_MAX_STANDINGS = 8
"""Standings of a robot that walked about, of which what it saw meanwhile is looked at."""


class WorldState:
    """Things, placements and frames of a knowledge base.

    Attributes
    ----------
    kb
        The knowledge base.
    index
        Index of placements.
    frames
        Tree of frames.
    """

    def __init__(self, kb: GraphCore) -> None:
        # The knowledge base owns its world, which must not keep it from being collected.
        self.kb: GraphCore = weakref.proxy(kb)
        self.index = PlacementIndex(self.kb)
        self.frames = FrameTree(kb, self.placement_at, self._rival_at)

    def exemplars_of(self, product: str) -> list[str]:
        """Return the things that are exemplars of a product, sorted, merged ones apart."""
        return sorted(
            quad.subject.value
            for quad in self.kb.match(None, RT.exemplarOf, iri(product))
            if isinstance(quad.subject, NamedNode) and not self.is_merged(quad.subject.value)
        )

    def product_of(self, exemplar: str) -> str:
        """Return the product that a thing is an exemplar of, or ""."""
        for quad in self.kb.match(iri(exemplar), RT.exemplarOf):
            if isinstance(quad.object, NamedNode):
                return quad.object.value
        return ""

    def is_merged(self, exemplar: str) -> bool:
        """Whether a thing turned out to be another one."""
        return bool(self.kb.match(iri(exemplar), RT.mergedInto))

    def placement_at(self, subject: str, time_s: float) -> Placement | None:
        """Return the placement of a thing or frame at an instant, or None if it is not known."""
        last = self.last_placement(subject, time_s)
        return last if last is not None and last.holds_at(time_s) else None

    def _rival_at(self, subject: str, time_s: float) -> Placement | None:
        node = self.index.rival(subject, time_s)
        return None if node is None else self.index.read(node)

    def last_placement(self, subject: str, time_s: float = _NEVER) -> Placement | None:
        """Return the last placement of a thing that had begun by an instant, ended or not."""
        nodes = (self.index.last(name, time_s) for name in self.names_of(subject))
        placements = [self.index.read(node) for node in nodes if node is not None]
        return max((p for p in placements if p is not None), key=_by_begin, default=None)

    def arrival(self, placement: Placement) -> Placement:
        """Return the placement with which a thing came to where it is: on this, in that.

        It begins another one each time that it is seen to have moved there.
        """
        names = self.names_of(placement.subject)
        return self.index.read(self.index.arrival(names, placement)) or placement

    def first_placement(self, subject: str) -> Placement | None:
        """Return the first placement of a thing, or None if it never had one."""
        nodes = (self.index.first(name) for name in self.names_of(subject))
        placements = [self.index.read(node) for node in nodes if node is not None]
        return min((p for p in placements if p is not None), key=_by_begin, default=None)

    def last_with_pose(self, subject: str) -> Placement | None:
        """Return the last placement of a thing that has a pose, or None if none has."""
        nodes = (self.index.last_with_pose(name) for name in self.names_of(subject))
        placements = [self.index.read(node) for node in nodes if node is not None]
        return max((p for p in placements if p is not None), key=_by_begin, default=None)

    def entries(self, subject: str) -> list[Entry]:
        """Return what the index says of all placements of a thing, oldest first.

        Much quicker than reading them, for who needs only some.
        """
        entries = [entry for name in self.names_of(subject) for entry in self.index.entries(name)]
        return sorted(entries, key=lambda entry: (entry.begin, entry.node))

    def history(self, subject: str) -> list[Placement]:
        """Return all placements of a thing or frame, oldest first."""
        nodes = (node for name in self.names_of(subject) for node in self.index.history(name))
        placements = (self.index.read(node) for node in nodes)
        return sorted((p for p in placements if p is not None), key=_by_begin)

    def open_placements(self, subject: str) -> list[Placement]:
        """Return the placements of a thing that have no end, oldest first.

        There is at most one, unless an end was taken back, or two things turned out to be one.
        """
        nodes = (node for name in self.names_of(subject) for node in self.index.open(name))
        placements = (self.index.read(node) for node in nodes)
        return sorted((p for p in placements if p is not None and p.is_current), key=_by_begin)

    def names_of(self, exemplar: str) -> list[str]:
        """Return the IRI of a thing, and those of things that turned out to be it."""
        names = {exemplar: None}
        todo = [exemplar]
        while todo:
            for quad in self.kb.match(None, RT.mergedInto, iri(todo.pop())):
                if isinstance(quad.subject, NamedNode) and quad.subject.value not in names:
                    names[quad.subject.value] = None
                    todo.append(quad.subject.value)
        return list(names)

    def doubts(self, exemplar: str, time_s: float = _NEVER) -> list[tuple[str, float]]:
        """Return the things that this one may be, with the chances, as far as it is not settled.

        A thing that was new is not another one that turns out to be where it always was. Where two
        things were known before, and one of them was seen again, they are two all the same, and
        which one was seen stays open from then on.

        Parameters
        ----------
        time_s
            Unix time about which is asked; default: now.
        """
        node, doubts = iri(exemplar), []
        for quad in self.kb.match(node, RT.possiblyIdenticalTo):
            other = quad.object
            if not isinstance(other, NamedNode):
                continue
            is_settled = self._is_settled(node, other)
            chances = [
                chance for chance, since_s in self._stated_doubts(node, other)
                if since_s <= time_s and (not is_settled or self._are_older(node, other, since_s))
            ]  # fmt: skip
            if chances:
                doubts.append((other.value, max(chances)))
        return sorted(doubts, key=lambda doubt: (-doubt[1], doubt[0]))

    def _stated_doubts(self, node: NamedNode, other: NamedNode) -> list[tuple[float, float]]:
        """Return each chance that was stated, and since when; .5 if none was."""
        stated = []
        for link in self.kb.match(None, RDF.reifies, Triple(node, RT.possiblyIdenticalTo, other)):
            times = self.kb.match(link.subject, PROV.generatedAtTime)
            since_s = min((seconds(python_value(quad.object)) for quad in times), default=-_NEVER)
            stated += [
                (float(str(python_value(quad.object))), since_s)
                for quad in self.kb.match(link.subject, RT.confidence)
            ]
        return stated or [(0.5, -_NEVER)]

    def _are_older(self, node: NamedNode, other: NamedNode, time_s: float) -> bool:
        """Whether both of two things had a place before a time, and none of them is the other.

        Or whether either may be the other since a look that saw both of them anew: that both are
        seen again does not tell which of them is the one that was known before.
        """
        if self.kb.match(other, RT.mergedInto, node):
            return False
        if self.kb.match(other, RT.possiblyIdenticalTo, node):
            return True
        return all(
            any(begin < time_s for begin in self.index.begins(thing.value, -_NEVER, time_s))
            for thing in (node, other)
        )

    def _is_settled(self, exemplar: NamedNode, other: NamedNode) -> bool:
        return bool(
            self.kb.match(exemplar, RT.distinctFrom, other)
            or self.kb.match(other, RT.distinctFrom, exemplar)
            or self.kb.match(other, RT.mergedInto, exemplar)
        )

    def way_to(self, placement: Placement, frame: str, time_s: float) -> Way:
        """Return the pose of a frame's measurements in another frame, for a placement at a time."""
        return self.frames.way(frame, placement.frame, time_s, min(placement.begin, time_s))

    def pose_in(
        self, placement: Placement, frame: str, time_s: float
    ) -> tuple[NDArray[np.float64], float] | None:
        """Return the pose (4, 4), m, of a placement in a frame at a time, and the variance added.

        None if it has no pose, or if no way leads from one frame to the other.
        """
        if placement.frame_from_subject is None:
            return None
        way = self.way_to(placement, frame, time_s)
        if way.target_from_source is None:
            return None
        return way.target_from_source @ placement.frame_from_subject, way.variance_m2

    def spread(self, placement: Placement, time_s: float) -> Spread:
        """Return how far the thing of a placement may be from there at a time."""
        # A pose is not measured anew while the thing is seen about there, but hands shift it.
        times_s = self._events_near(placement, time_s)
        events, shifts = sum(t > placement.confirmed for t in times_s), len(times_s)
        if placement.frame and not self.frames.is_of_robot(placement.frame):
            # A table that was pushed may have shaken off what stood on it.
            events += len(self.index.begins(placement.frame, placement.confirmed, time_s))
        spread = spread_of(placement, time_s, events, shifts)
        if placement.end is None or not placement.confirmed < time_s < placement.end:
            return spread
        return self._in_hindsight(placement, time_s, spread)

    def _events_near(self, placement: Placement, time_s: float) -> list[float]:
        """Return when other things came to or left the surroundings of a place since it began.

        Whoever saw them: two robots at a table measure in a frame each, and one that walks measured
        in its own frame from where it stood.
        """
        here = placement.frame_from_subject
        if here is None or time_s <= placement.begin:
            return []
        events: list[float] = []
        window_s = placement.begin, time_s
        for frame in self.index.posed_frames():
            for stood_s in self._standings(frame, time_s):
                asked_s = time_s if math.isinf(stood_s[0]) else stood_s[0]
                way = self.frames.way(frame, placement.frame, asked_s, placement.begin)
                if way.target_from_source is not None:
                    spot = (way.target_from_source @ here)[:3, 3]
                    events += self.index.events_near(
                        placement.subject, frame, spot, window_s, NEARBY_M, stood_s
                    )  # fmt: skip
        return events

    def _standings(self, frame: str, time_s: float) -> list[tuple[float, float]]:
        """Return from and until when a robot's frame stood somewhere, the latest; else all time.

        What was measured from a table moves along with it, so that only where it is now counts.
        """
        if not self.frames.is_of_robot(frame):
            return [(-_NEVER, _NEVER)]
        begins = self.index.begins(frame, -_NEVER, time_s)[-_MAX_STANDINGS:]
        return list(itertools.pairwise([*begins, _NEVER])) or [(-_NEVER, _NEVER)]

    def _in_hindsight(self, placement: Placement, time_s: float, spread: Spread) -> Spread:
        """Return the spread between when a thing was last seen at a place and when it was gone.

        Whoever took it away knows when that was. Else it left at any time in between.
        """
        assert placement.end is not None
        after = self.last_placement(placement.subject, placement.end)
        if after is not None and after.begin == placement.end and after.relation != "at":
            return replace(spread, still_there=1.0)
        if placement.relation == "held_by" and after is not None and after.iri != placement.iri:
            return replace(spread, still_there=1.0)
        gap_s = placement.end - placement.confirmed
        return replace(spread, still_there=1.0 - (time_s - placement.confirmed) / gap_s)

    def close(self) -> None:
        """Stop following the graph."""
        self.index.close()


def _by_begin(placement: Placement) -> tuple[float, str]:
    return placement.begin, placement.iri
