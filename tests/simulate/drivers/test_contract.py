"""What starts a motion of a real arm and what ends it, before a bridge that misbehaves."""

from __future__ import annotations

import json
import threading
import time

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers.contract import JointLimits, check_ending
from simulate.drivers.rosbridge import RosbridgeArm
from simulate.motion.trajectory import time_path

JOINTS = ("shoulder", "elbow")
LIMITS = JointLimits(np.array([-3.0, -3.0]), np.array([3.0, 3.0]))
START = (0.9, 0.3)
ACTION, TOPIC = "/arm_controller/follow_joint_trajectory", "/joint_states"


class HostileBridge:
    """A stand-in for rosbridge before an arm of two joints; ``state`` and ``end`` say how it lies.

    It speaks the protocol of rosbridge 2.x: ``subscribe``, ``publish``, ``send_action_goal``,
    ``action_result`` with ``result: true`` for every ended goal, and ``cancel_action_goal``.
    """

    def __init__(self):
        self.server = serve(self.session, "127.0.0.1", 0, compression=None)
        self.url = f"ws://127.0.0.1:{self.server.socket.getsockname()[1]}"
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()
        self.reset()

    def reset(self):
        self.state, self.end, self.at = "good", {"status": 4}, np.array(START)
        self.goals, self.cancelled, self.stopped = [], [], threading.Event()

    def close(self):
        self.server.shutdown()
        self.thread.join()

    def session(self, socket):
        publishes = False
        try:
            while True:
                try:
                    message = json.loads(socket.recv(timeout=0.01))
                except TimeoutError:
                    message = {}
                publishes = message.get("op", "") != "unsubscribe" and (
                    publishes or message.get("op") == "subscribe"
                )
                if publishes:
                    state = self.joint_state()
                    socket.send(json.dumps({"op": "publish", "topic": TOPIC, "msg": state}))
                if message.get("op") == "cancel_action_goal":
                    self.cancelled.append(message["id"])
                    self.stopped.set()
                if message.get("op") == "send_action_goal" and self.take(socket, message):
                    return
        except ConnectionClosed:
            return

    def take(self, socket, message):
        """Carry out a goal at once; return whether the link is lost over it."""
        self.goals.append(message["id"])
        if self.end == "lost":
            return True
        if self.end == "silent":
            return False
        if "stays" not in self.end:
            self.at = np.array(message["args"]["trajectory"]["points"][-1]["positions"])
        about = {"op": "action_result", "id": message["id"], "action": message["action"]}
        values = {"error_code": 0, "error_string": ""}
        status = {"status": self.end["status"]} if "status" in self.end else {}
        socket.send(json.dumps({**about, "values": values, "result": True, **status}))
        return False

    def joint_state(self):
        seconds, nanoseconds = divmod(time.time_ns() - 3_600_000_000_000 * (self.state == "old"),
                                      1_000_000_000)  # fmt: skip
        names, at = list(JOINTS), self.at.tolist()
        stamp = {"sec": seconds, "nanosec": nanoseconds}
        velocity = [0.0, 1.5] if self.state == "moving" else [0.0, 0.0]
        match self.state:
            case "without time":
                stamp = {"sec": 0, "nanosec": 0}
            case "ahead":
                stamp["sec"] += 60
            case "frozen":
                stamp = self.__dict__.setdefault("first_stamp", stamp)
            case "NaN":
                at[1] = None  # as rosbridge writes what JSON has no number for
            case "degrees":
                at = np.rad2deg(self.at).tolist()
            case "outside":
                at[0] = 3.4
            case "in another order":
                names.reverse()
            case "incomplete":
                names, at, velocity = names[:1], at[:1], velocity[:1]
            case "uneven":
                at = at[:1]
            case "unannounced motion":
                at, velocity = (self.at + 1.5 * (time.time() % 1)).tolist(), []
        return {"header": {"stamp": stamp}, "name": names, "position": at, "velocity": velocity}


@pytest.fixture(scope="module")
def bridge_process():
    bridge = HostileBridge()
    yield bridge
    bridge.close()


@pytest.fixture
def bridge(bridge_process, monkeypatch):
    monkeypatch.setattr("simulate.drivers.rosbridge._STATE_S", 0.25)
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
        ("old", r"3600\.\d s old; restart the driver .* clocks"),
        ("ahead", r"ahead of this machine"),
        ("frozen", "its time stands still"),
        ("without time", r"carry no time.*have the driver fill header\.stamp"),
        ("moving", "elbow is moving; stop what moves the arm"),
        ("unannounced motion", "(shoulder|elbow) is moving"),
        ("NaN", "elbow is not a finite number; check its encoder"),
        ("degrees", "shoulder is 51.57, which looks like degrees; .* radians"),
        ("outside", "shoulder is 3.40 rad, outside its limits .*; move the arm back"),
        ("in another order", "another order of the joints: check that the driver's names"),
        ("incomplete", "the joint states lack elbow; start the broadcaster"),
        ("uneven", "names 2 joints and has 1 positions"),
    ],
)
def test_a_state_that_cannot_be_trusted_starts_nothing_and_says_why(bridge, state, complaint):
    bridge.state = state
    with arm_of(bridge) as arm, pytest.raises(RobotError, match=complaint):
        arm.follow(way())
    assert bridge.goals == []


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
        (1, {"status": 2}, "preempted"),
        (1, {"status": 4}, "aborted"),
        (1, {"status": 3, "stays": True}, "elbow ended 0.20 rad"),
    ],
)
def test_result_true_is_no_success_unless_status_and_joints_say_so(bridge, ros, end, complaint):
    bridge.end = end
    with arm_of(bridge, ros=ros) as arm, pytest.raises(RobotError, match=complaint):
        arm.follow(way())


def test_success_has_another_number_in_each_version_of_ros(bridge):
    bridge.end = {"status": 3}
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


def test_a_goal_that_does_not_end_is_cancelled_by_its_own_id(bridge, monkeypatch):
    monkeypatch.setattr("simulate.drivers.rosbridge._SPARE_S", -0.2)
    bridge.end = "silent"
    with arm_of(bridge) as arm:
        with pytest.raises(RemoteUnavailableError, match="did not end within"):
            arm.follow(way())
        assert bridge.stopped.wait(10)
    assert bridge.cancelled == bridge.goals


def test_a_lost_link_is_told_and_a_second_connection_cancels_the_goal(bridge):
    bridge.end = "lost"
    with arm_of(bridge) as arm, pytest.raises(RemoteUnavailableError, match="connection was lost"):
        arm.follow(way())
    assert bridge.stopped.wait(10)
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
