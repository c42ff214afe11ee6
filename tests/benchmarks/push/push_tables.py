"""Tables of Kehoe 2014, chapter 3, and the settings behind them."""

from __future__ import annotations

import os
import time
from itertools import pairwise

import numpy as np

from grasp.push import analyse, open_executor, sample_grasps
from grasp.push.early import analyse_early, finish_times
from grasp.push.parts import BRACKETS
from grasp.push.studies import nominal_only, sensitivity_grid
from grasp.push.trials import Trials
from tests.benchmarks.push.push_nodes import shard_times, trials_of
from tests.benchmarks.push.push_settings import CONFIGURATIONS, plan, timed, usual

# Table 3.1: part, Q* in per cent, MATLAB seconds on four cores, d_C, rho, |Phi|.
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

# Table 3.2: nodes, then PiCloud and MATLAB seconds of configurations 1, 2, 3 as printed.
TABLE_3_2 = {
    10: (139.4, 72.6, 1022.2, 944.2, 1109.1, 1023.9),
    25: (98.1, 29.5, 496.3, 407.8, 197.7, 140.1),
    50: (74.8, 14.2, 291.5, 208.9, 289.3, 218.3),
    100: (71.3, 8.0, 195.2, 107.2, 182.3, 106.2),
    250: (62.8, 4.1, 135.3, 44.1, 118.2, 42.8),
    500: (60.3, 2.6, 105.7, 20.0, 90.9, 18.8),
}


def speed() -> None:
    """Evaluations per second and core."""
    for setting in CONFIGURATIONS:
        part, test, tolerance = usual("A")
        grasps = sample_grasps(
            part, filter_distance=setting[0], density=setting[1], angles=setting[2]
        )
        trials = Trials.of(part, grasps, test, tolerance, 0)
        _, spent = timed(lambda t=trials: t(0, 400))  # type: ignore[misc]
        rate = len(grasps) * 400 / spent
        print(f"{setting}: {len(grasps)} grasps, {rate / 1e6:.2f} M evaluations/s/core (target 1)")


def table_3_1() -> None:
    """Q* and run time of 100 perturbations, part by part."""
    plan("A", CONFIGURATIONS[0])
    print("part  d_C   rho  |Phi|  thesis Q*  stand-in Q*  thesis s  ours s (CPU)   ratio")
    ratios = []
    for line in TABLE_3_1.strip().replace("\n", ";").split(";"):
        name, quality, seconds, d, rho, phi = line.split()
        setting = (float(d), float(rho), int(phi))
        found, spent = timed(lambda n=name, s=setting: plan(n, s))  # type: ignore[misc]
        ratios.append(float(seconds) / spent)
        print(
            f"{name:4s}  {float(d):.2f} {float(rho):4.1f}  {phi:>4s}  {float(quality):9.1f}  "
            f"{100 * found.quality:11.1f}  {float(seconds):8.1f}  {spent:12.5f}  {ratios[-1]:7.0f}"  # type: ignore[attr-defined]
        )
    print(f"ratio of times: least {min(ratios):.0f}, median {np.median(ratios):.0f}")


def table_3_2() -> None:
    """Shards over nodes, each timed in a worker process; start-up drawn, both ways to end."""
    workers = len(os.sched_getaffinity(0))
    print(f"{workers} worker processes at a time; five runs; ms of a shard, mean and deviation")
    print("conf  nodes  thesis PiCloud/MATLAB s      our shard ms  sync s  async s  gain")
    gains = []
    with open_executor("processes", workers) as executor:
        for c, setting in enumerate(CONFIGURATIONS):
            trials = trials_of("A", setting)
            list(executor.finished(trials, [(0, 2)] * workers))
            for nodes, published in TABLE_3_2.items():
                runs = [shard_times(executor, trials, nodes) for _ in range(5)]
                spans = np.concatenate(runs)
                last, fifth = finish_times(runs[0].tolist(), (41.6, 133.0), 0.2, seed=nodes)
                gains.append(last / fifth)
                print(
                    f"{c + 1:4d}  {nodes:5d}  {published[2 * c]:9.1f} / "
                    f"{published[2 * c + 1]:7.1f}  {1e3 * spans.mean():9.2f} +- "
                    f"{1e3 * spans.std():5.2f}  {last:6.1f}  {fifth:7.1f}  {last / fifth:.2f}"
                )
    print(f"asynchronous gain {min(gains):.2f} to {max(gains):.2f}, mean {np.mean(gains):.2f}")
    print("thesis 3.6: 1.04 to 2.00, mean 1.43; start-up here drawn evenly from 41.6 to 133 s")
    part, test, tolerance = usual("A")
    grasps = sample_grasps(part, density=7.5, angles=9)
    analyse(part, grasps, test, tolerance, samples=4)
    serial = analyse(part, grasps, test, tolerance, samples=500)
    for kind in ("threads", "processes"):
        with open_executor(kind, 2) as executor:
            analyse(part, grasps, test, tolerance, samples=4, executor=executor)
            began = time.perf_counter()
            found = analyse(part, grasps, test, tolerance, samples=500, executor=executor)
            spent = time.perf_counter() - began
            early = analyse_early(
                part, grasps, test, tolerance, samples=100, check=True, executor=executor
            )
        assert early.bias is not None
        print(f"{kind}: {spent:.3f} s against {serial.seconds:.3f} s serial (wall), equal: "
              f"{np.array_equal(found.counts, serial.counts)}; early shards: largest z "
              f"{early.bias.largest_z:.1f} over {len(grasps)} grasps, {early.early_seconds:.3f} "
              f"of {early.all_seconds:.3f} s")  # fmt: skip


def nominal() -> None:
    """Planning without uncertainty (3.5)."""
    shares, ratios = [], []
    for name in BRACKETS:
        found = nominal_only(plan(name, CONFIGURATIONS[1]))
        shares.append(found.best_share)
        ratios.append(found.mean_ratio)
        print(f"{name}: {found.closing:4d} close on the nominal part, {found.best_share:5.1%} of "
              f"them are best, mean quality {found.mean_ratio:.0%} of Q*")  # fmt: skip
    print(f"mean {np.mean(shares):.1%} and {np.mean(ratios):.0%} (thesis 4 % and 58 %, 84 tests)")


def grid(names: tuple[str, ...] = BRACKETS) -> None:
    """The 84 settings of the sensitivity analysis (3.5)."""
    print("part  worst Q*  best Q*  at (d_C, rho, |Phi|)  cheapest within .01  density lowers Q*")
    for name in names:
        points = list(sensitivity_grid(*usual(name)))
        best = max(points, key=lambda p: p.quality)
        cheap = min((p for p in points if p.quality >= best.quality - 0.01),
                    key=lambda p: p.candidates)  # fmt: skip
        falls = sum(
            b.quality < a.quality
            for a, b in pairwise(points)
            if a.angles == b.angles and a.filter_distance == b.filter_distance
        )
        print(f"{name:4s}  {min(p.quality for p in points):8.3f}  {best.quality:7.3f}  "
              f"({best.filter_distance}, {best.density}, {best.angles})  "
              f"({cheap.filter_distance}, {cheap.density}, {cheap.angles}), "
              f"{cheap.candidates} candidates  {falls} of 72 steps")  # fmt: skip
