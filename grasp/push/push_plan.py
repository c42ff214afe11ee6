"""Planning of push grasps: candidates, perturbations, ranking (Kehoe 2014, 3.4, Algorithm 2)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp.arrays import FloatArray
from grasp.push.analysis import Analysis, Elimination, Racing, analyse
from grasp.push.candidates import Grasps, needed_openings, sample_grasps
from grasp.push.perturb import Tolerance
from grasp.push.polygon import MAX_VERTICES, Part, as_part
from grasp.push.shards import Executor, Progress
from grasp.push.trials import CodeArray, PushTest, Trials

__all__ = ["PushPlan", "analyse_push_grasps", "plan_push_grasps", "tolerance_of"]


@dataclass(frozen=True)
class PushPlan:
    """A part and its ranked push grasps.

    Parameters
    ----------
    nominal : (g,) int8
        Result codes on the nominal part.
    openings : (g,)
        How far apart the jaws must be.
    """

    part: Part
    test: PushTest
    tolerance: Tolerance
    analysis: Analysis
    nominal: CodeArray
    openings: FloatArray
    seconds: float = field(compare=False)

    @property
    def grasps(self) -> Grasps:
        """The candidates."""
        return self.analysis.grasps

    @property
    def best(self) -> int:
        """Index of the best grasp."""
        return self.analysis.best

    @property
    def quality(self) -> float:
        """Quality of the best grasp (Q* of equation 3.4)."""
        return float(self.analysis.quality[self.best])


def tolerance_of(
    part: Part,
    vertex_std: float | ArrayLike | None,
    com_std: float | None,
    pose_std: tuple[float, float] | None = None,
    correlation: float | None = None,
) -> Tolerance:
    """Return a tolerance whose missing numbers are the thesis's for a part of this size."""
    usual = Tolerance.default(part)
    spread = usual.vertex_std if vertex_std is None else np.asarray(vertex_std, dtype=np.float64)
    if np.ndim(spread) and np.shape(spread) != (len(part.vertices),):
        raise ValueError(
            f"vertex_std is one number or one for each of the {len(part.vertices)} vertices"
        )
    return Tolerance(
        spread if np.ndim(spread) else float(spread),
        usual.com_std if com_std is None else com_std,
        pose_std or (0.0, 0.0),
        correlation=correlation,
    )


def plan_push_grasps(
    polygon: ArrayLike,
    com: ArrayLike | None = None,
    *,
    jaw_width: float,
    friction: float = 0.7,
    vertex_std: float | ArrayLike | None = None,
    com_std: float | None = None,
    pose_std: tuple[float, float] | None = None,
    correlation: float | None = None,
    filter_distance: float = 0.0,
    density: float = 1.5,
    angles: int = 5,
    max_angle_deg: float = 15.0,
    samples: int = 100,
    elimination: Elimination | Racing | None = None,
    stop: bool = False,
    method: Literal["bound", "simulation"] = "bound",
    closure: Literal["strict", "nguyen"] = "strict",
    weighting: Literal["mean", "density"] = "mean",
    sampling: Literal["random", "sobol"] = "random",
    max_opening: float | None = None,
    seed: int = 0,
    executor: Executor | None = None,
    keep_codes: bool = False,
    progress: Progress | None = None,
    deadline_s: float | None = None,
) -> PushPlan:
    """Plan push grasps of a polygonal part under uncertainty.

    Parameters
    ----------
    polygon : (n, 2)
        Outline; any unit of length, which then is that of every other length.
    com : (2,)
        Centre of mass; the centroid unless given.
    jaw_width
        Of both jaws.
    vertex_std, com_std
        Standard deviations; default .045 and .084 part radii (`Tolerance`).
    pose_std
        Of the part's lateral position (a length) and rotation (rad).
    correlation
        Length over which the deviations of vertices resemble each other (`Tolerance`); None =
        independent. Not with ``weighting="density"``, which weighs independent draws.
    filter_distance, density, angles, max_angle_deg
        Of the candidates (`sample_grasps`).
    samples, elimination, stop, weighting, executor, keep_codes, progress, deadline_s
        Of the analysis (`analyse`).
    method, closure, friction, sampling
        Of the test of one grasp on one part (`PushTest`).
    max_opening
        Stroke of the gripper: candidates that need more are left out.

    Raises
    ------
    ValueError
        For a polygon, tolerance or number that makes no sense, and when the part is bigger than the
        stroke everywhere.

    Examples
    --------
    >>> plan = plan_push_grasps([(0, 0), (2, 0), (2, 1), (0, 1)], jaw_width=0.5)
    >>> len(plan.grasps), plan.quality > 0.5
    (30, True)
    """
    began = time.perf_counter()
    part = as_part(polygon, com)
    if len(part.vertices) > MAX_VERTICES:
        raise ValueError(
            f"the part has {len(part.vertices)} vertices, planning takes {MAX_VERTICES}; "
            "simplify it first (grasp.push.simplify)"
        )
    test = PushTest(jaw_width, friction, method, closure, sampling=sampling)
    tolerance = tolerance_of(part, vertex_std, com_std, pose_std, correlation)
    if correlation is not None and weighting == "density":
        raise ValueError("correlated deviations are averaged plainly: weighting must be mean")
    grasps = sample_grasps(
        part, filter_distance=filter_distance, density=density, angles=angles,
        max_angle_deg=max_angle_deg,
    )  # fmt: skip
    openings = needed_openings(part, grasps, jaw_width)
    if max_opening is not None:
        fits = _within_stroke(openings, max_opening)
        grasps, openings = grasps.take(np.flatnonzero(fits)), openings[fits]
    analysis = analyse(
        part, grasps, test, tolerance, samples=samples, elimination=elimination, stop=stop,
        weighting=weighting, seed=seed, executor=executor, keep_codes=keep_codes,
        progress=progress, deadline_s=deadline_s,
    )  # fmt: skip
    nominal = Trials.of(part, grasps, test, tolerance, seed).nominal()
    spent = time.perf_counter() - began
    return PushPlan(part, test, tolerance, analysis, nominal, openings, spent)


def analyse_push_grasps(
    grasps: Grasps,
    polygon: ArrayLike,
    com: ArrayLike | None = None,
    *,
    jaw_width: float,
    friction: float = 0.7,
    vertex_std: float | ArrayLike | None = None,
    com_std: float | None = None,
    pose_std: tuple[float, float] | None = None,
    samples: int = 100,
    method: Literal["bound", "simulation"] = "bound",
    closure: Literal["strict", "nguyen"] = "strict",
    seed: int = 0,
    executor: Executor | None = None,
) -> Analysis:
    """Judge given grasps of a part; parameters as for `plan_push_grasps`."""
    part = as_part(polygon, com)
    tolerance = tolerance_of(part, vertex_std, com_std, pose_std)
    test = PushTest(jaw_width, friction, method, closure)
    return analyse(part, grasps, test, tolerance, samples=samples, seed=seed, executor=executor)


def _within_stroke(openings: FloatArray, max_opening: float) -> NDArray[np.bool_]:
    if not (np.isfinite(max_opening) and max_opening > 0):
        raise ValueError(f"max_opening must be positive, got {max_opening}")
    fits: NDArray[np.bool_] = openings <= max_opening
    if not fits.any():
        raise ValueError(
            f"the part is bigger than the gripper's stroke: at least {openings.min():.4g} between "
            f"the jaws are needed, {max_opening:g} is the most"
        )
    return fits
