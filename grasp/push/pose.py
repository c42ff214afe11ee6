"""Quality of one grasp under uncertain pose, by simulation (Kehoe 2014, 3.8)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from grasp.arrays import FloatArray
from grasp.push.candidates import Grasps
from grasp.push.mechanics.quasistatic import simulate
from grasp.push.perturb import Tolerance
from grasp.push.polygon import Part
from grasp.push.quality import density_weights
from grasp.push.shards import Executor, Progress, Watch
from grasp.push.trials import CodeArray, PushTest, Trials

__all__ = ["PoseMap", "PoseTrials", "centred_grasp", "pose_map"]


@dataclass(frozen=True)
class PoseMap:
    """Qualities over a grid of uncertainties.

    Parameters
    ----------
    position_std : (p,)
        Lateral, in the part's unit.
    rotation_std : (r,), rad
    quality : (p, r)
    simulations, seconds
        Spent.
    """

    position_std: FloatArray
    rotation_std: FloatArray
    quality: FloatArray
    simulations: int
    seconds: float = field(compare=False)


@dataclass(frozen=True)
class PoseTrials:
    """Trials of one grasp over a grid of uncertainties, numbered grid point by grid point."""

    trials: Trials
    position_std: FloatArray
    rotation_std: FloatArray
    samples: int

    def poses(self, first: int, count: int) -> tuple[FloatArray, FloatArray]:
        """Return the draws (count, 2) and the lateral offsets and rotations (count, 2)."""
        draws = self.trials.draws(first, count)
        n = len(self.trials.ring)
        unit = np.column_stack([draws[:, n + 1, 0], draws[:, n + 2, 0]])
        point = np.arange(first, first + count) // self.samples
        columns = len(self.rotation_std)
        spread = np.column_stack(
            [self.position_std[point // columns], self.rotation_std[point % columns]]
        )
        return unit, unit * spread

    def moved(self, poses: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x and y (count, n) and centres of mass (count, 2) of the part in these poses."""
        trials = self.trials
        dx, dy = trials.rows[0, 2], trials.rows[0, 3]
        mass = trials.com + poses[:, :1] * np.array([dy, -dx])
        c, s = np.cos(poses[:, 1:]), np.sin(poses[:, 1:])
        ax, ay = (trials.ring - trials.com).T
        vx = c * ax - s * ay + mass[:, :1]
        vy = s * ax + c * ay + mass[:, 1:]
        return np.ascontiguousarray(vx), np.ascontiguousarray(vy), np.ascontiguousarray(mass)

    def __call__(self, first: int, count: int) -> CodeArray:
        """Return the codes (1, count) of trials."""
        trials, test = self.trials, self.trials.test
        out = np.empty((1, count), np.int8)
        vx, vy, mass = self.moved(self.poses(first, count)[1])
        simulate(
            vx, vy, mass, np.ones(count, np.bool_), trials.rows[:1], trials.width,
            test.friction, test.moment_arm**2, trials.diameter, test.step * trials.diameter, out,
        )  # fmt: skip
        return out


def pose_map(
    part: Part,
    grasp: Grasps,
    test: PushTest,
    position_std: ArrayLike,
    rotation_std: ArrayLike,
    *,
    samples: int = 100,
    weighting: Literal["mean", "density"] = "mean",
    seed: int = 0,
    executor: Executor | None = None,
    progress: Progress | None = None,
    deadline_s: float | None = None,
) -> PoseMap:
    """Simulate one grasp under every pair of uncertainties.

    Parameters
    ----------
    position_std : (p,)
        Of the lateral position; the position along the approach does not matter.
    rotation_std : (r,), rad
        About the centre of mass.
    weighting
        ``density`` weights every sample by the density of its pose, as the thesis does; as samples
        follow that density already, this acts as an uncertainty smaller by sqrt 2.
    progress
        Is told how many simulations have ended, and how many there are.
    deadline_s
        Time for all of them.

    Raises
    ------
    ValueError
        For numbers that make no sense.
    TimeoutError
        The time was up before the map was complete.
    """
    if len(grasp) != 1:
        raise ValueError(f"expected one grasp, got {len(grasp)}")
    if samples < 1:
        raise ValueError(f"samples must be at least 1, got {samples}")
    spans = [np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in (position_std, rotation_std)]
    if any(not np.all(np.isfinite(v)) or np.any(v < 0) for v in spans):
        raise ValueError("standard deviations must be finite and at least 0")
    began = time.perf_counter()
    simulated = replace(test, method="simulation")
    trials = Trials.of(part, grasp, simulated, Tolerance(0.0), seed)
    task = PoseTrials(trials, spans[0] / part.radius, spans[1], samples)
    count = len(spans[0]) * len(spans[1]) * samples
    ranges = Watch(executor, count, progress, deadline_s).run(task, 0, count)
    codes = np.concatenate([part_codes for _, part_codes in ranges], axis=1)[0]
    if len(codes) < count:
        raise TimeoutError(f"{len(codes)} of {count} simulations ended within {deadline_s:g} s")
    success = (codes > 0).reshape(-1, samples)
    if weighting == "density":
        unit = task.poses(0, count)[0].reshape(-1, samples, 2)
        weights = np.array([density_weights(u) for u in unit])
        quality = (success * weights).sum(axis=1) / weights.sum(axis=1)
    else:
        quality = success.mean(axis=1)
    table = quality.reshape(len(spans[0]), len(spans[1]))
    return PoseMap(spans[0], spans[1], table, count, time.perf_counter() - began)


def centred_grasp(part: Part, direction: ArrayLike, jaw_width: float) -> Grasps:
    """Return the grasp that comes along a direction with its jaw centred on the centre of mass.

    Notes
    -----
    It is fixed by window and direction alone, so its contact need not lie on the boundary.
    """
    v = np.asarray(direction, dtype=np.float64)
    v = v / np.hypot(*v)
    right = np.array([v[1], -v[0]])
    start = part.com + right * jaw_width / 2 - v * part.diameter
    zero = np.zeros(1)
    index = np.zeros(1, np.int64)
    return Grasps(start[None], zero, v[None], np.zeros(1, np.bool_), index, index)
