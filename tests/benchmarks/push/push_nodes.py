"""Fig. 3.17 to 3.19 of Kehoe 2014: an analysis shared among nodes, on workers that run apart.

Every shard of every number of nodes is carried out by a worker process of this machine, as many at
a time as it has cores, and timed by its own processor; what a node would take is therefore
measured, and only that 500 of them run at a time is not. Beside it stands a model with three
numbers, fitted to the shards of one node, of as many nodes as there are workers, and of one
perturbation: a shard of k takes a + b k, with a deviation of s sqrt(k).
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp.charts import curve_chart
from grasp.push import open_executor, sample_grasps
from grasp.push.parts import BRACKETS
from grasp.push.shards import Executor, shard
from grasp.push.trials import Trials
from tests.benchmarks.push.push_settings import CONFIGURATIONS, Drawings, usual

NODES = (1, 10, 50, 100, 250, 500)
SAMPLES = 500
START_UP_S = (41.6, 133.0)
"""Of a PiCloud node (3.6)."""
MATLAB_S = (726.0, 9442.0, 10239.0)
"""Of part A on one node in each configuration: ten times that of ten nodes (Table 3.2)."""
_DRAWS = 400


@dataclass(frozen=True)
class TimedTrials:
    """Trials that tell how long they took, s of the worker's processor."""

    trials: Trials

    def __call__(self, first: int, count: int) -> float:
        """Carry out a shard."""
        began = time.process_time()
        self.trials(first, count)
        return time.process_time() - began


@dataclass(frozen=True)
class Model:
    """Seconds of a shard of k perturbations: ``fixed + each * k``, deviation ``spread sqrt(k)``."""

    fixed: float
    each: float
    spread: float

    @classmethod
    def of(cls, ones: Sequence[float], wholes: Sequence[tuple[int, float]]) -> Model:
        """Fit to the times of single perturbations, and of large shards (size, time)."""
        sizes = np.array([size for size, _ in wholes], float)
        times = np.array([spent for _, spent in wholes])
        single = float(np.median(ones))
        each = float(np.sum((times - single) * (sizes - 1)) / np.sum((sizes - 1) ** 2))
        return cls(max(single - each, 0.0), each, float(np.std(ones)))

    def nodes(self, count: int, samples: int = SAMPLES, seed: int = 0) -> tuple[float, float]:
        """Return the mean time of a node, and that of the slowest on the average."""
        size = max(samples / count, 1.0)
        mean = self.fixed + self.each * size
        if count == 1:
            return mean, mean
        highest = np.random.default_rng(seed).normal(size=(_DRAWS, count)).max(axis=1).mean()
        return mean, mean + self.spread * float(np.sqrt(size) * highest)


def shard_times(executor: Executor, trials: Trials, nodes: int) -> np.ndarray:
    """Return the processor seconds (nodes,) of each node's shard."""
    found = dict(executor.finished(TimedTrials(trials), shard(0, SAMPLES, nodes)))
    return np.array([found[node] for node in sorted(found)])


def start_ups(times: int = 5) -> list[float]:
    """Return how long it takes, s, until a new worker process has done one perturbation."""
    trials = trials_of("A", CONFIGURATIONS[0])
    spans = []
    for _ in range(times):
        with open_executor("processes", 1) as fresh:
            began = time.perf_counter()
            list(fresh.finished(trials, [(0, 1)]))
            spans.append(time.perf_counter() - began)
    return spans


def trials_of(name: str, setting: tuple[float, float, int]) -> Trials:
    """Return the trials of a stand-in at a setting of Table 3.2."""
    part, test, tolerance = usual(name)
    grasps = sample_grasps(part, filter_distance=setting[0], density=setting[1], angles=setting[2])
    return Trials.of(part, grasps, test, tolerance, 0)


def fig_3_17() -> None:
    """Fig. 3.17 to 3.19: speed-up of the average node, of the slowest, and with its start-up."""
    workers = len(os.sched_getaffinity(0))
    curves: dict[str, list[np.ndarray]] = {"average": [], "slowest": [], "started": [], "ours": []}
    modelled: list[np.ndarray] = []
    best: dict[str, tuple[float, str]] = {}
    own = start_ups()
    print(
        f"{workers} workers at a time; a new worker process is ready after "
        f"{min(own):.2f} to {max(own):.2f} s of the clock"
    )
    rng = np.random.default_rng(0)
    with open_executor("processes", workers) as executor:
        for number, setting in enumerate(CONFIGURATIONS, start=1):
            slower = 1.0
            for name in BRACKETS:
                trials = trials_of(name, setting)
                list(executor.finished(trials, [(0, 2)] * workers))
                spans = {nodes: shard_times(executor, trials, nodes) for nodes in NODES}
                some = shard_times(executor, trials, workers)
                sizes = [(SAMPLES, float(spans[1][0])), *((SAMPLES // workers, s) for s in some)]
                model = Model.of(spans[SAMPLES], sizes)
                one = float(spans[1][0])
                if name == "A":
                    slower = MATLAB_S[number - 1] / one
                table = {
                    "average": [one / spans[n].mean() for n in NODES],
                    "slowest": [one / spans[n].max() for n in NODES],
                    "started": [
                        _with_start(slower * one, slower * spans[n], START_UP_S, rng) for n in NODES
                    ],
                    "ours": [_with_start(one, spans[n], (min(own), max(own)), rng) for n in NODES],
                }
                for what, row in table.items():
                    curves[what].append(np.array(row))
                    top = max(row)
                    if top > best.get(what, (0.0, ""))[0]:
                        best[what] = top, f"part {name}, configuration {number}"
                alone = model.nodes(1)[0]
                modelled.append(
                    np.array([[alone / t for t in model.nodes(n, seed=n)] for n in NODES])
                )
    _print(curves, np.array(modelled), best)


def _with_start(
    one: float, spans: np.ndarray, start: tuple[float, float], rng: np.random.Generator
) -> float:
    """Return the speed-up where each node starts first, for a time drawn evenly from a range.

    One node alone takes the middle of the range.
    """
    slowest = (spans + rng.uniform(*start, len(spans))).max() if len(spans) > 1 else None
    alone = one + float(np.mean(start))
    return 1.0 if slowest is None else float(alone / slowest)


def _print(
    curves: dict[str, list[np.ndarray]], modelled: np.ndarray, best: dict[str, tuple[float, str]]
) -> None:
    figures = {
        "average": ("3.17", "average node", "515 (part A, configuration 3)"),
        "slowest": ("3.18", "slowest node", "393 (part C, configuration 3)"),
        "started": (
            "3.19",
            "slowest node, as slow as MATLAB, PiCloud's start-up",
            "97 (part C, configuration 3)",
        ),
        "ours": ("3.19", "slowest node, start-up of our processes", "-"),
    }
    for what, (figure, label, thesis) in figures.items():
        rows = np.array(curves[what])
        print(f"Fig. {figure}, {label}: {len(rows)} runs; thesis at 500 nodes at most {thesis}")
        for k, nodes in enumerate(NODES):
            column = rows[:, k]
            line = (
                f"{nodes:5d} nodes: {column.mean():7.2f} ({column.min():.2f} to {column.max():.2f})"
            )
            if what in ("average", "slowest"):
                model = modelled[:, k, 0 if what == "average" else 1]
                line += f"   model {_range(model)}"
            print(line)
        print(f"      most: {best[what][0]:.1f}, {best[what][1]}")
        limits = (0.0, float(rows.max()) * 1.05)
        drawn = {"mean": rows.mean(axis=0), "least*": rows.min(axis=0), "most*": rows.max(axis=0)}
        Drawings.write(
            f"fig-{figure}" + ("-ours" if what == "ours" else ""),
            curve_chart(NODES, drawn, f"Fig. {figure}, {label}", "nodes", limits, "speed-up"),
        )


def _range(values: np.ndarray) -> str:
    return f"{values.mean():7.2f} ({values.min():.2f} to {values.max():.2f})"
