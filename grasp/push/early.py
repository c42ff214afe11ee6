"""Asynchronous analysis from the shards that finish first (Kehoe 2014, 3.6).

More trials are started than wanted and the analysis ends with the first that make up the number.
Shards that finish early could be easier than the others, which would bias the result; the thesis
leaves the question open. With ``check`` the others are awaited too and both estimates compared.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from grasp.arrays import FloatArray, IntArray
from grasp.push.analysis import Analysis, summed
from grasp.push.candidates import Grasps
from grasp.push.perturb import Tolerance
from grasp.push.polygon import Part
from grasp.push.shards import Executor, Serial, shard
from grasp.push.trials import CodeArray, PushTest, Trials

__all__ = ["BiasCheck", "EarlyAnalysis", "analyse_early", "finish_times"]


@dataclass(frozen=True)
class BiasCheck:
    """Early shards against all of them.

    Parameters
    ----------
    difference : (g,)
        Quality of the early shards minus that of the others.
    largest_z
        Largest difference over its standard error, among all grasps.
    same_best
        The best grasp is the same.
    """

    difference: FloatArray
    largest_z: float
    same_best: bool


@dataclass(frozen=True)
class EarlyAnalysis:
    """Result of the early shards, and how it compares.

    Parameters
    ----------
    shards : (k,) int
        Numbers of the shards that were taken, in order of finishing.
    early_seconds, all_seconds
        Until enough, and until all shards had finished (0 without ``check``).
    """

    analysis: Analysis
    shards: IntArray
    bias: BiasCheck | None
    early_seconds: float = field(compare=False)
    all_seconds: float = field(compare=False)


def analyse_early(
    part: Part,
    grasps: Grasps,
    test: PushTest,
    tolerance: Tolerance,
    *,
    samples: int = 100,
    started: int = 5,
    shards: int = 20,
    check: bool = False,
    seed: int = 0,
    executor: Executor | None = None,
) -> EarlyAnalysis:
    """Start ``started`` times the wanted trials and use those that finish first.

    Parameters
    ----------
    shards
        Into how many the started trials are split.
    check
        Wait for the others too and compare.
    """
    if samples < 1 or started < 1 or shards < 1:
        raise ValueError("samples, started and shards must be at least 1")
    began = time.perf_counter()
    trials = Trials.of(part, grasps, test, tolerance, seed)
    ranges = shard(0, samples * started, shards)
    run = Serial() if executor is None else executor
    pieces, numbers, others = [], [], []
    got, early = 0, 0.0
    for number, codes in run.finished(trials, ranges):
        if got < samples:
            pieces.append(codes[:, : samples - got])
            numbers.append(number)
            got += codes.shape[1]
            early = time.perf_counter() - began
        else:
            others.append(codes)
        if got >= samples and not check:
            break
    gone = np.zeros(len(grasps), np.int64)
    taken = np.concatenate(pieces, axis=1)
    analysis = summed(trials, grasps, taken, gone, "mean", began)
    bias = None
    if check and others:
        bias = _compared(trials, analysis, np.concatenate(others, axis=1), began)
    spent = time.perf_counter() - began if check else 0.0
    return EarlyAnalysis(analysis, np.array(numbers), bias, early, spent)


def _compared(trials: Trials, early: Analysis, rest: CodeArray, began: float) -> BiasCheck:
    gone = np.zeros(len(trials.rows), np.int64)
    late = summed(trials, early.grasps, rest, gone, "mean", began)
    difference = early.quality - late.quality
    pooled = (early.successes + late.successes) / (early.tried + late.tried)
    error = np.sqrt(pooled * (1 - pooled) * (1 / early.tried + 1 / late.tried))
    some = error > 0
    largest = float(np.abs(difference[some] / error[some]).max()) if some.any() else 0.0
    return BiasCheck(difference, largest, early.best == late.best)


def finish_times(
    shard_seconds: Sequence[float], start_up: tuple[float, float], share: float, seed: int = 0
) -> tuple[float, float]:
    """Return when all nodes, and when a share of them, have finished.

    Parameters
    ----------
    shard_seconds
        Measured, one for each node.
    start_up
        Range of a node's start-up, drawn evenly, s (41.6 to 133 s in Kehoe 2014, 3.6).
    """
    delays = np.random.default_rng(seed).uniform(*start_up, len(shard_seconds))
    done = np.sort(delays + np.asarray(shard_seconds))
    return float(done[-1]), float(done[max(0, int(np.ceil(share * len(done))) - 1)])
