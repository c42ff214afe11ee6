"""Spatial relations between things, places and robots, as queries in SPARQL ask for them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from rtask.errors import TooLargeError
from rtask.rdf.namespaces import CORA, RDF, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.sparql.place_service import PlaceQuestion, PlaceRow
from rtask.world.spots import Spot, Spots

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = ["MAX_COMPARED", "MAX_ROWS", "related"]

MAX_COMPARED = 2_000
"""Things that one question compares."""

MAX_ROWS = 10_000
"""Rows of one answer."""

_NEAR_M = 0.5
_UNKNOWN_EXTENT_M = 0.1
_HIGHER_M = 0.01
_Pairs = Iterator[PlaceRow]


def related(world: WorldState, question: PlaceQuestion) -> list[PlaceRow]:
    """Return the pairs between which a relation holds at a time.

    What has no known place, or no way to the other's frame, is in no pair.

    Raises
    ------
    TooLargeError
        More things or pairs than one question may have.
    """
    asked_s = time.time() if question.at_s is None else question.at_s
    spots = Spots(world, asked_s)
    rows: list[PlaceRow] = []
    for row in _RELATIONS[question.relation](spots, question):
        rows.append(row)
        if len(rows) > MAX_ROWS:
            raise _too_many("pairs", MAX_ROWS)
    return rows


def _near(spots: Spots, question: PlaceQuestion) -> _Pairs:
    within_m = _NEAR_M if question.within_m is None else question.within_m
    for spot, other, apart in _pairs(spots, question):
        distance = float(np.linalg.norm(apart))
        if distance <= within_m:
            yield _row(spot, other, distance)


def _above(spots: Spots, question: PlaceQuestion) -> _Pairs:
    for spot, other, apart in _pairs(spots, question):
        if apart[2] < _HIGHER_M:
            # A pose is that of the middle, so that two things on one table differ a little.
            continue
        extent = spots.extent(other.node)
        aside_m = (_UNKNOWN_EXTENT_M if extent is None else extent) / 2.0
        if float(np.hypot(*apart[:2])) <= aside_m:
            yield _row(spot, other, float(np.linalg.norm(apart)))


def _inside(spots: Spots, question: PlaceQuestion) -> _Pairs:
    for thing in _compared(spots, question.subject):
        for container in spots.containers(thing):
            if question.other in (None, container):
                spot = spots.of(thing)
                numbers = {} if spot is None else {"chance": spot.still_there}
                yield PlaceRow(thing, container, numbers)


def _reached(spots: Spots, question: PlaceQuestion) -> _Pairs:
    """Yield things that a robot reaches: on or in places that it does, or within its arm."""
    kb, within_m = spots.world.kb, question.within_m
    robots = _robots(spots) if question.other is None else [question.other]
    bodies = {robot: spots.of(robot) for robot in robots}
    for thing in _compared(spots, question.subject):
        placement = spots.world.placement_at(thing, spots.time_s)
        places = [*spots.containers(thing), *([placement.place] if placement else [])]
        spot = spots.of(thing)
        for robot, body in bodies.items():
            distance = None
            # Without a common root there is no distance, which is not the same as far.
            if spot is not None and body is not None and spot.root == body.root:
                distance = float(np.linalg.norm(spot.position - body.position))
            is_stated = any(kb.match(iri(robot), RT.reaches, iri(p)) for p in places if p)
            is_near = within_m is not None and distance is not None and distance <= within_m
            if is_stated or is_near:
                numbers = {} if distance is None else {"distance": distance}
                if spot is not None:
                    numbers["chance"] = spot.still_there
                yield PlaceRow(thing, robot, numbers)


def _pose_in(spots: Spots, question: PlaceQuestion) -> _Pairs:
    """Yield the positions of things in the frame of something."""
    target = spots.of(question.other or "")
    for spot in [] if target is None else _spots(spots, _compared(spots, question.subject)):
        if target is None or spot.root != target.root:
            continue
        pose = np.linalg.inv(target.root_from_node) @ spot.root_from_node
        numbers = {axis: float(pose[k, 3]) for k, axis in enumerate("xyz")}
        yield PlaceRow(spot.node, target.node, {**numbers, "chance": spot.still_there})


_RELATIONS: dict[str, Callable[[Spots, PlaceQuestion], _Pairs]] = {
    "near": _near, "above": _above, "inside": _inside, "reachedBy": _reached, "poseIn": _pose_in,
}  # fmt: skip


def _pairs(
    spots: Spots, question: PlaceQuestion
) -> Iterator[tuple[Spot, Spot, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]]:
    """Yield spots of one tree, with the way (3,), m, from the second to the first."""
    spots_of_subject = _spots(spots, _compared(spots, question.subject))
    others = _spots(spots, _compared(spots, question.other))
    by_root: dict[str, list[Spot]] = {}
    for other in others:
        # Only spots of one tree can be compared; the others are in no relation that is known.
        by_root.setdefault(other.root, []).append(other)
    for spot in spots_of_subject:
        for other in by_root.get(spot.root, ()):
            if other.node != spot.node:
                yield spot, other, spot.position - other.position


def _compared(spots: Spots, node: str | None) -> list[str]:
    if node is not None:
        return [node]
    things = spots.placed(MAX_COMPARED)
    if len(things) > MAX_COMPARED:
        raise _too_many("things", MAX_COMPARED)
    return things


def _spots(spots: Spots, nodes: Iterable[str]) -> list[Spot]:
    return [spot for spot in map(spots.of, nodes) if spot is not None]


def _robots(spots: Spots) -> list[str]:
    quads = spots.world.kb.match(None, RDF.type, CORA.Robot)
    return sorted({q.subject.value for q in quads if isinstance(q.subject, NamedNode)})


def _row(spot: Spot, other: Spot, distance: float) -> PlaceRow:
    chance = spot.still_there * other.still_there
    return PlaceRow(spot.node, other.node, {"distance": distance, "chance": chance})


def _too_many(what: str, most: int) -> TooLargeError:
    return TooLargeError(
        f"more than {most} {what} to compare; name the thing or the other side by its IRI, or a "
        "smaller rtf:within", limit=what, allowed=most,
    )  # fmt: skip
