"""What happens in the lab during a day: robots work, people move, swap, cover and take things."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rtask.engine import Engine
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import literal
from simulate.study.day.lab import BOXES, TABLES, Item, Lab, Place, distance
from simulate.study.day.robots import BASE, Robot, ask, box_iri
from simulate.world.seeds import stream

__all__ = ["LONGEST_COVER_S", "Day", "Sample", "live_day"]

START_S = 1_767_600_000.0
"""Unix time at which the day begins: 5 January 2026, 8 o'clock UTC."""
_STREAM = 73
_LOOK_MIN = 5
_WALK_MIN = 60
_DEED = 0.2
_SLIP = 0.05
_BY_PERSON = 0.05
_COVERS = 0.15
_BUMPED_M = 0.2
LONGEST_COVER_S = 2400.0
"""Time for which people cover a thing at most, s."""
_IDENTITY = {"orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


@dataclass(frozen=True)
class Sample:
    """How far a thing was from where the graph said it was, while the day went on.

    Parameters
    ----------
    kind
        Of its place: open, or covered since it was last seen.
    away_m, radius90_m
        The distance, infinite if it is out of the lab, and that within which it was said to be with
        a chance of 90 %.
    """

    kind: str
    away_m: float
    radius90_m: float


@dataclass
class Day:
    """A day that was lived: the truth, and what came of it."""

    lab: Lab
    engine: Engine
    robots: list[Robot]
    begin_s: float
    end_s: float
    identified: dict[str, Item]
    samples: list[Sample] = field(default_factory=list)
    deeds: dict[str, int] = field(default_factory=dict)

    def count(self, what: str) -> None:
        """Count something that happened."""
        self.deeds[what] = self.deeds.get(what, 0) + 1

    def iri_of(self, item: Item) -> str:
        """Return the IRI under which the graph knows a thing; "" if no robot ever saw it."""
        return next((iri for iri, true in self.identified.items() if true is item), "")


def live_day(engine: Engine, settings: Mapping[str, Any]) -> Day:
    """Let a day go by, and return it with its truth."""
    rng = stream(settings["seed"], _STREAM)
    lab = Lab.made(rng, settings["things"], START_S - 60.0)
    _furnish(engine, lab)
    identified: dict[str, Item] = {}
    errors: list[str] = []
    tables = {"nao-1": "table-a", "panda-1": "table-a", "nao-2": "table-b"}
    robots = [Robot(name, engine, lab, rng, table, identified, errors)
              for name, table in tables.items()]  # fmt: skip
    minutes = round(settings["hours"] * 60)
    day = Day(lab, engine, robots, START_S, START_S + 60.0 * minutes, identified)
    for robot in robots:
        robot.register(START_S)
    per_minute = settings["samples"] / minutes
    for minute in range(minutes):
        time_s = START_S + 60.0 * minute
        _let_people_act(day, rng, time_s)
        for number, robot in enumerate(robots):
            _let_robot_act(day, robot, rng, minute, time_s + 1.0 + 18.0 * number, number)
        for _ in range(int((minute + 1) * per_minute) - int(minute * per_minute)):
            _sample(day, rng, time_s + 58.0)
    for robot in robots:
        robot.look(day.end_s - 1.0)
    return day


def _furnish(engine: Engine, lab: Lab) -> None:
    """State what people enter beforehand: products, boxes, and where the tables stand."""
    names = {item.product: item.name for item in lab.items}
    products = " ".join(
        f"<{BASE}object/{number}> a rt:ManipulableObject ; rt:objectId {literal(f'lab/{number}')} ;"
        f" rt:name {literal(name)} ; rt:extentX 0.06e0 ; rt:extentY 0.06e0 ."
        for number, name in names.items()
    )
    boxes = " ".join(
        f"<{box_iri(box)}> a rt:SupportSurface ; rt:name {literal(box)} ." for box in BOXES
    )
    engine.context.kb.update(
        f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {products} {boxes} }} }}"
    )
    ann = Access("ann", "teacher")
    engine.call("state_frame", {"frame": "map", "stamp": START_S}, ann)
    for table, (x, y) in TABLES.items():
        pose = {"position": {"x": x, "y": y, "z": 0.0}, **_IDENTITY}
        args = {"frame": table, "parent": "map", "pose": pose, "stamp": START_S}
        engine.call("state_frame", args, ann)


def _let_people_act(day: Day, rng: np.random.Generator, time_s: float) -> None:
    """Let a person move, swap, bump, cover, take or bring back a thing, seen by nobody.

    A cover hides a thing from robots, and not from people: they reach under it as often as for what
    lies open, and whoever moves the thing takes the cover off.
    """
    if rng.random() < _COVERS:
        _cover(day, rng, time_s)
    if rng.random() >= _BY_PERSON:
        return
    lab = day.lab
    table = str(rng.choice(list(TABLES)))
    items = lab.on(table)
    away = [item for item in lab.items if item.now.kind == "away"]
    what = str(rng.choice(["move", "swap", "bump", "take", "bring"]))
    if what == "bring" and away:
        item = away[0]
        lab.move(item, Place("on", table, time_s, "", lab.free_spot(table)))
    elif what in ("move", "take", "bump") and items:
        item = items[int(rng.integers(len(items)))]
        if what == "bump":
            for jolted in (item, *lab.neighbours(item, _BUMPED_M)):
                lab.nudge(jolted, time_s)
            day.count("by people: bump")
            return
        item.covered_until_s = min(item.covered_until_s, time_s)
        if what == "take" and len(away) < 3:
            lab.move(item, Place("away", "", time_s))
        else:
            target = str(rng.choice(list(TABLES)))
            lab.move(item, Place("on", target, time_s, "", lab.free_spot(target)))
    elif what == "swap" and len(items) > 1:
        # Nobody could tell that two equal things were swapped unseen: these are not.
        first, other = (items[int(k)] for k in rng.choice(len(items), 2, replace=False))
        if first.product == other.product:
            return
        spot, other_spot = first.now.spot, other.now.spot
        for item, there in ((first, other_spot), (other, spot)):
            item.covered_until_s = min(item.covered_until_s, time_s)
            lab.move(item, Place("on", table, time_s, "", there))
    else:
        return
    day.count(f"by people: {what}")


def _cover(day: Day, rng: np.random.Generator, time_s: float) -> None:
    """Let a person cover a thing for ten to forty minutes."""
    table = str(rng.choice(list(TABLES)))
    items = [item for item in day.lab.on(table) if item.covered_until_s <= time_s]
    if items:
        item = items[int(rng.integers(len(items)))]
        item.covered_from_s = time_s
        item.covered_until_s = time_s + float(rng.uniform(600.0, LONGEST_COVER_S))
        day.count("by people: cover")


def _let_robot_act(
    day: Day, robot: Robot, rng: np.random.Generator, minute: int, time_s: float, number: int
) -> None:
    """Let a robot walk, look, or carry something, when it is time to."""
    if robot.name == "nao-1" and minute % _WALK_MIN == _WALK_MIN - 1:
        robot.stand_at("table-b" if robot.table == "table-a" else "table-a", time_s)
        day.count("walks")
    acts = rng.random() < _DEED
    if not acts and (minute + number) % _LOOK_MIN:
        return
    seen = robot.look(time_s)
    day.count("looks")
    if not acts or not seen:
        return
    lab = day.lab
    slips = rng.random() < _SLIP
    spot = lab.free_spot(robot.table)
    on_table = Place("on", robot.table, time_s, robot.name, spot)
    box = next(box for box, table in BOXES.items() if table == robot.table)
    boxed = robot.boxed(time_s)
    what = str(rng.choice(["move", "box", "unbox"], p=[0.6, 0.2, 0.2]))
    if what == "unbox" and boxed:
        iri = boxed[int(rng.integers(len(boxed)))]
        robot.carry(day.identified[iri], iri, on_table, time_s + 2.0, slips)
    else:
        iri, item = seen[int(rng.integers(len(seen)))]
        is_boxed = what == "box" and len(boxed) < 4
        target = Place("in", box, time_s, robot.name) if is_boxed else on_table
        what = "box" if is_boxed else "move"
        robot.carry(item, iri, target, time_s + 2.0, slips)
    day.count("slips" if slips else f"by robots: {what}")


def _sample(day: Day, rng: np.random.Generator, time_s: float) -> None:
    """Ask where one thing is now, and note how far from there it is.

    Every second time one that was covered of late, of which there are fewer. It counts as covered
    if it was since it was last seen, also when somebody has carried it off from under the cover:
    else only those would be judged that nobody moved.
    """
    of_late = rng.random() < 0.5
    items = [
        item for item in day.lab.items
        if item.now.kind in ("on", "away")
        and (item.covered_from_s > time_s - LONGEST_COVER_S) == of_late
    ]  # fmt: skip
    item = items[int(rng.integers(len(items)))] if items else None
    iri = "" if item is None else day.iri_of(item)
    if item is None or not iri:
        return
    for place in ask(day.engine, "where_is", name=iri, frame="map", stamp=time_s)["things"]:
        if place.pose is not None and place.radius90 is not None:
            at, is_on = place.pose["position"], item.now.kind == "on"
            away_m = distance((at["x"], at["y"]), item.now.spot) if is_on else np.inf
            kind = "covered" if item.covered_from_s >= place.seen else "open"
            day.samples.append(Sample(kind, away_m, place.radius90))
