"""How long robots stand idle beside work that they could do, by the times that a plan expects.

    python -m tests.benchmarks.tasks.bench_idle [-n LABS] [--seed SEED]

plans for random labs in which two to four robots reach most places, and lets each plan run: a robot
begins its next step as soon as what comes before it has ended, as claims do. Idle beside work is a
robot that waits or has nothing left, while a thing that nobody has picked up could be picked up and
put down by it: it reaches both places. With ``--by-cost``, steps are not shared out.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.plan import PlannedStep
from rtask.tasks.planning import search

_BASE = "https://example.org/kb/"
_PLACES = ("table", "bench", "left box", "right box")
_KINDS = ("Cup", "Pen")


@dataclass(frozen=True)
class Idle:
    """Times of one plan, in s: of all robots until its end, idle, and idle beside work."""

    total: float
    idle: float
    beside_work: float
    end: float


def main() -> None:
    """Print the shares of all labs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-n", type=int, default=40, help="labs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--by-cost", action="store_true", help="do not share steps out")
    given = parser.parse_args()
    if given.by_cost:
        search._BUSY = 0.0
    found = [of_lab(np.random.default_rng([given.seed, number])) for number in range(given.n)]
    total = sum(item.total for item in found)
    print(f"labs: {len(found)}, time of all robots until the goals are reached: {total:.0f} s")
    print(f"idle: {sum(item.idle for item in found) / total:.3f} of it")
    print(f"idle beside work: {sum(item.beside_work for item in found) / total:.3f}")
    end = sum(item.end for item in found) / len(found)
    print(f"until a goal is reached: {end:.0f} s on average")


def of_lab(rng: np.random.Generator) -> Idle:
    """Return the times of a random goal in a random lab."""
    return run(*plan_of(rng))


def plan_of(rng: np.random.Generator) -> tuple[Sequence[PlannedStep], dict[str, set[str]]]:
    """Return the plan for a random goal in a random lab, and which places each robot reaches."""
    robots = [f"robot-{number}" for number in range(int(rng.integers(2, 5)))]
    reach = {name: [p for p in _PLACES if rng.random() < 0.8] or [_PLACES[0]] for name in robots}
    reach[robots[0]] = list(_PLACES)
    with rtask.open(":memory:", base=_BASE) as kb:
        assert isinstance(kb, KnowledgeBase)
        kb.update(_update(rng, reach))
        plan = kb.tasks.plan("every cup into the left box; every pen into the right box")
    assert plan.is_complete, plan.text
    return plan.steps, {f"{_BASE}robot/{name}": {_place(p) for p in reach[name]} for name in robots}


def _place(name: str) -> str:
    return f"{_BASE}place/{name.replace(' ', '-')}"


def _update(rng: np.random.Generator, reach: dict[str, list[str]]) -> str:
    rows = [f'<{_place(name)}> a rt:SupportSurface ; rt:name "{name}" .' for name in _PLACES]
    for name, places in reach.items():
        robot = f"{_BASE}robot/{name}"
        reached = ", ".join(f"<{_place(place)}>" for place in places)
        rows.append(
            f'<{robot}> a cora:Robot ; rt:name "{name}" ; rt:hasEndEffector <{robot}/hand> ; '
            f'rt:reaches {reached} . <{robot}/hand> a rt:Hand ; rt:name "{name} hand" ; '
            f'rt:gripperType "{name}" ; rt:minOpening 0.0e0 ; rt:maxOpening 0.1e0 ; '
            "rt:maxPayload 3.0e0 ."
        )
    # One of each at least, or the goal names what is not there.
    things = [(f"{kind.lower()}-0", kind, "table") for kind in _KINDS]
    for number in range(1, int(rng.integers(5, 14))):
        kind = _KINDS[int(rng.integers(2))]
        things.append((f"{kind.lower()}-{number}", kind, _PLACES[int(rng.integers(2))]))
    rows += [_thing(*thing) for thing in things]
    return f"{PREFIXES} INSERT DATA {{ GRAPH <{_BASE}graph/shared> {{ {' '.join(rows)} }} }}"


def _thing(name: str, kind: str, place: str) -> str:
    product, thing, at = (f"{_BASE}{part}/{name}" for part in ("object", "thing", "placement"))
    return (
        f'<{product}> a rt:{kind} ; rt:objectId "lab/{name}" ; rt:name "{name}" ; '
        f"rt:graspWidth 0.04e0 ; rt:mass 0.1e0 . <{thing}> a rt:Exemplar ; rt:exemplarOf "
        f"<{product}> . <{at}> a rt:Placement ; rt:placementOf <{thing}> ; rt:placedOn "
        f"<{_place(place)}> ; time:hasBeginning <{at}/b> . <{at}/b> "
        'time:inXSDDateTimeStamp "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp .'
    )


def run(steps: Sequence[PlannedStep], reach: dict[str, set[str]]) -> Idle:
    """Return the times of a plan whose steps last as long as expected."""
    begun: dict[int, float] = {}
    ended: dict[int, float] = {}
    end = max(step.start_s + step.duration_s for step in steps)
    for step in steps:
        begun[step.number], ended[step.number] = step.start_s, step.start_s + step.duration_s
    moments = sorted({0.0, end, *begun.values(), *ended.values()})
    idle = beside = 0.0
    for now, after in pairwise(moments):
        busy = {r for step in steps for r in step.robots
                if begun[step.number] <= now < ended[step.number]}  # fmt: skip
        for robot in reach.keys() - busy - _holding(steps, begun, ended, now):
            idle += after - now
            if any(_could(robot, pick, steps, reach, begun, ended, now) for pick in steps):
                beside += after - now
    return Idle(end * len(reach), idle, beside, end)


def _holding(
    steps: Sequence[PlannedStep], begun: dict[int, float], ended: dict[int, float], now: float
) -> set[str]:
    """Return the robots that have something in their hand between two steps."""
    holding: set[str] = set()
    for step in steps:
        put = put_of(step, steps)
        if put is not None and ended[step.number] <= now < begun[put.number]:
            holding.update(step.robots)
    return holding


def _could(
    robot: str, pick: PlannedStep, steps: Sequence[PlannedStep], reach: dict[str, set[str]],
    begun: dict[int, float], ended: dict[int, float], now: float,
) -> bool:  # fmt: skip
    """Whether a robot could pick up now what nobody has, and put it where it is to go."""
    put = put_of(pick, steps)
    if put is None or begun[pick.number] <= now or robot in pick.robots:
        return False
    # What it waits for beside its own robot's other work.
    own = {step.number for step in steps if set(step.robots) & set(pick.robots)}
    is_ready = all(ended[number] <= now for number in pick.after if number not in own)
    values = (*pick.arguments.values(), *put.arguments.values())
    places = {value for value in values if "/place/" in value}
    return is_ready and places <= reach[robot]


def put_of(pick: PlannedStep, steps: Sequence[PlannedStep]) -> PlannedStep | None:
    """Return the step that puts down what a step picks up."""
    if not pick.action.endswith("Grasp"):
        return None
    thing = pick.arguments["thing"]
    return next((step for step in steps if step.number > pick.number
                 and step.arguments.get("thing") == thing), None)  # fmt: skip


if __name__ == "__main__":
    main()
