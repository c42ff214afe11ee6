"""Places where a held thing may be let go, and the room that it takes on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simulate.grasping.attempt.run import AttemptRun
from simulate.grasping.executor import GraspRequest, PlannedGrasp, Workcell
from simulate.grasping.judgement import Answer, HeightMap, Judgement
from simulate.grasping.placing import PlacePlan, PlaceSpot, held_load, plan_place
from simulate.grasping.planning import GraspPlanner
from simulate.motion.arm_space import ALLOWED, ArmSpace
from simulate.motion.collision import Obstacle
from simulate.robots import describe
from simulate.robots.description import Floats
from simulate.world.hidden import NO_SECRET
from simulate.world.objects import ObjectSpec, product
from simulate.world.world import PlaceBox

_YAW, _OFF_M = 0.8, 0.045
BOX = PlaceBox("right", (0.40, 0.58), (-0.50, -0.30), 0.20, 0.23)


def seen(*things: tuple[float, float]) -> HeightMap:
    """Return the view of a box in which things of (place along x, height) m lie across it."""
    heights = np.zeros((30, 33))
    for x, height in things:
        start = round(x / 0.006)
        heights[start : start + 5, 5:28] = height
    return HeightMap(heights, np.array([0.40, -0.50]))


@pytest.mark.parametrize(
    ("view", "grounds"),
    [
        (None, (0.20,)),
        (seen(), (0.20,)),
        (seen((0.03, 0.04)), (0.24, 0.20)),
        (seen((0.03, 0.02), (0.09, 0.05)), (0.25, 0.20)),
        (seen((0.0, 0.03)), (0.23, 0.20)),
        (seen((0.03, 0.04), (0.09, 0.15)), (0.20,)),  # an arm is before it
    ],
)
def test_a_thing_is_let_go_over_what_lies_in_the_box(
    view: HeightMap | None, grounds: tuple[float, ...]
) -> None:
    spot = PlaceSpot.in_box(BOX, 0, 0.1, view)
    assert spot.grounds == pytest.approx(grounds)


def test_a_thing_is_let_go_where_the_robot_sees_the_box() -> None:
    x, y = BOX.centre
    hidden = seen()
    hidden.heights[:, 19:] = np.nan  # y > -0.386 m
    for used in range(5):
        spots = PlaceSpot.in_box(BOX, used, 0.05, hidden).centres
        assert [spot[1] > y for spot in spots] == [False, False, False, True, True]
        assert len({*spots}) == 5
    dark = HeightMap(np.full((30, 33), np.nan), np.array([0.40, -0.50]))
    assert PlaceSpot.in_box(BOX, 1, 0.05, dark).centres[0] == pytest.approx((x - 0.03, y + 0.03))


def test_a_thing_is_put_down_near_the_shoulder_from_farther_away() -> None:
    """There a Nao's arm does not get straight up: no line above the place is within its reach."""
    space = ArmSpace(describe("nao"))
    table = space.robot.workplace.table_height
    request = GraspRequest(0.15, -0.105, 0.0, width=0.03, length=0.03, height=0.07,
                           table_height=table, round=True)  # fmt: skip
    held = GraspPlanner(space).plan(request, [], seed=1)
    assert isinstance(held, PlannedGrasp)
    start, chain = held.lift.positions[-1], space.chains[held.arm]
    way = plan_place(space, held, start, PlaceSpot.on_table(0.131, -0.124, table))
    assert isinstance(way, PlacePlan)
    _, (over, down) = chain.tool_poses(way.lower.positions[[0, -1]])
    assert down == pytest.approx(way.tool, abs=0.006)
    assert np.linalg.norm(over[:2] - down[:2]) > 0.02
    # The open hand backs off along its approach, and does not push what it let go.
    rotation, _ = chain.tool_poses(way.lower.positions[-1:])
    _, away = chain.tool_poses(way.retreat.positions[:20])
    assert float((away[-1] - down) @ rotation[0, :, 2]) < 0.0
    assert plan_place(space, held, start, PlaceSpot.on_table(0.05, -0.124, table)) == "place_plan"


def test_the_open_hand_leaves_a_can_on_the_table_without_touching_it() -> None:
    """A way home from above it that went 18 mm into its top was taken, and toppled it."""
    robot = describe("panda")
    table = robot.workplace.table_height
    boxes = {side: PlaceBox.at(robot.workplace, side, table) for side in ("left", "right")}
    walls = [Obstacle.box("box", *wall) for box in boxes.values() for wall in box.walls()]
    space = ArmSpace(robot, walls)
    planner = GraspPlanner(space, box_for=lambda side, y: boxes["left" if y > 0 else "right"])
    to = (0.42471, -0.17680)
    request = GraspRequest(0.40555, -0.03768, 0.94926, width=0.03, length=0.04, height=0.0833,
                           table_height=table, only_theta=True)  # fmt: skip
    held = planner.plan(request, [], seed=0)
    assert isinstance(held, PlannedGrasp)
    way = plan_place(space, held, held.lift.positions[-1], PlaceSpot.on_table(*to, table))
    assert isinstance(way, PlacePlan)
    chain, hand = space.chains[held.arm], space.spheres(held.arm, held.opening)
    rotation, position = chain.tool_poses(way.lower.positions[-1:])
    base_from_tool = np.eye(4)
    base_from_tool[:3, :3], base_from_tool[:3, 3] = rotation[0], position[0]
    load = held_load(held, chain)
    base_from_load = base_from_tool @ load.tool_from_load
    can = Obstacle("placed", base_from_load[:3, 3], load.size / 2, base_from_load[:3, :3])
    around = space.surroundings(held.arm, table, [can])
    apart = hand.clearances(way.retreat.positions, around, hand.slack(around, ALLOWED))
    assert apart.min() > 0


@pytest.mark.slow
@pytest.mark.parametrize(("x", "y"), [(0.50, -0.15), (0.55, -0.10)])
def test_a_long_thing_held_by_its_end_clears_the_walls_of_the_box(x: float, y: float) -> None:
    # Not its middle is in the hand: the other end sticks out twice as far as from there.
    bar = replace(product("bar", 12), mass=0.2, secret=NO_SECRET)
    length, width, height = bar.extent
    with Workcell("panda", preset="fast") as cell:
        body = cell.world.spawn(bar, (x, y), _YAW)
        cell.world.step(0.2)
        request = GraspRequest(
            x=x + _OFF_M * np.cos(_YAW), y=y + _OFF_M * np.sin(_YAW),
            theta=_YAW + np.pi / 2, width=width, height=height, length=length,
            table_height=cell.world.table_height, only_theta=True,
            outline=(x, y, _YAW, length, width),
        )  # fmt: skip
        plan = cell.executor.plan(request, seed=1)
        assert isinstance(plan, PlannedGrasp)
        box = cell.world.place_boxes["right"]
        record = cell.executor.execute(plan)
        assert (record.reason, record.place_reason) == ("ok", "ok")
        there = cell.world.object_pose(body)
        assert box.x_range[0] < there.x < box.x_range[1]
        assert box.y_range[0] < there.y < box.y_range[1]


def held_in_the_middle(
    cell: Workcell, spec: ObjectSpec, x: float, y: float, yaw: float
) -> PlannedGrasp:
    """Return a plan for a grasp of the middle of a bar."""
    length, width, height = spec.extent
    request = GraspRequest(
        x=x, y=y, theta=yaw + np.pi / 2, width=width, height=height, length=length,
        table_height=cell.world.table_height, only_theta=True,
        outline=(x, y, yaw, length, width),
    )  # fmt: skip
    plan = cell.executor.plan(request, seed=1)
    assert isinstance(plan, PlannedGrasp)
    return plan


@pytest.mark.slow
@pytest.mark.parametrize("turn", [-0.85, 0.85])
def test_the_end_that_hangs_from_the_hand_is_carried_over_the_wall_of_the_box(turn: float) -> None:
    with Workcell("panda", preset="fast") as cell:
        plan = held_in_the_middle(cell, product("bar", 50), 0.47, -0.15, _YAW)
        space, box = cell.executor.space_of(plan.stance), cell.world.place_boxes["right"]
        spot = PlaceSpot.in_box(box, 0, 0.13)
        way = plan_place(space, plan, plan.lift.positions[-1], spot, turn)
        chain = space.chains[plan.arm]
    assert not isinstance(way, str)
    load = held_load(plan, chain).turned(turn)
    centres, radii = load.spheres()
    rotations, positions = chain.tool_poses(way.transport.positions)
    points = centres @ rotations.transpose(0, 2, 1) + positions[:, None]
    over_wall = np.abs(points[..., 1] - box.y_range[1]) < radii[0]
    bottoms = (points[..., 2] - radii[0])[over_wall]
    assert bottoms.size
    assert bottoms.min() > box.rim
    heights = positions[:, 2] - chain.tool_poses(plan.posture[None])[1][0, 2]
    assert heights[0] == pytest.approx(0.06, abs=0.01)
    assert heights.max() > 0.09  # it rises before it goes aside
    assert load.bottom(_pose(rotations[-1], positions[-1])) > box.rim


@pytest.mark.parametrize(("height", "rises"), [(0.16, True), (0.60, False)])
def test_a_load_beside_high_neighbours_rises_until_it_is_free(height: float, rises: bool) -> None:
    """6 cm over the table, where the lift ends, it still stands between them, as they are seen."""
    with Workcell("panda", preset="fast") as cell:
        table = cell.world.table_height
        request = GraspRequest(0.47, -0.12, 0.0, width=0.04, length=0.06, height=0.08,
                               table_height=table)  # fmt: skip
        plan = cell.executor.plan(request, seed=1)
        assert isinstance(plan, PlannedGrasp)
        middle = table + height / 2
        walls = [  # each reaches 2 cm into the load
            Obstacle.box("neighbour", (0.47, -0.12 + side * 0.04, middle), (0.02, 0.06, height))
            for side in (-1, 1)
        ]
        space, box = cell.executor.space_of(plan.stance), cell.world.place_boxes["right"]
        crowded = replace(plan, obstacles=tuple(walls))
        start = plan.lift.positions[-1]
        way = plan_place(space, crowded, start, PlaceSpot.in_box(box, 0, 0.08))
        chain = space.chains[plan.arm]
        if not rises:  # the arm gets no higher than they are
            assert way == "place_plan"
            return
        assert not isinstance(way, str)
        rotations, tools = chain.tool_poses(way.transport.positions)
        load = held_load(plan, chain)
        bottoms = np.array(
            [load.bottom(_pose(r, t)) for r, t in zip(rotations, tools, strict=True)]
        )
        beside = np.linalg.norm(tools[:, :2] - tools[0, :2], axis=1)
    # It goes aside only above them, but for the 4 mm that it may touch; lines are kept within 2 mm.
    assert bottoms[0] < table + 0.08
    assert bottoms[beside > 0.02][0] > table + height - 0.006


@pytest.mark.slow
def test_a_bar_that_turns_in_the_hand_is_seen_to_and_reaches_the_box() -> None:
    # Carried as if it lay in the hand as it lay on the table, it hits the wall of the box.
    bar, place, yaw = product("bar", 31), (0.436, -0.113), 1.134
    with Workcell("panda", preset="fast") as cell:
        body = cell.world.spawn(bar, place, yaw)
        cell.world.step(0.2)
        record = cell.executor.execute(held_in_the_middle(cell, bar, *place, yaw))
        there = cell.world.object_pose(body)
        box = cell.world.place_boxes["right"]
    assert "turned by" in record.evidence
    assert (record.reason, record.place_reason) == ("ok", "ok")
    assert box.x_range[0] < there.x < box.x_range[1]
    assert box.y_range[0] < there.y < box.y_range[1]


@pytest.mark.slow
def test_an_end_that_hangs_is_lifted_off_the_table_where_no_look_sees_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(AttemptRun, "_judge_clear", lambda run: Judgement("unknown"))
    flask = product("flask", 74)
    length, width, height = flask.extent
    x, y, yaw, off = 0.47, -0.13, 0.3, -0.0221
    touches: dict[str, bool] = {}
    with Workcell("panda", preset="fast") as cell:
        body = cell.world.spawn(flask, (x, y), yaw)
        cell.world.step(0.2)
        request = GraspRequest(
            x=x + off * np.cos(yaw), y=y + off * np.sin(yaw), theta=yaw + np.pi / 2, width=width,
            height=height, length=length, table_height=cell.world.table_height, only_theta=True,
            outline=(x, y, yaw, length, width),
        )  # fmt: skip
        plan = cell.executor.plan(request, seed=1)
        assert isinstance(plan, PlannedGrasp)
        record = cell.executor.execute(
            plan, lambda phase: touches.update({phase: cell.world.on_table(body)})
        )
    assert touches["close"]
    assert not touches["lift"]
    assert not touches["hold"]
    assert record.reason == "ok"


@pytest.mark.slow
def test_what_is_held_in_the_middle_is_lifted_no_higher_than_need_be() -> None:
    bar = replace(product("bar", 61), secret=NO_SECRET)  # 10 cm long: no end can hang to the table
    with Workcell("panda", preset="fast") as cell:
        cell.world.spawn(bar, (0.47, -0.15), _YAW)
        cell.world.step(0.2)
        plan = held_in_the_middle(cell, bar, 0.47, -0.15, _YAW)
        record = cell.executor.execute(plan, place=False)
    assert record.reason == "ok"
    assert record.lifted_m < 0.07


@pytest.mark.slow
def test_what_turns_on_in_the_hand_while_it_is_held_is_lifted_further_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # It was clear after the lift, hangs low after the hold, and is clear again higher up.
    answers: list[Answer] = ["yes", "no", "yes"]
    monkeypatch.setattr(AttemptRun, "_judge_clear", lambda run: Judgement(answers.pop(0)))
    with Workcell("panda", preset="fast") as cell:
        cell.world.spawn(replace(product("bar", 61), secret=NO_SECRET), (0.47, -0.15), _YAW)
        cell.world.step(0.2)
        plan = held_in_the_middle(cell, product("bar", 61), 0.47, -0.15, _YAW)
        record = cell.executor.execute(plan, place=False)
    assert record.reason == "ok"
    assert record.lifted_m > 0.08
    assert not answers


@pytest.mark.slow
def test_the_arm_before_a_box_is_not_taken_for_what_lies_in_it() -> None:
    with Workcell("nao", preset="fast") as cell:
        cell.world.step(0.5)
        request = GraspRequest(0.15, -0.10, 0.0, width=0.03, height=0.08, length=0.03, round=True)
        plan = cell.executor.plan(request, seed=1)
        assert isinstance(plan, PlannedGrasp)
        run = cell.executor.begin(plan)
        seen = run.looks.box(cell.world.place_boxes["right"])
    assert seen.is_seen
    assert seen.occupied[1:-1, 1:-1].sum() <= 2


def _pose(rotation: Floats, position: Floats) -> Floats:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def test_a_thing_is_turned_as_asked_where_that_is_possible_and_anyhow_elsewhere():
    spot = PlaceSpot(0.2, ((0.4, 0.1), (0.5, 0.1)), closings=((0.0, np.pi / 2), ()))
    turned = [
        (centre, None if way is None else way.round(6).tolist()) for centre, way in spot.turned
    ]
    assert turned == [
        ((0.4, 0.1), [1.0, 0.0, 0.0]), ((0.4, 0.1), [0.0, 1.0, 0.0]),
        ((0.4, 0.1), None), ((0.5, 0.1), None),
    ]  # fmt: skip
    assert [way for _, way in PlaceSpot.on_table(0.4, 0.1, 0.2).turned] == [None]
