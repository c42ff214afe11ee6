"""Changes of the world in one commit: seen, held, put somewhere, lost.

Closing an interval and opening the next are statements of the same commit, so that no reader sees a
thing at two places or, on its way, at none. An end is added to a placement rather than taken from
it: a robot cannot write into the graph of another one, whose thing it moved.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import RT, mint
from rtask.rdf.terms import Literal, NamedNode, iri
from rtask.world.identities.doubts import doubts_about, is_moved_together, mutual_doubts
from rtask.world.identities.identity import Candidate, identify
from rtask.world.identities.late import Then, inserted, is_same_place, then, was_seen_since
from rtask.world.identities.pending import MOVED_RAD, PendingWorld
from rtask.world.identities.seen import Look, Seen, in_order
from rtask.world.identities.supports import NO_SUPPORT, Support, support_of, supports_at
from rtask.world.placement import Placement, Relation
from rtask.world.spots import Pose
from rtask.world.standing import is_same_standing
from rtask.world.statements import Statement, confirmed, doubted, ended, new_exemplar, placed
from rtask.world.uncertainty import MOVED_M

__all__ = ["MOVED_RAD", "Seen", "WorldEdit"]

_CONFIRM_S = 60.0


@dataclass
class WorldEdit(PendingWorld):
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

    graph: NamedNode
    new_exemplar: str = ""
    statements: list[Statement] = field(default_factory=list)
    withdrawn: list[Statement] = field(default_factory=list)
    _ended: set[str] = field(default_factory=set)
    _look: Look = field(default_factory=Look)
    _guessed: dict[str, list[str]] = field(default_factory=dict)
    _supports: dict[float, list[Support]] = field(default_factory=dict)

    def see_all(self, look: Sequence[Seen]) -> list[str]:
        """State what was seen in one look; return the IRIs of the things, in its order.

        Each is another thing. What a robot names is taken first, then what is nearest to where a
        thing was: the order of a report says nothing, and must not decide which of two equal cups
        was moved.
        """
        seen_as: dict[int, str] = {}
        for k in self._nearest_first(look):
            seen_as[k] = self.see(look[k])
        return [seen_as[k] for k in range(len(look))]

    def _nearest_first(self, look: Sequence[Seen]) -> list[int]:
        alike = Counter(seen.product for seen in look if not seen.exemplar)
        away: list[tuple[float, int, str]] = []
        for k, seen in enumerate(look):
            if seen.exemplar or alike[seen.product] < 2:
                continue
            candidates = (self.candidate(name, seen) for name in self.exemplars(seen.product))
            away += [(c.distance_m, k, c.exemplar) for c in candidates if c.distance_m is not None]
        named = [k for k, seen in enumerate(look) if seen.exemplar]
        return in_order(named, sorted(away), len(look))

    def see(self, seen: Seen) -> str:
        """State that a thing was seen; return its IRI, a new one if it is none of those known.

        What was put on or into something stays there, now with its pose, unless it is seen beside.
        """
        exemplar = (not seen.exemplar and self._look.twice(seen)) or self._see(seen)
        self._look.add(seen, exemplar)
        return exemplar

    def _see(self, seen: Seen) -> str:
        exemplar = seen.exemplar or self._identified(seen)
        last = self.last(exemplar)
        if last is not None and seen.time_s < last.begin:
            self._see_late(exemplar, seen)
        elif last is not None and last.is_current and self.is_there(last, seen):
            self._see_again(exemplar, seen, last)
        elif not was_seen_since(last, seen.time_s):
            self._see_elsewhere(exemplar, seen, last)
        return exemplar

    def _identified(self, seen: Seen) -> str:
        """Return which thing of its product is seen, made if it is none of those known."""
        candidates = [
            self.candidate(candidate, seen) for candidate in self.exemplars(seen.product)
            if not self._look.has(candidate, seen.time_s)
        ]  # fmt: skip
        identity = identify(candidates, seen.sigma_m, seen.min_extent_m)
        doubts = identity.doubts
        rivals: tuple[str, ...] = ()
        if identity.is_followed:
            # It is known by having been followed, so it may be none of the others.
            exemplar = self._united(identity.exemplar, candidates, seen)
        elif identity.exemplar:
            exemplar = identity.exemplar
            self._guessed.setdefault(seen.product, []).append(exemplar)
            doubts += mutual_doubts(self.world, exemplar, {name for name, _ in doubts})
        else:
            exemplar = self.make_exemplar(seen.product)
            rivals = tuple(self._guessed.get(seen.product, ()))
        self._doubt(exemplar, doubts, rivals, seen.time_s)
        return exemplar

    def _doubt(
        self,
        exemplar: str,
        doubts: Sequence[tuple[str, float]],
        rivals: Sequence[str],
        time_s: float,
    ) -> None:
        """State which known things it may be, and which were taken for it or may have been."""
        base = self.world.kb.base
        known = dict(self.world.doubts(exemplar)) if doubts else {}
        for other, chance in doubts:
            if other not in known:
                self.statements += doubted(base, exemplar, other, chance, time_s)
        for other in rivals:
            # Of three cups in sight two were lost: which two, nobody knows, nor ever will.
            for pair in ((exemplar, other), (other, exemplar)):
                self.statements += doubted(base, *pair, 1.0 / (len(rivals) + 1), time_s)

    def _see_again(self, exemplar: str, seen: Seen, last: Placement) -> None:
        """State that a thing still is where it was."""
        self._confirm(last, seen.time_s)
        self._settle(last, seen.time_s)
        if last.relation == "at":  # the table may have been described since
            relation, place = self._support_of(seen, last)
            if place:
                self.put(exemplar, relation, place, seen.time_s, seen.agent, was_carried=False)

    def _see_elsewhere(self, exemplar: str, seen: Seen, last: Placement | None) -> None:
        """State where a thing is now: seen where it was put, it stays there with a new pose."""
        stays = last is not None and last.is_current and self.stays(last, seen)
        relation, place = (
            (last.relation, last.place) if last and stays else self._support_of(seen, last)
        )
        self._close(exemplar, seen.time_s)
        self._open(self._seen_at(exemplar, seen, relation, place))

    def _support_of(self, seen: Seen, last: Placement | None) -> tuple[Relation, str]:
        """Return what a thing stands on or lies in where it is seen now."""
        if last is not None and last.is_current and last.relation == "held_by":
            return NO_SUPPORT  # the hand may hold it still, just above the table
        if seen.time_s not in self._supports:
            self._supports[seen.time_s] = supports_at(self.world, seen.time_s)
        return support_of(self.world, seen, self._supports[seen.time_s])

    def _seen_at(
        self, exemplar: str, seen: Seen, relation: Relation = "at", place: str = ""
    ) -> Placement:
        return Placement(
            self._node(), exemplar, seen.time_s, None, seen.time_s, relation, place, seen.frame,
            seen.frame_from_exemplar, seen.sigma_m, seen.confidence, seen.agent, seen.source,
        )  # fmt: skip

    def _see_late(self, exemplar: str, seen: Seen) -> None:
        """State where a thing was seen before it came to its last place."""
        known = self._then(exemplar, seen.time_s)
        if known is None:
            return
        before = known.placement
        if before is not None and before.holds_at(seen.time_s) and self.is_there(before, seen):
            self._confirm(before, seen.time_s)
            return
        self.statements += inserted(known, self._seen_at(exemplar, seen), seen.time_s)

    def _then(self, exemplar: str, time_s: float) -> Then | None:
        """Return what is known of a thing at a time before its last place; None of a new one."""
        # What this commit says of it is in no index yet, and is not older than the commit itself.
        return None if exemplar in self._last else then(self.world, exemplar, time_s)

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
            known = self._then(exemplar, time_s)
            if known is not None and not is_same_place(known.placement, relation, place, time_s):
                told = Placement(self._node(), exemplar, time_s, None, time_s, relation, place,
                                 confidence=confidence, agent=agent, source=source)  # fmt: skip
                self.statements += inserted(known, told, time_s)
            return
        if last is not None and is_same_place(last, relation, place, time_s):
            self._confirm(last, time_s)
            return
        if was_seen_since(last, time_s):
            return
        # What a hand carried is turned on its way; only what others moved beneath keeps its pose.
        pose = None if was_carried or relation == "held_by" else self.pose_at(last, place, time_s)
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
            if last is not None and time_s < last.begin:
                known = self._then(exemplar, time_s)
                self.statements += () if known is None else inserted(known, None, time_s)
            if last is None or time_s < last.begin or was_seen_since(last, time_s):
                continue
            other = self._carried(last, exemplars) if last.is_current else None
            # The loss of one thing and the sight of a new one are the same event: it was moved.
            self._close(exemplar, time_s if other is None else other.begin)
            if other is not None:
                same = NamedNode(other.subject), RT.mergedInto, NamedNode(exemplar)
                self.statements.append(same)

    def _carried(self, last: Placement, lost: Sequence[str]) -> Placement | None:
        """Return the first placement of a thing that turns out to be a lost one, or None."""
        for other in doubts_about(self.world, last.subject):
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
        for exemplar in self.exemplars(product):
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

    def _united(self, exemplar: str, candidates: Sequence[Candidate], seen: Seen) -> str:
        """Return the thing that is seen, after others that turn out to be it were merged into it.

        Where maps were tied, or a table was moved, since two robots made a thing each.
        """
        reach_m = max(MOVED_M, seen.min_extent_m / 2.0)
        for other in candidates:
            is_here = other.is_current and other.distance_m is not None
            if other.exemplar == exemplar or not is_here or (other.distance_m or 0.0) > reach_m:
                continue
            pair = [self.world.last_placement(name) for name in (exemplar, other.exemplar)]
            first, second = sorted((p for p in pair if p is not None), key=lambda p: p.begin)
            if {first.subject, second.subject} & {*self._last, *self._ended}:
                continue  # this commit moves one of them
            if not is_moved_together(self.world, first, second, seen.time_s):
                continue
            self._close(first.subject, second.begin)
            same = NamedNode(second.subject), RT.mergedInto, NamedNode(first.subject)
            self.statements.append(same)
            self._last[first.subject] = replace(second, subject=first.subject)
            exemplar = first.subject
        return exemplar

    def _open(self, placement: Placement) -> None:
        self.statements += placed(placement)
        self._last[placement.subject] = placement

    def _close(self, subject: str, time_s: float) -> None:
        """End the placement of a thing, and earlier ones that an undone change left without end."""
        last = self.last(subject)
        stored = [] if self.is_made(subject) else self.world.open_placements(subject)
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
        for other in doubts_about(self.world, last.subject):
            place = self.last(other)
            # Both were in place at the same time, so that they are two.
            if place is None or not place.is_current or not last.begin < place.begin < time_s:
                continue
            first, second = NamedNode(other), NamedNode(last.subject)
            if not self.world.kb.match(first, RT.distinctFrom, second):
                self.statements.append((first, RT.distinctFrom, second))


def _posed(pose: Pose | None) -> dict[str, Any]:
    if pose is None:
        return {}
    return {"frame": pose.frame, "frame_from_subject": pose.frame_from_exemplar,
            "sigma_m": pose.sigma_m}  # fmt: skip
