"""Questions about a day, put to the public operations and judged by what truly happened.

An answer is right, wrong, or "not known": that is an answer without a place, one whose chance is
below :data:`SURE`, one that may be about another thing, or one that leaves more than a quarter of
an hour open.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from rtask.world.placement import seconds
from simulate.study.day.happenings import LONGEST_COVER_S, Day
from simulate.study.day.lab import Item, Place, distance
from simulate.study.day.robots import ask, place_rows

__all__ = ["KINDS", "SURE", "Asked", "ask_all"]

SURE = 0.9
"""Chance below which an answer counts as "not known"."""
_OTHER = 0.1
_RIGHT_M = 0.05
_BESIDE_M, _MARGIN_M = 0.25, 0.03
_GAP_S = 900.0
_NEXT_LOOK_S = 660.0
_STEP_S = 600.0
_FIRST_LOOKS_S = 360.0
_TRIES = 50
Verdict = Literal["right", "not known", "wrong"]


@dataclass(frozen=True)
class Asked:
    """One question: what was asked, the answer, the truth, and the verdict."""

    kind: str
    question: str
    answer: str
    truth: str
    verdict: Verdict


@dataclass
class _Asker:
    """A reader who asks about one day."""

    day: Day
    rng: np.random.Generator

    @property
    def engine(self) -> Engine:
        """Engine that is asked."""
        return self.day.engine

    def where(self, name: str, time_s: float) -> list[Any]:
        """Return the things of a name that where_is knows and is sure of."""
        items = ask(self.engine, "where_is", name=name, frame="map", stamp=time_s)["things"]
        return [item for item in items if _is_sure(item)]

    def last_place(self, name: str, time_s: float) -> Any | None:
        """Return the place of a thing at a time from its trace, if it was surely there."""
        identified = self.where(name, time_s)
        begun = self.trace(identified[0]["thing"], time_s) if len(identified) == 1 else []
        return begun[-1] if begun else None

    def trace(self, name: str, time_s: float) -> list[Any]:
        """Return the places of a thing that began by a time, as they are known now."""
        return list(ask(self.engine, "trace_thing", name=name, stamp=time_s).places)

    @cached_property
    def last_first_sight_s(self) -> float:
        """Unix time at which a thing was seen for the first time, the latest of all; s.

        Of those that are not most likely one that was known before.
        """
        rows = self.engine.context.kb.select(f"""{PREFIXES}
SELECT ?thing (MIN(?begin) AS ?first) WHERE {{
  ?place rt:placementOf ?thing ; time:hasBeginning/time:inXSDDateTimeStamp ?begin .
  ?thing rt:exemplarOf ?product
  FILTER NOT EXISTS {{ ?thing rt:mergedInto ?known }}
}} GROUP BY ?thing ORDER BY DESC(?first)""")
        for row in rows:
            answer = ask(self.engine, "where_is", name=str(row.value("thing")), frame="map",
                         stamp=self.day.end_s)  # fmt: skip
            if all(other.chance < SURE for each in answer["things"] for other in each.may_be):
                return seconds(row.value("first"))
        return math.inf

    def item(self) -> tuple[Item, str] | None:
        """Draw a thing, and its name: its IRI if another one looks the same."""
        lab = self.day.lab
        item = lab.items[int(self.rng.integers(len(lab.items)))]
        name = item.name if item in lab.single else self.day.iri_of(item)
        return (item, name) if self.day.iri_of(item) else None

    def time(self) -> float:
        """Draw a time of the day, to a second, after every robot has looked once."""
        first_s = min(self.day.begin_s + _FIRST_LOOKS_S, self.day.end_s - 1.0)
        return float(int(self.rng.uniform(first_s, self.day.end_s)))


def ask_all(day: Day, count: int, rng: np.random.Generator) -> list[Asked]:
    """Ask so many questions, each kind in turn, and return them judged.

    Fewer on a day on which too little happened to ask about.
    """
    asker, asked = _Asker(day, rng), list[Asked]()
    kinds = list(KINDS)
    for _ in range(_TRIES * count):
        if len(asked) == count:
            break
        kind = kinds[len(asked) % len(kinds)]
        question = KINDS[kind](asker)
        if question is not None:
            asked.append(Asked(kind, *question))
    return asked


_Judged = tuple[str, str, str, Verdict] | None


def _ask_where(asker: _Asker) -> _Judged:
    drawn, time_s = asker.item(), asker.time()
    if drawn is None:
        return None
    item, name = drawn
    return _judge_where(asker, f"where was {name} at {time_s:.0f}", name, item, time_s)


def _judge_where(
    asker: _Asker, question: str, name: str, item: Item, time_s: float
) -> tuple[str, str, str, Verdict]:
    truth = item.at(time_s)
    identified = asker.where(name, time_s)
    if not identified or len(identified) > 1:
        return question, "", _words(truth), "not known"
    return question, identified[0].text, _words(truth), _right(_is_at(identified[0], truth))


def _ask_when(asker: _Asker) -> _Judged:
    drawn, time_s = asker.item(), asker.time()
    if drawn is None:
        return None
    item, name = drawn
    truth, question = item.at(time_s), f"when did {name} come to where it was at {time_s:.0f}"
    place = asker.last_place(name, time_s)
    came = None if truth is None else truth.since_s
    if place is None or place.arrived_after is None or place.since - place.arrived_after > _GAP_S:
        return question, "", f"{came}", "not known"
    low, high = place.arrived_after, place.since
    is_right = came is not None and low - 1.0 <= came <= high + 1.0
    return question, f"{low:.0f} to {high:.0f}", f"{came}", _right(is_right)


def _ask_how_long(asker: _Asker) -> _Judged:
    drawn, time_s = asker.item(), asker.time()
    if drawn is None:
        return None
    item, name = drawn
    truth, question = item.at(time_s), f"how long was {name} where it was at {time_s:.0f}"
    left = None if truth is None else item.until(truth)
    if truth is None or left is None:
        return None
    stayed = left - truth.since_s
    place = asker.last_place(name, time_s)
    if place is None or place.arrived_after is None or place.left_before is None:
        return question, "", f"{stayed:.0f} s", "not known"
    low, high = max(place.seen - place.since, 0.0), place.left_before - place.arrived_after
    if high - low > _GAP_S:
        return question, "", f"{stayed:.0f} s", "not known"
    return (question, f"{low:.0f} to {high:.0f} s", f"{stayed:.0f} s",
            _right(low - 1.0 <= stayed <= high + 1.0))  # fmt: skip


def _ask_who(asker: _Asker) -> _Judged:
    drawn, time_s = asker.item(), asker.time()
    if drawn is None:
        return None
    item, name = drawn
    truth, question = item.at(time_s), f"who moved {name} last, by {time_s:.0f}"
    mover = "" if truth is None else truth.mover
    place = asker.last_place(name, time_s)
    if place is None or not place.moved_by:
        return question, "", mover or "a person, unseen", "not known"
    return question, place.moved_by, mover or "a person, unseen", _right(place.moved_by == mover)


def _ask_beside(asker: _Asker) -> _Judged:
    drawn, time_s = asker.item(), asker.time()
    if drawn is None:
        return None
    item, name = drawn
    truth = item.at(time_s)
    if truth is None or truth.kind != "on":
        return None
    question = f"what stood within {_BESIDE_M} m of {name} at {time_s:.0f}"
    near = {other.name for other, away in _beside(asker.day, item, time_s) if away < _BESIDE_M}
    identified = asker.where(name, time_s)
    if len(identified) != 1:
        return question, "", str(sorted(near)), "not known"
    beside = _named_beside(asker, identified[0], time_s)
    if beside is None:
        return question, "", str(sorted(near)), "not known"
    named = {asker.day.identified[iri] for iri in beside}
    is_right = all(
        (other in named) == (away < _BESIDE_M)
        or abs(away - _BESIDE_M) <= _MARGIN_M
        for other, away in _beside(asker.day, item, time_s)
    )  # fmt: skip
    return question, str(sorted(each.name for each in named)), str(sorted(near)), _right(is_right)


def _named_beside(asker: _Asker, item: Any, time_s: float) -> set[str] | None:
    """Return what the graph says stood beside a thing; None if it is not sure of one of them.

    What was seen there only at the next look, and came at a time nobody knows, is not sure. Nor is
    anything while there are things that nobody had ever seen by then: one that was covered before
    a robot looked for the first time may have stood there.
    """
    block = f"<{item.thing}> rtf:near ?other ; rtf:within {_BESIDE_M} ; rtf:chance ?chance"
    rows = place_rows(asker.engine, block, time_s)
    if any(row["chance"] < SURE for row in rows) or asker.last_first_sight_s > time_s:
        return None
    beside = {str(row["other"]) for row in rows}
    # What slipped and was covered before a look is found once the cover is off.
    for wait_s in np.arange(_NEXT_LOOK_S, _NEXT_LOOK_S + LONGEST_COVER_S + 1.0, _STEP_S):
        later_s = min(time_s + float(wait_s), asker.day.end_s)
        for other in _stood_about(asker, item, later_s) - beside - {item.thing}:
            after = [p for p in asker.trace(other, later_s) if p.since > time_s]
            if any(p.arrived_after is None or p.arrived_after < time_s for p in after):
                return None
    return beside


def _stood_about(asker: _Asker, item: Any, later_s: float) -> set[str]:
    """Return what is known to have stood later about where a thing was, which may be gone by then.

    A SERVICE about the thing itself would tell of where it is then.
    """
    if item.pose is None:
        return set()
    block = f"?other rtf:poseIn <{item.frame}> ; rtf:x ?x ; rtf:y ?y"
    spot = item.pose["position"]["x"], item.pose["position"]["y"]
    return {
        str(row["other"]) for row in place_rows(asker.engine, block, later_s)
        if distance(spot, (float(row["x"]), float(row["y"]))) < _BESIDE_M + _MARGIN_M
    }  # fmt: skip


def _ask_which(asker: _Asker) -> _Judged:
    pairs = asker.day.lab.pairs
    if not pairs:
        return _ask_where(asker)
    pair = pairs[int(asker.rng.integers(len(pairs)))]
    item = pair[int(asker.rng.integers(2))]
    first_s, then_s = sorted((asker.time(), asker.time()))
    stood = item.at(first_s)
    if stood is None or stood.kind != "on":
        return None
    question = (f"where was at {then_s:.0f} that {item.name} which stood at "
                f"({stood.spot[0]:.2f}, {stood.spot[1]:.2f}) at {first_s:.0f}")  # fmt: skip
    seen = [each for each in asker.where(item.name, first_s) if _is_at(each, stood)]
    if len(seen) != 1:
        return question, "", _words(item.at(then_s)), "not known"
    return _judge_where(asker, question, seen[0]["thing"], item, then_s)


KINDS: dict[str, Callable[[_Asker], _Judged]] = {
    "where": _ask_where, "when": _ask_when, "how long": _ask_how_long, "who moved it": _ask_who,
    "what beside": _ask_beside, "which of two": _ask_which,
}  # fmt: skip
"""Kinds of questions."""


def _beside(day: Day, item: Item, time_s: float) -> list[tuple[Item, float]]:
    """Return the other things on tables at a time, with the true distance."""
    here = item.at(time_s)
    assert here is not None
    there = ((other, other.at(time_s)) for other in day.lab.items if other is not item)
    return [
        (other, distance(place.spot, here.spot)) for other, place in there
        if place is not None and place.kind == "on"
    ]  # fmt: skip


def _is_sure(item: Any) -> bool:
    is_other = any(other.chance >= _OTHER for other in item.may_be)
    return item.relation != "unknown" and item.still_there >= SURE and not is_other


def _is_at(item: Any, truth: Place | None) -> bool:
    """Whether an answer names the true place, on a table to 5 cm."""
    if truth is None or truth.kind == "away":
        return False
    if truth.kind == "on":
        if item.relation != "at" or item.frame_id != "map":
            return False
        at = item.pose["position"]
        return distance((at["x"], at["y"]), truth.spot) <= _RIGHT_M
    if truth.kind == "in":
        return bool(item.relation == "in" and item.place_label == truth.where)
    return bool(item.relation == "held_by" and item.by == truth.where)


def _right(is_right: bool) -> Verdict:
    return "right" if is_right else "wrong"


def _words(place: Place | None) -> str:
    if place is None:
        return "nowhere"
    return f"{place.kind} {place.where} {place.spot if place.kind == 'on' else ''}".strip()
