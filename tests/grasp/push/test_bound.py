"""The bound is a bound: whatever the conservative test accepts, the simulator closes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp.push import PushTest, Tolerance, as_part, make_grasps, sample_grasps
from grasp.push.mechanics.quasistatic import NO_POINTS, simulate_on_points
from grasp.push.parts import stand_in
from grasp.push.trials import Trials
from tests.grasp.push.soft_contact import OUTLINES, compared, feet_of

Pairs = tuple[Trials, NDArray[np.int64], NDArray[np.int64], NDArray[np.int8]]


def _inside(x: NDArray[np.float64], y: NDArray[np.float64], p: NDArray[np.float64]) -> bool:
    a, b = np.roll(x, -1), np.roll(y, -1)
    crosses = (y > p[1]) != (b > p[1])
    at = x + (a - x) * (p[1] - y) / np.where(b == y, 1.0, b - y)
    return bool((crosses & (p[0] < at)).sum() % 2)


def _accepted(name: str, count: int, samples: int = 30) -> Pairs:
    """Return pairs (grasp, part) that the bound accepts, centre of mass inside the part."""
    part = as_part(stand_in(name))
    test = PushTest(0.25 * part.diameter)
    trials = Trials.of(part, sample_grasps(part), test, Tolerance.default(part), seed=1)
    codes = trials(0, samples)
    vx, vy, mass, valid = trials.parts(0, samples)
    fit = np.array([valid[k] and _inside(vx[k], vy[k], mass[k]) for k in range(samples)])
    g, k = np.nonzero((codes > 0) & fit)
    some = np.random.default_rng(0).permutation(len(g))[:count]
    return trials, g[some], k[some], codes[g[some], k[some]]


def _simulated(
    pairs: Pairs, step: float, points: NDArray[np.float64] | None = None
) -> NDArray[np.bool_]:
    trials, g, k, _ = pairs
    vx, vy, mass, _ = trials.parts(0, int(k.max()) + 1)
    out = np.empty(len(g), np.int8)
    feet = np.repeat(NO_POINTS[None], len(g), axis=0) if points is None else points
    simulate_on_points(
        vx[k], vy[k], mass[k], trials.rows[g], trials.width, trials.test.friction,
        trials.diameter, step * trials.diameter, feet, out,
    )  # fmt: skip
    return np.asarray(out > 0)


def _tripods(pairs: Pairs, seed: int) -> NDArray[np.float64]:
    """Return three feet for every pair that carry the weight of the part, (n, 3, 3)."""
    trials, _, k, _ = pairs
    vx, vy, _, _ = trials.parts(0, int(k.max()) + 1)
    rng = np.random.default_rng(seed)
    feet = np.empty((len(k), 3, 3))
    for i, part in enumerate(k):
        half = np.array([np.ptp(vx[part]), np.ptp(vy[part])]) / 2
        while True:
            triangle = rng.uniform(-1, 1, (3, 2)) * half
            system = np.vstack([triangle.T, np.ones(3)])
            if abs(np.linalg.det(system)) < 0.05:
                continue
            weights = np.linalg.solve(system, [0.0, 0.0, 1.0])
            if np.all(weights > 0.03):
                break
        feet[i, :, :2], feet[i, :, 2] = triangle, weights
    return feet


@pytest.mark.deep
@pytest.mark.parametrize("name", ["trapezium", "pentagon"])
def test_soft_contacts_close_on_what_the_bound_accepts(name: str) -> None:
    """Parts that creep round the jaws of simulators whose contacts slip a little in each step."""
    accepted, closed, _ = compared(OUTLINES[name], samples=12, most=40)
    assert accepted == closed == 40


def test_feet_carry_the_part_at_its_centre_of_mass() -> None:
    com = np.array([0.1, -0.05])
    feet = feet_of(OUTLINES["trapezium"], com, seed=3)
    assert feet[:, 2].sum() == pytest.approx(1.0)
    np.testing.assert_allclose(feet[:, 2] @ feet[:, :2], 0.0, atol=1e-9)
    assert (feet[:, 2] > 0).all()


NAMES = ("rectangle", "ell", "tee", "A", "B", "D", "J", "C")


@pytest.fixture(scope="module")
def accepted() -> dict[str, Pairs]:
    return {name: _accepted(name, 160) for name in NAMES}


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.004, 0.002])
def test_what_the_bound_accepts_closes_on_an_ellipsoidal_limit_surface(
    accepted: dict[str, Pairs], step: float
) -> None:
    """.1 % may differ: parts that hardly turn either way, which a finer step decides."""
    total, missed = 0, 0
    for pairs in accepted.values():
        closed = _simulated(pairs, step)
        total += len(closed)
        missed += int((~closed).sum())
        for i in np.flatnonzero(~closed):
            one = (pairs[0], pairs[1][i : i + 1], pairs[2][i : i + 1], pairs[3][i : i + 1])
            # A true counterexample would survive a finer simulation.
            assert _simulated(one, 0.00025)[0]
    assert total > 1000
    assert missed <= 0.001 * total


@pytest.mark.parametrize("seed", [0, 1])
def test_it_closes_on_every_support_of_three_points(accepted: dict[str, Pairs], seed: int) -> None:
    """The claim is for every distribution of pressure; three feet are its extreme points."""
    total, missed = 0, 0
    for name in NAMES:
        trials, g, k, codes = accepted[name]
        pairs = (trials, g[:60], k[:60], codes[:60])
        closed = _simulated(pairs, 0.002, _tripods(pairs, seed))
        total += len(closed)
        missed += int((~closed).sum())
    assert total > 400
    assert missed <= 0.003 * total


def test_the_simulator_closes_more_than_the_bound_accepts() -> None:
    part = as_part(stand_in("ell"))
    grasps, tolerance = sample_grasps(part), Tolerance.default(part)
    width = 0.25 * part.diameter
    bound = Trials.of(part, grasps, PushTest(width), tolerance, 3)(0, 40) > 0
    test = PushTest(width, method="simulation")
    simulated = Trials.of(part, grasps, test, tolerance, 3)(0, 40) > 0
    assert 0.5 <= bound.sum() / simulated.sum() <= 0.98


def test_a_wrong_bound_would_be_found_out(accepted: dict[str, Pairs]) -> None:
    """Trials that the bound refuses fail in the simulator far more often than .3 %."""
    trials, _, _, _ = accepted["A"]
    codes = trials(0, 10)
    g, k = np.nonzero(codes < 0)
    pairs = (trials, g[:300], k[:300], codes[g, k][:300])
    assert (~_simulated(pairs, 0.004)).mean() > 0.3


def test_a_flat_part_is_held_between_a_flush_jaw_and_its_tip() -> None:
    """No end of the flush contact lies within the tip's friction cone; what is between does."""
    part = as_part([(-3.0, 0.0), (3.0, 0.0), (0.1, 1.0)])
    grasp = make_grasps([(-2.0, 0.0)], [(0.0, 1.0)], [0.0])
    grasp = replace(grasp, left=np.array([True]))
    for method in ("bound", "simulation"):
        test = PushTest(4.0, method=method)  # type: ignore[arg-type]
        assert Trials.of(part, grasp, test, Tolerance(0.0), 0)(0, 1)[0, 0] > 0
