"""Curves: what a grasp of one is worth does not depend on how finely it is drawn."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp.push import PushTest, Tolerance, analyse, as_part, make_grasps, sample_grasps
from grasp.push.curves import STEP_DEG, Curves, facets
from grasp.push.mechanics.quasistatic import NO_POINTS, simulate_on_points
from grasp.push.parts import BRACKETS, SHAPES, TOLERANCING, stand_in
from grasp.push.trials import Trials
from tests.grasp.push.outlines import Floats, ellipse, pebble, plate, stadium


@pytest.mark.parametrize(("outline", "count"), [(ellipse, 24), (stadium, 12), (plate, 5)])
def test_quality_does_not_depend_on_the_number_of_facets(
    outline: Callable[[int], Floats], count: int
) -> None:
    """The same grasps and the same warps of the plane, on outlines of 24 to 96 vertices."""
    base = as_part(outline(2 * count))
    grasps = sample_grasps(base, angles=5)
    test, radius = PushTest(0.25 * base.diameter), base.radius
    tolerance = Tolerance(0.03 * radius, 0.03 * radius, correlation=0.5 * radius)
    found = [
        analyse(as_part(outline(n)), grasps, test, tolerance, samples=400).quality
        for n in (count, 2 * count, 4 * count)
    ]
    best = [float(quality.max()) for quality in found]
    assert min(best) > 0.85
    assert np.ptp(best) < 0.05, best
    assert max(np.abs(a - b).mean() for a, b in itertools.pairwise(found)) < 0.02


def test_facets_taken_for_flat_sides_would_fall_with_their_number() -> None:
    """The reason for `PushTest.rolling`: drawn finely, flat facets allow no grasp of an ellipse."""
    base = as_part(ellipse(24))
    grasps = sample_grasps(base, angles=5)
    test, radius = PushTest(0.25 * base.diameter, rolling=False), base.radius
    tolerance = Tolerance(0.03 * radius, 0.03 * radius, correlation=0.5 * radius)
    few, many = (
        analyse(as_part(ellipse(n)), grasps, test, tolerance, samples=200).quality.max()
        for n in (24, 96)
    )
    assert few > 0.3 > 0.15 > many


def _push(part: Floats, x: float, y: float, normal: tuple[float, float]) -> int:
    """Return the code of one push along the normal at a point, the face to the right of it."""
    body = as_part(part)
    grasp = make_grasps([(x, y)], [normal], [0.1])
    test = PushTest(1.2)
    return int(Trials.of(body, grasp, test, Tolerance(0.0), 0)(0, 1)[0, 0])


def test_an_ellipse_rolls_to_rest_on_its_side_and_off_the_jaw_at_its_end() -> None:
    """A jaw is stable where the boundary is flatter than a circle about the centre of mass."""
    part = ellipse(48)
    assert _push(part, -0.1, -0.597, (0.0, 1.0)) > 0
    assert _push(part, 0.995, 0.06, (-1.0, 0.0)) < 0


def test_a_circle_is_drawn_as_a_circle() -> None:
    ring = ellipse(14, 1.0)
    drawn = Curves.of(ring)
    x, y = drawn.drawn(ring[None, :, 0], ring[None, :, 1])
    assert x.shape[1] >= 360 / STEP_DEG
    assert np.abs(np.hypot(x, y) - 1).max() < 5e-4
    assert drawn.drawn_vertices.all()
    assert drawn.drawn_facets.all()


def test_straight_sides_between_curves_stay_straight() -> None:
    ring = as_part(stadium(12)).vertices
    assert facets(ring).sum() == 22
    drawn = Curves.of(ring)
    x, y = drawn.drawn(ring[None, :, 0], ring[None, :, 1])
    assert np.abs(y).max() < 0.6 + 1e-4
    assert np.abs(np.hypot(np.maximum(np.abs(x) - 1, 0), y)).max() < 0.6 + 1e-4
    assert len(drawn.drawn_facets) - drawn.drawn_facets.sum() == 2


@pytest.mark.parametrize("name", [*BRACKETS, *SHAPES, *TOLERANCING])
def test_corners_are_no_curves(name: str) -> None:
    assert not facets(as_part(stand_in(name)).vertices).any()


def test_vertices_on_straight_sides_are_no_curves() -> None:
    corners = np.array([(0.0, 0.0), (2, 0), (2, 1), (0, 1)])
    t = np.linspace(0, 1, 10, endpoint=False)[:, None]
    ring = np.vstack(
        [a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    assert not facets(ring).any()


@pytest.mark.parametrize("outline", [ellipse, pebble])
def test_what_rolls_to_rest_closes_in_simulation(outline: Callable[[int], Floats]) -> None:
    """The bound stays a bound: the simulator meets the drawn outline, contact by contact."""
    part = as_part(outline(40))
    tolerance = Tolerance(0.03 * part.radius, 0.05 * part.radius, correlation=0.5 * part.radius)
    test = PushTest(0.25 * part.diameter)
    trials = Trials.of(part, sample_grasps(part), test, tolerance, seed=1)
    codes = trials(0, 30)
    vx, vy, mass, valid = trials.parts(0, 30)
    assert valid.all()
    g, k = np.nonzero(codes > 0)
    some = np.random.default_rng(0).permutation(len(g))[:150]
    g, k = g[some], k[some]
    assert len(g) > 50
    out = np.empty(len(g), np.int8)
    feet: NDArray[np.float64] = np.repeat(NO_POINTS[None], len(g), axis=0)
    simulate_on_points(
        vx[k], vy[k], mass[k], trials.rows[g], trials.width, test.friction, trials.diameter,
        0.002 * trials.diameter, feet, out,
    )  # fmt: skip
    assert (out > 0).all()
