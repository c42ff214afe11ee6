"""Kinematics and planning as services, on every model that comes with them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import simulate.services
from rtask.errors import ServiceError, UsageError
from rtask.services import ServiceHost
from simulate.motion.joint_messages import read_trajectory
from simulate.motion.kinematics import Chain
from simulate.robots import describe

ROBOTS = ("NAO", "Panda", "PlanarArm", "Point")


@pytest.fixture(scope="module")
def host() -> Iterator[ServiceHost]:
    with ServiceHost(simulate.services.SERVICES, check_every=1) as opened:
        for name, contents in simulate.services.DATASETS.items():
            opened.datasets.offer(name, contents)
        yield opened


def test_forward_kinematics_are_those_of_the_robot(host):
    robot = describe("nao")
    arm = robot.arm("left_arm")
    chain = Chain.of(robot, "left_arm")
    joints = np.array(arm.home)
    service = host.connect("example/Kinematics", {"robot": "robots/NAO"})
    root_from_wrist = service.forwardKinematics("left_arm", joints)
    _, position = chain.tool_poses(joints[None])
    # The robot's own chain ends in its hand and starts on the floor below the root.
    wrist_from_tool = np.eye(4)
    wrist_from_tool[:3, 3] = arm.tcp
    found = robot.base_from_root.matrix @ root_from_wrist @ wrist_from_tool
    # URDF text keeps nine digits.
    np.testing.assert_allclose(found[:3, 3], position[0], atol=1e-8)


@pytest.mark.parametrize("robot", ROBOTS)
def test_inverse_kinematics_bring_a_reachable_pose_back(host, robot):
    service = host.connect("example/Kinematics", {"robot": f"robots/{robot}"})
    rng = np.random.default_rng(3)
    for arm in service.describe().manipulators:
        share = rng.random((5, len(arm.joints)))
        for joints in arm.lower + share * (arm.upper - arm.lower):
            wanted = service.forwardKinematics(arm.name, joints)
            answer = service.inverseKinematics(arm.name, wanted)
            assert len(answer.solutions) >= 1
            for found in answer.solutions:
                reached = service.forwardKinematics(arm.name, found)
                # The tolerances of the service: 1 mm and 0.01 rad.
                assert np.linalg.norm(reached[:3, 3] - wanted[:3, 3]) <= 1e-3
                assert np.abs(reached[:3, :3] - wanted[:3, :3]).max() <= 1e-2


def test_a_pose_out_of_reach_has_no_solution_and_says_how_far_it_is(host):
    pose = np.eye(4)
    pose[0, 3] = 2.0
    answer = host.connect("example/Kinematics", {"robot": "robots/PlanarArm"}).inverseKinematics(
        "arm", pose
    )
    assert answer.solutions == []
    service = host.connect("example/Trajopt", {"robot": "robots/PlanarArm"})
    (nearest,) = service.trace("arm", [answer.nearest]).postures
    off = np.linalg.norm(nearest.pose[:3, 3] - pose[:3, 3])
    assert off == pytest.approx(answer.position_error)
    # The arm is 1.1 m long; the best posture found weighs distance against orientation.
    assert 0.9 - 1e-6 <= answer.position_error <= 1.2


def test_a_wrong_arm_and_a_wrong_number_of_joints_are_named(host):
    service = host.connect("example/Kinematics", {"robot": "robots/NAO"})
    with pytest.raises(ServiceError, match="no arm 'lef_arm'; did you mean 'left_arm'"):
        service.forwardKinematics("lef_arm", [0.0])
    with pytest.raises(ServiceError, match=r"the arm has 5 \(LShoulderPitch"):
        service.linkPoses("left_arm", [0.0])


@pytest.mark.parametrize(
    ("robot", "start", "goal", "obstacle"),
    [
        ("PlanarArm", [-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.7, 0.0, 0.0, 0.1]),
        ("Point", [-1.0, 0.0], [1.0, 0.0], [0.0, 0.0, 0.0, 0.3]),
    ],
)
def test_a_path_leads_around_what_is_in_the_way(host, robot, start, goal, obstacle):
    service = host.connect("example/Trajopt", {"robot": f"robots/{robot}"})
    straight = service.check("arm", [start, goal], [obstacle])
    assert (straight.free, straight.first_blocked) == (False, 0)
    planned = service.plan("arm", start, goal, obstacles=[obstacle])
    assert service.check("arm", planned.path, [obstacle]).free
    np.testing.assert_array_equal(planned.path[0], start)
    np.testing.assert_array_equal(planned.path[-1], goal)
    again = service.plan("arm", start, goal, obstacles=[obstacle])
    np.testing.assert_array_equal(np.array(again.path), np.array(planned.path))
    smoothed = service.smooth("arm", planned.path, [obstacle], tries=200)
    assert smoothed.length <= planned.length
    assert service.check("arm", smoothed.path, [obstacle]).free


def test_a_path_gets_times_that_a_driver_of_the_arm_can_follow(host):
    service = host.connect("example/Trajopt", {"robot": "robots/PlanarArm"})
    corners = [[-1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [1.0, 0.0, 0.0]]
    timed = service.time("arm", corners, speed=0.5)
    told = timed.trajectory
    way = read_trajectory(told, told["joint_names"], np.array(corners[0]))
    assert way.duration == pytest.approx(timed.duration_s)
    np.testing.assert_allclose(way.positions[[0, -1]], [corners[0], corners[-1]], atol=1e-9)
    speeds = np.abs(np.diff(way.positions, axis=0) / np.diff(way.times)[:, None])
    slow = service.time("arm", corners, speed=0.25)
    assert slow.duration_s > 1.5 * timed.duration_s
    again = read_trajectory(slow.trajectory, told["joint_names"], np.array(corners[0]))
    slower = np.abs(np.diff(again.positions, axis=0) / np.diff(again.times)[:, None])
    # Within a step of 10 ms, a mean over it.
    assert slower.max() == pytest.approx(speeds.max() / 2, rel=0.05)
    with pytest.raises(UsageError, match="speed: 0 is not above 0"):
        service.time("arm", corners, speed=0.0)


def test_a_goal_inside_an_obstacle_is_refused(host):
    service = host.connect("example/Trajopt", {"robot": "robots/Point"})
    with pytest.raises(ServiceError, match="goal: the robot touches"):
        service.plan("arm", [-1, 0], [1, 0], obstacles=[[1, 0, 0, 0.1]])
    with pytest.raises(ServiceError, match="goal: beyond the limits"):
        service.plan("arm", [-1, 0], [9, 0])


def test_a_trace_shows_links_pose_and_clearance_along_a_path(host):
    planning = host.connect("example/Trajopt", {"robot": "robots/PlanarArm"})
    kinematics = host.connect("example/Kinematics", {"robot": "robots/PlanarArm"})
    path = [[0.0, 0.0, 0.0], [1.0, 0.5, -0.5], [1.0, 1.0, 0.0]]
    ball = [2.0, 0.0, 0.0, 0.1]
    traced = planning.trace("arm", path, obstacles=[ball], samples=11).postures
    assert len(traced) == 11
    np.testing.assert_allclose([traced[0].joints, traced[-1].joints], [path[0], path[-1]])
    # The stretched arm ends at 1.1 m; the ball begins at 1.9 m, the link is 2 cm thick each way.
    assert traced[0].clearance == pytest.approx(1.9 - 1.1 - 0.02)
    for posture in traced:
        reached = kinematics.forwardKinematics("arm", posture.joints)
        np.testing.assert_allclose(posture.pose, reached)
        assert len(posture.links) == 3
        np.testing.assert_allclose(posture.links[-1][3:], reached[:3, 3], atol=1e-12)
    alone = planning.trace("arm", [path[1]]).postures
    assert [one.clearance for one in alone] == [None]
    with pytest.raises(ServiceError, match="1 or more postures, got 0"):
        planning.trace("arm", [])


def test_a_model_is_checked_before_it_is_stored_and_needs_no_meshes(host):
    service = host.connect("example/Kinematics", {"robot": "robots/Point"})
    model = host.datasets.read("robots/PlanarArm", "model")
    mesh = b'<collision><geometry><mesh filename="package://gone.stl"/></geometry></collision>'
    read = service.read(model.replace(b"<inertial>", mesh + b"<inertial>")).manipulators
    assert [(one.name, one.joints) for one in read] == [("link4", ["joint1", "joint2", "joint3"])]
    with pytest.raises(ServiceError, match="urdf: the model: joint 'joint2' names no link: 'lonk'"):
        service.read(model.replace(b'parent link="link1"', b'parent link="lonk"'))
    with pytest.raises(ServiceError, match="urdf: the model: not XML"):
        service.read(b"solid")
