"""Arms that end in a suction cup or in three fingers hold, place and refuse as jaws do."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rtask
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.gripper_files import end_effector_named
from grasp.spatial.meshes.shapes import box_mesh
from grasp.spatial.suction import plan_suction
from grasp.spatial.suction_cup import SuctionCup
from rtask.engine.engine import Engine
from rtask.errors import RobotError
from simulate.act.service import ActService
from simulate.grasping.clutter import hand_of
from simulate.grasping.executor import Workcell
from simulate.grasping.rules import GraspRequest
from simulate.onboarding.check import check_robot_body
from simulate.onboarding.guess import guess_robot
from simulate.robots import RobotDescription, describe
from simulate.robots.description import Pose
from simulate.robots.other_hands import MOUNT, cup_with_wrist
from simulate.robots.robot_files import load_robot, save_robot
from simulate.world.objects import ObjectSpec

pytestmark = pytest.mark.slow

HANDS = ("suction:0.015", "three:0.1")
SIZE = (0.05, 0.06, 0.06)
PLACE = (0.45, -0.10)


@pytest.fixture(params=HANDS, scope="module")
def cell(request: pytest.FixtureRequest) -> Iterator[Workcell]:
    with Workcell(describe("panda", hand=request.param), preset="fast") as cell:
        yield cell


WITH_A_CUP = pytest.mark.parametrize(
    "cell",
    [HANDS[0], pytest.param(HANDS[1], marks=pytest.mark.deep)],
    indirect=True,
    scope="module",
)
"""For what all hands have in common: three fingers as well where tests run deep."""


def put_box(cell: Workcell, mass: float = 0.2, size: tuple[float, float, float] = SIZE) -> int:
    body = cell.world.spawn(ObjectSpec("box", size, mass, 0, "box"), PLACE)
    cell.world.step(0.3)
    return body


def posed(cell: Workcell) -> GraspRequest:
    """Return a request for a pose of the tool from above, of points on the box."""
    table = cell.world.table_height
    cup = cell.robot.arm("panda_arm").cup
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = *PLACE, table + (SIZE[2] if cup else SIZE[2] / 2)
    # One finger of three along x, two on the sides across y.
    width, opening = (0.0, cup.give) if cup else (0.072, 0.1)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 9)] * 3), axis=-1).reshape(-1, 3)
    shell = grid[np.abs(grid).max(axis=1) > 0.49] * SIZE
    points = shell + np.array([*PLACE, table + SIZE[2] / 2])
    return GraspRequest.at_pose(pose, width, opening, points, table, 0.2)


@WITH_A_CUP
def test_a_pose_is_carried_out_and_the_thing_placed(cell: Workcell) -> None:
    body = put_box(cell)
    try:
        plan = cell.executor.plan(posed(cell))
        assert not isinstance(plan, str), plan
        record = cell.executor.execute(plan)
        assert record.judged_held.is_yes
        assert record.place_reason == "ok"
        assert cell.world.object_pose(body).position[1] < -0.2  # in the box on that side
    finally:
        cell.world.remove(body)


def test_a_cup_takes_a_thing_lower_than_its_neighbours_if_the_flange_stays_clear() -> None:
    """From the lip to the flange of the Panda, 4.5 cm in radius, it is 7 cm."""
    with Workcell(describe("panda", hand="suction:0.015"), preset="fast") as cell:
        request = posed(cell)
        top = request.table_height + SIZE[2]
        place = np.eye(4)
        place[:3, 3] = *PLACE, request.table_height + SIZE[2] / 2
        box = box_mesh(SIZE).moved(place)
        edge, sides = np.linspace(-0.03, 0.03, 13), PLACE[0] + np.array([-0.036, 0.036])
        for higher, says in ((0.045, "planned"), (0.09, "grasp_collision")):
            heights = np.arange(request.table_height, top + higher, 0.004)
            beside = np.stack(np.meshgrid(sides, PLACE[1] + edge, heights), axis=-1)
            plan = cell.executor.plan(request, [beside.reshape(-1, 3)])
            assert (plan if isinstance(plan, str) else "planned") == says
            # What is planned on the points knows of the flange, too.
            around = Surroundings(Support(request.table_height), beside.reshape(-1, 3))
            found = plan_suction(box, hand_of(cell.robot.description, "right"), around)
            from_above = any(one.approach[2] < -0.99 for one in found)
            assert from_above == (says == "planned")


def test_the_wrist_behind_a_cup_is_as_wide_as_the_flange_of_its_arm() -> None:
    panda = describe("panda", hand="suction:0.015")
    arm = panda.arm("right")
    x, y, z = cup_with_wrist(panda, arm).wrist or (0.0, 0.0, 0.0)
    # The flange of link 7 is round, 44 mm in radius, and its mesh ends 55 mm behind the stem.
    assert x * y == pytest.approx(np.pi * 0.044**2, rel=0.02)
    assert z == pytest.approx(0.055, abs=0.001)
    assert arm.cup is not None
    told = replace(arm, cup=replace(arm.cup, wrist=(0.1, 0.1, 0.02)))
    assert cup_with_wrist(panda, told) == told.cup


@pytest.mark.deep
@WITH_A_CUP
def test_where_nothing_stands_nothing_is_held(cell: Workcell) -> None:
    plan = cell.executor.plan(posed(cell))
    assert not isinstance(plan, str), plan
    record = cell.executor.execute(plan)
    assert record.reason == "missed"
    assert not record.judged_held.is_yes


@WITH_A_CUP
def test_the_act_service_grasps_and_puts_down(cell: Workcell) -> None:
    body = put_box(cell, size=(0.036, 0.036, 0.06))  # as large as the service assumes
    try:
        service = ActService(cell)
        upright = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
        x, y, z = cell.world.object_pose(body).position.tolist()
        goal = {"position": {"x": x, "y": y, "z": z}, "orientation": upright}
        answer = service.act({"action_type": "grasp", "goal_pose": goal})
        assert answer["reason"] == "ok"
        assert cell.world.object_pose(body).position[2] > z + 0.03
        aside = {"position": {"x": x, "y": y - 0.07, "z": z}, "orientation": upright}
        answer = service.act({"action_type": "place", "goal_pose": aside})
        assert answer["reason"] == "ok"
        assert cell.world.object_pose(body).position[:2] == pytest.approx((x, y - 0.07), abs=0.02)
    finally:
        cell.world.remove(body)


@pytest.mark.deep
@WITH_A_CUP
def test_the_way_home_goes_around_what_was_put_down(cell: Workcell) -> None:
    body = put_box(cell)
    try:
        table = cell.world.table_height
        size = dict(zip(("width", "length", "height"), SIZE, strict=True))
        plan = cell.executor.plan(GraspRequest(*PLACE, 0.0, **size, table_height=table))
        assert not isinstance(plan, str), plan
        run = cell.executor.begin(plan)
        assert run.grasp() == "ok"
        run.place_at(PLACE[0], -0.02)  # the straight way home leads through there
        assert cell.world.object_pose(body).position[:2] == pytest.approx((0.45, -0.02), abs=0.01)
    finally:
        cell.world.remove(body)


def test_a_vacuum_lets_go_of_what_is_too_heavy() -> None:
    """A lip of 8 mm radius bears 12 N; the box weighs 20 N."""
    with Workcell(describe("panda", hand="suction:0.008"), preset="fast") as cell:
        body = put_box(cell, mass=2.0)
        plan = cell.executor.plan(replace(posed(cell), mass=None))
        assert not isinstance(plan, str), plan
        record = cell.executor.execute(plan)
        assert not record.judged_held.is_yes
        assert cell.world.object_pose(body).position[2] < cell.world.table_height + 0.04


def test_a_file_describes_the_hand(tmp_path: Path) -> None:
    path = tmp_path / "cup.toml"
    path.write_text('kind = "suction"\nname = "vac"\nradius = 0.02\nmax_payload = 0.7\n')
    arm = describe("panda", hand=str(path)).arm("right")
    assert (arm.end_effector, arm.max_payload, arm.fingers) == ("vac", 0.7, ())
    assert arm.cup is not None
    assert arm.max_force == pytest.approx(arm.cup.force)
    path.write_text('name = "wide"\nmax_opening = 0.1\n')
    with pytest.raises(RobotError, match="describes jaws without links; an arm takes jaw:STROKE"):
        describe("panda", hand=str(path))
    with pytest.raises(RobotError, match=r"a radius in m, as in suction:0\.015"):
        describe("panda", hand="suction:wide")


@pytest.mark.parametrize("hand", [HANDS[0], pytest.param(HANDS[1], marks=pytest.mark.deep)])
def test_a_robot_of_a_urdf_takes_the_hand_and_its_settings_keep_it(
    hand: str, tmp_path: Path
) -> None:
    found = importlib.util.find_spec("pybullet_data")
    assert found is not None
    assert found.origin is not None
    urdf = Path(found.origin).parent / "kuka_iiwa" / "model.urdf"
    made = guess_robot(urdf, "kuka", gripper=hand)
    save_robot(made.settings, made.guessed, tmp_path / "kuka.toml")
    loaded = load_robot(tmp_path / "kuka.toml")
    assert loaded.arms == made.robot.arms
    arm = loaded.arm("right")
    assert (arm.cup or arm.three) == end_effector_named(hand)
    findings = list(check_robot_body(loaded))
    assert all(finding.passed for finding in findings), findings


def test_settings_of_a_cup_without_its_size_are_refused(tmp_path: Path) -> None:
    robot = describe("panda", hand="suction:0.015")
    found = importlib.util.find_spec("pybullet_data")
    assert found is not None
    assert found.origin is not None
    urdf = Path(found.origin).parent / "kuka_iiwa" / "model.urdf"
    arm = robot.arm("right")
    lines = [
        f'urdf = "{urdf}"', "[arms.arm]", f'grip = "{arm.grip}"', "side = 0", "joints = []",
        'wrist = "lbr_iiwa_link_7"', "tcp = [0, 0, 0]", "approach = [0, 0, 1]",
        "closing = [1, 0, 0]", "home = []", 'end_effector = "cup"', "fingers = []",
        "finger_range = 1.0", "mouth = 0.3", "max_payload = 1.0", "[workplace]",
    ]  # fmt: skip
    (tmp_path / "bad.toml").write_text("\n".join(lines))
    with pytest.raises(RobotError, match=r"a suction_cup needs its size: suction = RADIUS"):
        load_robot(tmp_path / "bad.toml")


def test_welding_keeps_frames_where_they_were() -> None:
    panda = describe("panda", hand="three:0.1")
    wrist, pose = panda.frames["panda_grasptarget"]
    moved = replace(panda, frames={"aside": ("made_finger_1", Pose((0.0, 0.0, 0.01)))})
    fixed = tuple(
        replace(joint, kind="fixed", mimic=None) if joint.child.startswith("made_finger") else joint
        for joint in panda.joints
    )
    link, at = RobotDescription(**{**moved.__dict__, "joints": fixed}).welded().frames["aside"]
    assert (wrist, link) == ("panda_link7", "panda_link7")
    assert MOUNT not in {one.name for one in panda.links}
    assert at.xyz[2] == pytest.approx(0.107 + 0.05 + 0.01)
    assert pose.xyz[2] == pytest.approx(0.107 + 0.05 + 0.051)


def test_a_hand_registers_as_what_it_is() -> None:
    cup, three = (describe("panda", hand=hand) for hand in HANDS)
    with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
        for name, robot in (("one", cup), ("two", three)):
            with Workcell(robot, preset="fast") as cell:
                engine.call("register_robot", cell.robot.describe(name))
        held = {one.robot_name: one.gripper for one in engine.context.grippers.all()}
    assert held["one"].contact_kind == "suction"
    assert held["one"].finger_width == pytest.approx(0.03)
    cup_on_flange, known = hand_of(cup, "right"), held["one"]
    assert isinstance(cup_on_flange, SuctionCup)
    assert isinstance(known, SuctionCup)
    assert known.wrist is not None
    # Sizes are kept to the micrometre.
    assert known.flange_radius == pytest.approx(cup_on_flange.flange_radius, abs=1e-6)
    assert held["two"].contact_kind == "three_fingers"
    # Each finger's share of the closing force, and the sizes that planning asks for.
    assert held["two"] == hand_of(three, "right")


def test_a_pile_is_picked_by_the_hand_that_the_arm_carries() -> None:
    cup, three = (hand_of(describe("panda", hand=hand), "right") for hand in HANDS)
    assert (cup.contact_kind, three.contact_kind) == ("suction", "three_fingers")
