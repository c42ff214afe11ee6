"""Worlds, bodies, and what the robot says of itself."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from rtask.errors import RobotError, UsageError
from simulate.robots.nao import describe_nao
from simulate.world.objects import product
from simulate.world.robot_body import RobotBody
from simulate.world.world import World


@pytest.fixture(scope="module")
def world():
    with World() as world:
        world.add_table()
        world.add_place_box("left")
        world.add_place_box("right")
        yield world


@pytest.fixture(scope="module")
def robot(world):
    return RobotBody(world, describe_nao())


def test_importing_the_core_loads_no_physics():
    code = "import sys, rtask; print('pybullet' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_a_window_without_display_is_one_clear_error(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(RobotError, match="no display"):
        World(gui=True)


def test_unknown_preset_and_side_are_named(world):
    with pytest.raises(UsageError, match="faithful, fast"):
        World(preset="slow")
    with pytest.raises(UsageError, match="'middle'"):
        world.add_place_box("middle")


def test_worlds_are_apart():
    with World() as first, World() as second:
        first.add_table()
        first.step(0.1)
        assert second.time == 0
        assert second.client.getNumBodies() == 0


def test_objects_rest_where_they_were_put(world):
    for kind in ("can", "ball", "box", "bottle", "pen"):
        spec = product(kind, 3)
        body = world.spawn(spec, (0.30, 0.1), 0.4)
        world.step(0.5)
        pose = world.object_pose(body)
        assert np.abs(pose.position[:2] - [0.30, 0.1]).max() < 0.002, kind
        assert pose.z == pytest.approx(world.table_height + spec.rest_height, abs=0.001)
        assert pose.yaw == pytest.approx(0.4, abs=0.02)
        assert world.on_table(body)
        world.remove(body)
    assert not world.objects


def test_boxes_stand_beside_the_work_area_mirrored(world):
    left, right = world.place_boxes["left"], world.place_boxes["right"]
    assert left.x_range == right.x_range
    assert left.y_range == (-right.y_range[1], -right.y_range[0])
    assert left.x_range[1] - left.x_range[0] == pytest.approx(0.14)
    ball = world.spawn(product("ball", 1), (*left.centre, left.floor + 0.05))
    world.client.resetBaseVelocity(ball, (0.4, 0.0, 0.0))
    world.step(2.0)
    x, y, _ = world.object_pose(ball).position
    world.remove(ball)
    assert left.x_range[0] < x < left.x_range[1]
    assert left.y_range[0] < y < left.y_range[1]


def test_arms_hold_their_homes(world, robot):
    world.step(0.3)
    for arm in ("left", "right"):
        np.testing.assert_allclose(robot.arm_joints(arm), robot.home(arm), atol=2e-3)


def test_looking_turns_the_camera_to_the_side(robot):
    poses = {side: robot.look(side) for side in ("left", "right", "ahead")}
    for pose in poses.values():
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert pose[2, 2] < -0.5  # the optical axis looks down
    assert poses["left"][1, 2] > 0.15 > -0.15 > poses["right"][1, 2]
    assert poses["ahead"][1, 2] == pytest.approx(0.0, abs=1e-9)
    mirrored = poses["left"][:3, 3] * [1, -1, 1]
    np.testing.assert_allclose(poses["right"][:3, 3], mirrored, atol=1e-12)
    with pytest.raises(RobotError, match="left, right, ahead"):
        robot.look("up")


def test_camera_pose_agrees_with_the_physics_engine(robot, world):
    """The camera box is welded to the head, so the head's pose and the fixed mount tell it."""
    from simulate.robots.description import transform_from

    q = np.array([0.3, 0.2])
    robot.set_head(q)
    state = world.client.getLinkState(
        robot.body, robot.link_index["Head"], computeForwardKinematics=True
    )
    base_from_head = np.eye(4)
    base_from_head[:3, :3] = np.array(world.client.getMatrixFromQuaternion(state[5])).reshape(3, 3)
    base_from_head[:3, 3] = state[4]
    mount = robot.description.joint("CameraDepth3_fixed").pose
    optical = robot.description.frames["camera_depth_optical_frame"][1]
    expected = base_from_head @ mount.matrix @ transform_from(optical.xyz, optical.rpy)
    np.testing.assert_allclose(robot.base_from_camera(q), expected, atol=1e-6)
    np.testing.assert_allclose(robot.base_from_camera(), expected, atol=1e-6)


def test_the_work_area_is_in_the_image(robot):
    for side, sign in (("left", 1), ("right", -1)):
        camera_from_base = np.linalg.inv(robot.look(side))
        corners = np.array(
            [[x, sign * y, z] for x in (0.11, 0.19) for y in (0.02, 0.19) for z in (0.27, 0.33)]
        )
        seen = corners @ camera_from_base[:3, :3].T + camera_from_base[:3, 3]
        u = seen[:, 0] / seen[:, 2] * 467.74 + 319.5
        v = seen[:, 1] / seen[:, 2] * 467.74 + 239.5
        assert ((u > 5) & (u < 634) & (v > 5) & (v < 474)).all(), (side, u, v)


def test_registration_names_both_hands_and_the_camera(robot):
    message = robot.describe("nao-1")
    assert message["name"] == "nao-1"
    assert {hand["name"] for hand in message["end_effectors"]} == {
        "nao_left_hand",
        "nao_right_hand",
    }
    assert {hand["gripper_type"] for hand in message["end_effectors"]} == {"nao_hand"}
    camera = message["cameras"][0]
    assert camera["fx"] == pytest.approx(467.74, abs=0.01)
    assert (camera["cx"], camera["cy"]) == (319.5, 239.5)
    assert robot.base_frame in message["frames"]


def test_registration_says_where_the_table_and_the_boxes_are():
    with World() as world:
        robot = RobotBody(world, describe_nao())
        assert robot.describe("nao-1")["places"] == []
        world.add_table()
        box = world.add_place_box("left")
        table, left = robot.describe("nao-1")["places"]
        assert (table["name"], table["rim_height"]) == ("table", 0.0)
        assert (left["name"], left["length"]) == (
            "left box",
            pytest.approx(world.workplace.box_inner),
        )
        assert [left["pose"]["position"][axis] for axis in "xyz"] == [
            *box.centre,
            world.table_height,
        ]
        aside = np.eye(4)
        aside[0, 3] = 1.0
        assert RobotBody(world, describe_nao(), aside).describe("nao-2")["places"] == []


def test_a_robot_stands_where_it_is_put():
    with World() as world:
        pose = np.eye(4)
        pose[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
        pose[:3, 3] = [1.0, 2.0, 0.0]
        robot = RobotBody(world, describe_nao(), pose)
        wrist = world.client.getLinkState(
            robot.body, robot.link_index["l_wrist"], computeForwardKinematics=True
        )[4]
        _, positions = robot.chains["left_arm"].link_frames(robot.home("left")[None])
        expected = pose[:3, :3] @ positions[0, -1] + pose[:3, 3]
        np.testing.assert_allclose(wrist, expected, atol=1e-6)
