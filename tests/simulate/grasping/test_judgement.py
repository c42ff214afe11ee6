"""Conclusions of a robot from its senses, in which the truth has no part."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from simulate.agent.scoring import AttemptTruth
from simulate.grasping.executor import GraspRequest, PlannedGrasp, Workcell
from simulate.grasping.judgement import (
    HeightMap,
    is_stuck,
    judge_held,
    judge_off_table,
    judge_old_place,
    judge_placed,
    narrowest_hold,
    new_cells,
    share_left,
)
from simulate.grasping.record import GraspRecord
from simulate.robots import describe
from simulate.world.eyes import Eyes
from simulate.world.objects import product
from simulate.world.robot_body import HandTouch

FLOOR = 0.27
CAN = product("can", 3)


def opened(close: float, lift: float, hold: float) -> dict[str, float]:
    return {"close": close, "lift": lift, "hold": hold}


@pytest.mark.parametrize(
    ("openings", "rise", "answer"),
    [
        (opened(0.6, 0.6, 0.58), 0.06, "yes"),
        (opened(0.6, 0.6, 0.01), 0.06, "no"),
        (opened(0.6, 0.01, 0.01), 0.06, "no"),
        (opened(0.6, 0.6, 0.3), 0.06, "no"),
        (opened(0.6, 0.4, 0.38), 0.06, "yes"),
        (opened(0.6, 0.6, 0.6), 0.01, "no"),
        (opened(0.6, 0.6, float("nan")), 0.06, "unknown"),
    ],
)
def test_held_needs_a_hand_kept_open_and_a_tool_that_rose(openings, rise, answer):
    judged = judge_held(openings, rise)
    assert judged.answer == answer
    assert "opening 0.60" in judged.evidence


def test_fingers_that_close_beyond_half_the_width_hold_nothing():
    # Cartons of 28 and 36 mm that a NAO held kept its hand open by .38 and .44, of 50 mm.
    assert 0.25 < narrowest_hold(0.028, 0.05) < 0.38
    assert 0.30 < narrowest_hold(0.036, 0.05) < 0.44


@pytest.mark.parametrize(
    ("before", "moved_mm", "width_mm", "stuck"),
    [
        (1.0, 0.5, 40.0, True),
        (1.0, 39.0, 40.0, False),
        (1.0, 5.0, 40.0, False),  # the object was grasped by a wider part than was seen
        (0.6, 1.0, 40.0, True),  # 8 mm of way, of which a quarter is 1.25 beside the error
        (1.0, 0.5, 77.0, False),  # it fills the hand, or is stuck: a look after the lift tells
        (1.0, 0.0, 79.0, False),
    ],
)
def test_fingers_are_stuck_that_could_have_moved(before, moved_mm, width_mm, stuck):
    closed = before - moved_mm / 80.0
    assert is_stuck(before, closed, width_mm / 1000, mouth=0.080) == stuck


def scene(height: float, x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    """Return points 2 mm apart of an empty floor with a block of that height on it."""
    grid = np.mgrid[0.0:0.12:0.002, 0.0:0.12:0.002].reshape(2, -1).T
    inside = (grid[:, 0] > x[0]) & (grid[:, 0] < x[1]) & (grid[:, 1] > y[0]) & (grid[:, 1] < y[1])
    return np.column_stack([grid, FLOOR + np.where(inside, height, 0.0)])


def mapped(points: np.ndarray) -> HeightMap:
    return HeightMap.of(points, (0.0, 0.12), (0.0, 0.12), FLOOR)


EMPTY = mapped(scene(0.0, (0, 0), (0, 0)))
BLOCK = mapped(scene(0.04, (0.03, 0.06), (0.03, 0.06)))
MOVED = mapped(scene(0.04, (0.06, 0.09), (0.06, 0.09)))
TWO_BLOCKS = replace(
    BLOCK, heights=np.fmax(BLOCK.heights, mapped(scene(0.03, (0.07, 0.1), (0.03, 0.09))).heights)
)
EDGES = mapped(scene(0.03, (0.0, 0.12), (0.0, 0.006)))
HALF_HIDDEN = mapped(scene(0.0, (0, 0), (0, 0))[: 60 * 40])
UNSEEN = mapped(np.zeros((0, 3)))


def test_a_map_gives_the_median_height_of_each_seen_cell():
    assert BLOCK.heights[7, 7] == pytest.approx(0.04)
    assert BLOCK.heights[0, 0] == pytest.approx(0.0)
    assert not np.isfinite(UNSEEN.heights).any()
    grown = new_cells(EMPTY, BLOCK)
    assert 20 <= grown.sum() <= 36  # 30 x 30 mm in cells of 6 mm, the edges shared
    np.testing.assert_allclose(BLOCK.centre_of(grown), [0.045, 0.045], atol=0.006)


def test_what_lies_on_something_else_is_new_as_well():
    higher = mapped(scene(0.08, (0.03, 0.06), (0.03, 0.06)))
    assert new_cells(BLOCK, higher).sum() >= 20
    assert new_cells(BLOCK, BLOCK).sum() == 0


@pytest.mark.parametrize(
    ("kept", "before", "after", "answer"),
    [
        (True, EMPTY, BLOCK, "yes"),
        (True, EMPTY, EMPTY, "no"),
        (True, BLOCK, BLOCK, "no"),
        (True, BLOCK, MOVED, "no"),  # it pushed about what lay there, and lies elsewhere
        (True, BLOCK, TWO_BLOCKS, "yes"),
        (True, EMPTY, EDGES, "no"),  # the walls of the box
        (True, EMPTY, HALF_HIDDEN, "unknown"),
        (True, EMPTY, UNSEEN, "unknown"),
        (True, UNSEEN, BLOCK, "unknown"),
        (False, EMPTY, BLOCK, "unknown"),  # it lies there, or leans on the rim
        (False, EMPTY, EDGES, "no"),
        (False, EMPTY, EMPTY, "no"),
        (False, EMPTY, HALF_HIDDEN, "unknown"),
    ],
)
def test_placed_needs_something_new_where_it_was_to_go(kept, before, after, answer):
    assert judge_placed(kept, before, after).answer == answer


def test_what_came_to_lie_on_what_was_pushed_aside_is_placed() -> None:
    below = mapped(scene(0.04, (0.06, 0.09), (0.06, 0.09)))
    stacked = mapped(scene(0.08, (0.06, 0.09), (0.06, 0.09)))
    volume = 0.03 * 0.03 * 0.04
    assert judge_placed(True, BLOCK, stacked, volume).answer == "yes"
    assert judge_placed(True, BLOCK, below, volume).answer == "no"


def test_what_was_tipped_over_in_the_box_leaves_it_unknown_what_arrived() -> None:
    lying = mapped(scene(0.02, (0.03, 0.09), (0.06, 0.09)))  # as large as the block, and flat
    volume = 0.03 * 0.03 * 0.04
    assert judge_placed(True, BLOCK, lying).answer == "yes"
    assert judge_placed(True, BLOCK, lying, volume).answer == "unknown"
    assert judge_placed(True, EMPTY, lying, volume).answer == "yes"
    apart = mapped(scene(0.05, (0.06, 0.10), (0.05, 0.09)))
    assert judge_placed(True, BLOCK, apart, volume).answer == "yes"
    assert judge_placed(False, BLOCK, apart, volume).answer == "unknown"


def test_what_was_lost_on_the_way_is_placed_only_if_all_of_it_is_seen_there() -> None:
    assert judge_placed(False, EMPTY, BLOCK, 0.03 * 0.03 * 0.04).answer == "yes"
    assert judge_placed(False, EMPTY, BLOCK, 0.10 * 0.03 * 0.04).answer == "unknown"


def test_what_was_lost_on_the_way_and_lies_on_the_table_is_not_placed() -> None:
    volume = 0.03 * 0.03 * 0.04
    assert BLOCK.volume == pytest.approx(volume, rel=0.2)
    assert share_left(BLOCK, MOVED, BLOCK.volume) == pytest.approx(1.0, abs=0.2)
    assert share_left(BLOCK, EMPTY, BLOCK.volume) == pytest.approx(0.0, abs=0.2)
    assert share_left(TWO_BLOCKS, MOVED, BLOCK.volume) < 0.5  # another was moved as well
    assert share_left(EMPTY, EMPTY, 0.0) == 0.0
    for after in (EMPTY, HALF_HIDDEN):
        assert judge_placed(False, EMPTY, after, volume, 0.9).answer == "no"
        assert judge_placed(True, EMPTY, after, volume, 0.9) == judge_placed(
            True, EMPTY, after, volume
        )
    assert judge_placed(False, EMPTY, BLOCK, volume, 0.9).answer == "yes"
    assert judge_placed(False, EMPTY, HALF_HIDDEN, volume, 0.1).answer == "unknown"


def test_the_old_place_tells_whether_the_object_is_gone():
    assert judge_old_place(BLOCK, BLOCK).answer == "yes"
    assert judge_old_place(BLOCK, EMPTY).answer == "no"
    assert judge_old_place(BLOCK, UNSEEN).answer == "unknown"
    assert judge_old_place(EMPTY, EMPTY).answer == "unknown"


def attempt(lie: bool, friction: float) -> tuple[GraspRecord, AttemptTruth]:
    """Let a Panda try a can; with ``lie`` the world gives wrong answers about objects."""
    with Workcell("panda", preset="fast") as cell, pytest.MonkeyPatch.context() as patch:
        world, (x, y) = cell.world, (0.47, -0.10)
        slippery = replace(CAN, friction=replace(CAN.friction, lateral=friction))
        world.spawn(slippery, (x, y))
        world.step(0.2)
        request = GraspRequest(
            x, y, 0.0, width=CAN.dims[0], length=CAN.dims[0], height=CAN.dims[1], round=True,
            table_height=world.table_height,
        )  # fmt: skip
        plan = cell.executor.plan(request, seed=1)
        assert isinstance(plan, PlannedGrasp)
        watch = AttemptTruth(world, cell.robot, plan)
        if lie:
            real = world.object_pose

            def elsewhere(body: int) -> Any:
                return replace(real(body), position=np.array([9.0, 9.0, 0.0]))

            patch.setattr(world, "object_pose", elsewhere)
            patch.setattr(world, "on_table", lambda body: True)
            patch.setattr(cell.robot, "touch", lambda arm, body: HandTouch(0, 0.0))
        return cell.executor.execute(plan, watch), watch


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.8, 0.0])
def test_a_world_that_lies_about_the_truth_changes_no_record(friction):
    honest, seen = attempt(lie=False, friction=friction)
    fooled, wrong = attempt(lie=True, friction=friction)
    held = friction > 0
    assert (honest.held, honest.placed) == (held, held)
    for name in ("reason", "place_reason", "judged_held", "judged_placed", "old_place",
                 "lifted_m", "slip_m", "jaw_gap_m", "links", "forces", "times"):  # fmt: skip
        assert getattr(fooled, name) == getattr(honest, name), name
    assert seen.truth.held is held
    assert not wrong.truth.held


@pytest.mark.slow
def test_both_robots_see_into_their_boxes():
    for robot in ("nao", "panda"):
        with Workcell(robot, preset="fast") as cell:
            eyes = Eyes(cell.robot)
            for box in cell.world.place_boxes.values():
                seen = HeightMap.of(eyes.box_points(box.side), box.x_range, box.y_range, box.floor)
                assert np.isfinite(seen.heights).mean() > 0.8, (robot, box.side)
                # A forearm may be over a corner.
                assert seen.occupied[2:-2, 2:-2].mean() < 0.15, (robot, box.side)


def test_a_look_at_an_unchanged_scene_costs_one_frame():
    with Workcell("nao", preset="fast") as cell:
        eyes = Eyes(cell.robot)
        first, _ = eyes.look("left")
        assert eyes.look("left")[0] is first
        assert eyes.look("right")[0] is not first
        assert eyes.frames == 2
        cell.world.step(0.01)
        assert eyes.look("left")[0] is not first


def test_fixed_cameras_over_the_boxes_are_announced():
    assert set(describe("panda").cameras) == {"camera_depth", "box_left", "box_right"}


def _plane(low: bool) -> HeightMap:
    """Return the map of a table of 6 cm, with something 2 cm high on its left third if ``low``."""
    grid = np.stack(np.meshgrid(np.arange(0, 0.06, 0.002), np.arange(0, 0.06, 0.002)), -1)
    points = np.concatenate([grid.reshape(-1, 2), np.zeros((grid.shape[0] ** 2, 1))], axis=1)
    if low:
        points[points[:, 0] < 0.02, 2] = 0.02
    return HeightMap.of(points, (0.0, 0.06), (0.0, 0.06), 0.0, 0.03)


def test_an_end_that_stays_on_the_table_is_seen_under_the_lifted_hand() -> None:
    gone, hanging = _plane(low=False), _plane(low=True)
    place = gone.within(0.01, 0.03, np.pi / 2, 0.06, 0.024)
    assert judge_off_table(gone, place).is_yes
    assert judge_off_table(hanging, place).answer == "no"
    # What lies beside its place says nothing.
    elsewhere = gone.within(0.05, 0.03, np.pi / 2, 0.06, 0.016)
    assert judge_off_table(hanging, elsewhere).is_yes
    unseen = HeightMap.of(np.zeros((0, 3)), (0.0, 0.06), (0.0, 0.06), 0.0)
    assert judge_off_table(unseen, place).answer == "unknown"
