"""The shared environment that Kehoe 2014, 6.2, proposes: a copy, a simulation on it, and back."""

from __future__ import annotations

import time

import numpy as np
from pyoxigraph import Quad

import rtask
from rtask.engine import Engine
from rtask.knowledge_base import KnowledgeBase
from rtask.scratch import ScratchFolder
from simulate.study.tasks.trial import lab_update, random_goal
from simulate.tasks.crew import Crew
from simulate.tasks.executor import Executor
from simulate.tasks.lab import read_lab
from simulate.thesis.result import Compared, Result, Setting, counted, share_of
from simulate.world.seeds import stream

__all__ = ["shared_environment"]

_BASE = "https://example.org/kb/"
_STREAM = 93


def shared_environment(setting: Setting) -> Result:
    """Copy the graph, carry a goal out on the copy, and revert; then do so again, and merge."""
    things, goals = setting.size(200, 20), setting.size(20, 4)
    copying, dropping = [], []
    reached = reverted = merged = stated = 0
    rng = stream(setting.seed, _STREAM)
    with (
        ScratchFolder("environment") as folder,
        rtask.open(folder / "store", base=_BASE) as kb,
    ):
        kb.update(lab_update(rng, things))
        for _ in range(goals):
            before = _statements(kb)
            began = time.perf_counter()
            branch = kb.branch()
            copying.append(time.perf_counter() - began)
            reached += _carried_out(branch.graph, rng)
            stated += len(branch.compare().added)
            began = time.perf_counter()
            branch.drop()
            dropping.append(time.perf_counter() - began)
            reverted += _statements(kb) == before
        with kb.branch("kept") as last:
            _carried_out(last.graph, rng)
            meant = last.compare()
            last.merge()
        now = _statements(kb)
        merged = all(quad in now for quad in meant.added)
    return Result(
        (
            share_of("goals reached on a copy, simulated without dynamics", reached, goals),
            Compared("statements of each on the copy, mean", stated / goals),
            share_of("graphs that were as before once the copy was dropped", reverted, goals),
            counted("a copy that was merged instead: its statements are in the graph",
                    float(merged), 1.0),
            Compared("time to copy", 1e3 * float(np.median(copying)), unit="ms"),
            Compared("time to drop the copy", 1e3 * float(np.median(dropping)), unit="ms"),
        ),
        (
            "the thesis proposes it as future work and gives no figures",
            f"a lab of two tables with {things} things, two Naos and two Pandas; times by the "
            "clock, medians",
            *setting.shrunk("goals", 20, goals),
        ),
    )  # fmt: skip


def _statements(kb: KnowledgeBase) -> set[Quad]:
    return set(kb.match())


def _carried_out(graph: KnowledgeBase, rng: np.random.Generator) -> bool:
    """Plan a random goal, carry it out and store all of it; whether it was reached."""
    with Engine(graph) as engine:
        planner = rtask.connect(engine)
        lab = read_lab(planner.query, rng)
        goal, _ = random_goal(planner, rng, lab)
        planner.call("store_plan", goal=goal)
        robots = {
            robot: Executor(rtask.connect(engine, agent=robot.rpartition("/")[2]), lab.robot(robot))
            for robot in sorted(lab.hands)
        }
        return Crew(planner, robots).work()[0].result == "reached"
