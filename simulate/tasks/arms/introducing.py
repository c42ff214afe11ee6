"""Robots of a bench introduce themselves to the graph, and look what is on the table.

What a person knows beforehand is stated: where hands get to, and the names, kinds and masses of the
products as their packages tell them. What stands where, the robots find out with their cameras.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Protocol
from urllib.parse import quote

from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import literal
from simulate.tasks.arms.bench import Bench, Station
from simulate.tasks.arms.body import ArmBody
from simulate.tasks.arms.sightings import Sighting
from simulate.tasks.executor import Graph
from simulate.world.seeds import mix_seed

__all__ = ["Introduced", "Planner", "introduce", "survey"]


class Planner(Graph, Protocol):
    """A client that may state things."""

    def update(self, sparql: str) -> None:
        """Carry out a SPARQL update."""


@dataclass(frozen=True)
class Introduced:
    """Robots of a bench as the graph knows them.

    Parameters
    ----------
    bodies
        By the IRI of the robot.
    places
        Name of the area of each place, by IRI.
    """

    bodies: Mapping[str, ArmBody]
    places: Mapping[str, str]


def introduce(
    planner: Planner,
    bench: Bench,
    seed: int = 0,
) -> Introduced:
    """Register the robots of a bench with their hands, and state the places that they get to.

    Parameters
    ----------
    planner
        Says so; a client that may state knowledge.
    seed
        Of the choices of the robots.
    """
    names: dict[str, dict[str, Any]] = {}
    taken: set[str] = set()
    for name, station in bench.stations.items():
        # A place that several hands get to is one place, which the first robot describes.
        described = [p for p in station.places() if p["name"] not in taken]
        taken.update(place["name"] for place in described)
        names[name] = station.robot.describe(name, described)
    robots = {
        name: str(planner.call("register_robot", **message)["robot"])
        for name, message in names.items()
    }
    places: dict[str, str] = {}
    rows = []
    for post in bench.layout.posts:
        for name in dict.fromkeys(n for reached in post.reach.values() for n in reached):
            iri = next((i for i, other in places.items() if other == name), "")
            iri = iri or f"{robots[post.robot]}/place/{quote(name, safe='')}"
            places[iri] = name
            rows.append(f"<{iri}> a rt:SupportSurface ; rt:name {literal(name)} .")
            rows.append(f"<{robots[post.robot]}> rt:reaches <{iri}> .")
    hands = {name: _hands(planner, robots[name], station)
             for name, station in bench.stations.items()}  # fmt: skip
    for post in bench.layout.posts:
        for hand, arm in hands[post.robot].items():
            mine = post.reach.get(arm, ())
            others = {n for reached in post.reach.values() for n in reached} - set(mine)
            rows += [f"<{iri}> rt:beyondReachOf <{hand}> ."
                     for iri, name in places.items() if name in others]  # fmt: skip
    planner.update(f"{PREFIXES} INSERT DATA {{ {' '.join(rows)} }}")
    bodies = {}
    for number, post in enumerate(bench.layout.posts):
        own = {arm: names for arm, names in post.reach.items() if names}
        within = {n for names in own.values() for n in names}
        bodies[robots[post.robot]] = ArmBody(
            bench.stations[post.robot], planner,
            {hand: arm for hand, arm in hands[post.robot].items() if arm in own},
            {iri: name for iri, name in places.items() if name in within},
            mix_seed(seed, number),
            places,
        )  # fmt: skip
    return Introduced(bodies, places)


def survey(
    planner: Planner,
    bench: Bench,
    crew: Introduced,
) -> list[str]:
    """Let the robots look at all areas of the table; return the IRIs of the things there.

    What the graph does not know is stored under the name and with the kind and mass that a person
    says it has, to whom the robot points it out. Things that the graph has at these places, and
    nobody sees there, are stated to be lost.
    """
    seen: list[str] = []
    seen_at: set[str] = set()
    for body in crew.bodies.values():
        for place in body.places:
            if place in seen_at or bench.layout.area(body.places[place]).is_box:
                continue
            seen_at.add(place)
            for sighting in body.look(place):
                seen.append(_store(planner, bench, body, sighting, place, seen))
        body.look_anew()
    for row in planner.query(_AT % " ".join(f"<{place}>" for place in crew.places)):
        if str(row["thing"]) not in seen:
            planner.call("state_place", thing=str(row["thing"]), lost=True)
    return seen


def _store(
    planner: Planner, bench: Bench, body: ArmBody, sighting: Sighting, place: str,
    taken: Collection[str] = (),
) -> str:  # fmt: skip
    """Store a thing where it was seen; return its IRI.

    Parameters
    ----------
    taken
        IRIs of things that were seen elsewhere at this table: this is none of them.
    """
    spec = bench.product_at(body.robot.station, sighting.seen.position)
    entry: dict[str, Any] = {**sighting.observation, "gripper_id": next(iter(body.hands.values()))}
    rows = planner.query(_STORED_THERE % (sighting.object, place)) if sighting.object else []
    there = [thing for row in rows if (thing := str(row["thing"])) not in taken]
    # What merely resembles a product is one only where such a thing is expected. A second can that
    # was taken for the first had no name of its own, and the first one was said to be there, too.
    if sighting.object and (sighting.is_accepted or there):
        entry["object"] = sighting.object
        if len(there) == 1:
            entry["thing"] = there[0]
    elif spec is not None:
        named = planner.query(_NAMED % literal(spec.name))
        if len(named) == 1:  # the person names what is shown, and the graph knows it by that name
            entry["object"] = str(named[0]["product"])
        else:
            entry |= {"name": spec.name, "class_description": spec.kind}
    stored = body.graph.call("insert_object", objects=[entry])["objects"][0]
    thing = str(stored["thing"])
    if spec is not None and "object" not in entry:
        planner.update(
            f"{PREFIXES} INSERT DATA {{ <{stored['object']}> rt:mass {spec.mass:.4f}e0 }}"
        )
    planner.call("state_place", thing=thing, place=place)
    return thing


def _hands(planner: Planner, robot: str, station: Station) -> dict[str, str]:
    """Return the name of the arm of each hand of a robot, by IRI."""
    rows = planner.query(_HANDS % robot)
    arms = {arm.end_effector: name for name, arm in station.robot.arms.items()}
    return {str(row["hand"]): arms[str(row["name"])] for row in rows if str(row["name"]) in arms}


_HANDS = f"""{PREFIXES}
SELECT ?hand ?name WHERE {{ <%s> rt:hasEndEffector ?hand . ?hand rt:name ?name }}"""
_AT = f"""{PREFIXES}
SELECT DISTINCT ?thing WHERE {{
  VALUES ?place {{ %s }} ?thing a rt:Exemplar ; rt:locatedOn ?place }}"""
_NAMED = f"""{PREFIXES}
SELECT DISTINCT ?product WHERE {{ ?product rt:name %s ; rt:objectId ?id }}"""
_STORED_THERE = f"""{PREFIXES}
SELECT DISTINCT ?thing WHERE {{ ?thing rt:exemplarOf <%s> ; rt:locatedOn <%s> }}"""
