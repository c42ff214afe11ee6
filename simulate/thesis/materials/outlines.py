"""Stand-ins for the outlines of Kehoe 2014, chapter 3, and plans on them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from scipy import stats

from grasp.push import Part, PushPlan, PushTest, Tolerance, as_part, plan_push_grasps, sample_grasps
from grasp.push.parts import stand_in
from grasp.push.trials import Trials

__all__ = ["CONFIGURATIONS", "STAND_INS", "plan", "timed", "trials_of", "usual"]

T = TypeVar("T")

CONFIGURATIONS = ((0.0, 1.5, 5), (0.03, 7.5, 9), (0.09, 20.0, 15))
"""Filter distance, density and angles of the three settings of Table 3.2."""

STAND_INS = "the thesis's outlines are not published: ours are stand-ins of the same kinds"


def usual(name: str) -> tuple[Part, PushTest, Tolerance]:
    """Return a stand-in, the usual test and the usual tolerance."""
    part = as_part(stand_in(name))
    return part, PushTest(0.25 * part.diameter), Tolerance.default(part)


_TIMES = 5


def timed(work: Callable[[], T]) -> tuple[T, float, tuple[float, float]]:
    """Return a result, the mean of five processor times and its 95 % interval (Student), s."""
    spans = []
    for _ in range(_TIMES):
        began = time.process_time()
        result = work()
        spans.append(time.process_time() - began)
    mean, error = float(np.mean(spans)), float(stats.sem(spans))
    half = error * float(stats.t.ppf(0.975, _TIMES - 1))
    return result, mean, (max(mean - half, 0.0), mean + half)


def plan(name: str, setting: tuple[float, float, int], **more: Any) -> PushPlan:
    """Return the plan of a stand-in at a setting."""
    part, test, _ = usual(name)
    distance, density, angles = setting
    return plan_push_grasps(
        part.vertices, jaw_width=test.jaw_width, filter_distance=distance, density=density,
        angles=angles, **more,
    )  # fmt: skip


def trials_of(name: str, setting: tuple[float, float, int], seed: int) -> Trials:
    """Return the trials of a stand-in at a setting of Table 3.2."""
    part, test, tolerance = usual(name)
    distance, density, angles = setting
    grasps = sample_grasps(part, filter_distance=distance, density=density, angles=angles)
    return Trials.of(part, grasps, test, tolerance, seed)
