"""The conservative test of one grasp: closed forms, Mason's rule, invariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp.push import PushTest, Tolerance, as_part, make_grasps, plan_push_grasps, sample_grasps
from grasp.push.mechanics.closure import closes
from grasp.push.mechanics.conditions import evaluate
from grasp.push.parts import BRACKETS, SHAPES, stand_in
from grasp.push.perturb import normals, valid_outlines
from grasp.push.trials import Trials

Floats = NDArray[np.float64]


def _codes(ring: Floats, com: Floats, rows: Floats, width: float, mu: float = 0.7) -> list[int]:
    out = np.empty((len(rows), 1), np.int8)
    x, y = ring[None, :, 0].copy(), ring[None, :, 1].copy()
    flat = np.zeros(len(ring), bool)
    evaluate(x, y, com[None].copy(), np.ones(1, bool), rows, width, mu, 7, False, flat, flat, out)
    return [int(c) for c in out[:, 0]]


@pytest.mark.parametrize("mu", [0.3, 0.7])
def test_a_rectangle_succeeds_exactly_in_the_region_of_figure_3_5(mu: float) -> None:
    """tan|phi| <= mu, r tan|phi| <= |d| <= w, on the side to which the part turns, on the edge."""
    ring = np.array([(-2.0, -0.5), (2, -0.5), (2, 0.5), (-2, 0.5)])
    r, w = 0.5, 1.1
    rng = np.random.default_rng(0)
    for _ in range(2000):
        x, phi = rng.uniform(-1.9, 1.9), rng.uniform(-0.9, 0.9)
        v = np.array([math.sin(phi), math.cos(phi)])
        row = np.array([[x, -0.5, *v, 1.0 if phi > 0 else -1.0]])
        foot = -x if phi > 0 else x  # ahead of the corner, along the jaw
        inside = math.tan(abs(phi)) <= mu and r * math.tan(abs(phi)) <= foot <= w
        # The far jaw must find the part above the contact for every place after slipping.
        assert (_codes(ring, np.zeros(2), row, w, mu)[0] > 0) == inside, (x, phi)


def test_single_contacts_follow_mason() -> None:
    ring = np.array([(-2.0, -1), (2, -1), (2, 1), (-2, 1)])
    com = np.zeros(2)

    def push(x: float, deg: float) -> int:
        phi = math.radians(deg)
        row = np.array([[x, -1, math.sin(phi), math.cos(phi), 1.0 if phi > 0 else -1.0]])
        return _codes(ring, com, row, 1.5)[0]

    assert push(-0.5, 10) == 1  # sticks, turns to the jaw
    assert push(-1.2, 10) == 11  # slips towards the foot
    assert push(0.5, 10) == -4  # turns away
    assert push(-0.1, 10) == -4  # push ray passes on the wrong side
    assert push(-0.9, 40) == -3  # outside the friction cone
    assert push(-1.9, 10) == -5  # centre of mass beyond the jaw


@pytest.mark.slow
def test_closure_modes_are_told_apart() -> None:
    flat = np.array([(0.0, 0), (2, 0), (2, 1), (0, 1.2)])
    roof = np.array([(0.0, 0), (2, 0), (2, 1), (1, 1.8), (0, 1)])
    steep = np.array([(0.0, 0), (2, 0), (2, 0.2), (0, 3)])
    notch = np.array([(0.0, 0), (3, 0), (3, 0.9), (1, 1.0), (0.5, 3), (0, 3)])

    def mode(ring: Floats, s: float, w: float) -> int:
        x, y = ring[:, 0].copy(), ring[:, 1].copy()
        return int(closes(x, y, len(ring), s, w, 0.0, float(ring[1, 0]), 0.7, False))

    assert mode(flat, 0.5, 1.0) == 1
    assert mode(roof, 0.5, 1.0) == 2
    assert mode(steep, 0.5, 1.0) == 0
    assert mode(notch, 0.8, 1.0) == 3


def _case(seed: int, name: str) -> tuple[Floats, Floats, Floats, float]:
    """Return a perturbed part, its centre of mass, grasps and the jaw's width."""
    part = as_part(stand_in(name))
    grasps = sample_grasps(part, density=1.0)
    trials = Trials.of(part, grasps, PushTest(0.25 * part.diameter), Tolerance.default(part), seed)
    vx, vy, mass, valid = trials.parts(0, 1)
    assume(bool(valid[0]))
    return np.column_stack([vx[0], vy[0]]), mass[0], trials.rows, trials.width


CASES = {"seed": st.integers(0, 10**6), "name": st.sampled_from(BRACKETS + SHAPES)}
_MANY = settings(max_examples=150, deadline=None, derandomize=True)


def _close_to(a: list[int], b: list[int], seed: int) -> None:
    different = sum((p > 0) != (q > 0) for p, q in zip(a, b, strict=True))
    assert different == 0, (seed, a, b)


@_MANY
@given(angle=st.floats(-3.1, 3.1), x=st.floats(-9, 9), y=st.floats(-9, 9), **CASES)
def test_rotation_and_translation_change_nothing(
    seed: int, name: str, angle: float, x: float, y: float
) -> None:
    ring, com, rows, width = _case(seed, name)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    moved = rows.copy()
    moved[:, :2] = rows[:, :2] @ turn + (x, y)
    moved[:, 2:4] = rows[:, 2:4] @ turn
    there = _codes(ring @ turn + (x, y), com @ turn + (x, y), moved, width)
    _close_to(_codes(ring, com, rows, width), there, seed)


@_MANY
@given(**CASES)
def test_a_mirrored_part_with_mirrored_grasps_does_the_same(seed: int, name: str) -> None:
    ring, com, rows, width = _case(seed, name)
    flip = np.array([-1.0, 1.0])
    mirrored = rows.copy()
    mirrored[:, :2] *= flip
    mirrored[:, 2:4] *= flip
    mirrored[:, 4] *= -1
    _close_to(
        _codes(ring, com, rows, width), _codes((ring * flip)[::-1], com * flip, mirrored, width),
        seed,
    )  # fmt: skip


@_MANY
@given(shift=st.integers(1, 20), **CASES)
def test_renumbering_the_vertices_changes_nothing(seed: int, name: str, shift: int) -> None:
    ring, com, rows, width = _case(seed, name)
    renumbered = np.roll(ring, shift, axis=0)
    assert _codes(ring, com, rows, width) == _codes(renumbered, com, rows, width)


@_MANY
@given(at=st.floats(0.1, 0.9), edge=st.integers(0, 20), **CASES)
def test_a_collinear_vertex_more_changes_nothing(
    seed: int, name: str, at: float, edge: int
) -> None:
    ring, com, rows, width = _case(seed, name)
    k = edge % len(ring)
    extra = ring[k] + at * (ring[(k + 1) % len(ring)] - ring[k])
    split = np.insert(ring, k + 1, extra, axis=0)
    _close_to(_codes(ring, com, rows, width), _codes(split, com, rows, width), seed)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(power=st.integers(-6, 6), name=st.sampled_from(BRACKETS))
def test_a_plan_does_not_depend_on_the_unit_of_length(power: int, name: str) -> None:
    ring, unit = stand_in(name), 10.0**power
    width = 0.25 * as_part(ring).diameter
    one = plan_push_grasps(ring, jaw_width=width, samples=10)
    other = plan_push_grasps(ring * unit + 3 * unit, jaw_width=width * unit, samples=10)
    assert (one.analysis.successes == other.analysis.successes).mean() > 0.98


def test_perturbations_are_standard_normal_and_reproducible_by_number() -> None:
    drawn = normals(7, 0, 4000, 5)
    assert np.array_equal(drawn[1234], normals(7, 1234, 1, 5)[0])
    assert abs(drawn.mean()) < 0.02  # 40,000 draws: standard error .005
    assert abs(drawn.std() - 1) < 0.02
    flat = drawn.reshape(4000, -1)
    assert np.abs(np.corrcoef(flat.T) - np.eye(10)).max() < 0.08


def test_a_perturbed_outline_that_crosses_itself_counts_as_failure() -> None:
    bow = np.array([(0.0, 0), (1, 1), (1, 0), (0, 1)])
    square = np.array([(0.0, 0), (1, 0), (1, 1), (0, 1)])
    x, y = np.array([bow[:, 0], square[:, 0]]), np.array([bow[:, 1], square[:, 1]])
    assert valid_outlines(x, y).tolist() == [False, True]
    part = as_part(stand_in("G"))
    plan = plan_push_grasps(part.vertices, jaw_width=0.25 * part.diameter, samples=200)
    assert 0.2 < plan.analysis.crossed < 0.5
    assert plan.analysis.reasons(0)["perturbed outline crosses itself"] == round(
        plan.analysis.crossed * 200
    )


def test_the_contact_angle_turns_clockwise_from_the_inward_normal() -> None:
    grasps = make_grasps([(0.0, 0.0)], [(0.0, 1.0)], [0.3, -0.3])
    assert grasps.approaches[0][0] > 0 > grasps.approaches[1][0]
    assert grasps.left.tolist() == [True, False]
    assert grasps.jaw(0, 2.0)[1][0] > 0 > grasps.jaw(1, 2.0)[1][0]
