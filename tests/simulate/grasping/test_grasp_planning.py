"""Plans keep clear of what was perceived, and every way to fail has its own name."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from simulate.grasping.executor import PlannedGrasp, Workcell
from simulate.grasping.hand_rules import DiagonalMouth
from simulate.grasping.planning import GraspPlanner
from simulate.grasping.rules import GraspRequest, closing_angles, grasp_heights, openings
from simulate.motion.arm_space import ALLOWED, ArmSpace
from simulate.motion.collision import Obstacle
from simulate.robots import describe_nao
from simulate.world.hidden import NO_SECRET
from simulate.world.objects import product

CAN = GraspRequest(0.15, -0.10, 0.0, width=0.032, length=0.032, height=0.075, round=True)
BOX = GraspRequest(0.15, -0.10, 0.6, width=0.03, length=0.045, height=0.05)
PEN = GraspRequest(0.15, -0.10, 0.3, width=0.019, length=0.11, height=0.019)


@pytest.fixture(scope="module")
def planner():
    return GraspPlanner(ArmSpace(describe_nao()))


@pytest.mark.slow
def test_a_plan_ends_at_the_requested_point(planner):
    for request in (CAN, BOX, PEN):
        plan = planner.plan(request, [], seed=1)
        assert not isinstance(plan, str)
        _, position = planner.space.chains[plan.arm].tool_poses(plan.posture[None])
        wanted = [request.x, request.y, request.table_height + plan.tool_height]
        assert position[0] == pytest.approx(wanted, abs=0.0015)


def test_phases_join_without_a_jump(planner):
    plan = planner.plan(BOX, [], seed=1)
    home = np.array(planner.robot.arm(plan.arm).home)
    np.testing.assert_allclose(plan.free.positions[0], home, atol=1e-9)
    np.testing.assert_allclose(plan.free.positions[-1], plan.approach.positions[0], atol=1e-9)
    np.testing.assert_allclose(plan.approach.positions[-1], plan.posture, atol=1e-9)
    np.testing.assert_allclose(plan.lift.positions[0], plan.posture, atol=1e-9)


def test_the_hand_closes_as_asked_across_a_box(planner):
    plan = planner.plan(BOX, [], seed=1)
    off = (plan.closing_angle - BOX.theta + math.pi / 2) % math.pi - math.pi / 2
    assert abs(off) < 0.4


@pytest.mark.slow
@pytest.mark.parametrize(
    "distances", [(0.15,), pytest.param((0.13, 0.15, 0.17), marks=pytest.mark.deep)]
)
def test_both_arms_plan_the_mirrored_grasp(planner, distances):
    reached = {"left_arm": 0, "right_arm": 0}
    for x in distances:
        for y in (0.05, 0.09, 0.13, 0.17):
            for side in (1, -1):
                plan = planner.plan(replace(CAN, x=x, y=side * y), [], seed=0)
                if not isinstance(plan, str):
                    reached[plan.arm] += 1
    assert min(reached.values()) >= 4 * len(distances) - 1
    assert abs(reached["left_arm"] - reached["right_arm"]) <= 1


def test_auto_takes_the_near_arm_and_the_other_when_it_must(planner):
    assert planner.plan(replace(CAN, y=0.1), [], seed=0).arm == "left_arm"
    assert planner.plan(replace(CAN, y=-0.1), [], seed=0).arm == "right_arm"
    only_right = [
        Obstacle.box("neighbour", (0.15, 0.16, 0.40), (0.20, 0.05, 0.26)),
        Obstacle.box("neighbour", (0.12, 0.10, 0.45), (0.10, 0.10, 0.10)),
    ]
    request = replace(CAN, y=0.02)
    assert isinstance(planner.plan(replace(request, arm="left"), only_right, seed=0), str)
    assert planner.plan(request, only_right, seed=0).arm == "right_arm"


def test_paths_keep_clear_of_perceived_neighbours(planner):
    beside = Obstacle.box("neighbour", (0.15, -0.17, 0.31), (0.04, 0.04, 0.08))
    plan = planner.plan(CAN, [beside], seed=2)
    assert not isinstance(plan, str)
    spheres = planner.space.spheres(plan.arm, plan.opening)
    around = planner.space.surroundings(plan.arm, CAN.table_height, [beside])
    slack = spheres.slack(around, {**ALLOWED, ("table", "finger"): 0.008})
    for way in (plan.free, plan.approach, plan.lift):
        # Lines are checked at 8 points; between them a joint turns by a few hundredths of a rad.
        assert spheres.clearances(way.positions, around, slack).min() > -0.002


def test_same_seed_same_plan(planner):
    first, second = (GraspPlanner(ArmSpace(describe_nao())).plan(BOX, [], seed=9) for _ in range(2))
    np.testing.assert_array_equal(first.free.positions, second.free.positions)
    np.testing.assert_array_equal(first.posture, second.posture)


WALL_THROUGH = Obstacle.box("neighbour", (0.15, -0.10, 0.33), (0.012, 0.30, 0.12))
LID = Obstacle.box("neighbour", (0.15, -0.10, 0.385), (0.30, 0.34, 0.01))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("request_", "obstacles", "reasons"),
    [
        (replace(CAN, x=0.45), [], {"ik"}),
        (replace(CAN, width=0.08, length=0.08), [], {"too_wide"}),
        (replace(CAN, mass=0.5), [], {"too_heavy"}),
        (CAN, [WALL_THROUGH], {"grasp_collision"}),
        (
            replace(PEN, y=-0.12),
            [LID],
            {"approach_collision", "pregrasp_collision", "grasp_collision"},
        ),
        (CAN, [Obstacle.box("neighbour", (0.12, -0.24, 0.40), (0.06,) * 3)], {"rrt_start"}),
    ],
)  # fmt: skip
def test_every_failure_has_its_reason(planner, request_, obstacles, reasons):
    assert planner.plan(replace(request_, arm="right"), obstacles, seed=0) in reasons


def test_a_wall_close_before_the_object_blocks_the_approach(planner):
    """Just clear of the open hand at the object, in the way of every path to it."""
    free = planner.plan(CAN, [], seed=0)
    _, _tool = planner.space.chains[free.arm].tool_poses(free.posture[None])
    rings = [
        Obstacle.box("neighbour", (0.15, -0.10 + dy, 0.42), (0.26, 0.02, 0.02))
        for dy in np.linspace(-0.12, 0.12, 13)
    ]
    found = planner.plan(CAN, rings, seed=0)
    assert found in {"approach_collision", "lift_ik", "grasp_collision", "rrt_time"}


def test_heights_follow_the_size_and_the_wish_within_it():
    assert next(grasp_heights(replace(CAN, height=0.06))) == pytest.approx(0.030)
    assert next(grasp_heights(replace(CAN, height=0.12))) == pytest.approx(0.045)
    assert next(grasp_heights(replace(CAN, z=0.27 + 0.05))) == pytest.approx(0.05)
    assert next(grasp_heights(replace(CAN, z=0.27 + 0.20))) == pytest.approx(0.055)
    assert next(grasp_heights(replace(CAN, height=0.035, width=0.035))) == pytest.approx(0.01925)
    assert max(grasp_heights(PEN)) < 0.02


def test_a_hand_closes_low_on_what_a_finger_alone_would_throw_over():
    rules = DiagonalMouth(describe_nao().arms["left_arm"])
    narrow = replace(BOX, width=0.028, length=0.09, height=0.048)
    low, _, high = (rules.cost(narrow, 0.3, height, 0) for height in rules.heights(narrow))
    assert high > low + 0.1
    wide = replace(narrow, width=0.040, height=0.052)
    costs = [rules.cost(wide, 0.3, height, 0) for height in rules.heights(wide)]
    assert costs == pytest.approx([costs[0]] * 3)
    flat = replace(PEN, width=0.010, height=0.010)
    assert rules.cost(flat, 0.28, 0.0165, 0) == pytest.approx(0.0)


def test_a_hand_closes_deep_enough_that_a_thing_held_at_one_end_does_not_turn_out_of_it():
    rules = DiagonalMouth(describe_nao().arms["left_arm"])
    low_box = replace(BOX, width=0.034, length=0.10, height=0.034)
    deep, _, rim = (rules.cost(low_box, 0.3, height, 0) for height in rules.heights(low_box))
    assert rim > deep + 0.2
    assert rules.cost(PEN, 0.3, 0.016, 0) == rules.cost(replace(PEN, height=0.018), 0.3, 0.016, 0)


def test_a_pen_may_be_turned_and_a_small_box_taken_on_either_side():
    turns = np.array(closing_angles(PEN)) - PEN.theta
    assert np.abs(turns).max() == pytest.approx(0.65)
    assert closing_angles(replace(BOX, length=0.034)) == (0.6, 0.6 + math.pi / 2)
    assert closing_angles(BOX) == (0.6,)
    assert closing_angles(CAN) == (None,)
    assert openings(CAN)[0] == openings(PEN)[0] == 1.0


@pytest.mark.slow
def test_a_finger_of_a_panda_fits_between_two_boxes_that_stand_side_by_side() -> None:
    # Its spheres and the margin of neighbours take 31 mm when it is open, the finger itself less.
    box, yaw = replace(product("carton", 56), secret=NO_SECRET), 0.4
    length, width, height = box.extent
    place, across = np.array([0.45, -0.12]), np.array([-np.sin(yaw), np.cos(yaw)])
    beside = place + (width + 0.0285) * across
    with Workcell("panda", preset="fast") as cell:
        floor = cell.world.table_height
        cell.world.spawn(box, (place[0], place[1]), yaw)
        neighbour = cell.world.spawn(box, (beside[0], beside[1]), yaw)
        cell.world.step(0.2)
        before = cell.world.object_pose(neighbour).position
        centre = (float(beside[0]), float(beside[1]), floor + height / 2)
        obstacle = Obstacle.box("neighbour", centre, (length, width, height), yaw)
        request = GraspRequest(
            *place, yaw + np.pi / 2, width=width, length=length, height=height,
            table_height=floor, only_theta=True,
        )  # fmt: skip
        plan = cell.executor.plan(request, [obstacle], seed=1)
        assert isinstance(plan, PlannedGrasp)
        assert plan.opening < 0.7
        record = cell.executor.execute(plan, place=False)
        moved = cell.world.object_pose(neighbour).position - before
    assert record.reason == "ok"
    assert np.linalg.norm(moved) < 0.012
