"""A lab without dynamics: things are somewhere, hands take and drop them, people move them.

The truth is here and nowhere else: robots know what the graph says and what they see. Each action
takes effect at once and succeeds with a chance, by a fixed seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.body import Deed
from simulate.tasks.picture import draw_places

__all__ = ["Lab", "LabRobot", "places_of", "read_lab"]

_DURATION_S = {"pick": 8.0, "put": 5.0, "give": 10.0}
_LIFT_M = 0.1


@dataclass
class Lab:
    """What is where, in truth.

    Parameters
    ----------
    where
        IRI of the place or hand of each thing.
    reach
        IRIs of the places that each robot reaches and sees.
    hands
        IRI and gripper id of the hands of each robot.
    rng
        Of all chances.
    slip
        Chance that a thing slips from the hand when it is picked up.
    slips
        The same of single things, by IRI.
    on_deed, on_done
        Called before each action, and after it took effect, with the robot, the action and the
        thing; events of a study.
    """

    where: dict[str, str]
    reach: Mapping[str, frozenset[str]]
    hands: Mapping[str, Mapping[str, str]]
    rng: np.random.Generator
    slip: float = 0.0
    slips: Mapping[str, float] = field(default_factory=dict)
    on_deed: Callable[[str, str, str], None] = lambda robot, action, item: None
    on_done: Callable[[str, str, str], None] = lambda robot, action, item: None
    done: list[tuple[str, str, str]] = field(default_factory=list)
    """Actions that took effect: robot, action, thing."""
    dead: set[str] = field(default_factory=set)
    """Robots whose arm is out of order."""
    shut: set[str] = field(default_factory=set)
    """Places behind a shut door, which nobody sees or reaches."""
    helped: set[str] = field(default_factory=set)
    """Things with which a person helped, so that they do not slip."""

    def robot(self, iri: str) -> LabRobot:
        """Return a robot of the lab."""
        return LabRobot(self, iri)

    def in_hand(self, hand: str) -> str | None:
        """Return what a hand holds."""
        return next((item for item, place in self.where.items() if place == hand), None)

    def finish(self, robot: str, action: str, item: str) -> None:
        """Note that an action took effect."""
        self.done.append((robot, action, item))
        self.on_done(robot, action, item)

    def drop(self, item: str, robot: str) -> None:
        """Let a thing fall to one of the places that a robot reaches."""
        places = sorted(self.reach[robot])
        self.where[item] = places[int(self.rng.integers(len(places)))]


@dataclass(frozen=True)
class LabRobot:
    """A robot of a lab; a :class:`simulate.tasks.body.TaskBody`."""

    lab: Lab
    iri: str

    @property
    def hands(self) -> Mapping[str, str]:
        """Gripper id of each hand."""
        return self.lab.hands[self.iri]

    @property
    def physics(self) -> Literal["fast"]:
        """Coarser than any: reports from here must not count like those of real hands."""
        return "fast"

    def sees(self, item: str, place: str) -> bool:
        """Look whether a thing is at a place within reach, or in an own hand."""
        at = self.lab.where.get(item)
        if at != place or place in self.lab.shut:
            return False
        return place in self.hands or place in self.lab.reach[self.iri]

    def picture(self) -> bytes:
        """Return its places with what stands there, and its hands, drawn as PNG."""
        within = sorted(self.lab.reach[self.iri] - self.lab.shut)
        there = {
            place: sorted(item for item, at in self.lab.where.items() if at == place)
            for place in (*within, *self.hands)
        }
        return draw_places(there)

    def find(self, item: str) -> str | None:
        """Look for a thing wherever the robot reaches, and in its hands."""
        at = self.lab.where.get(item)
        return at if at is not None and self.sees(item, at) else None

    def pick(self, item: str, place: str, hand: str) -> Deed:
        """Pick a thing up; it may have gone since it was seen, or slip."""
        self.lab.on_deed(self.iri, "pick", item)
        took = _DURATION_S["pick"]
        if self.iri in self.lab.dead:
            return Deed(False, "hardware", took)
        if not self.sees(item, place) or self.lab.in_hand(hand) is not None:
            return Deed(False, "missed", took)
        slip = 0.0 if item in self.lab.helped else self.lab.slips.get(item, self.lab.slip)
        if self.lab.rng.random() < slip:
            return Deed(False, "slip_lift", took, 0.01)
        self.lab.where[item] = hand
        self.lab.finish(self.iri, "pick", item)
        return Deed(True, "ok", took, _LIFT_M)

    def put(self, item: str, place: str, hand: str) -> Deed:
        """Put a held thing down."""
        self.lab.on_deed(self.iri, "put", item)
        took = _DURATION_S["put"]
        if self.iri in self.lab.dead:
            return Deed(False, "hardware", took)
        if place in self.lab.shut:
            return Deed(False, "place_plan", took)
        if self.lab.where.get(item) != hand or place not in self.lab.reach[self.iri]:
            return Deed(False, "slip_transport", took)
        self.lab.where[item] = place
        self.lab.finish(self.iri, "put", item)
        return Deed(True, "ok", took)

    def give(self, item: str, hand: str, target: str) -> Deed:
        """Give a held thing into another hand that is free."""
        self.lab.on_deed(self.iri, "give", item)
        took = _DURATION_S["give"]
        if self.iri in self.lab.dead:
            return Deed(False, "hardware", took)
        if self.lab.where.get(item) != hand or self.lab.in_hand(target) is not None:
            return Deed(False, "slip_transport", took)
        self.lab.where[item] = target
        self.lab.finish(self.iri, "give", item)
        return Deed(True, "ok", took)


_WHERE = f"""{PREFIXES}
SELECT ?thing ?place WHERE {{ ?thing a rt:Exemplar ; rt:locatedOn ?place }}"""
_ROBOTS = f"""{PREFIXES}
SELECT ?robot ?hand ?name ?place WHERE {{
  ?robot a cora:Robot ; rt:hasEndEffector ?hand . ?hand rt:name ?name
  OPTIONAL {{ ?robot rt:reaches ?place }}
}}"""


def places_of(query: Callable[[str], Iterable[Mapping[str, Any]]]) -> dict[str, str]:
    """Return the IRI of the place or hand of each thing, as the graph has it now."""
    return {str(row["thing"]): str(row["place"]) for row in query(_WHERE)}


def read_lab(
    query: Callable[[str], Iterable[Mapping[str, Any]]], rng: np.random.Generator, slip: float = 0.0
) -> Lab:
    """Return the lab that a graph describes, as if all that it says were true."""
    reach: dict[str, set[str]] = {}
    hands: dict[str, dict[str, str]] = {}
    for row in query(_ROBOTS):
        robot = str(row["robot"])
        hands.setdefault(robot, {})[str(row["hand"])] = str(row["hand"])
        places = reach.setdefault(robot, set())
        if row["place"] is not None:
            places.add(str(row["place"]))
    return Lab(
        places_of(query), {robot: frozenset(at) for robot, at in reach.items()}, hands, rng, slip
    )
