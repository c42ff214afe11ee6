"""What a crew wins over one robot, and rearranging over a crew without it, in crowded scenes.

    python tests/benchmarks/tasks/bench_crew_hard.py OUT [SCENE ...]

The scenes of :data:`SCENES` were fixed before anything was run on them: four or five things on the
long table of two Naos and a Panda, most of which have to change hands, and in some a robot that
leaves after its first thing. Each is carried out by

    crew      all robots,
    plain     all robots, none of which moves what another finds no way to,
    one       the one robot whose plan brings most things to their places; the others stand still.

What counts is how many things are where they should be, in the physics. A crew that never
rearranged anything does without it what it did before, so that it is not run again.

    python tests/benchmarks/tasks/bench_crew_hard.py --summary OUT
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import rtask
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks import rearranging
from simulate.tasks.arms.layouts import SORTING
from simulate.tasks.arms.working import Settings, WholeCrew, crew_at_tables
from simulate.tasks.executor import Turn

VARIANTS = ("one", "crew", "plain")
_DRAWS = 10_000


@dataclass(frozen=True)
class Scene:
    """Things, seed, the box of each kind, and who leaves after it has put down its first thing."""

    things: int
    seed: int
    boxes: Mapping[str, str]
    leaves: str = ""

    @property
    def goal(self) -> str:
        return "; ".join(f"every {kind} into the {box} box" for kind, box in self.boxes.items())

    def arrived(self, working: WholeCrew) -> tuple[int, int]:
        """Return how many things are in their box in the physics, and how many should be."""
        meant = [
            (truth.place, f"{self.boxes[kind]} box")
            for truth in working.truths()
            if (kind := truth.name.partition("-")[0]) in self.boxes
        ]
        return sum(place == box for place, box in meant), len(meant)


_LEFT = {"can": "left", "box": "left", "bottle": "left"}
_SORT = {"can": "left", "box": "right", "bottle": "right"}
_CROSS = {"can": "right", "box": "left", "bottle": "left"}
SCENES = (
    Scene(4, 6201, _LEFT),
    Scene(4, 6202, _SORT),
    Scene(4, 6203, _CROSS),
    Scene(5, 6204, _SORT),
    Scene(5, 6205, _CROSS),
    Scene(4, 6206, _SORT, "nao-2"),
    Scene(4, 6207, _CROSS, "nao-1"),
    Scene(4, 6208, _SORT, "panda-1"),
)


def carry_out(number: int, variant: str) -> dict[str, Any]:
    """Return what came of a scene, with the processor time that it took, s."""
    scene, began = SCENES[number], time.process_time()
    turns: list[Turn] = []
    with (
        rtask.open(":memory:") as kb,
        Engine(kb) as engine,
        crew_at_tables(
            rtask.connect(engine), Settings((SORTING,), scene.things, scene.seed)
        ) as working,
    ):
        if variant == "one":
            _leave_to_one(working, scene.goal)
        working.planner.call("store_plan", goal=scene.goal, allow_part=True)
        [ended] = working.work(_telling(working, scene, turns))[:1]
        plans = working.planner.call("list_plans", state="all")["plans"]
        arrived, meant = scene.arrived(working)
        truths = working.truths()
    return {
        "scene": number, "variant": variant, "result": ended.result, "arrived": arrived,
        "meant": meant, "steps": len(turns), "cpu_s": time.process_time() - began,
        "failed": [turn.comment for turn in turns if turn.result == "failed"],
        "wrong": sum(t.remembered not in ("", t.place) for t in truths),
        "moved": sum(plan["goal"].startswith("<") for plan in plans),
    }  # fmt: skip


def _telling(working: WholeCrew, scene: Scene, turns: list[Turn]) -> Callable[[str, Turn], None]:
    """Return what notes turns, and lets the robot that is to leave do so."""
    left: list[str] = []

    def tell(robot: str, turn: Turn) -> None:
        turns.append(turn)
        is_first = turn.result == "done" and " puts " in turn.text and not left
        if scene.leaves and robot.endswith(scene.leaves) and is_first:
            left.append(robot)
            _take_out(working, robot)

    return tell


def _take_out(working: WholeCrew, robot: str) -> None:
    working.planner.update(f"{PREFIXES} INSERT DATA {{ <{robot}> a rt:OutOfOrder }}")


def _leave_to_one(working: WholeCrew, goal: str) -> None:
    """Take all robots out but the one whose plan has most steps that put something down."""
    robots = sorted(working.bodies)
    does: dict[str, int] = {}
    for robot in robots:
        for other in robots:
            if other != robot:
                _take_out(working, other)
        plan = working.planner.call("plan_goal", goal=goal)
        does[robot] = sum(" puts " in step["text"] for step in plan["steps"])
        for other in robots:
            working.planner.update(f"{PREFIXES} DELETE DATA {{ <{other}> a rt:OutOfOrder }}")
    best = max(robots, key=lambda robot: does[robot])
    for other in robots:
        if other != best:
            _take_out(working, other)


def summarise(file: Path) -> None:
    """Print the things that arrived in each scene, and paired differences with 95 % intervals."""
    of = {(r["scene"], r["variant"]): r for r in map(json.loads, file.read_text().splitlines())}
    for number in range(len(SCENES)):
        if (
            (number, "crew") in of
            and (number, "plain") not in of
            and not of[number, "crew"]["moved"]
        ):
            of[number, "plain"] = of[number, "crew"]
    whole = [n for n in range(len(SCENES)) if all((n, v) in of for v in VARIANTS)]
    for n in whole:
        row = [f"{of[n, v]['arrived']} of {of[n, v]['meant']}" for v in VARIANTS]
        print(n, SCENES[n].goal, SCENES[n].leaves, *row, sep=" | ")
    rng = np.random.default_rng(0)
    for first, second in (("crew", "one"), ("crew", "plain")):
        gains = np.array([of[n, first]["arrived"] - of[n, second]["arrived"] for n in whole])
        means = rng.choice(gains, (_DRAWS, len(gains))).mean(axis=1)
        low, high = np.quantile(means, [0.025, 0.975])
        print(f"{first} - {second}: {gains.mean():.2f} things a scene ({low:.2f} to {high:.2f})")
    for variant in VARIANTS:
        rows = [of[n, variant] for n in whole]
        total = {k: sum(row[k] for row in rows) for k in ("arrived", "meant", "steps", "cpu_s")}
        print(variant, total, "elsewhere than the graph has it", sum(row["wrong"] for row in rows))


def main() -> None:
    """Run scenes, or sum up a file of results."""
    if sys.argv[1] == "--summary":
        summarise(Path(sys.argv[2]))
        return
    out, scenes = Path(sys.argv[1]), [int(word) for word in sys.argv[2:]] or range(len(SCENES))
    for number in scenes:
        moved = 0
        for variant in VARIANTS:
            if variant == "plain" and not moved:
                continue
            most = rearranging._MAX_MOVES
            rearranging._MAX_MOVES = 0 if variant == "plain" else most
            result = carry_out(number, variant)
            rearranging._MAX_MOVES, moved = most, result["moved"]
            print(result, flush=True)
            with out.open("a") as file:
                file.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
