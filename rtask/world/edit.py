"""Changes of the world in one commit: seen, held, put somewhere, lost.

Closing an interval and opening the next are statements of the same commit, so that no reader sees a
thing at two places or, on its way, at none. An end is added to a placement rather than taken from
it: a robot cannot write into the graph of another one, whose thing it moved.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import RT, mint
from rtask.rdf.terms import Literal, NamedNode, iri
from rtask.world.identity import Candidate, identify
from rtask.world.placement import DEFAULT_SIGMA_M, Placement, Relation
from rtask.world.spots import Pose, is_at
from rtask.world.standing import is_same_standing
from rtask.world.state import WorldState
from rtask.world.statements import Statement, confirmed, doubted, ended, new_exemplar, placed
from rtask.world.uncertainty import MOVED_M, NEARBY_M, Spread, spread_of

__all__ = ["MOVED_RAD", "Seen", "WorldEdit"]

MOVED_RAD = float(np.deg2rad(15.0))
"""Angle from which a thing has turned, rad."""

_CONFIRM_S = 60.0
_NOWHERE = Spread(0.0, 0.0, 1.0)
_NO_PLACE: tuple[Relation, str] = ("at", "")


@dataclass(frozen=True, eq=False)
class Seen:
    """A thing of a product as seen by a robot.

    Parameters
    ----------
    product
        IRI of the product.
    frame, frame_from_exemplar
        IRI of the frame, and the pose (4, 4) in it, m.
    time_s
        When it was seen, Unix time.
    sigma_m
        Standard deviation of the position per axis, m.
    confidence
        In what it is and where, 0..1.
    min_extent_m
        The product's smaller horizontal extent, m; 0 if it is not known.
    is_round
        A turn about the z axis is no motion.
    robot
        IRI of the robot; what lies in its places or hands has an IRI below it.
    hands
        IRIs of the robot's end effectors.
    agent, source
        IRIs of the author and of the observation; or empty.
    exemplar
        IRI of the thing, if the robot says which it means; or empty.
    """

    product: str
    frame: str
    frame_from_exemplar: NDArray[np.float64]
    time_s: float
    sigma_m: float = DEFAULT_SIGMA_M
    confidence: float = 1.0
    min_extent_m: float = 0.0
    is_round: bool = False
    robot: str = ""
    hands: Collection[str] = ()
    agent: str = ""
    source: str = ""
    exemplar: str = ""


@dataclass
class WorldEdit:
    """The statements of one commit about things and their places.

    Parameters
    ----------
    world
        The world before the commit.
    graph
        Graph of the author, from which alone something can be withdrawn.
    new_exemplar
        IRI for the next thing that turns out to be new; "" to make one up.

    Attributes
    ----------
    statements, withdrawn
        To be added to, and removed from, the author's graph.
    """

    world: WorldState
    graph: NamedNode
    new_exemplar: str = ""
    statements: list[Statement] = field(default_factory=list)
    withdrawn: list[Statement] = field(default_factory=list)
    _last: dict[str, Placement] = field(default_factory=dict)
    _ended: set[str] = field(default_factory=set)
    _made: dict[str, list[str]] = field(default_factory=dict)

    def see(self, seen: Seen) -> str:
        """State that a thing was seen; return its IRI, a new one if it is none of those known.

        What was put on or into something stays there, now with its pose, unless it is seen beside.
        """
        exemplar = seen.exemplar
        doubts: tuple[tuple[str, float], ...] = ()
        if not exemplar:
            candidates = [
                self._candidate(candidate, seen) for candidate in self._exemplars(seen.product)
            ]
            identity = identify(candidates, seen.sigma_m, seen.min_extent_m)
            exemplar, doubts = identity.exemplar, identity.doubts
            # A thing that was followed all along is known by that, and needs no doubts.
            if exemplar and not identity.is_followed:
                doubts += self._mutual_doubts(exemplar, {name for name, _ in doubts})
        if not exemplar:
            exemplar = self.make_exemplar(seen.product)
        for other, chance in doubts:
            if other not in dict(self.world.doubts(exemplar)):
                base = self.world.kb.base
                self.statements += doubted(base, exemplar, other, chance, seen.time_s)
        last = self.last(exemplar)
        # Told late: what is known is newer, and a place in the past would contradict it.
        if last is not None and seen.time_s < last.begin:
            return exemplar
        if last is not None and last.is_current and self._is_there(last, seen):
            self._confirm(last, seen.time_s)
            self._settle(last, seen.time_s)
            return exemplar
        stays = last is not None and last.is_current and self._stays(last, seen)
        # Seen where it was put, a thing stays in its box; only its pose is new.
        relation, place = (last.relation, last.place) if last and stays else _NO_PLACE
        self._close(exemplar, seen.time_s)
        self._open(
            Placement(
                self._node(), exemplar, seen.time_s, None, seen.time_s, relation, place, seen.frame,
                seen.frame_from_exemplar, seen.sigma_m, seen.confidence, seen.agent,
                seen.source,
            )
        )  # fmt: skip
        return exemplar

    def put(
        self,
        exemplar: str,
        relation: Relation,
        place: str,
        time_s: float,
        agent: str = "",
        source: str = "",
        confidence: float = 1.0,
        *,
        was_carried: bool = True,
    ) -> None:
        """State that a thing is on, in or held by something, from a time on.

        Parameters
        ----------
        was_carried
            Whether it was brought there. If not, and its last pose is there, it keeps that.
        """
        last = self.last(exemplar)
        if last is not None and time_s < last.begin:
            return
        is_same = last is not None and (last.relation, last.place) == (relation, place)
        if last is not None and last.is_current and is_same:
            self._confirm(last, time_s)
            return
        # What a hand carried is turned on its way; only what others moved beneath keeps its pose.
        pose = None if was_carried or relation == "held_by" else self._pose_at(last, place, time_s)
        self._close(exemplar, time_s)
        self._open(
            Placement(
                self._node(), exemplar, time_s, None, time_s, relation, place,
                confidence=confidence, agent=agent, source=source, **_posed(pose),
            )
        )  # fmt: skip

    def lose(self, exemplar: str, time_s: float) -> None:
        """State that a thing is no longer where it was, and nobody knows where."""
        self.lose_all([exemplar], time_s)

    def lose_all(self, exemplars: Sequence[str], time_s: float) -> None:
        """State that several things are no longer where they were.

        If one that is like a lost thing was seen elsewhere meanwhile, and no other like it is lost,
        it was this one.
        """
        for exemplar in exemplars:
            last = self.last(exemplar)
            if last is None or time_s < last.begin:
                continue
            other = self._carried(last, exemplars) if last.is_current else None
            # The loss of one thing and the sight of a new one are the same event: it was moved.
            self._close(exemplar, time_s if other is None else other.begin)
            if other is not None:
                same = NamedNode(other.subject), RT.mergedInto, NamedNode(exemplar)
                self.statements.append(same)

    def _carried(self, last: Placement, lost: Sequence[str]) -> Placement | None:
        """Return the first placement of a thing that turns out to be a lost one, or None."""
        for other in self._doubts_about(last.subject):
            first = self.world.first_placement(other)
            doubts = [name for name, _ in self.world.doubts(other)]
            if self.world.is_merged(other) or last.subject not in doubts or first is None:
                continue
            rivals = [name for name in doubts if name != last.subject]
            # With another thing that may be it, nobody can tell which of the two moved.
            is_only = all(self._is_there_still(name) and name not in lost for name in rivals)
            if is_only and last.confirmed < first.begin:
                return first
        return None

    def _is_there_still(self, exemplar: str) -> bool:
        last = self.last(exemplar)
        return last is not None and last.is_current

    def stand(
        self,
        frame: str,
        parent: str,
        parent_from_frame: NDArray[np.float64],
        time_s: float,
        sigma_m: float = 0.0,
        agent: str = "",
    ) -> None:
        """State that a frame stands in another one, from a time on.

        A frame that did not move keeps its interval, which is confirmed.

        Parameters
        ----------
        frame, parent
            IRIs of the frame and of the one above it.
        parent_from_frame : (4, 4), m
        sigma_m
            Standard deviation of the position per axis, m.
        """
        last = self.last(frame)
        if last is not None and time_s < last.begin:
            return
        if last is not None and is_same_standing(last, parent, parent_from_frame):
            self._confirm(last, time_s)
            return
        self._close(frame, time_s)
        self._open(
            Placement(
                self._node(), frame, time_s, None, time_s, "at", "", parent, parent_from_frame,
                sigma_m, agent=agent,
            )
        )  # fmt: skip

    def exemplar_of(self, product: str, robot: str, hands: Collection[str]) -> str:
        """Return the thing that a robot handled which did not say which one; "" if none is known.

        The one in its hand; else the one that it, then anybody, saw or moved last in its frames.
        """
        ranked: list[tuple[bool, bool, float, str]] = []
        for exemplar in self._exemplars(product):
            last = self.last(exemplar)
            if last is not None:
                is_held = last.is_current and last.place in hands
                # A robot without a camera on the place still handles what is on its own table.
                is_near = last.frame.startswith(f"{robot}/") or last.place.startswith(f"{robot}/")
                if is_held or is_near:
                    ranked.append((is_held, last.is_current, last.confirmed, exemplar))
        return max(ranked)[-1] if ranked else ""

    def make_exemplar(self, product: str) -> str:
        """State a new exemplar of a product; return its IRI."""
        exemplar, self.new_exemplar = self.new_exemplar or mint(self.world.kb.base, "thing"), ""
        self.statements += new_exemplar(exemplar, product)
        self._made.setdefault(product, []).append(exemplar)
        return exemplar

    @property
    def made(self) -> int:
        """Number of things that this commit states for the first time."""
        return sum(len(made) for made in self._made.values())

    def is_of(self, exemplar: str, product: str) -> bool:
        """Whether a thing is an exemplar of a product, stored or made in this commit."""
        return exemplar in self._made.get(product, ()) or bool(
            self.world.kb.match(iri(exemplar), RT.exemplarOf, iri(product))
        )

    def drain(self) -> tuple[list[Statement], list[Statement]]:
        """Return what to add and to withdraw since the last time."""
        drained = self.statements, self.withdrawn
        self.statements, self.withdrawn = [], []
        return drained

    def last(self, exemplar: str) -> Placement | None:
        """Return the last placement of a thing, with what this commit changes."""
        known = self._last.get(exemplar)
        return known if known or self._is_made(exemplar) else self.world.last_placement(exemplar)

    def _is_made(self, exemplar: str) -> bool:
        return any(exemplar in made for made in self._made.values())

    def _exemplars(self, product: str) -> list[str]:
        return [*self.world.exemplars_of(product), *self._made.get(product, ())]

    def _candidate(self, exemplar: str, seen: Seen) -> Candidate:
        last = self.last(exemplar)
        if last is None:
            return Candidate(exemplar, None, _NOWHERE, is_current=False, is_reachable=False)
        # What this commit changes is not in the index yet, from which the spread counts events.
        pending = exemplar in self._last
        spread = spread_of(last, seen.time_s) if pending else self.world.spread(last, seen.time_s)
        there = self.world.pose_in(last, seen.frame, seen.time_s)
        is_in_place = None
        if last.is_current and last.frame_from_subject is None and last.relation in ("on", "in"):
            is_in_place = is_at(self.world, last.place, _pose_of(seen))
            before = self._pose_before(last) if is_in_place is None else None
            if before is not None:
                there = self.world.pose_in(before, seen.frame, seen.time_s)
        is_own = last.place.startswith(f"{seen.robot}/") or last.place in seen.hands
        return Candidate(
            exemplar,
            None if there is None else _distance(there[0], seen.frame_from_exemplar),
            spread,
            last.is_current,
            last.is_current and last.place in seen.hands,
            there is not None or is_own or self._was_in_reach(last, seen),
            seen.time_s - last.confirmed,
            last.relation == "held_by" and not last.is_current,
            bool(is_in_place),
        )

    def _was_in_reach(self, last: Placement, seen: Seen) -> bool:
        """Whether a thing that was in a hand or box last was in the frames of a robot before."""
        if last.frame_from_subject is not None or self._is_made(last.subject):
            return False
        posed = self.world.last_with_pose(last.subject)
        return posed is not None and self.world.pose_in(posed, seen.frame, seen.time_s) is not None

    def _is_there(self, last: Placement, seen: Seen) -> bool:
        there = self.world.pose_in(last, seen.frame, seen.time_s)
        if there is None:
            return False
        # Between two frames, the error of their transform comes on top of the least move.
        pose, moved_m = there[0], MOVED_M + (0.0 if last.frame == seen.frame else seen.sigma_m)
        if float(np.linalg.norm(pose[:3, 3] - seen.frame_from_exemplar[:3, 3])) > moved_m:
            return False
        # A round thing has no angle about its own axis.
        if seen.is_round:
            cosine = pose[:3, 2] @ seen.frame_from_exemplar[:3, 2]
        else:
            cosine = (np.trace(pose[:3, :3].T @ seen.frame_from_exemplar[:3, :3]) - 1.0) / 2.0
        return bool(np.arccos(np.clip(cosine, -1.0, 1.0)) <= MOVED_RAD)

    def _stays(self, last: Placement, seen: Seen) -> bool:
        """Whether a thing that was put on or into something is still there where it is seen now.

        Where the graph does not know where the place is or how large, a look can contradict it only
        by what was seen before: a shove leaves a thing where it is, and a thing that stands where
        it stood when somebody said what it is on has not been taken away.
        """
        if last.relation not in ("on", "in"):
            return False
        is_there = is_at(self.world, last.place, _pose_of(seen))
        if is_there is not None:
            return is_there
        if last.frame_from_subject is None:
            if last.relation == "in":  # things are seen on tables, and seldom in boxes
                return False
            before = self._pose_before(last)
            return bool(seen.exemplar) or (before is not None and self._is_there(before, seen))
        # Put down and nudged, it is still on the same table.
        there = self.world.pose_in(last, seen.frame, seen.time_s)
        return there is not None and _distance(there[0], seen.frame_from_exemplar) <= NEARBY_M

    def _pose_before(self, last: Placement) -> Placement | None:
        """Return the place with a pose that a thing had when somebody stated what it is on.

        What is in a box now was moved into it.
        """
        if last.relation != "on" or self._is_made(last.subject):
            return None
        for entry in self.world.entries(last.subject):
            if entry.end != last.begin or entry.place >= 0 or entry.frame < 0:
                continue
            placement = self.world.index.read(entry.node)
            if placement is not None and placement.frame_from_subject is not None:
                return replace(last, frame=placement.frame, begin=placement.begin,
                               frame_from_subject=placement.frame_from_subject,
                               sigma_m=placement.sigma_m)  # fmt: skip
        return None

    def _pose_at(self, last: Placement | None, place: str, time_s: float) -> Pose | None:
        """Return the pose that a thing has, if that is at a place; in a frame that stays."""
        if last is None or not last.is_current or last.frame_from_subject is None:
            return None
        frame = last.frame
        if self.world.frames.is_of_robot(frame):  # what it measured is where the robot was then
            frame = self.world.frames.rooted(frame, time_s, last.begin).root
        there = self.world.pose_in(last, frame, time_s)
        if there is None:
            return None
        sigma_m = float(np.hypot(last.sigma_m, np.sqrt(there[1])))
        pose = Pose(frame, there[0], time_s, sigma_m)
        return pose if is_at(self.world, place, pose) else None

    def _open(self, placement: Placement) -> None:
        self.statements += placed(placement)
        self._last[placement.subject] = placement

    def _close(self, subject: str, time_s: float) -> None:
        """End the placement of a thing, and earlier ones that an undone change left without end."""
        last = self.last(subject)
        stored = [] if self._is_made(subject) else self.world.open_placements(subject)
        stray = [
            placement for placement in stored
            if placement.iri not in self._ended and (last is None or placement.iri != last.iri)
        ]  # fmt: skip
        current = [last] if last is not None and last.is_current else []
        begins = [placement.begin for placement in (*stray, *current)]
        for k, placement in enumerate(stray):
            self._end(placement, begins[k + 1] if k + 1 < len(begins) else time_s)
        for placement in current:
            self._end(placement, time_s)
            confirmed_s = min(placement.confirmed, time_s)
            self._last[subject] = replace(placement, end=time_s, confirmed=confirmed_s)

    def _end(self, placement: Placement, time_s: float) -> None:
        self.statements += ended(placement.iri, max(placement.begin, time_s))
        self._ended.add(placement.iri)

    def _node(self) -> str:
        return mint(self.world.kb.base, "placement")

    def _confirm(self, last: Placement, time_s: float) -> None:
        """State that a placement still lasts, unless that was stated within a minute."""
        # Each sight would be a commit; a place is as sure a minute later.
        if time_s - last.confirmed < _CONFIRM_S:
            return
        node = iri(last.iri)
        for quad in self.world.kb.match(node, RT.confirmedAt, None, self.graph):
            if isinstance(quad.object, Literal):
                self.withdrawn.append((node, RT.confirmedAt, quad.object))
        self.statements.append(confirmed(last.iri, time_s))

    def _settle(self, last: Placement, time_s: float) -> None:
        """State that a thing which is still there is not another one that was seen meanwhile."""
        for other in self._doubts_about(last.subject):
            place = self.last(other)
            # Both were in place at the same time, so that they are two.
            if place is None or not place.is_current or not last.begin < place.begin < time_s:
                continue
            first, second = NamedNode(other), NamedNode(last.subject)
            if not self.world.kb.match(first, RT.distinctFrom, second):
                self.statements.append((first, RT.distinctFrom, second))

    def _doubts_about(self, exemplar: str) -> list[str]:
        return sorted(
            quad.subject.value
            for quad in self.world.kb.match(None, RT.possiblyIdenticalTo, iri(exemplar))
            if isinstance(quad.subject, NamedNode)
        )

    def _mutual_doubts(
        self, exemplar: str, named: Collection[str]
    ) -> tuple[tuple[str, float], ...]:
        """Return the things that may be this one, which then may be any of them."""
        chances = (
            (other, dict(self.world.doubts(other)).get(exemplar))
            for other in self._doubts_about(exemplar)
            if other not in named and not self.world.is_merged(other)
        )
        return tuple((other, chance) for other, chance in chances if chance is not None)


def _pose_of(seen: Seen) -> Pose:
    return Pose(seen.frame, seen.frame_from_exemplar, seen.time_s, seen.sigma_m)


def _posed(pose: Pose | None) -> dict[str, Any]:
    if pose is None:
        return {}
    return {"frame": pose.frame, "frame_from_subject": pose.frame_from_exemplar,
            "sigma_m": pose.sigma_m}  # fmt: skip


def _distance(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(first[:3, 3] - second[:3, 3]))
