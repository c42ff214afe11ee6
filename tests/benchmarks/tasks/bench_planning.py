"""Search for plans: processor time and cost, beside another planner if one is given.

    python tests/benchmarks/tasks/bench_planning.py
    python tests/benchmarks/tasks/bench_planning.py --planner "python fast-downward.py \
        --plan-file {plan} --alias lama-first {domain} {problem}"

In the lab "row", robots stand in a row and neighbours share a place; each thing is to be brought
one robot's reach further. In the lab "mixed", robots reach three more places each, things go
anywhere, and each robot has a chance of its own with each thing, so that ways differ in cost. The
other planner gets the same problem as PDDL and runs as a process; its plan is read back, each step
checked, and its cost compared.

    python tests/benchmarks/tasks/bench_planning.py --graph

plans for the row out of a graph instead, by the operation that users call: with all preconditions
that the ontology has, which are asked of the graph first.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import resource
import shlex
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.planning.pddl import PddlProblem, write_pddl
from rtask.tasks.planning.problem import Estimate, Problem, Step
from rtask.tasks.planning.search import find_plan
from tests.rtask.tasks.lab import lab

SIZES = ((10, 2), (50, 4), (500, 10))
TARGETS_S = {(50, 4): 1.0, (500, 10): 10.0}
BASE = "https://example.org/kb/"
ROW_GOAL = "?x rt:locatedOn ?y WHERE { ?x rdfs:seeAlso ?y }"
COST_RATIOS = {(50, 4): 1.2, (500, 10): 1.5}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--planner", help="command with {domain}, {problem} and {plan}")
    parser.add_argument("--limit", type=float, default=300.0, help="seconds for it")
    parser.add_argument("--graph", action="store_true", help="plan out of a graph")
    given = parser.parse_args()
    if given.graph:
        print("graph, things x robots | steps | CPU, s | again, s | target")
        for size in SIZES:
            from_graph(*size)
        return
    print(
        "lab, things x robots | steps | cost, s | CPU, s | busiest robot, s | target | "
        "other: steps | cost | CPU, s | "
        "ratio"
    )
    for name, size in ((name, size) for name in ("row", "mixed") for size in SIZES):
        problem = lab(*size) if name == "row" else mixed(*size)
        problem = replace(problem, workers=frozenset(problem.objects["robot"]))
        began = time.process_time()
        plan = find_plan(problem)
        took_s = time.process_time() - began
        assert plan is not None
        row = [
            f"{name}, {size[0]} x {size[1]}", f"{len(plan.steps)}", f"{plan.cost_s:.0f}",
            f"{took_s:.2f}", f"{_longest_s(problem, plan.steps):.0f}",
            f"{TARGETS_S.get(size, '-')}",
        ]  # fmt: skip
        if given.planner:
            row += other(given.planner, given.limit, problem, size, plan.cost_s)
        print(" | ".join(row), flush=True)


def _longest_s(problem: Problem, steps: Sequence[Step]) -> float:
    """Return how long the busiest robot works, s."""
    return max(
        sum(step.duration_s for step in steps if robot in dict(step.arguments).values())
        for robot in problem.workers
    )


def from_graph(things: int, robots: int) -> None:
    """Print the row of a graph."""
    with rtask.open(":memory:", base=BASE) as kb, Engine(kb) as engine:
        kb.update(row_update(things, robots))
        planner = rtask.connect(engine)
        kb.query("ASK { ?thing <https://w3id.org/rtask-kg/ns#locatedOn> ?place }")
        took = []
        for _ in range(2):
            began = time.process_time()
            plan = planner.call("plan_goal", 300.0, goal=ROW_GOAL)
            took.append(time.process_time() - began)
        assert plan["complete"], plan["text"]
    target = TARGETS_S.get((things, robots), "-")
    times = " | ".join(f"{seconds:.2f}" for seconds in took)
    print(f"graph, {things} x {robots} | {len(plan['steps'])} | {times} | {target}", flush=True)


def row_update(things: int, robots: int) -> str:
    """Return the update that states the row: robots with a hand each, places, and things."""
    rows = [f"<{BASE}place/{n}> a rt:SupportSurface ; rt:name 'place {n}' ."
            for n in range(robots + 1)]  # fmt: skip
    for n in range(robots):
        robot = f"{BASE}robot/{n}"
        rows.append(
            f"<{robot}> a cora:Robot ; rt:name 'robot {n}' ; rt:hasEndEffector <{robot}/hand> ; "
            f"rt:reaches <{BASE}place/{n}>, <{BASE}place/{n + 1}> . <{robot}/hand> a "
            f"rt:ParallelJawGripper ; rt:name 'hand {n}' ; rt:gripperType 'jaw' ; "
            "rt:minOpening 0.0e0 ; rt:maxOpening 0.08e0 ; rt:maxPayload 0.5e0 ."
        )
    for n in range(things):
        product, item, at = (f"{BASE}{part}/{n}" for part in ("object", "thing", "placement"))
        start, end = n % (robots + 1), (n + 2) % (robots + 1)
        rows.append(
            f"<{product}> a rt:Cup ; rt:objectId 'lab/{n}' ; rt:name 'cup {n}' ; "
            f"rt:graspWidth 0.03e0 ; rt:mass 0.1e0 . <{item}> a rt:Exemplar ; rt:exemplarOf "
            f"<{product}> ; rdfs:seeAlso <{BASE}place/{end}> . <{at}> a rt:Placement ; "
            f"rt:placementOf <{item}> ; rt:placedOn <{BASE}place/{start}> ; time:hasBeginning "
            f"<{at}/begin> . <{at}/begin> time:inXSDDateTimeStamp "
            "'2026-01-01T10:00:00Z'^^xsd:dateTimeStamp ."
        )
    return f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {' '.join(rows)} }} }}"


def mixed(things: int, robots: int) -> Problem:
    """Return a lab in which chances differ, and places are shared at random."""
    problem, draw = lab(things, robots), random.Random(7)
    members, places = problem.objects["robot"], problem.objects["place"]
    chances = {
        (robot, item): draw.uniform(0.5, 0.99)
        for robot in members
        for item in problem.objects["thing"]
    }

    def estimate(duration_s: float) -> Estimate:
        return lambda given: (duration_s, chances[given["r"], given["o"]])

    actions = tuple(
        replace(action, estimate=estimate(8.0 if action.name == "pick" else 4.0))
        for action in problem.actions
    )
    facts = {fact for fact in problem.facts if fact[0] != "at"}
    for robot in members:
        more = draw.sample(places, min(3, len(places)))
        facts |= {("reaches", robot, place) for place in more}
    goals = []
    for item in problem.objects["thing"]:
        start, end = draw.sample(places, 2)
        facts.add(("at", item, start))
        goals.append((("at", item, end),))
    return replace(problem, actions=actions, facts=frozenset(facts), goals=tuple(goals))


def other(
    command: str, limit_s: float, problem: Problem, size: tuple[int, int], cost_s: float
) -> list[str]:
    """Return the columns of the other planner."""
    pddl = write_pddl(problem)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    steps = run(command, limit_s, pddl)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    took_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if steps is None:
        return ["none in time", "-", f"{took_s:.2f}", "-"]
    cost = sum(step.cost_s(problem.failure_cost_s) for step in steps)
    target = COST_RATIOS.get(size)
    ratio = f"{cost_s / cost:.3f}" + (f" (at most {target})" if target else "")
    return [f"{len(steps)}", f"{cost:.0f}", f"{took_s:.2f}", ratio]


def run(command: str, limit_s: float, pddl: PddlProblem) -> Sequence[Step] | None:
    """Return the steps of another planner's plan, or None if it wrote none in time."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {part: folder / f"{part}.pddl" for part in ("domain", "problem")}
        files["domain"].write_text(pddl.domain, encoding="utf-8")
        files["problem"].write_text(pddl.problem, encoding="utf-8")
        plan = folder / "plan"
        words = [word.format(plan=plan, **files) for word in shlex.split(command)]
        # In a group of its own, so that what it starts ends with it.
        started = subprocess.Popen(
            words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        with contextlib.suppress(subprocess.TimeoutExpired):
            started.wait(limit_s)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(started.pid, signal.SIGKILL)
        started.wait()
        # An anytime planner numbers its plans, and the last may be cut off.
        for written in sorted(folder.glob("plan*"), reverse=True):
            with contextlib.suppress(ValueError):
                return pddl.read_plan(written.read_text("utf-8"))
        return None


if __name__ == "__main__":
    main()
