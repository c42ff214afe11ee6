"""A simulated arm and its sensors in ROS 2, over a stand-in for rclpy."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rtask.cli.ros.schema import engine_schema
from rtask.errors import RobotError
from simulate.act.service import ActService
from simulate.drivers.rclpy_arm import RclpyArm
from simulate.grasping.executor import Workcell
from simulate.motion.trajectory import time_path
from simulate.robots import describe
from simulate.ros.body import RosBody
from simulate.ros.rclpy_front import RclpyFront
from simulate.ros.sensors import Rates
from tests.rtask.ros2.standin import Clock, Publisher, World, install

pytest.importorskip("rosbags")

ARM = describe("panda").arm("panda_arm")
ACTION = "panda_arm_controller/follow_joint_trajectory"
WAIT_S = 60.0


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    """A Panda whose physics runs in a thread of its own."""
    made = World(engine_schema())
    with pytest.MonkeyPatch.context() as patch:
        install(made, lambda name, module: patch.setitem(sys.modules, name, module))
        patch.setattr(Clock, "now", lambda self: SimpleNamespace(nanoseconds=time.time_ns()))
        patch.setattr(Publisher, "publish", _pass_on(made))
        node = sys.modules["rclpy.lifecycle"].LifecycleNode("body")
        ready, ended = threading.Event(), threading.Event()

        def live() -> None:
            with Workcell("panda", preset="fast") as cell:
                body = RosBody(RclpyFront(node), ActService(cell), Rates(50.0, 2.0))
                ready.set()
                body.run(ended.is_set)

        thread = threading.Thread(target=live)
        thread.start()
        assert ready.wait(60.0)
        yield made
        ended.set()
        thread.join(60.0)


def _pass_on(world: World) -> Any:
    """Return a publisher's method that hands messages to whoever subscribed."""

    def publish(publisher: Publisher, message: Any) -> None:
        publisher.messages.put(message)
        topics = [name for name, made in world.publishers.items() if made is publisher]
        for topic in topics:
            for take in world.subscriptions.get(topic, ()):
                take(message)

    return publish


@pytest.fixture
def arm(world: World) -> RclpyArm:
    """Return a driver of the arm, which is at home, wherever other tests left it."""
    node = sys.modules["rclpy.lifecycle"].LifecycleNode("reach")
    driver = RclpyArm(node, ACTION, ARM.joints)
    here, home = driver.measured(), np.array(ARM.home)
    if np.abs(here - home).max() > 0.02:
        driver.follow(time_path(np.stack([here, home]), np.full(7, 0.8)))
    return driver


def way(to: float) -> Any:
    home = np.array(ARM.home)
    return time_path(np.stack([home, home + np.eye(7)[6] * to]), np.full(7, 0.8))


def test_the_arm_follows_goals_of_ros_2_and_a_goal_missed_is_told_with_its_code(arm):
    arm.follow(way(0.2))
    np.testing.assert_allclose(arm.measured(), way(0.2).positions[-1], atol=0.02)
    back = way(0.2)
    arm.follow(time_path(back.positions[::-1], np.full(7, 0.8)))
    with pytest.raises(
        RobotError, match=r"ended with -5 \(GOAL_TOLERANCE_VIOLATED\): panda_joint7 ended"
    ):
        arm.follow(way(4.0))


def test_a_newer_goal_ends_its_predecessor_and_a_cancelled_one_stops(world):
    goal = {"trajectory": _slow(world)}
    first, second = (world.actions[ACTION].send(**goal) for _ in range(2))
    assert first.ended.wait(WAIT_S)
    assert (first.status, first.result.error_code) == ("aborted", 0)
    assert first.result.error_string == "a newer goal came"
    second.is_cancel_requested = True
    assert second.ended.wait(WAIT_S)
    assert second.status == "canceled"


def _slow(world: World) -> Any:
    made = world.types.make("trajectory_msgs/JointTrajectory")
    point = world.types.make("trajectory_msgs/JointTrajectoryPoint")
    made.joint_names, point.positions = list(ARM.joints), list(ARM.home)
    point.time_from_start.secs = 60
    made.points = [point]
    return made


def ended(world: World, **changes: Any) -> tuple[str, int, str]:
    """Return how a goal of one point ended: the last joint is off home after 0.2 s."""
    trajectory = _slow(world)
    [point] = trajectory.points
    point.positions = [*ARM.home[:-1], ARM.home[-1] + changes.pop("off", 0.1)]
    point.time_from_start.secs, point.time_from_start.nsecs = 0, 200_000_000
    names = changes.pop("joint_names", None)
    trajectory.joint_names = list(ARM.joints) if names is None else names
    seconds = changes.pop("start_s", None)
    if seconds is not None:
        nanoseconds = time.time_ns() + round(seconds * 1e9)
        stamp = trajectory.header.stamp
        stamp.secs, stamp.nsecs = divmod(nanoseconds, 10**9)
    handle = world.actions[ACTION].send(trajectory=trajectory, **changes)
    assert handle is not None
    assert handle.ended.wait(WAIT_S)
    return handle.status, handle.result.error_code, handle.result.error_string


def tolerance(world: World, position: float, name: str = ARM.joints[-1]) -> list[Any]:
    made = world.types.make("control_msgs/JointTolerance")
    made.name, made.position = name, position
    return [made]


def patience(world: World) -> Any:
    """Return a tolerance for a processor that is busy: the physics comes late."""
    made = world.types.make("control_msgs/FollowJointTrajectory_Goal").goal_time_tolerance
    made.secs = 60
    return made


def go_there_first(world: World) -> None:
    """Bring the arm to the goal of :func:`ended`, from wherever other tests left it."""
    assert ended(world, goal_time_tolerance=patience(world)) == ("succeeded", 0, "")


def test_every_code_of_the_action_is_answered(world):
    go_there_first(world)
    assert ended(world, joint_names=["wrist"])[:2] == ("aborted", -2)
    assert ended(world, joint_names=list(ARM.joints[:-1]))[:2] == ("aborted", -2)
    assert ended(world, joint_names=[*ARM.joints, "finger"])[:2] == ("aborted", -2)
    unknown = ended(world, goal_tolerance=tolerance(world, 0.1, "wrist"))
    assert unknown[:2] == ("aborted", -1)
    assert "'wrist' is no joint of the arm" in unknown[2]
    assert ended(world, path_tolerance=tolerance(world, float("nan")))[:2] == ("aborted", -1)
    old = ended(world, start_s=-5.0)
    assert old[:2] == ("aborted", -3)
    assert "5." in old[2]
    far = ended(world, off=0.5, path_tolerance=tolerance(world, 1e-6))
    assert far[:2] == ("aborted", -4)
    assert "from its path" in far[2]
    missed = ended(world, goal_tolerance=tolerance(world, 1e-9))
    assert missed[:2] == ("aborted", -5)
    none = {"goal_tolerance": tolerance(world, -1.0), "goal_time_tolerance": patience(world)}
    assert ended(world, **none) == ("succeeded", 0, "")


def test_a_goal_that_starts_later_waits_for_its_time_and_can_be_given_up(world):
    go_there_first(world)
    start_s = time.time() + 0.5  # by the clock that stamps, not by that of the physics
    late = ended(world, start_s=0.5, goal_time_tolerance=patience(world))
    assert late == ("succeeded", 0, "")
    assert time.time() > start_s
    trajectory = _slow(world)
    trajectory.header.stamp.secs = int(time.time()) + 1000
    handle = world.actions[ACTION].send(trajectory=trajectory)
    handle.is_cancel_requested = True
    assert handle.ended.wait(WAIT_S)
    assert handle.status == "canceled"


def test_joints_transforms_and_views_have_one_stamp_and_the_frames_of_the_robot(world):
    cloud = world.publishers["camera/depth_registered/points"]
    cloud.listeners = 1
    message = cloud.messages.get(timeout=WAIT_S)
    cloud.listeners = 0
    assert message.header.frame_id == next(iter(describe("panda").cameras.values())).frame_id
    assert len(message.data) == message.row_step * message.height
    stamp = (message.header.stamp.secs, message.header.stamp.nsecs)
    stamps: dict[str, list[tuple[int, int]]] = {}
    transforms = world.publishers["/tf"].messages
    while not transforms.empty():
        for each in transforms.get_nowait().transforms:
            at = (each.header.stamp.secs, each.header.stamp.nsecs)
            stamps.setdefault(each.child_frame_id, []).append(at)
    for frame, times in stamps.items():
        assert stamp in times, f"where {frame} is at the time of the view"
        assert times == sorted(set(times)), f"each stamp of {frame} once, in order"
    assert world.publishers["/tf_static"].messages.qsize() == 1


def test_the_act_service_answers_and_says_what_it_refuses(world):
    answer = world.call("act", action_type="home")
    assert answer.success == 1, answer.reason
    assert "dance" in world.call("act", action_type="dance").reason
