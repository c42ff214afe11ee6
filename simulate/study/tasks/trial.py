"""One random goal in a lab of two tables with two robots each, and one event that comes between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import NamedNode, iri
from simulate.tasks.crew import Crew, Ended
from simulate.tasks.executor import Executor, Turn
from simulate.tasks.lab import Lab, read_lab
from simulate.world.seeds import stream

__all__ = ["EVENTS", "lab_update", "random_goal", "run_trial", "stored_picks"]

_BASE = "https://example.org/kb/"
EVENTS = (
    "moved", "dropped", "taken_away", "declined", "killed", "dead_arm", "shut_door",
)  # fmt: skip
"""What may come between: a person moves the thing, it falls from the hand, it is taken out of the
lab, a person says no, a robot's program ends after it has acted, an arm fails for good, the door to
a place is shut."""
_STREAM = 71
_ROBOTS = {
    "nao-1": ("Hand", 0.05, ("table-1", "left-box-1")),
    "panda-1": ("ParallelJawGripper", 0.08, ("table-1", "right-box-1", "shelf")),
    "nao-2": ("Hand", 0.05, ("table-2", "left-box-2")),
    "panda-2": ("ParallelJawGripper", 0.08, ("table-2", "right-box-2", "shelf")),
}
"""Kind of hand, opening, m, and places of each robot; the Pandas share a shelf."""
_Robots = Mapping[str, tuple[str, float, tuple[str, ...]]]
_SPARE = {"panda-3": ("ParallelJawGripper", 0.08,
                      ("table-1", "table-2", "left-box-1", "left-box-2", "right-box-1",
                       "right-box-2"))}  # fmt: skip
"""A robot that can stand in for another, where something may be out of order for good."""
_PLACES = sorted({place for _, _, places in _ROBOTS.values() for place in places})
_KINDS = ("Cup", "Pen", "Bottle")


class KilledError(RuntimeError):
    """The program of a robot ends."""


@dataclass
class _Event:
    """The event of a trial, which happens once, at one of the actions."""

    kind: str
    at: int
    rng: np.random.Generator
    count: int = 0
    is_over: bool = False

    def is_due(self, kinds: tuple[str, ...]) -> bool:
        """Whether it happens now; each call counts an action at which it might."""
        if self.is_over or self.kind not in kinds:
            return False
        self.count += 1
        self.is_over = self.count > self.at
        return self.is_over


def run_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return what came of one goal."""
    rng = stream(settings["seed"], _STREAM, number)
    kinds = settings["events"]
    kind = str(kinds[number % len(kinds)]) if kinds else ""
    with rtask.open(":memory:", base=_BASE) as kb, Engine(kb) as engine:
        spare = _SPARE if kind in ("dead_arm", "shut_door") else None
        kb.update(lab_update(rng, settings["things"], spare))
        planner = rtask.connect(engine)
        lab = read_lab(planner.query, rng, settings["slip"])
        goal, plan = random_goal(planner, rng, lab, wants_handover=rng.random() < 0.3)
        event = _Event(kind, int(rng.integers(max(1, len(plan["steps"]) // 2))), rng)
        target = goal.split(" rt:locatedOn ")[1].strip("<>")
        _inject(lab, event, target)
        planner.call("store_plan", goal=goal)
        ended, repairs_s = _carry_out(engine, planner, lab, event)
        item = goal.split(" rt:locatedOn ")[0].strip("<>")
        return {
            "goal": goal, "event": kind if event.is_over else "", "result": ended.result,
            "robots": len({robot for step in plan["steps"] for robot in step["robots"]}),
            "steps": len(plan["steps"]), "repairs": ended.repairs, "deeds": len(lab.done),
            "lost": len(_forgotten(kb, lab)), "wrong": len(_wrong(kb, lab)),
            # Less are stored where a robot ended between a grasp and its report: nobody saw it.
            "twice": max(stored_picks(kb) - [deed[1] for deed in lab.done].count("pick"), 0),
            "repair_s": max(repairs_s, default=0.0), "says": ended.result,
            "possible": ended.result == "reached" or _has_way(lab, item, target),
        }  # fmt: skip


def lab_update(rng: np.random.Generator, count: int, more: _Robots | None = None) -> str:
    """Return the update that states the lab: robots, places, and things somewhere on these."""
    rows = [
        f"<{_BASE}place/{place}> a rt:SupportSurface ; rt:name '{place}' ." for place in _PLACES
    ]
    for name, (hand, opening, places) in {**_ROBOTS, **(more or {})}.items():
        robot = f"{_BASE}robot/{name}"
        reached = ", ".join(f"<{_BASE}place/{place}>" for place in places)
        rows.append(
            f"<{robot}> a cora:Robot ; rt:name '{name}' ; rt:hasEndEffector <{robot}/hand> ; "
            f"rt:reaches {reached} . <{robot}/hand> a rt:{hand} ; rt:name '{name} hand' ; "
            f"rt:gripperType '{name[:-2]}' ; rt:minOpening 0.0e0 ; rt:maxOpening {opening}e0 ; "
            f"rt:maxPayload 0.5e0 ."
        )
    for number in range(count):
        kind = _KINDS[number % len(_KINDS)]
        place = _PLACES[int(rng.integers(len(_PLACES)))]
        product, item, at = (f"{_BASE}{part}/{number}" for part in ("object", "thing", "placement"))
        rows.append(
            f"<{product}> a rt:{kind} ; rt:objectId 'lab/{number}' ; rt:name '{kind.lower()} "
            f"{number}' ; rt:graspWidth 0.03e0 ; rt:mass 0.1e0 . <{item}> a rt:Exemplar ; "
            f"rt:exemplarOf <{product}> . <{at}> a rt:Placement ; rt:placementOf <{item}> ; "
            f"rt:placedOn <{_BASE}place/{place}> ; time:hasBeginning <{at}/begin> . <{at}/begin> "
            "time:inXSDDateTimeStamp '2026-01-01T10:00:00Z'^^xsd:dateTimeStamp ."
        )
    return f"{PREFIXES} INSERT DATA {{ GRAPH <{_BASE}graph/shared> {{ {' '.join(rows)} }} }}"


def random_goal(
    planner: Any, rng: np.random.Generator, lab: Lab, *, wants_handover: bool = False
) -> tuple[str, Mapping[str, Any]]:
    """Draw a goal that takes at least one step, and several robots if that is wanted."""
    items = sorted(lab.where)
    while True:
        item = items[int(rng.integers(len(items)))]
        place = f"{_BASE}place/{_PLACES[int(rng.integers(len(_PLACES)))]}"
        goal = f"<{item}> rt:locatedOn <{place}>"
        plan = planner.call("plan_goal", goal=goal)
        robots = {robot for step in plan["steps"] for robot in step["robots"]}
        if plan["complete"] and robots and (len(robots) > 1 or not wants_handover):
            return goal, plan


def _inject(lab: Lab, event: _Event, target: str) -> None:
    def before(robot: str, action: str, item: str) -> None:
        if action == "pick" and event.is_due(("moved",)):
            places = [place for place in _PLACES if f"{_BASE}place/{place}" != lab.where[item]]
            lab.where[item] = f"{_BASE}place/{places[int(event.rng.integers(len(places)))]}"
        elif action == "pick" and event.is_due(("taken_away",)):
            del lab.where[item]
        elif action == "put" and event.is_due(("dropped",)):
            lab.drop(item, robot)
        elif event.is_due(("dead_arm",)):
            lab.dead.add(robot)
        elif action == "put" and event.is_due(("shut_door",)):
            places = sorted(lab.reach[robot] - {target}) or [target]
            lab.shut.add(places[int(event.rng.integers(len(places)))])

    def after(robot: str, action: str, item: str) -> None:
        if event.is_due(("killed",)):
            raise KilledError

    lab.on_deed, lab.on_done = before, after


def _carry_out(engine: Engine, planner: Any, lab: Lab, event: _Event) -> tuple[Ended, list[float]]:
    """Let the robots work, and start them again when one was killed."""
    repairs_s: list[float] = []
    while True:
        robots = {}
        for robot in sorted(lab.hands):
            client = rtask.connect(engine, agent=robot.rpartition("/")[2])
            may = _may(event)
            robots[robot] = Executor(client, lab.robot(robot), may=may)
        crew = Crew(planner, robots, _state_out_of_order(engine, lab), repair_s=repairs_s)
        try:
            return crew.work()[0], repairs_s
        except KilledError:
            continue


def _state_out_of_order(engine: Engine, lab: Lab) -> Callable[[str, Turn], None]:
    """Return what lets a person state what is out of order or shut, after a failure."""

    def tell(robot: str, turn: Turn) -> None:
        if turn.result != "failed":
            return
        states = [f"<{broken}> a rt:OutOfOrder" for broken in sorted(lab.dead & {robot})]
        states += [f"<{place}> a rt:Shut" for place in sorted(lab.shut)]
        if states:
            engine.kb.update(f"{PREFIXES} INSERT DATA {{ {' . '.join(states)} }}")

    return tell


def _has_way(lab: Lab, item: str, target: str) -> bool:
    """Whether the arms that work could bring a thing to a place, past shut doors."""
    at = lab.where.get(item)
    hands = {hand: robot for robot, own in lab.hands.items() for hand in own}
    reach = {
        robot: places - lab.shut for robot, places in lab.reach.items() if robot not in lab.dead
    }
    within = set(reach.get(hands[at], frozenset())) if at in hands else {at} - lab.shut
    while True:
        more = {place for places in reach.values() if places & within for place in places} | within
        if more == within:
            return target in within
        within = more


def _may(event: _Event) -> Any:
    return lambda text: not event.is_due(("declined",))


def _forgotten(kb: KnowledgeBase, lab: Lab) -> list[str]:
    """Return the things that the memory no longer has, wherever they are."""
    return [
        item for item in lab.where
        if not any(where.exemplar == item for where in kb.world.where_is(item).exemplars)
    ]  # fmt: skip


def _wrong(kb: KnowledgeBase, lab: Lab) -> list[str]:
    """Return the things that are elsewhere than the memory has them; unknown is not wrong."""
    wrong = []
    for item, place in lab.where.items():
        stated = {quad.object for quad in kb.match(iri(item), RT.locatedOn)}
        if stated and stated != {NamedNode(place)}:
            wrong.append(item)
    return wrong


def stored_picks(kb: KnowledgeBase) -> int:
    """Return how many grasps that held are stored."""
    rows = kb.select(f"""{PREFIXES}
SELECT (COUNT(DISTINCT ?attempt) AS ?n) WHERE {{
  ?attempt a rt:GraspAttempt ; rt:hasOutcome/rt:success true
}}""")
    return int(str(rows[0].value("n")))
