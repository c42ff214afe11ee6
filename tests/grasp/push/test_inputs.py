"""Every bad polygon, number and setting: refused with words, never a wrong answer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from grasp.push import (
    Elimination,
    PushTest,
    Tolerance,
    as_part,
    as_polygon,
    open_executor,
    plan_push_grasps,
    sample_grasps,
    simplify,
)
from grasp.push.polygon import MAX_VERTICES, _reduced

SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]


def _area(ring: object) -> float:
    return as_part(ring).area  # type: ignore[arg-type]


# Polygons


def test_clockwise_outlines_are_turned_round() -> None:
    assert _area(SQUARE[::-1]) == 2.0


def test_repeated_vertices_are_one_vertex() -> None:
    doubled = [p for p in SQUARE for _ in range(3)] + SQUARE[:1]
    assert as_polygon(doubled).tolist() == as_polygon(SQUARE).tolist()


@pytest.mark.parametrize(
    ("ring", "words"),
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], r"crosses itself: edge 0 \(0-1\) and edge 2 \(2-3\)"),
        ([(0, 0), (2, 0), (1, 0), (1, 1)], "touches or crosses itself"),
        ([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)], "touches or crosses itself"),
        ([(0, 0), (1, 1), (2, 2), (3, 3)], "collinear"),
        ([(0, 0), (1, 0)], "three different vertices, got 2"),
        ([(0, 0), (0, 0), (0, 0)], "three different vertices, got 1"),
        ([(0, 0), (1, 0), (math.nan, 1)], "vertex 2 of the polygon is not finite"),
        ([(0, 0), (math.inf, 0), (0, 1)], "not finite"),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], r"shape \(n, 2\)"),
        ([(0, 0), (1e200, 0), (0, 1e200)], "out of range"),
        ("part", "array"),
        ([(0, 0), (10**400, 0), (0, 1)], "array"),
        ([], "shape"),
    ],
)
def test_outlines_that_are_no_polygon_are_refused(ring: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        as_polygon(ring)  # type: ignore[arg-type]


def test_a_part_far_from_the_origin_has_its_diameter() -> None:
    far = np.array([(0, 0), (2, 0), (2, 1), (0, 1)]) + 1e15  # in steps of an eighth there
    assert as_part(far).diameter == pytest.approx(math.sqrt(5))


def test_a_part_of_ten_thousand_vertices_is_simplified_or_refused() -> None:
    angle = np.linspace(0, 2 * np.pi, 10_000, endpoint=False)
    radius = 1 + 0.3 * np.cos(5 * angle)
    star = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    assert _area(star) == pytest.approx(np.pi * 1.045, rel=1e-3)
    with pytest.raises(ValueError, match="simplify it first"):
        plan_push_grasps(star, jaw_width=0.3)
    small = simplify(star, 60)
    assert len(small) <= 60
    assert _area(small) == pytest.approx(_area(star), rel=0.02)
    assert plan_push_grasps(small, jaw_width=0.3, samples=5).analysis.evaluations > 0


# Numbers


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"friction": -0.1}, "friction must be at least 0"),
        ({"friction": math.nan}, "friction"),
        ({"jaw_width": 0.0}, "jaw_width must be positive"),
        ({"jaw_width": math.inf}, "jaw_width must be positive"),
        ({"vertex_std": -1.0}, "at least 0"),
        ({"vertex_std": [0.1, 0.1]}, "one for each of the 4 vertices"),
        ({"com_std": math.nan}, "finite"),
        ({"com": (math.nan, 0)}, "two finite numbers"),
        ({"samples": 0}, "samples must be at least 1"),
        ({"angles": 4}, "odd"),
        ({"density": 0.0}, "density must be positive"),
        ({"density": 1e9}, "too many"),
        ({"filter_distance": -1.0}, "filter_distance"),
        ({"max_angle_deg": 100.0}, "max_angle_deg"),
        ({"max_opening": 0.3}, "bigger than the gripper's stroke: at least 1 between"),
        ({"max_opening": -1.0}, "max_opening must be positive"),
        ({"method": "guess"}, "method is bound or simulation"),
        ({"closure": "any"}, "closure is strict or nguyen"),
        ({"sampling": "even"}, "sampling is random or sobol"),
        ({"stop": True, "elimination": Elimination((5, 5), 0.5)}, "exclude each other"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        plan_push_grasps(SQUARE, **{"jaw_width": 0.5, **change})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "call",
    [
        lambda: Elimination((), 0.5),
        lambda: Elimination((5,), 1.0),
        lambda: PushTest(1.0, step=1.0),
        lambda: open_executor("cluster"),  # type: ignore[arg-type]
        lambda: open_executor("threads", -1),
    ],
)
def test_settings_that_make_no_sense_are_refused(call) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError):
        call()


@pytest.mark.parametrize("method", ["bound", "simulation"])
@pytest.mark.parametrize(
    "change",
    [
        {"jaw_width": 50.0},  # wider than the part
        {"friction": 0.0},
        {"friction": 2.0},
        {"vertex_std": 0.0, "com_std": 0.0},
        {"com": (9.0, 9.0)},  # outside
        {"samples": 1, "density": 0.01, "angles": 1},
        {"pose_std": (0.1, 0.2)},
        {"vertex_std": [0.0, 0.1, 0.0, 0.1]},
    ],
)
def test_extremes_give_numbers_without_warnings(change: dict[str, object], method: str) -> None:
    given = {"jaw_width": 0.5, "samples": 4, "method": method, **change}
    plan = plan_push_grasps(SQUARE, **given)  # type: ignore[arg-type]
    quality = plan.analysis.quality
    assert np.all((quality >= 0) & (quality <= 1))
    if "com" in change and method == "bound":
        assert plan.quality == 0.0


def test_a_needle_is_planned_on() -> None:
    plan = plan_push_grasps([(0, 0), (10, 0), (5, 1e-4)], jaw_width=1.0, samples=20)
    assert np.all(np.isfinite(plan.analysis.quality))


def test_the_stroke_leaves_out_what_does_not_fit() -> None:
    plan = plan_push_grasps(SQUARE, jaw_width=0.5, max_opening=1.3, vertex_std=0.01)
    assert 0 < len(plan.grasps) < 30
    assert plan.openings.max() <= 1.3
    assert len(sample_grasps(as_part(SQUARE))) == 30


def test_tolerances_are_explicit_standard_deviations() -> None:
    part = as_part(SQUARE)
    usual = Tolerance.default(part)
    # Variances of .2 and .7 times the radius, px^2, of an outline with a radius of 100 px.
    assert usual.vertex_std == pytest.approx(math.sqrt(20) * part.radius / 100, rel=0.01)
    assert usual.com_std == pytest.approx(math.sqrt(70) * part.radius / 100, rel=0.01)


def _crescent(thick: float, count: int = 220) -> np.ndarray:
    """Return a band along three quarters of a circle, so thin that chords of its sides cross."""
    turn = np.linspace(0, 1.5 * np.pi, count)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.vstack([ring, (1 - thick) * ring[::-1] * (1 + 1e-3 * np.cos(9 * turn)[:, None])])


def test_an_outline_that_would_touch_itself_is_simplified_more_finely() -> None:
    band = _crescent(0.012)
    with pytest.raises(ValueError, match="touches or crosses itself"):
        as_polygon(_reduced(band, 0.02))
    kept = simplify(band, len(band), 0.02)
    assert len(_reduced(band, 0.02)) < len(kept) < len(band)
    few = simplify(band, 24)
    assert 24 < len(few) <= MAX_VERTICES  # 24 vertices of this band cross


def test_vertices_that_repeat_one_another_are_left_out() -> None:
    square = np.array([[0, 0], [1, 0], [1, 1e-8], [1, 1], [0, 1]])
    assert len(simplify(square)) == 4
