"""Table 3.1 of Kehoe 2014 and the experiments of section 3.5 that have figures of their own."""

from __future__ import annotations

import time
from functools import partial
from itertools import pairwise

import numpy as np

from grasp.push.candidates import sample_grasps
from grasp.push.parts import BRACKETS
from grasp.push.studies import nominal_only, sensitivity_grid
from grasp.push.tolerancing import optimise_tolerance
from simulate.study.intervals import wilson
from simulate.thesis.materials.outlines import CONFIGURATIONS, STAND_INS, plan, timed, usual
from simulate.thesis.result import Compared, Result, Setting

__all__ = ["belief", "nominal", "sensitivity", "table_3_1"]

TABLE_3_1 = """
A 86.0 47.6 .03 1.5 5;A 91.3 102.9 .03 5 5;A 92.7 48.8 0 1.5 5;B 65.9 19.4 .09 1.5 5
B 80.6 32.7 .03 1.5 5;B 85.7 34.8 0 1.5 5;C 76.6 40.4 .06 1.5 5;C 85.0 31.5 .09 1.5 5
C 89.1 110.8 .09 7.5 5;C 90.0 156.5 0 5 5;D 93.2 27.3 .09 1.5 5;D 98.2 75.8 .03 7.5 5
D 98.3 219.6 .06 15 9;E 88.4 28.1 .09 1.5 5;E 98.1 47.4 .03 1.5 5;E 100.0 71.4 0 3 5
F 97.3 37.2 .09 1.5 5;F 99.0 281.5 .03 7.5 9;G 5.2 15.5 .09 1.5 5;G 12.2 61.7 0 3 5
G 17.1 184.6 .06 15 9;H 77.8 30.3 .09 1.5 5;H 93.2 78.5 .03 5 5;H 94.0 236.7 .06 15 9
I 81.1 35.9 .09 1.5 5;I 98.0 57.5 .06 1.5 5;I 99.0 118.4 0 1.5 5;J 100.0 14.7 0 1.5 5
J 100.0 125.3 .03 20 9;K 99.0 37.0 .09 7.5 5;K 99.5 99.9 .06 15 9;K 100.0 123.4 0 20 9
L 90.6 16.6 .09 1.5 5;L 91.0 146.2 0 20 9;L 95.2 17.0 0 1.5 5
"""
"""Part, Q* in per cent, seconds of MATLAB on four cores, d_C, rho, |Phi|; as printed."""

_SAMPLES = 100


def table_3_1(setting: Setting) -> Result:
    """Best quality and run time of 100 perturbations, part by part."""
    plan("A", CONFIGURATIONS[0])  # compiles before the clock runs
    rows = []
    for line in TABLE_3_1.strip().replace("\n", ";").split(";"):
        name, quality, seconds, d, rho, phi = line.split()
        where = (float(d), float(rho), int(phi))
        planned, spent, spread = timed(partial(plan, name, where, seed=setting.seed))
        ours = float(planned.quality)
        what = f"stand-in {name}, d_C {d}, rho {rho}, {phi} angles"
        low, high = wilson(round(ours * _SAMPLES), _SAMPLES)
        rows.append(
            Compared(f"{what}: Q*", 100 * ours, float(quality), "%", (100 * low, 100 * high))
        )  # fmt: skip
        rows.append(
            Compared(f"{what}: run time", spent, float(seconds), "s", spread, better="lower")
        )
    return Result(
        tuple(rows),
        (
            f"{STAND_INS}: Q* compares in kind, run times in order of size",
            "intervals are of the best grasp's own share, which is a little high as the largest",
            "theirs: MATLAB R2013a on four cores of 3.4 GHz; ours: processor seconds of one core",
        ),
    )


def nominal(setting: Setting) -> Result:
    """Planning on the nominal outline alone, judged under uncertainty."""
    settings = [
        (d, rho, phi)
        for d in (0.0, 0.03, 0.06, 0.09)
        for phi in (5, 9, 15)
        for rho in (1.5, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0)
    ]
    chosen = settings[:: 12 if setting.fast else 1]
    outcomes = [nominal_only(plan(name, s, seed=setting.seed)) for name in BRACKETS for s in chosen]
    shares = np.array([o.best_share for o in outcomes if o.closing])
    ratios = np.array([o.mean_ratio for o in outcomes if o.closing])
    return Result(
        (
            _mean("of those that close on the nominal part, share that is best", shares, 0.04),
            _mean("their mean quality over Q*", ratios, 0.58),
        ),
        (
            STAND_INS,
            f"{len(chosen)} of the 84 settings for each of {len(BRACKETS)} outlines"
            + (" (--fast)" if setting.fast else ""),
        ),
    )


def _mean(what: str, values: np.ndarray, theirs: float) -> Compared:
    error = 1.96 * float(values.std(ddof=1)) / len(values) ** 0.5
    mean = float(values.mean())
    return Compared(f"stand-ins: {what}", mean, theirs, interval=(mean - error, mean + error))


def sensitivity(setting: Setting) -> Result:
    """The grid of 84 settings: denser candidates raise Q*, and sometimes lower it."""
    names = BRACKETS[: setting.size(len(BRACKETS), 2)]
    rows, falls = [], 0
    for name in names:
        points = list(sensitivity_grid(*usual(name), seed=setting.seed))
        falls += sum(
            b.quality < a.quality
            for a, b in pairwise(points)
            if a.angles == b.angles and a.filter_distance == b.filter_distance
        )
        best = max(points, key=lambda p: p.quality)
        least = min(points, key=lambda p: p.quality)
        rows.append(Compared(f"stand-in {name}: largest Q* of 84 settings", 100 * best.quality,
                             unit="%"))  # fmt: skip
        rows.append(Compared(f"stand-in {name}: smallest Q* of 84 settings", 100 * least.quality,
                             unit="%"))  # fmt: skip
    rows.append(
        Compared(f"steps to a higher density that lower Q*, of {72 * len(names)}", float(falls))
    )
    return Result(
        tuple(rows),
        (
            STAND_INS,
            "the thesis says that a higher density sometimes lowers Q*, without a count",
            *setting.shrunk("outlines", len(BRACKETS), 2),
        ),
    )


def belief(setting: Setting) -> Result:
    """Tolerances chosen by what tightening them and failing cost (6.2, proposed there)."""
    part, test, _ = usual("A")
    grasps = sample_grasps(part)
    rows = []
    began = time.process_time()
    for failure_cost in (0.5, 20.0) if setting.fast else (0.5, 1.0, 5.0, 20.0):
        chosen = optimise_tolerance(
            part, grasps, test, failure_cost=failure_cost, weights=(0.005, 0.005, 0.0),
            com_std=0.084 * part.radius,
        )  # fmt: skip
        near = chosen.std[0] / part.radius
        what = f"stand-in A, failure costs {failure_cost:g}"
        rows.append(Compared(f"{what}: deviation of the near edge", near, unit="R"))
        rows.append(Compared(f"{what}: quality", chosen.quality, interval=(chosen.lower_95, 1.0)))
    return Result(
        tuple(rows), ("the thesis proposes it as future work and gives no figures",
                      f"{time.process_time() - began:.1f} s of processor time"),
    )  # fmt: skip
