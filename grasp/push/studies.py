"""The experiments of Kehoe 2014, 3.5, on any part."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from grasp.arrays import FloatArray
from grasp.push.analysis import analyse
from grasp.push.candidates import sample_grasps
from grasp.push.perturb import Tolerance
from grasp.push.polygon import Part
from grasp.push.push_plan import PushPlan
from grasp.push.trials import CodeArray, PushTest

__all__ = [
    "ANGLE_COUNTS",
    "DENSITIES",
    "FILTERS",
    "GridPoint",
    "NominalOnly",
    "elimination_outcome",
    "nominal_only",
    "refined",
    "sensitivity_grid",
]

FILTERS = (0.0, 0.03, 0.06, 0.09)
ANGLE_COUNTS = (5, 9, 15)
DENSITIES = (1.5, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0)


@dataclass(frozen=True)
class GridPoint:
    """One setting of the candidates and what it gave.

    Parameters
    ----------
    seconds
        Processor time of candidates and analysis.
    """

    filter_distance: float
    density: float
    angles: int
    candidates: int
    quality: float
    seconds: float


def sensitivity_grid(
    part: Part,
    test: PushTest,
    tolerance: Tolerance,
    *,
    filters: Sequence[float] = FILTERS,
    densities: Sequence[float] = DENSITIES,
    angle_counts: Sequence[int] = ANGLE_COUNTS,
    samples: int = 100,
    seed: int = 0,
) -> Iterator[GridPoint]:
    """Yield the best quality for every setting, 84 by default (Kehoe 2014, 3.5)."""
    for distance in filters:
        for angles in angle_counts:
            for density in densities:
                began = time.process_time()
                grasps = sample_grasps(
                    part, filter_distance=distance, density=density, angles=angles
                )
                analysis = analyse(part, grasps, test, tolerance, samples=samples, seed=seed)
                spent = time.process_time() - began
                best = float(analysis.quality[analysis.best])
                yield GridPoint(distance, density, angles, len(grasps), best, spent)


@dataclass(frozen=True)
class NominalOnly:
    """Result of planning without uncertainty (Kehoe 2014, 3.5).

    Parameters
    ----------
    closing
        Candidates that close on the nominal part.
    best_share
        Of these, how many are best under uncertainty.
    mean_ratio
        Their mean quality over the best one.
    """

    closing: int
    best_share: float
    mean_ratio: float


def nominal_only(plan: PushPlan) -> NominalOnly:
    """Compare a plan with one that ignores uncertainty."""
    closing = plan.nominal > 0
    count = int(closing.sum())
    if count == 0 or plan.quality == 0:
        return NominalOnly(count, 0.0, 0.0)
    quality = plan.analysis.quality[closing]
    share = float((quality >= plan.quality - 1e-12).mean())
    return NominalOnly(count, share, float(quality.mean() / plan.quality))


def elimination_outcome(codes: CodeArray, first: int, share: float) -> tuple[float, float, float]:
    """Return what eliminating once would have done to a finished analysis.

    Parameters
    ----------
    codes : (g, N)
        Of an analysis without elimination.
    first
        Perturbations before the elimination (M_1).
    share
        Of grasps that are eliminated.

    Returns
    -------
    Share of evaluations done (eta hat), expected and worst best quality over that without
    elimination. The expectation over the random breaking of ties is exact: with t tied grasps of
    which k are kept, the j-th best of them survives as the best with C(t - j, k - 1) / C(t, k).
    """
    success = codes > 0
    count, samples = success.shape
    final = success.mean(axis=1)
    wins = success[:, :first].sum(axis=1)
    keep = max(1, int(np.floor((1 - share) * count + 0.5 + 1e-9)))
    spent = (count * first + keep * (samples - first)) / (count * samples)
    top = float(final.max())
    if top == 0:
        return spent, 1.0, 1.0
    border = np.sort(wins)[::-1][keep - 1]
    sure = final[wins > border]
    tied = np.sort(final[wins == border])[::-1]
    surviving = keep - len(sure)
    floor = float(sure.max()) if len(sure) else 0.0
    worst = max(floor, float(tied[len(tied) - surviving]))
    t, k = len(tied), surviving
    j = np.arange(1, t - k + 2)
    log = (
        gammaln(t - j + 1) - gammaln(k) - gammaln(t - j - k + 2)
        - (gammaln(t + 1) - gammaln(k + 1) - gammaln(t - k + 1))
    )  # fmt: skip
    expected = float((np.exp(log) * np.maximum(tied[: len(j)], floor)).sum())
    return spent, min(expected / top, 1.0), worst / top


def refined(plan: PushPlan, share: float = 0.05, samples: int = 100, seed: int = 0) -> FloatArray:
    """Return simulated qualities of the best share of a plan's grasps, in the plan's order.

    The bound ranks, the simulation tells how much it leaves out: it judges only what is promising.
    """
    if not 0 < share <= 1:
        raise ValueError(f"share must lie in 0..1, without 0, got {share}")
    chosen = plan.analysis.order[: max(1, round(share * len(plan.grasps)))]
    test = replace(plan.test, method="simulation")
    analysis = analyse(
        plan.part, plan.grasps.take(chosen), test, plan.tolerance, samples=samples, seed=seed
    )
    return analysis.quality
