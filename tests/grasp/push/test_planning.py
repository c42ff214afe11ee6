"""Planning: candidates, elimination, stopping, shards, pose, tolerances."""

from __future__ import annotations

import math
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from grasp.push import (
    Elimination,
    PushTest,
    Racing,
    Tolerance,
    analyse,
    as_part,
    open_executor,
    plan_push_grasps,
    running_best,
    sample_grasps,
    shards,
    stop_at,
)
from grasp.push.early import analyse_early, finish_times
from grasp.push.figures.whiskers import whisker_segments
from grasp.push.mechanics.conditions import CODES
from grasp.push.parts import (
    BRACKETS,
    SHAPES,
    TAPE_DISPENSER,
    TAPE_DISPENSER_COM,
    TOLERANCING,
    stand_in,
)
from grasp.push.polygon import filter_polygon
from grasp.push.pose import PoseTrials, centred_grasp, pose_map
from grasp.push.quality import density_quality, lower_bound
from grasp.push.studies import elimination_outcome, nominal_only, refined, sensitivity_grid
from grasp.push.tolerancing import near_vertices, optimise_tolerance, tolerance_limit
from grasp.push.trials import Trials
from tests.grasp.push.in_box2d import is_available, simulate_in_box2d


def _plan(name: str = "A", **more: object):  # type: ignore[no-untyped-def]
    ring = stand_in(name)
    more = {"keep_codes": True, **more}
    return plan_push_grasps(ring, jaw_width=0.25 * as_part(ring).diameter, **more)  # type: ignore[arg-type]


# Measured with 2,000 perturbations by a separate program: best quality and its share without
# pushes that may slip, setting (0, 1.5, 5), default tolerance. Self-crossing outlines of D were
# not yet failures there, so it is left out of the first column.
REFERENCE = {
    "A": (95, 0.99, 0.93), "B": (60, 0.66, 0.51), "C": (65, 0.90, 0.72), "D": (55, 0.97, 0.54),
    "E": (50, 0.99, 0.99), "F": (65, 0.99, 0.82), "H": (70, 0.90, 0.90), "I": (65, 0.98, 0.98),
    "J": (50, 0.62, 0.31), "K": (65, 0.98, 0.90), "L": (40, 0.82, 0.67),
    "rectangle": (30, 0.74, 0.41), "ell": (50, 0.97, 0.83), "tee": (60, 0.47, 0.36),
}  # fmt: skip


@pytest.mark.parametrize("name", REFERENCE)
def test_qualities_agree_with_a_separate_program(name: str) -> None:
    """Within .03: two samples of 1,500 and 2,000 at Q = .5 differ by .017 in one deviation."""
    count, best, without_slip = REFERENCE[name]
    plan = _plan(name, samples=1500)
    assert len(plan.grasps) == count
    assert plan.quality == pytest.approx(best, abs=0.03)
    codes = plan.analysis.codes
    sticking = ((codes > 0) & (codes // 10 != 1)).mean(axis=1).max()
    assert sticking == pytest.approx(without_slip, abs=0.04)


def test_contacts_lie_on_the_outline_also_where_the_filter_moved_it() -> None:
    ring = np.array([(0.0, 0), (1, 0.02), (2, 0), (2, 1), (1, 1.03), (0, 1)])
    part = as_part(ring)
    assert len(filter_polygon(part.vertices, 0.05 * part.radius)) == 4
    grasps = sample_grasps(part, filter_distance=0.05, density=4)
    after = np.roll(part.vertices, -1, axis=0)
    for p in grasps.contacts:
        along = after - part.vertices
        t = ((p - part.vertices) * along).sum(1) / (along**2).sum(1)
        foot = part.vertices + np.clip(t, 0, 1)[:, None] * along
        assert np.hypot(*(p - foot).T).min() < 1e-12


def test_survivors_of_elimination_have_the_results_of_the_full_run() -> None:
    full, less = _plan(samples=70), _plan(elimination=Elimination((5, 65), 0.9))
    kept = less.analysis.eliminated_after == 0
    assert kept.sum() == 10
    assert np.array_equal(less.analysis.codes[kept], full.analysis.codes[kept])
    assert less.analysis.spent == pytest.approx((95 * 5 + 10 * 65) / (95 * 70))
    assert np.all(less.analysis.tried[~kept] == 5)
    assert kept[less.best]


def test_racing_keeps_the_best_and_saves_evaluations() -> None:
    for name in ("A", "B", "J"):
        full, raced = _plan(name, samples=300), _plan(name, elimination=Racing(300, 20))
        assert raced.quality >= full.quality - 0.02
        assert raced.analysis.spent < 0.6
        kept = raced.analysis.eliminated_after == 0
        assert np.array_equal(raced.analysis.codes[kept], full.analysis.codes[kept])


@pytest.mark.parametrize(
    "more",
    [{"samples": 61}, {"elimination": Elimination((11, 50), 0.5)}, {"elimination": Racing(61, 9)}],
)
def test_sums_tell_the_same_as_the_results_of_all_trials(more: dict[str, object]) -> None:
    whole = _plan("J", **more).analysis
    with open_executor("threads", 3) as executor:
        summed = _plan("J", keep_codes=False, executor=executor, **more).analysis
    for name in (
        "counts",
        "quality",
        "lower_95",
        "successes",
        "tried",
        "eliminated_after",
        "order",
    ):
        assert np.array_equal(getattr(summed, name), getattr(whole, name)), name
    assert (summed.crossed, summed.spent, summed.samples) == (
        whole.crossed, whole.spent, whole.samples,
    )  # fmt: skip
    found, times = np.unique(whole.codes, return_counts=True)
    told = dict(zip((CODES[c] for c in found.tolist()), times.tolist(), strict=True))
    assert summed.reasons() == whole.reasons() == told
    assert list(summed.reasons().values()) == sorted(told.values(), reverse=True)
    with pytest.raises(ValueError, match="keep_codes"):
        _ = summed.codes


@pytest.mark.parametrize("keep_codes", [False, True])
def test_an_analysis_tells_how_far_it_is_and_ends_in_time_with_the_first_trials(
    keep_codes: bool,
) -> None:
    """An analysis cut short equals one of that many trials from the start."""
    told: list[tuple[int, int]] = []
    whole = _plan(samples=400, progress=lambda *at: told.append(at), keep_codes=keep_codes)
    assert told == [(50 * k, 400) for k in range(1, 9)]
    assert not whole.analysis.is_cut

    cut = _plan(samples=400, deadline_s=1e-9, keep_codes=keep_codes).analysis
    assert cut.is_cut
    assert cut.samples == 50
    same = _plan(samples=50, keep_codes=keep_codes).analysis
    assert np.array_equal(cut.counts, same.counts)
    assert np.array_equal(cut.order, same.order)

    plan = Elimination((40, 360), 0.5)
    cut = _plan(elimination=plan, deadline_s=1e-9, keep_codes=keep_codes).analysis
    assert (cut.samples, cut.is_cut, cut.eliminated_after.max()) == (5, True, 0)
    with pytest.raises(ValueError, match="deadline_s must be positive"):
        _plan(deadline_s=0)


def test_removed_grasps_are_left_out_when_the_time_is_up_between_batches() -> None:
    times = iter((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shards, "time", SimpleNamespace(monotonic=lambda: next(times, 9.0)))
        cut = _plan(elimination=Elimination((40, 360), 0.5), deadline_s=5.0).analysis
    first = _plan(elimination=Elimination((40,), 0.5)).analysis
    assert cut.is_cut
    assert cut.samples == 40
    assert np.array_equal(cut.codes, first.codes)
    survivors = cut.eliminated_after == 0
    assert 0 < survivors.sum() < len(survivors)
    assert survivors[cut.best]


def test_elimination_does_not_depend_on_the_order_of_the_candidates() -> None:
    part = as_part(stand_in("B"))
    grasps, test = sample_grasps(part), PushTest(0.25 * part.diameter)
    shuffled = np.random.default_rng(1).permutation(len(grasps))
    tolerance, drop = Tolerance.default(part), Elimination((3, 20), 0.8)
    one = analyse(part, grasps, test, tolerance, elimination=drop, keep_codes=True)
    other = analyse(part, grasps.take(shuffled), test, tolerance, elimination=drop, keep_codes=True)
    assert np.array_equal(one.codes[shuffled], other.codes)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_parallel_runs_equal_the_serial_run(kind: str) -> None:
    serial = _plan(samples=61, elimination=Elimination((11, 50), 0.5))
    with open_executor(kind, 2) as executor:  # type: ignore[arg-type]
        parallel = _plan(elimination=Elimination((11, 50), 0.5), executor=executor)
    assert np.array_equal(serial.analysis.codes, parallel.analysis.codes)
    assert np.array_equal(serial.analysis.order, parallel.analysis.order)


def test_ray_equals_the_serial_run() -> None:
    """All shards, and those that finish first: trial by trial what the serial run gives."""
    ray = pytest.importorskip("ray", reason="ray is optional: pip install '.[ray]'")
    part = as_part(stand_in("A"))
    test, tolerance = PushTest(0.25 * part.diameter), Tolerance.default(part)
    serial = _plan(samples=80).analysis.codes
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(ValueError, match="address of a running cluster"):
            open_executor("ray", 2)
        ray.init(num_cpus=2, include_dashboard=False, logging_level="ERROR")
        try:
            with open_executor("ray", 2) as executor:
                parallel = _plan(samples=80, executor=executor)
                early = analyse_early(
                    part, sample_grasps(part), test, tolerance, samples=16, shards=10,
                    executor=executor,
                )  # fmt: skip
        finally:
            ray.shutdown()
    assert np.array_equal(parallel.analysis.codes, serial)
    taken = np.concatenate([serial[:, 8 * k : 8 * k + 8] for k in early.shards], axis=1)
    assert np.array_equal(early.analysis.codes, taken)


def test_sobol_points_need_fewer_perturbations() -> None:
    """At 64 perturbations the mean square error of J is a tenth (0.012 against 0.042)."""
    part = as_part(stand_in("J"))
    grasps, width = sample_grasps(part), 0.25 * part.diameter
    tolerance = Tolerance.default(part)
    truth = (Trials.of(part, grasps, PushTest(width), tolerance, 9)(0, 8000) > 0).mean(axis=1)
    errors = {}
    for sampling in ("random", "sobol"):
        test = PushTest(width, sampling=sampling)  # type: ignore[arg-type]
        found = [(Trials.of(part, grasps, test, tolerance, k)(0, 64) > 0).mean(1) for k in range(8)]
        errors[sampling] = float(np.sqrt(np.mean(np.square(np.array(found) - truth))))
    assert errors["sobol"] < 0.6 * errors["random"]
    serial = _plan(samples=50, sampling="sobol")
    with open_executor("threads", 3) as executor:
        parallel = _plan(samples=50, sampling="sobol", executor=executor)
    assert np.array_equal(serial.analysis.codes, parallel.analysis.codes)


def test_the_early_shards_are_compared_with_the_late_ones() -> None:
    part = as_part(stand_in("A"))
    grasps, test = sample_grasps(part), PushTest(0.25 * part.diameter)
    tolerance = Tolerance.default(part)
    with open_executor("threads", 2) as executor:
        found = analyse_early(
            part, grasps, test, tolerance, samples=100, check=True, executor=executor
        )
    assert found.analysis.codes.shape == (95, 100)
    assert found.bias is not None
    # The largest of 95 nearly normal z: 4.5 is passed by chance in one run of a thousand.
    assert found.bias.largest_z < 4.5
    assert found.early_seconds <= found.all_seconds
    slowest, fifth = finish_times([3.0] * 100, (41.6, 133.0), 0.2)
    assert 100 < slowest < 136.1
    assert 1.04 <= slowest / fifth <= 3.0


def test_the_stop_rule_ends_early_and_keeps_the_result_of_the_first_perturbations() -> None:
    stopped, full = _plan(stop=True, samples=500), _plan(samples=500)
    used = stopped.analysis.codes.shape[1]
    assert 30 <= used < 500
    assert np.array_equal(stopped.analysis.codes, full.analysis.codes[:, :used])
    curve = running_best(full.analysis.codes)
    assert stop_at(curve) == used
    assert abs(curve[used - 1] - curve[-1]) < 0.07


def test_looser_tolerances_lower_the_best_quality() -> None:
    for name in BRACKETS:
        r = as_part(stand_in(name)).radius
        tight = _plan(name, samples=300, vertex_std=0.01 * r, com_std=0.02 * r).quality
        loose = _plan(name, samples=300, vertex_std=0.09 * r, com_std=0.17 * r).quality
        assert tight > loose, name


def test_without_tolerance_every_quality_is_nought_or_one() -> None:
    plan = _plan(vertex_std=0.0, com_std=0.0, samples=3)
    assert set(np.unique(plan.analysis.quality)) <= {0.0, 1.0}
    assert np.array_equal(plan.analysis.quality == 1, plan.nominal > 0)


def test_lower_bounds_hold_as_often_as_they_promise() -> None:
    rng = np.random.default_rng(0)
    for p in (0.1, 0.6, 0.95):
        wins = rng.binomial(80, p, 4000)
        assert (lower_bound(wins, np.full(4000, 80)) <= p).mean() >= 0.945


def test_weighting_by_density_is_the_worse_estimate() -> None:
    """In 26 dimensions a few draws carry all weight (RMSE .14 against .04 before)."""
    part = as_part(stand_in("A"))
    grasps, test = sample_grasps(part), PushTest(0.25 * part.diameter)
    trials = Trials.of(part, grasps, test, Tolerance.default(part), 5)
    truth = (trials(0, 4000) > 0).mean(axis=1)
    plain, weighted = [], []
    for k in range(20):
        success = trials(100 * k, 100) > 0
        plain.append(success.mean(axis=1) - truth)
        draws = trials.draws(100 * k, 100)[:, : len(part.vertices) + 1]
        weighted.append(density_quality(success, draws) - truth)
    rmse = [float(np.sqrt(np.mean(np.square(e)))) for e in (plain, weighted)]
    assert rmse[0] < 0.05
    assert rmse[1] > 2.5 * rmse[0]
    assert _plan(weighting="density", samples=50).analysis.quality.max() <= 1.0


def test_grasps_chosen_without_uncertainty_are_mostly_not_the_best() -> None:
    """Kehoe 2014, 3.5: 4 % were best, their mean quality was 58 % of the best one's."""
    found = [nominal_only(_plan(n, filter_distance=0.03, density=7.5, angles=9)) for n in "ABCD"]
    assert all(f.closing > 50 for f in found)
    assert np.mean([f.best_share for f in found]) < 0.15
    assert 0.5 < np.mean([f.mean_ratio for f in found]) < 0.9


def test_the_sensitivity_grid_has_84_points() -> None:
    part = as_part(stand_in("E"))
    test, tolerance = PushTest(0.25 * part.diameter), Tolerance.default(part)
    points = list(sensitivity_grid(part, test, tolerance, samples=2))
    assert len(points) == 84
    some = list(sensitivity_grid(part, test, tolerance, filters=(0.0,), angle_counts=(5,)))
    assert max(p.quality for p in some) > 0.95


def test_the_expected_outcome_of_elimination_is_that_of_many_draws() -> None:
    codes = _plan("B", samples=70).analysis.codes
    spent, expected, worst = elimination_outcome(codes, 3, 0.9)
    rng, final = np.random.default_rng(0), (codes > 0).mean(axis=1)
    wins = (codes[:, :3] > 0).sum(axis=1)
    tops = [
        final[np.lexsort((rng.random(len(wins)), -wins))[: round(0.1 * len(wins))]].max()
        for _ in range(4000)
    ]
    assert expected == pytest.approx(np.mean(tops) / final.max(), abs=0.01)
    assert worst <= min(tops) / final.max() + 1e-12
    assert spent == pytest.approx((60 * 3 + 6 * 67) / (60 * 70))


def test_simulation_refines_the_best_and_finds_no_less_than_the_bound() -> None:
    plan = _plan("ell", samples=60)
    better = refined(plan, 0.1, samples=60)
    bound = plan.analysis.quality[plan.analysis.order[: len(better)]]
    assert np.all(better >= bound - 1 / 60)


# Pose uncertainty


def test_quality_falls_with_position_and_may_rise_with_rotation() -> None:
    """The pattern of Kehoe 2014, Fig. 3.23, on a stand-in of its part."""
    part = as_part(TAPE_DISPENSER, TAPE_DISPENSER_COM)
    width = 0.35 * part.diameter
    position = np.linspace(0.055, 1.11, 4) * part.diameter
    rotation = np.deg2rad([5, 30, 60])
    up = pose_map(part, centred_grasp(part, (0, 1), width), PushTest(width), position, rotation)
    assert up.quality[0, 0] == 1.0
    assert np.all(np.diff(up.quality.mean(axis=1)) < 0.0)
    along = pose_map(part, centred_grasp(part, (1, 0), width), PushTest(width), position, rotation)
    assert along.quality[0, 2] > along.quality[0, 0] + 0.2
    weighted = pose_map(
        part, centred_grasp(part, (0, 1), width), PushTest(width), position, rotation,
        weighting="density",
    )  # fmt: skip
    assert weighted.quality.mean() > up.quality.mean()
    with open_executor("threads", 2) as executor:
        same = pose_map(
            part, centred_grasp(part, (0, 1), width), PushTest(width), position, rotation,
            executor=executor,
        )  # fmt: skip
    assert np.array_equal(same.quality, up.quality)


def test_the_simulation_agrees_with_box2d() -> None:
    if not is_available():
        pytest.skip("box2d is optional: pip install box2d")
    agreements = []
    for name, direction in (("rectangle", (0, 1)), ("ell", (0, 1)), ("A", (0, 1))):
        part = as_part(stand_in(name))
        width = 0.25 * part.diameter
        test = PushTest(width, method="simulation")
        trials = Trials.of(part, centred_grasp(part, direction, width), test, Tolerance(0.0), 0)
        task = PoseTrials(
            trials, np.array([0.06 * part.diameter / part.radius]), np.array([0.25]), 50
        )
        own = task(0, 50)[0] > 0
        vx, vy, mass = task.moved(task.poses(0, 50)[1])
        size = trials.diameter
        theirs = []
        for k in range(50):
            ring = np.column_stack([vx[k], vy[k]])
            code = simulate_in_box2d(
                ring, mass[k], trials.rows[0], trials.width, 0.7, 0.16, size, 0.004 * size
            )
            theirs.append(code > 0)
        agreements.append(float((own == theirs).mean()))
    assert min(agreements) >= 0.92
    assert np.mean(agreements) >= 0.95


# Tolerances


def _bottom(name: str):  # type: ignore[no-untyped-def]
    part = as_part(stand_in(name))
    grasps = sample_grasps(part, density=4.0)
    grasps = grasps.take(np.flatnonzero(np.abs(grasps.contacts[:, 1]) < 1e-9))
    test = PushTest(0.25 * part.diameter)
    tolerance = Tolerance(0.02 * part.radius, com_follows=True)
    best = analyse(part, grasps, test, tolerance, samples=1000).best
    return part, grasps.take(best), test


def test_thin_parts_bear_less_tolerance() -> None:
    """Kehoe 2014, 3.5: Part D against Part A."""
    limits = {}
    for name in ("TA", "TD"):
        part, grasp, test = _bottom(name)
        near = near_vertices(part, grasp, 0, test.jaw_width)
        assert part.vertices[near][:, 1].tolist() == [0.0, 0.0]
        found = tolerance_limit(
            part, grasp, test, raised=near, base_std=0.02 * part.radius, threshold=0.9
        )
        limits[name] = found.limit / part.radius
        at = found.sigmas <= found.limit
        assert np.all(found.lower_95[at][:1] >= 0.9)
        assert not found.unlimited
    assert limits["TA"] > 1.2 * limits["TD"]
    assert set(TOLERANCING) >= set(limits)


def test_a_threshold_out_of_reach_is_said_to_be() -> None:
    part, grasp, test = _bottom("TC")
    found = tolerance_limit(
        part, grasp, test, raised=np.ones(7, bool), base_std=0.3 * part.radius, threshold=0.999,
        samples=200,
    )  # fmt: skip
    assert math.isnan(found.limit)


@pytest.mark.slow
def test_optimal_tolerance_has_the_right_limits() -> None:
    part = as_part(stand_in("rectangle"))
    grasps, test = sample_grasps(part), PushTest(0.25 * part.diameter)

    def best(failure_cost: float, weight: float = 0.01):  # type: ignore[no-untyped-def]
        return optimise_tolerance(
            part, grasps, test, failure_cost=failure_cost, weights=(weight, weight, 0.0),
            samples=300,
        )  # fmt: skip

    low, high = 0.005 * part.radius, 0.2 * part.radius
    assert best(0.0).std[:2] == pytest.approx((high, high))
    free = best(1.0, 0.0)
    assert free.quality >= 0.99
    middle = best(1.0)
    assert low < middle.std[0] < high
    assert best(10.0, 0.1).std == pytest.approx(middle.std)
    assert best(1000.0).std[0] < middle.std[0]
    # Brute force on the same grid agrees within one cell.
    i, j = np.unravel_index(int(middle.grid.argmin()), (9, 9))
    ratio = middle.grid_near[1] / middle.grid_near[0]
    assert abs(math.log(middle.std[0] / middle.grid_near[i])) <= 1.01 * math.log(ratio)
    assert abs(math.log(middle.std[1] / middle.grid_far[j])) <= 1.01 * math.log(ratio)
    assert middle.near_range[0] <= middle.std[0] <= middle.near_range[1]
    with pytest.raises(ValueError, match="tighter tolerances cost more"):
        optimise_tolerance(
            part, grasps, test, failure_cost=1.0, cost="linear", weights=(1.0, 1.0, 0.0)
        )


def test_whiskers_start_at_contacts_and_point_against_the_approach() -> None:
    plan = _plan()
    segments = whisker_segments(plan)
    assert np.array_equal(segments[:, 0], plan.grasps.contacts)
    along = segments[:, 1] - segments[:, 0]
    lengths = np.hypot(*along.T)
    assert np.allclose(lengths / lengths.max(), plan.analysis.quality / plan.quality)
    assert np.all((along * plan.grasps.approaches).sum(axis=1) <= 0)


def test_shapes_are_valid_parts() -> None:
    for name in (*BRACKETS, *SHAPES, *TOLERANCING):
        assert as_part(stand_in(name)).area > 0
