"""What starts a motion of a real arm and what ends it, before a bridge that misbehaves."""

from __future__ import annotations

import re
import time
from types import SimpleNamespace

import numpy as np
import pytest

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers.action_arm import ActionArm
from simulate.drivers.contract import check_ending
from simulate.drivers.joint_states import JointLimits, check_positions, settled_joints
from simulate.drivers.rosbridge import RosbridgeArm
from simulate.drivers.rosbridge_goals import GoalEnd
from simulate.motion.trajectory import join, reverse, time_path
from tests.processes import EVER_LONGER_S, wait_until
from tests.simulate.drivers.benches import PATIENT_S, be_patient, error_of, waits_restored
from tests.simulate.drivers.hostile_arm import ACTION, JOINTS, LIMITS, START, TOPIC
from tests.simulate.drivers.hostile_bridge import HostileBridge


@pytest.fixture(scope="module")
def bridge_process():
    with waits_restored():
        bridge = HostileBridge()
        yield bridge
        bridge.close()


@pytest.fixture
def bridge(bridge_process):
    be_patient()
    bridge_process.reset()
    return bridge_process


def arm_of(bridge, **options):
    return RosbridgeArm(bridge.url, ACTION, JOINTS, TOPIC, limits=LIMITS, **options)


def way():
    return time_path(np.array([START, (0.9, 0.5)]), np.full(2, 1.0))


def test_an_arm_at_rest_that_arrives_has_succeeded_and_the_risk_was_said_before(bridge):
    said = []
    with arm_of(bridge, say=said.append) as arm:
        arm.follow(way())
        np.testing.assert_allclose(arm.measured(), (0.9, 0.5))
    assert bridge.cancelled == []
    assert len(said) == 1
    assert "if the link" in said[0]


@pytest.mark.parametrize(
    ("state", "complaint"),
    [
        ("a text for a number", "elbow is not a finite number"),
        ("a huge number", "elbow is not a finite number"),
        ("a text for a list", "position of a joint state is no list"),
        ("no names", "names that are no texts"),
        ("a text for a time", "carry no time"),
        ("no header", "carry no time"),
        ("a thousand times a second, moving", "(shoulder|elbow) is moving"),
    ],
)
def test_a_state_that_is_no_message_of_joints_starts_nothing_and_says_why(
    bridge, monkeypatch, state, complaint
):
    bridge.state = state
    for wait_s in EVER_LONGER_S:  # a busy machine shows none at all within a moment
        monkeypatch.setattr("simulate.drivers.rosbridge._STATE_S", wait_s)
        with arm_of(bridge) as arm:
            said = error_of(lambda arm=arm: arm.follow(way()))
        assert said
        assert bridge.goals == []
        if re.search(complaint, said):
            return
    pytest.fail(said)


@pytest.mark.parametrize(
    ("ros", "end", "complaint"),
    [
        (2, {"status": 5}, "canceled"),
        (2, {"status": 6}, "aborted"),
        (2, {"status": 3}, "unknown"),
        (2, {"status": 42}, "unknown"),
        (2, {"status": "4"}, "unknown"),
        (2, {}, "unknown"),
        (2, {"status": 4, "stays": True}, "elbow ended 0.20 rad from its goal, although"),
        (2, {"status": 4, "result": False}, "unknown"),
        (2, {"status": 4.0}, "unknown"),
        (2, {"status": 4, "freezes": 0.06}, "(shoulder|elbow) ended 0.06 rad"),
        (1, {"status": 2}, "preempted"),
        (1, {"status": 4}, "aborted"),
        (1, {"status": 3, "stays": True}, "elbow ended 0.20 rad"),
    ],
)
def test_result_true_is_no_success_unless_status_and_joints_say_so(bridge, ros, end, complaint):
    bridge.end, bridge.ros = end, ros
    with arm_of(bridge, ros=ros) as arm, pytest.raises(RobotError, match=complaint):
        arm.follow(way())


def test_success_has_another_number_in_each_version_of_ros(bridge):
    bridge.end, bridge.ros = {"status": 3}, 1
    with arm_of(bridge, ros=1) as arm:
        arm.follow(way())
    with pytest.raises(RobotError, match="unknown"):
        check_ending(2, True, ACTION)


def test_two_programs_on_one_bridge_never_share_a_goal_id(bridge):
    for _ in range(2):
        bridge.at = np.array(START)
        with arm_of(bridge) as arm:
            arm.follow(way())
    assert len(set(bridge.goals)) == 2


@pytest.mark.parametrize("ros", [1, 2])
def test_a_goal_that_does_not_end_is_cancelled_by_its_own_id(bridge, monkeypatch, ros):
    monkeypatch.setattr("simulate.drivers.rosbridge._SPARE_S", -0.2)
    bridge.end, bridge.ros = "silent", ros
    with arm_of(bridge, ros=ros) as arm:
        with pytest.raises(RemoteUnavailableError, match="did not end within"):
            arm.follow(way())
        assert bridge.stopped.wait(PATIENT_S)
    assert bridge.cancelled == bridge.goals


@pytest.mark.parametrize("ros", [1, 2])
def test_a_lost_link_is_told_and_a_second_connection_cancels_the_goal(bridge, ros):
    bridge.end, bridge.ros = "lost", ros
    with (
        arm_of(bridge, ros=ros) as arm,
        pytest.raises(RemoteUnavailableError, match="connection was lost"),
    ):
        arm.follow(way())
    assert bridge.stopped.wait(PATIENT_S)
    assert bridge.cancelled == bridge.goals


def test_joints_in_another_order_are_read_by_their_names_beside_other_joints(bridge, monkeypatch):
    plain = bridge.joint_state

    def shuffled():
        state = plain()
        names, at = [*state["name"][::-1], "jaw"], [*state["position"][::-1], 0.02]
        return {**state, "name": names, "position": at, "velocity": [0.0] * 3}

    monkeypatch.setattr(bridge, "joint_state", shuffled)
    with arm_of(bridge) as arm:
        np.testing.assert_allclose(arm.measured(), START)


def test_states_that_stop_during_a_motion_end_it_and_doubt_is_said(bridge, monkeypatch):
    monkeypatch.setattr("simulate.drivers.watch._SILENT_S", 0.1)
    monkeypatch.setattr("simulate.drivers.rosbridge._STOPPED_S", 0.1)
    said = []
    bridge.end = "states stop"
    with (
        arm_of(bridge, say=said.append) as arm,
        pytest.raises(RemoteUnavailableError, match="no new joint state came"),
    ):
        arm.follow(way())
    wait_until(lambda: set(bridge.cancelled) == set(bridge.goals) != set())
    assert bridge.sessions == 2  # the first connection did not show that the arm rests
    assert "nobody can tell whether the arm" in said[-1]


def test_the_end_of_another_programs_goal_ends_nothing(bridge, monkeypatch):
    monkeypatch.setattr("simulate.drivers.rosbridge._SPARE_S", -0.2)
    for ros in (1, 2):
        bridge.end, bridge.ros, bridge.at = {"status": 4, "of": "theirs"}, ros, np.array(START)
        with (
            arm_of(bridge, ros=ros) as arm,
            pytest.raises(RemoteUnavailableError, match="did not end within"),
        ):
            arm.follow(way())


@pytest.mark.parametrize("ends_wrong", [{"status": 6}, {"status": 4, "stays": True}])
def test_a_motion_that_went_wrong_is_cancelled_even_if_it_is_said_to_have_ended(bridge, ends_wrong):
    bridge.end = ends_wrong
    with arm_of(bridge) as arm, pytest.raises(RobotError):
        arm.follow(way())
    wait_until(lambda: bridge.cancelled == bridge.goals != [])


def test_a_short_way_within_the_tolerance_is_not_gone_by_staying(bridge):
    short = time_path(np.array([START, (0.9, 0.34)]), np.full(2, 1.0))
    bridge.end = {"status": 4, "stays": True}
    with arm_of(bridge) as arm, pytest.raises(RobotError, match="elbow stayed where it was"):
        arm.follow(short)
    bridge.end = {"status": 4}
    with arm_of(bridge) as arm:
        arm.follow(short)


def test_a_goal_at_the_present_position_moves_nothing(bridge):
    with arm_of(bridge) as arm:
        arm.follow(time_path(np.array([START, START]), np.full(2, 1.0)))
    assert bridge.goals == []
    with arm_of(bridge) as arm, pytest.raises(RobotError, match="from the start"):
        arm.follow(time_path(np.array([(0.5, 0.3)] * 2), np.full(2, 1.0)))


def test_a_way_there_and_back_is_not_gone_by_staying(bridge):
    there = way()
    back = join([there, reverse(there)])
    bridge.end = {"status": 4, "stays": True, "passes": [list(START)] * 3}
    with arm_of(bridge) as arm, pytest.raises(RobotError, match=r"went 0\.00 rad.*frozen"):
        arm.follow(back)
    bridge.end["passes"] = [[0.9, 0.4], [0.9, 0.49], [0.9, 0.35]]
    with arm_of(bridge) as arm:
        arm.follow(back)


def test_joints_without_a_sensor_of_velocity_rest_by_their_positions(bridge):
    bridge.state = "velocities unknown"
    with arm_of(bridge) as arm:
        np.testing.assert_allclose(arm.measured(), START)


def test_a_flood_of_states_of_a_moving_arm_does_not_hold_one_up(bridge):
    flood = iter(range(10**6))

    def endless(until):
        now = time.time_ns() + next(flood)
        stamp = {"sec": now // 10**9, "nanosec": now % 10**9}
        return {"header": {"stamp": stamp}, "name": JOINTS, "position": START, "velocity": [1, 1]}

    with pytest.raises(RobotError, match="is moving"):
        settled_joints(endless, JOINTS, None, 0.05)


@pytest.mark.parametrize(
    ("end", "says"), [(np.pi, "a whole turn off: .* wound up"), (3.0, "outside its limits")]
)
def test_a_joint_without_ends_that_was_wound_up_is_told_from_one_beyond_its_end(end, says):
    limits = JointLimits(np.full(2, -end), np.full(2, end))
    with pytest.raises(RobotError, match=says):
        check_positions(np.array([0.3, 4.0]), JOINTS, limits)


class _ArmThatEndsAtOnce(ActionArm):
    def send(self, way, ended):
        ended(GoalEnd(4, 0, ""))

    def cancel(self):
        pass


@pytest.mark.parametrize("duration_s", [0.5, 60.0])
def test_an_end_is_waited_for_as_long_as_the_motion_takes(duration_s):
    arm = _ArmThatEndsAtOnce(ACTION, JOINTS, 2, LIMITS, time.time)
    watch = SimpleNamespace(check=lambda: None, deadline=float("inf"))
    assert arm._carried_out(SimpleNamespace(duration=duration_s), watch).status == 4
