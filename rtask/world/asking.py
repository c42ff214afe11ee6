"""Answers to where something is: by name, kind or IRI, at a time, near a place."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, iri
from rtask.world.estimates import estimated_placement
from rtask.world.names import find_exemplars, find_frame, find_marks, is_exemplar, label_of
from rtask.world.placement import Placement
from rtask.world.spots import carried
from rtask.world.whereabouts import Question, Whereabouts, Whereis
from rtask.world.wording import answer_text, sentence

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = ["answer"]

_CHANCE = 0.9
_UNKNOWN = "unknown"


def answer(world: WorldState, question: Question) -> Whereis:
    """Return where the things are that a question is about.

    Raises
    ------
    UnknownTermError
        A frame or place of the question is not in the graph.
    UsageError
        Several frames have the name.
    """
    time_s = time.time() if question.at is None else question.at
    frame = None if question.frame is None else find_frame(world, question.frame)
    asked = _Asked(world, time_s, frame, question.at is None)
    pairs, untried = find_exemplars(world, question.name, question.max_things)
    places = [asked.where(exemplar, product) for exemplar, product in pairs]
    is_called, unresolved = bool(places), 0
    if question.near is not None:
        marks = find_marks(world, question.near)
        near = [asked.is_near(place, marks, question.radius_m) for place in places]
        unresolved = near.count(None)
        places = [place for place, is_near in zip(places, near, strict=True) if is_near]
    places.sort(key=lambda p: (not p.is_known, -p.still_there, -(p.seen_s or 0.0), p.exemplar))
    text = answer_text(question, places, is_called, untried, unresolved)
    return Whereis(time_s, tuple(places), text, untried + unresolved)


@dataclass(frozen=True)
class _Asked:
    """The time and the frame of a question."""

    world: WorldState
    time_s: float
    frame: str | None
    is_now: bool

    def where(self, exemplar: str, product: str) -> Whereabouts:
        """Return the whereabouts of a thing, or of a product that has no things."""
        world, time_s = self.world, self.time_s
        last = self._last(exemplar, product)
        doubts = tuple(world.doubts(exemplar, time_s)) if exemplar else ()
        whereabouts = Whereabouts(
            exemplar, product, label_of(world, exemplar or product), _UNKNOWN, doubts=doubts
        )
        if last is not None:
            whereabouts = replace(
                whereabouts, since_s=world.arrival(last).begin, seen_s=min(last.confirmed, time_s),
                until_s=last.end, place=last.place, place_label=label_of(world, last.place),
                agent=label_of(world, last.agent),
            )  # fmt: skip
        elif stated := self._stated_place(exemplar, product):
            whereabouts = replace(whereabouts, place=stated, place_label=label_of(world, stated))
        if last is not None and last.holds_at(time_s):
            whereabouts = self._placed(whereabouts, last)
        return replace(whereabouts, text=sentence(whereabouts, time_s, self.is_now))

    def _stated_place(self, exemplar: str, product: str) -> str:
        """Return what something is stated to stand on or in, though nobody saw it; empty for none.

        Of several, as where what is on a tray is on the table too, one that is on all others.
        """
        match = self.world.kb.match
        for node in (exemplar, product):
            places = {q.object for q in match(iri(node), RT.locatedOn)} if node else set()
            named = sorted(place.value for place in places if isinstance(place, NamedNode))
            if named:
                return max(named, key=lambda place: len(match(iri(place), RT.locatedOn)))
        return ""

    def is_near(self, place: Whereabouts, marks: Sequence[str], radius_m: float) -> bool | None:
        """Whether a thing is in, on or near one of the places, robots, frames and things.

        None where frames on the way are too many to tell.
        """
        if place.place in marks:
            return True
        if place.frame_from_exemplar is None:
            return False
        is_open = False
        for mark in marks:
            spots = self._spots(mark, place.frame)
            away = [np.linalg.norm(spot - place.frame_from_exemplar[:3, 3]) for spot in spots]
            if min(away, default=np.inf) <= radius_m:
                return True
            is_open |= not spots and (self._is_cut(mark) or self._is_cut(place.frame))
        return None if is_open else False

    def _is_cut(self, node: str) -> bool:
        """Whether the frame of something is deeper in its tree than what is followed."""
        placement = self.world.placement_at(node, self.time_s)
        frames = [node, *self._body_frames(node), *([placement.frame] if placement else [])]
        return any(self.world.frames.rooted(frame, self.time_s).is_cut for frame in frames if frame)

    def _last(self, exemplar: str, product: str) -> Placement | None:
        if exemplar:
            return self.world.last_placement(exemplar, self.time_s)
        return estimated_placement(self.world.kb, product, self.time_s)

    def _placed(self, whereabouts: Whereabouts, last: Placement) -> Whereabouts:
        world, time_s = self.world, self.time_s
        seen = replace(last, confirmed=min(last.confirmed, time_s))
        spread = world.spread(seen, time_s)
        last = carried(world, seen, time_s)
        # The spread is of the pose as it was measured; a tray that was moved adds its own errors.
        spread = replace(spread, sigma_m=math.sqrt(
            max(spread.sigma_m**2 - seen.sigma_m**2, 0.0) + last.sigma_m**2
        ))  # fmt: skip
        whereabouts = replace(
            whereabouts, relation=last.relation, still_there=spread.still_there * last.confidence
        )
        if last.frame_from_subject is None:
            return whereabouts
        frame, pose = last.frame, last.frame_from_subject
        way = world.way_to(last, self.frame or frame, time_s)
        if way.target_from_source is not None:
            frame, pose = self.frame or frame, way.target_from_source @ pose
        spread = replace(spread, sigma_m=float(np.sqrt(spread.sigma_m**2 + way.variance_m2)))
        return replace(
            whereabouts, frame=frame, frame_id=world.frames.name_of(frame),
            frame_from_exemplar=pose, radius90_m=spread.radius(_CHANCE), frame_reason=way.reason,
        )  # fmt: skip

    def _spots(self, mark: str, frame: str) -> list[NDArray[np.float64]]:
        """Return where a robot, frame or thing is in a frame, (3,), m."""
        spots = []
        for source in (*self._body_frames(mark), mark):
            way = self.world.frames.target_from_source(frame, source, self.time_s, self.time_s)
            if way is not None:
                spots.append(way[0][:3, 3])
        exemplars = [mark] if is_exemplar(self.world, mark) else self.world.exemplars_of(mark)
        for exemplar in exemplars:
            placement = self.world.placement_at(exemplar, self.time_s)
            there = None if placement is None else self.world.pose_in(
                carried(self.world, placement, self.time_s), frame, self.time_s
            )  # fmt: skip
            if there is not None:
                spots.append(there[0][:3, 3])
        return spots

    def _body_frames(self, robot: str) -> list[str]:
        quads = self.world.kb.match(iri(robot), RT.bodyFrame)
        return [quad.object.value for quad in quads if isinstance(quad.object, NamedNode)]
