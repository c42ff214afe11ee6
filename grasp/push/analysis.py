"""The quality of grasps over perturbed parts (Kehoe 2014, 3.4, Algorithm 1)."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray, IntArray
from grasp.push.candidates import Grasps
from grasp.push.mechanics.conditions import CODES, INVALID, UNTRIED
from grasp.push.perturb import Tolerance
from grasp.push.polygon import Part
from grasp.push.quality import best_first, density_quality, lower_bound
from grasp.push.shards import Executor, Progress, Range, Watch
from grasp.push.trials import ORDER, CodeArray, Counting, PushTest, Trials, count_codes

__all__ = [
    "MAX_SAMPLES",
    "Analysis",
    "Elimination",
    "PushTest",
    "Trials",
    "analyse",
    "running_best",
    "stop_at",
    "summed",
]

STOP_CHANGE, STOP_WINDOW, STOP_MIN_SAMPLES = 0.05, 20, 30
"""Convergence rule of Kehoe 2014, 3.5: the best quality moved by at most 5 % over a window."""

_BATCH = 64

MAX_SAMPLES = 1_000_000
"""Of perturbed parts; each takes 16 bytes for a vertex."""

_MAX_EVALUATIONS = 500_000_000


@dataclass(frozen=True)
class Elimination:
    """Adaptive removal of unpromising grasps (Kehoe 2014, 3.4).

    Parameters
    ----------
    batches
        Numbers of perturbations; after each but the last, grasps are removed.
    share
        Of the grasps that are removed, 0..1. (The thesis's text removes R |G|, its equation 3.5
        keeps R |G|; here R is removed.)
    """

    batches: tuple[int, ...]
    share: float

    def __post_init__(self) -> None:
        if not self.batches or any(b < 1 for b in self.batches):
            raise ValueError(f"batches must be positive numbers, got {self.batches}")
        if not 0 <= self.share < 1:
            raise ValueError(f"share must lie in 0..1, without 1, got {self.share}")


@dataclass(frozen=True)
class Racing:
    """Removal of grasps that are worse than the best one beyond doubt; beside the thesis's rule.

    All grasps see the same perturbations. After every batch those go whose upper confidence bound
    lies below the best one's lower bound; none is removed by lot.

    Parameters
    ----------
    samples, batch
        Perturbations in all, and between removals.
    confidence
        Of each one-sided bound.
    """

    samples: int = 100
    batch: int = 10
    confidence: float = 0.95

    def __post_init__(self) -> None:
        if self.samples < 1 or self.batch < 1:
            raise ValueError("samples and batch must be at least 1")
        if not 0.5 < self.confidence < 1:
            raise ValueError(f"confidence must lie between 0.5 and 1, got {self.confidence}")

    @property
    def batches(self) -> tuple[int, ...]:
        """Numbers of perturbations between removals."""
        full, rest = divmod(self.samples, self.batch)
        return (self.batch,) * full + ((rest,) if rest else ())


@dataclass(frozen=True)
class Analysis:
    """Grasps and how often they succeeded.

    Parameters
    ----------
    counts : (g, k) int
        How often each result came, in the order of `ORDER`; UNTRIED after elimination.
    samples
        Perturbed parts, N.
    quality, lower_95 : (g,)
        Estimate of the probability of success, and its one-sided 95 % lower bound (plain mean).
    successes, tried, eliminated_after : (g,) int
        ``eliminated_after`` is 0 for survivors.
    order : (g,) int
        Best first.
    crossed
        Share of perturbations whose outline crossed itself; they count as failures.
    is_cut
        Whether the time was up before all the perturbations that were wanted.
    evaluations, seconds
        Spent.
    """

    grasps: Grasps
    counts: IntArray
    samples: int
    quality: FloatArray
    lower_95: FloatArray
    successes: IntArray
    tried: IntArray
    eliminated_after: IntArray
    order: IntArray
    crossed: float
    is_cut: bool
    evaluations: int
    seconds: float = field(compare=False)
    kept: CodeArray | None = field(default=None, repr=False)

    @property
    def codes(self) -> CodeArray:
        """Result of every trial, (g, N) int8, `CODES`; UNTRIED after elimination.

        Raises
        ------
        ValueError
            They were not kept.
        """
        if self.kept is None:
            raise ValueError("results of single trials are kept with keep_codes=True only")
        return self.kept

    @property
    def best(self) -> int:
        """Index of the best grasp."""
        return int(self.order[0])

    @property
    def spent(self) -> float:
        """Evaluations over those without elimination (eta hat of Kehoe 2014, 3.4)."""
        return self.evaluations / (self.samples * len(self.grasps))

    def reasons(self, index: int | None = None) -> dict[str, int]:
        """Count the results of all grasps or of one, commonest first."""
        counts = self.counts.sum(axis=0) if index is None else self.counts[index]
        common = sorted(zip(-counts, ORDER.tolist(), strict=True))
        return {CODES[code]: -int(k) for k, code in common if k}


def analyse(
    part: Part,
    grasps: Grasps,
    test: PushTest,
    tolerance: Tolerance,
    *,
    samples: int = 100,
    elimination: Elimination | Racing | None = None,
    stop: bool = False,
    weighting: Literal["mean", "density"] = "mean",
    seed: int = 0,
    executor: Executor | None = None,
    keep_codes: bool = False,
    progress: Progress | None = None,
    deadline_s: float | None = None,
) -> Analysis:
    """Estimate the quality of grasps.

    Parameters
    ----------
    samples
        Perturbations; with ``elimination`` its batches count instead.
    stop
        End when the best quality has settled (`stop_at`); not together with elimination.
    keep_codes
        Keep the result of every trial (`Analysis.codes`). Otherwise workers return sums only,
        unless ``stop`` or the weighting by density needs more.
    progress
        Is told how many trials have been judged, and how many are wanted at most.
    deadline_s
        After this time the analysis ends with the trials that have finished, at least some
        (Kehoe 2014, 3.6); with elimination, after its last complete batch. Which trials they are
        depends on the machine.
    """
    if len(grasps) == 0:
        raise ValueError("there are no grasps to analyse")
    if samples < 1:
        raise ValueError(f"samples must be at least 1, got {samples}")
    total = samples if elimination is None else sum(elimination.batches)
    if total > MAX_SAMPLES or total * len(grasps) > _MAX_EVALUATIONS:
        raise ValueError(
            f"{total} samples of {len(grasps)} grasps are too many: at most {MAX_SAMPLES} "
            f"samples and {_MAX_EVALUATIONS} evaluations fit into memory"
        )
    if stop and elimination is not None:
        raise ValueError("stop and elimination exclude each other")
    if weighting not in ("mean", "density"):
        raise ValueError(f"weighting is mean or density, got {weighting!r}")
    began = time.perf_counter()
    trials = Trials.of(part, grasps, test, tolerance, seed)
    watch = Watch(executor, total, progress, deadline_s)
    # Workers return sums of a few bytes a grasp, unless each trial is asked for.
    if stop or keep_codes or weighting == "density":
        return _from_codes(trials, grasps, watch, total, elimination, stop, weighting, seed, began)
    counts = np.zeros((len(grasps), len(ORDER)), np.int64)
    gone, done = _batches(trials, elimination, total, seed, watch, counts)
    # Grasps that were removed have seen fewer trials than the others.
    counts[:, ORDER == UNTRIED] = (done - counts.sum(axis=1))[:, None]
    return _summed(grasps, counts, gone, done, done < total, began)


def _from_codes(
    trials: Trials, grasps: Grasps, watch: Watch, total: int,
    elimination: Elimination | Racing | None, stop: bool, weighting: str, seed: int, began: float,
) -> Analysis:  # fmt: skip
    """Analyse with the result of every trial."""
    gone = np.zeros(len(grasps), np.int64)
    if elimination is not None:
        codes, gone = _adaptive(trials, elimination, seed, watch)
    elif stop:
        codes = _until_settled(trials, total, watch)
    else:
        codes, _ = _all(trials, 0, total, watch)
    is_cut = codes.shape[1] < total and watch.is_over
    return summed(trials, grasps, codes, gone, weighting, began, is_cut)


def _all(trials: Trials, first: int, count: int, watch: Watch) -> tuple[CodeArray, bool]:
    """Return the codes of the trials that finished in time, and whether all did."""
    pieces = [codes for _, codes in watch.run(trials, first, count)]
    codes = np.concatenate(pieces, axis=1)
    return codes, codes.shape[1] == count


def _until_settled(trials: Trials, samples: int, watch: Watch) -> CodeArray:
    codes = np.empty((len(trials.rows), 0), np.int8)
    while codes.shape[1] < samples:
        size = min(_BATCH, samples - codes.shape[1])
        more, is_whole = _all(trials, codes.shape[1], size, watch)
        codes = np.hstack([codes, more])
        end = stop_at(running_best(codes))
        if end:
            return codes[:, :end]
        if not is_whole or watch.is_over:
            break
    return codes


def running_best(codes: CodeArray) -> FloatArray:
    """Return the best quality after 1, 2, .. perturbations, (N,) (Kehoe 2014, Fig. 3.11)."""
    done = np.arange(1, codes.shape[1] + 1)
    return np.asarray((np.cumsum(codes > 0, axis=1) / done).max(axis=0))


def stop_at(curve: FloatArray) -> int:
    """Return after how many perturbations the best quality had settled; 0 = not yet.

    >>> stop_at(np.ones(100)), stop_at(np.linspace(1, 0, 40))
    (30, 0)
    """
    for k in range(STOP_MIN_SAMPLES, len(curve) + 1):
        # The change over so many samples lies between one value more than there are samples.
        window = curve[k - STOP_WINDOW - 1 : k] if k > STOP_WINDOW else curve[:k]
        if np.ptp(window) <= STOP_CHANGE * max(curve[k - 1], 1e-12):
            return k
    return 0


def _adaptive(
    trials: Trials, plan: Elimination | Racing, seed: int, watch: Watch
) -> tuple[CodeArray, IntArray]:
    """Return the result of every trial, and after how many each grasp was removed."""
    codes = np.full((len(trials.rows), sum(plan.batches)), UNTRIED, np.int8)
    counts = np.zeros((len(trials.rows), len(ORDER)), np.int64)
    gone, done = _batches(trials, plan, codes.shape[1], seed, watch, counts, codes)
    return codes[:, :done], gone


def _batches(
    trials: Trials,
    plan: Elimination | Racing | None,
    total: int,
    seed: int,
    watch: Watch,
    counts: IntArray,
    codes: CodeArray | None = None,
) -> tuple[IntArray, int]:
    """Judge batch by batch into counts (g, k) and codes (g, N), and remove grasps between them.

    Returns
    -------
    (g,) after how many trials each grasp was removed, and how many trials were judged.
    """
    alive = np.arange(len(trials.rows))
    gone = np.zeros(len(trials.rows), np.int64)
    done = 0
    for batch in (total,) if plan is None else plan.batches:
        task = trials.among(alive)
        results: list[tuple[Range, IntArray]]
        if codes is None:
            results = watch.run(Counting(task), done, batch)
        else:
            results = []
            for (first, count), piece in watch.run(task, done, batch):
                codes[alive, first : first + count] = piece
                results.append(((first, count), count_codes(piece)))
        judged = sum(count for (_, count), _ in results)
        if judged < batch and done > 0:
            break  # those that were removed saw complete batches, so the others do as well
        for _, part_counts in results:
            counts[alive] += part_counts
        done += judged
        if plan is None or done == total or judged < batch or watch.is_over:
            break
        wins = counts[alive][:, ORDER > 0].sum(axis=1)
        survivors = _surviving(plan, wins, done, trials.rows[alive], seed)
        if len(survivors) < len(alive):
            gone[np.delete(alive, survivors)] = done
            alive = alive[survivors]
    return gone, done


def _surviving(
    plan: Elimination | Racing, wins: IntArray, done: int, rows: FloatArray, seed: int
) -> IntArray:
    """Return which of the grasps (g, 5) stay, ascending."""
    if isinstance(plan, Racing):
        # Many grasps have won as often, and the bound of the one that won most is the highest.
        levels, of_level = np.unique(wins, return_inverse=True)
        tried = np.full(len(levels), done)
        upper = 1 - lower_bound(tried - levels, tried, plan.confidence)
        best = lower_bound(levels[-1:], tried[-1:], plan.confidence)[0]
        return np.flatnonzero((upper >= best)[of_level])
    count = max(1, math.floor((1 - plan.share) * len(wins) + 0.5 + 1e-9))
    return np.sort(np.lexsort((_lots(rows, seed + done), -wins))[:count])


def _lots(rows: FloatArray, seed: int) -> NDArray[np.uint64]:
    """Return random numbers that belong to grasps, not to their places in the list."""
    z = np.full(len(rows), seed % 2**32, np.uint64)
    for column in np.round(rows, 9).T + 0.0:
        z = (z ^ np.ascontiguousarray(column).view(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
        z ^= z >> np.uint64(29)
    return z


def summed(
    trials: Trials, grasps: Grasps, codes: CodeArray, gone: IntArray, weighting: str, began: float,
    is_cut: bool = False,
) -> Analysis:  # fmt: skip
    """Return the analysis that codes (g, N) amount to; ``gone`` as in `Analysis`."""
    quality = None
    if weighting == "density":
        success = codes > 0
        quality = density_quality(success, _weighing(trials, codes.shape[1]))
        for g in np.flatnonzero(gone):
            some = _weighing(trials, int(gone[g]))
            quality[g] = density_quality(success[g : g + 1, : gone[g]], some)[0]
    summary = _summed(grasps, count_codes(codes), gone, codes.shape[1], is_cut, began, quality)
    return replace(summary, kept=codes)


def _summed(
    grasps: Grasps, counts: IntArray, gone: IntArray, samples: int, is_cut: bool, began: float,
    quality: FloatArray | None = None,
) -> Analysis:  # fmt: skip
    """Return the analysis that counts (g, k) amount to, by the plain mean unless told."""
    wins, tried = counts[:, ORDER > 0].sum(axis=1), counts[:, ORDER != UNTRIED].sum(axis=1)
    mean = wins / tried if quality is None else np.asarray(quality)
    survivor = int(np.flatnonzero(gone == 0)[0])
    crossed = float(counts[survivor, ORDER == INVALID].sum() / tried[survivor])
    return Analysis(
        grasps, counts, samples, mean, lower_bound(wins, tried), wins, tried, gone,
        best_first(mean, grasps, gone == 0), crossed, is_cut, int(tried.sum()),
        time.perf_counter() - began,
    )  # fmt: skip


def _weighing(trials: Trials, count: int) -> FloatArray:
    """Return the draws that had an effect: those of a zero deviation carry no probability."""
    draws = trials.draws(0, count)
    n, given = len(trials.ring), trials.tolerance
    used = np.zeros((n + 3, 2), bool)
    used[:n] = (np.broadcast_to(np.asarray(given.vertex_std), (n,)) > 0)[:, None]
    used[n] = given.com_std > 0
    used[n + 1] = given.pose_std[0] > 0
    used[n + 2, 0] = given.pose_std[1] > 0
    return np.where(used, draws, 0.0)
