"""Trials: one grasp on one perturbed part, many at a time, in any order."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray, IntArray
from grasp.push.candidates import Grasps
from grasp.push.curves import Curves
from grasp.push.mechanics.conditions import CODES, evaluate
from grasp.push.perturb import (
    Tolerance,
    normals,
    part_key,
    perturbed,
    sobol_normals,
    valid_outlines,
)
from grasp.push.polygon import Part

__all__ = ["ORDER", "CodeArray", "Counting", "PushTest", "Trials", "count_codes"]

CodeArray = NDArray[np.int8]

_CHUNK = 512

ORDER = np.array(sorted(CODES), np.int8)
"""Results in the order in which they are counted, (k,)."""

_PLACES = np.full(256, len(ORDER), np.int64)
"""Places in the order by a code taken as an unsigned byte; after the last one = no result."""
_PLACES[ORDER.view(np.uint8)] = np.arange(len(ORDER))


@dataclass(frozen=True)
class PushTest:
    """Parameters of the test of one grasp on one part.

    Parameters
    ----------
    jaw_width
        Of both jaws, in the part's unit.
    friction
        Coefficient between jaw and part, a conservative estimate.
    method
        ``bound``: the conservative conditions, right for every distribution of pressure under the
        part. ``simulation``: the quasi-static simulation with an ellipsoidal limit surface.
    closure
        ``strict``: a vertical line between the contacts; ``nguyen``: any line in both cones.
    vertex_pushes, slip_pushes
        Whether these kinds count.
    rolling
        Whether curves are smooth (`grasp.push.curves`) and roll on the jaw; else each of their
        facets is a flat side.
    step
        Of the simulation, in part diameters.
    moment_arm
        Of the support's friction in the simulation: largest moment over largest force, in part
        radii.
    sampling
        ``random``: independent perturbations. ``sobol``: those of a scrambled Sobol sequence, of
        which fewer give the same error; lower bounds, which count on independence, are cautious.
    """

    jaw_width: float
    friction: float = 0.7
    method: Literal["bound", "simulation"] = "bound"
    closure: Literal["strict", "nguyen"] = "strict"
    vertex_pushes: bool = True
    slip_pushes: bool = True
    rolling: bool = True
    step: float = 0.004
    moment_arm: float = 0.4
    sampling: Literal["random", "sobol"] = "random"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.jaw_width) and self.jaw_width > 0):
            raise ValueError(f"jaw_width must be positive, got {self.jaw_width}")
        if not (math.isfinite(self.friction) and self.friction >= 0):
            raise ValueError(f"friction must be at least 0, got {self.friction}")
        if self.method not in ("bound", "simulation"):
            raise ValueError(f"method is bound or simulation, got {self.method!r}")
        if self.closure not in ("strict", "nguyen"):
            raise ValueError(f"closure is strict or nguyen, got {self.closure!r}")
        if self.sampling not in ("random", "sobol"):
            raise ValueError(f"sampling is random or sobol, got {self.sampling!r}")
        if not 1e-4 <= self.step <= 0.05 or not self.moment_arm > 0:
            raise ValueError("step must lie in 0.0001..0.05 and moment_arm be positive")


@dataclass(frozen=True)
class Trials:
    """Task of a shard, called with a range of trial numbers.

    Parameters
    ----------
    ring : (n, 2), com : (2,), rows : (g, 5)
        Part and grasps with the centroid as origin and the radius as unit.
    width, diameter
        Of jaw and part in radii.
    tolerance
        In radii.
    """

    ring: FloatArray
    com: FloatArray
    rows: FloatArray
    width: float
    diameter: float
    tolerance: Tolerance
    test: PushTest
    key: int

    @classmethod
    def of(
        cls, part: Part, grasps: Grasps, test: PushTest, tolerance: Tolerance, seed: int
    ) -> Trials:
        """Scale everything to the part."""
        unit = part.radius
        lateral, turn = tolerance.pose_std
        scaled = Tolerance(
            np.asarray(tolerance.vertex_std, dtype=np.float64) / unit,
            tolerance.com_std / unit,
            (lateral / unit, turn),
            tolerance.com_follows,
            None if tolerance.correlation is None else tolerance.correlation / unit,
        )
        return cls(
            (part.vertices - part.centroid) / unit,
            (part.com - part.centroid) / unit,
            grasps.rows(part),
            test.jaw_width / unit,
            part.diameter / unit,
            scaled,
            test,
            part_key(part, seed),
        )

    def among(self, grasps: IntArray) -> Trials:
        """Return the trials of some of the grasps, by index."""
        some = replace(self, rows=self.rows[grasps])
        # The outline is the same: a race would find its curves again after every ten trials.
        some.__dict__["curves"] = self.curves
        return some

    @cached_property
    def curves(self) -> Curves:
        """Curves of the outline."""
        return Curves.of(self.ring) if self.test.rolling else Curves.none(len(self.ring))

    def draws(self, first: int, count: int) -> FloatArray:
        """Return the standard normals (count, n + 3, 2) of trials."""
        draw = sobol_normals if self.test.sampling == "sobol" else normals
        drawn: FloatArray = draw(self.key, first, count, len(self.ring) + 3)
        return drawn

    def parts(
        self, first: int, count: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return x and y (count, n), centres of mass (count, 2) and validity of trials.

        Curves have more vertices than in the ring.
        """
        draws = self.draws(first, count)
        vx, vy, mass = perturbed(self.ring, self.com, self.tolerance, draws)
        valid = valid_outlines(vx, vy)
        return *self.curves.drawn(vx, vy), mass, valid

    def __call__(self, first: int, count: int) -> CodeArray:
        """Return the codes (g, count) of trials."""
        out = np.empty((len(self.rows), count), np.int8)
        for at in range(0, count, _CHUNK):
            size = min(_CHUNK, count - at)
            out[:, at : at + size] = self._judge(*self.parts(first + at, size))
        return out

    def nominal(self) -> CodeArray:
        """Return the codes (g,) on the nominal part."""
        x, y = self.curves.drawn(self.ring[None, :, 0], self.ring[None, :, 1])
        return self._judge(x, y, self.com[None].copy(), np.ones(1, np.bool_))[:, 0]

    def _judge(
        self, vx: FloatArray, vy: FloatArray, mass: FloatArray, valid: NDArray[np.bool_]
    ) -> CodeArray:
        out = np.empty((len(self.rows), len(vx)), np.int8)
        test = self.test
        if test.method == "simulation":
            from grasp.push.mechanics.quasistatic import simulate

            simulate(
                vx, vy, mass, valid, self.rows, self.width, test.friction,
                test.moment_arm**2, self.diameter, test.step * self.diameter, out,
            )  # fmt: skip
        else:
            passes = 1 + 2 * test.vertex_pushes + 4 * test.slip_pushes
            nguyen = test.closure == "nguyen"
            evaluate(
                vx, vy, mass, valid, self.rows, self.width, test.friction, passes, nguyen,
                self.curves.drawn_vertices, self.curves.drawn_facets, out,
            )  # fmt: skip
        return out


@dataclass(frozen=True)
class Counting:
    """Task of a shard that returns how often each result came, not the results."""

    trials: Trials

    def __call__(self, first: int, count: int) -> IntArray:
        """Return the counts (g, k) of trials, in the order of `ORDER`."""
        total = np.zeros((len(self.trials.rows), len(ORDER)), np.int64)
        for at in range(0, count, _CHUNK):
            total += count_codes(self.trials(first + at, min(_CHUNK, count - at)))
        return total


def count_codes(codes: CodeArray) -> IntArray:
    """Return how often each result of codes (g, n) came, (g, k) in the order of `ORDER`."""
    width = len(ORDER) + 1
    cells = (
        _PLACES[np.ascontiguousarray(codes).view(np.uint8)] + width * np.arange(len(codes))[:, None]
    )
    counts = np.bincount(cells.ravel(), minlength=width * len(codes))
    return counts.reshape(len(codes), width)[:, :-1]
