"""An arm in ROS 2, its driver played by a stand-in for rclpy's action server."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rtask.cli.ros.schema import engine_schema
from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers.joint_states import JointLimits
from simulate.drivers.rclpy_arm import RclpyArm
from simulate.motion.trajectory import Trajectory, time_path
from tests.processes import wait_until
from tests.rtask.ros2.standin import ActionServer, Clock, GoalHandle, World, install
from tests.simulate.drivers.benches import be_patient, waits_restored

pytest.importorskip("rosbags")

ACTION, JOINTS = "/arm_controller/follow_joint_trajectory", ("shoulder", "elbow")
LIMITS = JointLimits(np.full(2, -2.0), np.full(2, 2.0))


@pytest.fixture(scope="module")
def types() -> World:
    return World(engine_schema())


class Robot:
    """A driver that publishes joint states, and carries goals out as it is told.

    Its states say of the joints what ``at`` is.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.at = np.zeros(2)
        self.goals: list[GoalHandle] = []
        self.ends: Callable[[GoalHandle], tuple[str, int]] = self.arrive
        self.accepts = True
        self.is_silent = False
        self.published = 0
        self.said: list[str] = []
        self._ended = threading.Event()
        self.node = sys.modules["rclpy.lifecycle"].LifecycleNode("reach")
        ActionServer(
            self.node, sys.modules["control_msgs.action"].FollowJointTrajectory, ACTION,
            self._execute, goal_callback=lambda goal: "accept" if self.accepts else "reject",
            handle_accepted_callback=lambda handle: handle.execute(),
        )  # fmt: skip
        self.arm = RclpyArm(self.node, ACTION, JOINTS, limits=LIMITS, say=self.said.append)
        self._thread = threading.Thread(target=self._publish, daemon=True)
        self._thread.start()

    def _publish(self) -> None:
        while not self._ended.wait(0.02):
            if self.is_silent:
                continue
            state = self.world.types.make("sensor_msgs/JointState")
            state.header.stamp.secs, state.header.stamp.nsecs = divmod(time.time_ns(), 10**9)
            state.name, state.position = ["hand", *reversed(JOINTS)], [0.0, *self.at[::-1]]
            self.world.publish("/joint_states", state)
            self.published += 1

    def arrive(self, handle: GoalHandle) -> tuple[str, int]:
        points = handle.request.trajectory.points
        for point in points:
            self.at = np.array(point.positions)
            before = self.published
            wait_until(lambda before=before: self.published > before)
        return "succeed", 0

    def _execute(self, handle: GoalHandle) -> Any:
        self.goals.append(handle)
        status, code = self.ends(handle)
        getattr(handle, status)()
        result = self.world.class_of("control_msgs/msg/FollowJointTrajectory_Result")()
        result.error_code, result.error_string = code, "told by the driver"
        return result

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


@pytest.fixture
def robot(types: World, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    types.actions.clear()
    types.subscriptions.clear()
    install(types, lambda name, module: monkeypatch.setitem(sys.modules, name, module))
    monkeypatch.setattr(Clock, "now", lambda self: SimpleNamespace(nanoseconds=time.time_ns()))
    with waits_restored():
        be_patient()
        made = Robot(types)
        yield made
        made.close()


def way(to: float) -> Trajectory:
    return time_path(np.array([[0.0, 0.0], [0.0, to]]), np.full(2, 2.0))


def test_the_arm_follows_and_says_before_it_moves_what_a_lost_link_means(robot):
    robot.arm.follow(way(0.3))
    np.testing.assert_allclose(robot.arm.measured(), [0.0, 0.3])
    [goal] = robot.goals
    assert list(goal.request.trajectory.joint_names) == list(JOINTS)
    assert not goal.is_cancel_requested
    assert [words for words in robot.said if "emergency stop" in words] == robot.said


@pytest.mark.parametrize(
    ("status", "code", "words"),
    [
        ("succeed", 0, "elbow ended 0.30 rad from its goal"),
        ("abort", 0, r"aborted \(status 6 of ROS 2\)"),
        ("canceled", 0, r"canceled \(status 5 of ROS 2\)"),
        ("abort", -1, r"ended with -1 \(INVALID_GOAL\): told by the driver"),
        ("abort", -2, r"ended with -2 \(INVALID_JOINTS\)"),
        ("abort", -3, r"ended with -3 \(OLD_HEADER_TIMESTAMP\)"),
        ("succeed", -4, r"ended with -4 \(PATH_TOLERANCE_VIOLATED\): told by the driver"),
        ("abort", -5, r"ended with -5 \(GOAL_TOLERANCE_VIOLATED\)"),
        ("abort", -99, "ended with -99: told"),
    ],
)
def test_every_end_but_an_arrival_that_was_measured_fails_and_cancels(robot, status, code, words):
    robot.ends = lambda handle: (status, code)
    with pytest.raises(RobotError, match=words):
        robot.arm.follow(way(0.3))
    assert robot.goals[0].is_cancel_requested


def test_a_rejected_goal_is_said_and_the_arm_is_seen_to_rest(robot):
    robot.accepts = False
    with pytest.raises(RobotError, match="the driver rejected the goal"):
        robot.arm.follow(way(0.3))
    assert len(robot.said) == 1, "only what is said before a motion"


def test_a_driver_whose_states_stop_is_cancelled_and_nobody_knows_where_the_arm_is(
    robot, monkeypatch
):
    monkeypatch.setattr("simulate.drivers.watch._SILENT_S", 2.0)  # the states before it are heard
    monkeypatch.setattr("simulate.drivers.action_arm._STOPPED_S", 0.2)

    def stop_telling(handle: GoalHandle) -> tuple[str, int]:
        robot.is_silent = True
        wait_until(lambda: handle.is_cancel_requested)
        return "canceled", 0

    robot.ends = stop_telling
    with pytest.raises(RemoteUnavailableError, match=r"no new joint state came for 2 s"):
        robot.arm.follow(way(0.3))
    assert robot.goals[0].is_cancel_requested
    assert "nobody can tell whether the arm" in robot.said[-1]


def test_no_goal_is_sent_from_elsewhere_or_to_a_driver_that_is_not_there(robot):
    robot.at = np.array([0.0, 0.5])
    with pytest.raises(RobotError, match=r"elbow is 0\.50 rad from the start"):
        robot.arm.follow(way(0.3))
    assert robot.goals == []
    with pytest.raises(RemoteUnavailableError, match="no action /other answers within"):
        RclpyArm(robot.node, "/other", JOINTS, wait_s=0.1)
