"""The act service: names of the thesis, what it answers, what it refuses, what comes out of it."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from rtask.errors import RobotError, UsageError
from rtask.wire.ros import ros_types
from simulate.act.request import ActMessage, ActRequest
from simulate.act.service import ActService, theta_offsets
from simulate.act.trials import csv_log, place_test, random_goal, reach_test
from simulate.act.workspace import map_workspace
from simulate.commands import simulate
from simulate.grasping.attempt.driving import ArmDrive
from simulate.grasping.executor import Workcell
from simulate.motion.arm_space import ArmSpace
from simulate.motion.trajectory import time_path
from simulate.robots import describe
from simulate.world.objects import product
from tests.commands import run_command

NAO = describe("nao")
# The service of the thesis, chapter 4.3, as its file has it.
THESIS = (
    "robot_name", "action_type", "arm_name", "plan_name", "end_eff_name", "attempts_max_in",
    "planing_time_in", "tolerance_min_in", "angle_resolution_in", "grasp_depth_in",
    "distance_error_allowed", "goal_pose",
)  # fmt: skip


def pose(x, y, z, yaw=0.0):
    turn = {"x": 0.0, "y": 0.0, "z": np.sin(yaw / 2), "w": np.cos(yaw / 2)}
    return {"position": {"x": x, "y": y, "z": z}, "orientation": turn}


@pytest.fixture(scope="module")
def panda():
    """The robot whose physics is cheaper."""
    with Workcell("panda") as cell:
        yield cell


@pytest.fixture
def service(panda):
    made = ActService(panda)
    yield made
    made.go_home()
    for body in list(panda.world.objects):
        panda.world.remove(body)


def goal(cell, dx=0.0, dy=-0.10, height=0.035, yaw=0.0):
    place = cell.world.workplace
    return pose(sum(place.area_x) / 2 + dx, dy, cell.world.table_height + height, yaw)


def test_the_request_has_the_fields_of_the_thesis_and_no_other():
    assert tuple(ActMessage.model_fields) == THESIS


def test_what_is_left_out_has_the_documented_defaults():
    read = ActRequest.read({"goal_pose": pose(0.15, -0.1, 0.3, 0.5)}, NAO)
    assert (read.action, read.arm, read.attempts, read.planning_s) == ("reach", "auto", 5, 5.0)
    assert (read.tolerance, read.angle_step, read.depth) == (0.0025, 0.2618, 0.0)
    assert read.error_allowed == 0.01
    assert read.theta == pytest.approx(0.5)


def test_zeros_and_empty_texts_of_a_typed_client_are_the_defaults():
    zero = {"string": "", "int64": 0, "float64": 0.0}
    (members,) = ros_types("rtask/ActRequest", ActMessage).values()
    typed = {member.name: zero.get(member.type) for member in members}
    read = ActRequest.read({**typed, "goal_pose": pose(0.15, -0.1, 0.3)}, NAO)
    assert (read.action, read.attempts, read.planning_s, read.tolerance) == (
        "reach", 5, 5.0, 0.0025,
    )  # fmt: skip
    assert read.angle_step == 0.0  # theta and no other
    assert ActRequest.read({**typed, "action_type": "home"}, NAO).action == "home"


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ({"planning_time_in": 3}, "did you mean 'planing_time_in'"),
        ({"action_type": "pick_plaec"}, "did you mean 'pick_place'"),
        ({"plan_name": "rrt_conect"}, "did you mean 'rrt_connect'"),
        ({"end_eff_name": "nao_rihgt_hand"}, "did you mean 'nao_right_hand'"),
        ({"end_eff_name": "RHand", "arm_name": "left_arm"}, "is the hand of right_arm"),
        ({"robot_name": "noa"}, "did you mean 'nao'"),
        ({"attempts_max_in": -1}, "below 0"),
        ({"tolerance_min_in": "wide"}, "a finite number"),
        ({}, "goal_pose is missing"),
        ({"goal_pose": pose(float("nan"), 0, 0)}, "goal_pose"),
    ],
)
def test_wrong_requests_are_refused_by_name(message, words):
    with pytest.raises(UsageError, match=words):
        ActRequest.read({"action_type": "reach", **message}, NAO)


def test_an_arm_that_is_not_there_is_named():
    with pytest.raises(RobotError, match="no arm 'third_arm'"):
        ActRequest.read({"goal_pose": pose(0, 0, 1), "arm_name": "third_arm"}, NAO)


@pytest.mark.parametrize("hand", ["nao_left_hand", "LHand"])
def test_a_hand_names_its_arm(hand):
    read = ActRequest.read({"goal_pose": pose(0.15, -0.1, 0.3), "end_eff_name": hand}, NAO)
    assert read.arm == "left_arm"


def test_theta_is_turned_to_either_side_up_to_a_right_angle():
    found = list(theta_offsets(0.5, 20))
    assert found[:5] == [0.0, 0.5, -0.5, 1.0, -1.0]
    assert max(np.abs(found)) <= np.pi / 2
    assert list(theta_offsets(0.0, 3)) == [0.0, 0.0, 0.0]


def test_reach_goes_there_stays_there_and_home_leaves(panda, service):
    wanted = goal(panda)
    answer = service.act({"action_type": "reach", "goal_pose": wanted})
    assert (answer["success"], answer["reason"], answer["held"]) == (1, "ok", False)
    assert answer["distance_error_m"] <= 0.01
    tool = panda.robot.tool_pose("panda_arm")[:3, 3]
    assert tool[:2] == pytest.approx([wanted["position"]["x"], wanted["position"]["y"]], abs=0.01)
    assert service.act({"action_type": "home"})["success"] == 1
    np.testing.assert_allclose(
        panda.robot.arm_joints("panda_arm"), panda.robot.home("panda_arm"), atol=0.02
    )


def test_home_brings_an_arm_home_that_a_controller_moved(panda, service):
    robot, home = panda.robot, panda.robot.home("panda_arm")
    drive = ArmDrive(panda.world, robot, "panda_arm", lambda phase: None)
    assert drive.follow(time_path(np.stack([home, home + np.eye(7)[6] * 0.3]), np.full(7, 0.8)))
    answer = service.act({"action_type": "home"})
    assert (answer["success"], answer["reason"], answer["distance_error_m"]) == (1, "ok", 0.0)
    np.testing.assert_allclose(robot.arm_joints("panda_arm"), home, atol=0.02)


def test_an_arm_that_does_not_get_home_is_no_success(service, monkeypatch):
    monkeypatch.setattr(ArmDrive, "start_at_home", lambda drive: False)
    answer = service.act({"action_type": "home"})
    assert (answer["success"], answer["reason"], answer["distance_error_m"]) == (
        0,
        "tracking",
        None,
    )


@pytest.mark.slow
def test_pick_and_place_in_one_and_in_two_requests(panda, service):
    body = panda.world.spawn(product("can", 3), (0.47, -0.10))
    panda.world.step(0.2)
    grasped = service.act({"action_type": "grasp", "goal_pose": goal(panda)})
    assert (grasped["success"], grasped["held"], grasped["placed"]) == (1, True, False)
    assert service.has_the_arm
    assert panda.world.object_pose(body).z > panda.world.table_height + 0.05
    placed = service.act({"action_type": "place", "goal_pose": goal(panda, 0.03, 0.05)})
    assert (placed["success"], placed["placed"], placed["reason"]) == (1, True, "ok")
    at = panda.world.object_pose(body)
    assert (at.x, at.y) == pytest.approx((0.50, 0.05), abs=0.05)
    panda.world.client.resetBasePositionAndOrientation(
        body, (0.47, 0.10, panda.world.table_height + 0.04), (0, 0, 0, 1)
    )
    panda.world.step(0.2)
    both = service.act({"action_type": "pick_place", "goal_pose": goal(panda, dy=0.10)})
    assert (both["held"], both["placed"], both["reason"]) == (True, True, "ok")
    box = panda.world.place_boxes["left"]
    assert box.y_range[0] < panda.world.object_pose(body).y < box.y_range[1]
    json.dumps(both, allow_nan=False)


@pytest.mark.slow
def test_success_says_nothing_about_the_object(service, panda):
    """The thesis: true when the pose was reached, not when something was grasped."""
    answer = service.act({"action_type": "grasp", "goal_pose": goal(panda)})
    assert (answer["success"], answer["held"], answer["reason"]) == (1, False, "missed")


@pytest.mark.parametrize(
    ("wanted", "reason"),
    [
        (pose(3.0, 0.0, 0.3), "ik"),
        (pose(0.47, -0.1, 0.1), "grasp_collision"),
    ],
)
def test_a_goal_out_of_reach_has_its_reason(service, wanted, reason):
    answer = service.act({"action_type": "reach", "goal_pose": wanted})
    assert (answer["success"], answer["reason"], answer["arm"]) == (0, reason, "")
    assert answer["distance_error_m"] is None


def test_no_time_to_plan_is_a_reason(service):
    request = {"goal_pose": pose(3.0, 0.0, 0.3), "planing_time_in": 1e-9, "attempts_max_in": 3}
    assert service.act(request)["reason"] == "timed_out"


def test_the_limit_of_planning_counts_work_and_not_the_clock(service, monkeypatch):
    request = {"goal_pose": pose(3.0, 0.0, 0.3), "planing_time_in": 0.2, "attempts_max_in": 90}
    executor = service.cell.executor
    spent = []
    for clock in (0.0, 1e6):
        ticks = iter(range(10**6))
        monkeypatch.setattr("time.monotonic", lambda ticks=ticks, by=clock: by * next(ticks))
        before = executor.planning_work
        assert service.act(request)["reason"] == "timed_out"
        spent.append(executor.planning_work - before)
    assert spent[0] == spent[1] > 0.2 * 40_000


def test_random_goals_depend_on_seed_and_number_only(service):
    first = random_goal(service, 4, 7, "reach")
    assert first == random_goal(service, 4, 7, "reach")
    assert first != random_goal(service, 4, 8, "reach")
    assert first != random_goal(service, 4, 7, "place")


@pytest.mark.slow
def test_the_test_interface_reaches_and_places(service, tmp_path):
    heard, path = [], tmp_path / "reach.csv"

    def hear(trial):
        write(trial)
        heard.append(trial)
        assert len(path.read_text().splitlines()) == 1 + len(heard)  # nothing waits for the end

    with csv_log(path) as write:
        reached = reach_test(service, 3, seed=1, on_trial=hear)
    placed = place_test(service, 2, seed=1)
    assert heard == reached
    assert [t.reached for t in reached + placed] == [True] * 5
    assert all(t.error_m < 0.01 for t in reached + placed)
    lines = path.read_text().splitlines()
    assert lines[0].startswith("number,x,y,z,theta,reached,reason")
    assert len(lines) == 4


@pytest.mark.slow
def test_the_workspace_is_what_both_arms_reach_and_a_picture_of_it(tmp_path):
    found = map_workspace(ArmSpace(NAO), step=0.06, angles=3)
    assert found.arms == ("left_arm", "right_arm")
    # Mirrored arms, mirrored maps: random starts of inverse kinematics may cost a direction.
    left, right = found.share[0, 0], found.share[1, 0][:, ::-1]
    assert np.abs(left - right).mean() < 0.1
    assert left[:, found.y > 0].sum() > 5 * left[:, found.y < -0.06].sum()
    assert 0.005 < found.area_m2(0.3)[found.heights[0]] < 0.1
    found.write_png(tmp_path / "map.png")
    found.write_npz(tmp_path / "map.npz")
    picture = cv2.imread(str(tmp_path / "map.png"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10
    with np.load(tmp_path / "map.npz") as data:
        np.testing.assert_array_equal(data["share"], found.share)


@pytest.mark.slow
def test_a_torso_that_leans_reaches_more_and_farther():
    maps = [
        map_workspace(ArmSpace(describe(n)), step=0.05, angles=4) for n in ("nao", "nao_leaning")
    ]
    upright, leaning = (found.best[0] for found in maps)
    assert leaning.sum() > 1.05 * upright.sum()
    farthest = [found.x[found.best[0].max(axis=1) > 0].max() for found in maps]
    assert farthest[1] > farthest[0]


@pytest.mark.slow
def test_the_commands_print_a_table_or_json(tmp_path):
    run = CliRunner().invoke
    shown = run(simulate, ["act-test", "reach", "--robot", "panda", "-n", "1"])
    assert shown.exit_code == 0, shown.output
    assert "panda: reached 1 of 1 (ok 1)" in shown.output
    for test in ("reach", "place"):  # in a process of its own: Bullet writes to its descriptor 1
        command = ("simulate", "act-test", test, "--robot", "panda", "-n", "1", "--json")
        alone = run_command(*command, check=True)
        assert json.loads(alone.stdout)["reached"] == 1
    out = tmp_path / "map"
    told = run(
        simulate,
        ["act-test", "workspace", "--robot", "panda", "--step", "0.15", "--angles", "2",
         "--out", str(out), "--json"],
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    assert json.loads(told.output)["area_cm2"]["0.23"] > 1000
    assert out.with_suffix(".png").exists()
    wrong = run(simulate, ["act-test", "reach", "--robot", "pandda"])
    assert "did you mean 'panda'" in str(wrong.exception)
