"""Further lies before every driver of ROS: of states in the middle, of motions that went elsewhere.

They were made after those of the contract's table, without looking at what a driver would say.
"""

from __future__ import annotations

import contextlib
import re
import socket
import threading

import numpy as np
import pytest

from rtask.errors import RemoteUnavailableError, RobotError
from simulate.drivers import rosbridge
from simulate.drivers.watch import MotionWatch
from simulate.motion.trajectory import time_path
from tests.processes import EVER_LONGER_S, wait_until
from tests.rtask.interop.ros.conftest import roscore  # noqa: F401  (a fixture)
from tests.simulate.drivers.benches import BRIDGES, DRIVERS, GOAL, NAOQI, ROS1, pieces_to
from tests.simulate.drivers.hostile_arm import ACTION, JOINTS, LIMITS, START, TOPIC
from tests.simulate.drivers.hostile_bridge import HostileBridge

pytestmark = pytest.mark.slow

_ROS = [driver for driver in DRIVERS if driver != NAOQI]
AFTER = {
    "success, and NaN in one joint": "elbow is not a finite number",
    "success, and one joint drops out": "lack elbow",
    "success, and the time steps back": r"\d\.\d s old; restart the driver",
}
"""Success, and then states that show nothing."""
MOVING = {
    "success after a detour": r"shoulder is 0\.\d+ rad off the way that was sent",
    "success of a mirrored motion": r"elbow is 0\.\d+ rad off the way|ended 0\.4\d? rad from",
    "success, with states sent again": r"ended 0\.20 rad from its goal|stayed where it was",
    "no end, as its controller was switched": r"did not end within|ended 0\.\d+ rad from its",
}
"""Goals of an arm that takes its time."""
ENDED = {
    "no end, and NaN in one joint": "no new joint state came",
    "no end, and one joint drops out": "no new joint state came",
    "canceled, and it goes on": "canceled|preempted|off the way",
    "a status of 0": "unknown.* 0 of ROS",
    "an error code beside success": "INVALID_GOAL",
}


def cells(rows):
    return [
        pytest.param(driver, row, words, id=f"{row}-{driver}")
        for row, words in rows.items()
        for driver in _ROS
        if driver != ROS1 or row not in AFTER  # read by rclpy's code, and slow to come
    ]


@pytest.mark.parametrize(("driver", "end", "words"), cells(AFTER))
def test_success_counts_for_nothing_where_no_state_shows_it(benches, driver, end, words):
    bench = benches(driver)
    for wait_s in EVER_LONGER_S:
        bench.arrange(end=end, state_s=wait_s)
        said = bench.follow()
        assert said
        if bench.goals() and re.search(words, said):
            return
    pytest.fail(said)


@pytest.mark.parametrize(("driver", "end", "words"), cells(MOVING))
def test_an_arm_that_goes_elsewhere_has_not_followed(benches, driver, end, words):
    bench = benches(driver)
    bench.arrange(end=end, is_timed=True)
    said = bench.follow()
    assert re.search(words, said), said
    wait_until(lambda: set(bench.cancelled()) == set(bench.goals()))


@pytest.mark.parametrize(("driver", "end", "words"), cells(ENDED))
def test_an_end_that_is_none_or_a_failure_is_cancelled(benches, driver, end, words):
    bench = benches(driver)
    bench.arrange(end=end)
    said = bench.follow()
    assert re.search(words, said), said
    wait_until(lambda: set(bench.cancelled()) == set(bench.goals()))
    if end == "canceled, and it goes on":
        assert "nobody can tell whether the arm" in bench.said()[-1]


@pytest.mark.parametrize("driver", _ROS)
@pytest.mark.parametrize("state", ["one old state, as latched", "one state of the future"])
def test_one_state_of_another_time_keeps_nobody_from_moving(benches, driver, state):
    bench = benches(driver)
    bench.arrange(state=state)
    assert bench.follow() == ""


@pytest.mark.parametrize("driver", _ROS)
def test_positions_that_change_are_a_motion_whatever_the_velocities_say(benches, driver):
    bench = benches(driver)
    for wait_s in EVER_LONGER_S:
        bench.arrange(state="without speed, moving", state_s=wait_s)
        said = bench.follow()
        assert bench.goals() == []
        if "is moving; stop what moves the arm" in said:
            return
    pytest.fail(said)


@pytest.mark.parametrize(("seconds", "doubts"), [(0.2, False), (0.02, True)])
def test_an_arm_that_keeps_no_velocities_is_said_to(monkeypatch, seconds, doubts):
    monkeypatch.setattr("simulate.drivers.watch._TIMES_FASTER", 2.0)  # benches hurry
    way = time_path(np.array([START, GOAL]), np.full(2, 1.0))
    watch = MotionWatch(way, JOINTS)
    for k in range(60):
        elbow = np.interp(k / 100, [0, seconds], [START[1], GOAL[1]])
        stamp = {"sec": 100, "nanosec": k * 10**7}
        watch.take({"header": {"stamp": stamp}, "name": JOINTS, "position": [0.9, elbow]})
    said = watch.pace_doubt()
    assert bool(said) is doubts
    assert not said or re.search(r"went at \d\.\d rad/s where \d\.\d were asked for", said)


def test_a_stamp_of_the_future_does_not_make_all_that_follow_old(monkeypatch):
    monkeypatch.setattr("simulate.drivers.watch._SILENT_S", 3.0)
    now = 0.0
    way = time_path(np.array([START, GOAL]), np.full(2, 1.0))
    watch = MotionWatch(way, JOINTS, clock=lambda: now)

    def state(stamp_s):
        stamp = {"sec": stamp_s, "nanosec": 0}
        return {"header": {"stamp": stamp}, "name": list(JOINTS), "position": list(START)}

    for stamp_s in (100, 10**9, 101, 102, 103):
        now += 1.0
        watch.take(state(stamp_s))
        watch.check()
    for _ in range(3):  # of one time, sent again and again
        now += 1.0
        watch.take(state(103))
    with pytest.raises(RemoteUnavailableError, match="no new joint state came"):
        watch.check()


def test_an_arm_that_is_off_its_way_in_one_state_alone_goes_on():
    way = time_path(np.array([START, GOAL]), np.full(2, 1.0))
    watch = MotionWatch(way, JOINTS)
    for stamp_s, shoulder in ((1, 0.9), (2, 1.2), (3, 0.9), (4, 1.2), (5, 1.2)):
        stamp = {"sec": stamp_s, "nanosec": 0}
        watch.take({"header": {"stamp": stamp}, "name": JOINTS, "position": [shoulder, 0.3]})
        watch.check()
    stamp = {"sec": 6, "nanosec": 0}
    watch.take({"header": {"stamp": stamp}, "name": JOINTS, "position": [1.2, 0.3]})
    with pytest.raises(RobotError, match=r"shoulder is 0\.30 rad off the way"):
        watch.check()


class HalfOpen:
    """A wire to a bridge that can be cut so that neither side hears of it."""

    def __init__(self, port):
        self.port, self.is_cut = port, threading.Event()
        self.server = socket.create_server(("127.0.0.1", 0))
        self.url = f"ws://127.0.0.1:{self.server.getsockname()[1]}"
        self.sockets = [self.server]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self.server.accept()
                far = socket.create_connection(("127.0.0.1", self.port))
                self.sockets += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source, sink):
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if not self.is_cut.is_set():
                    sink.sendall(data)

    def close(self):
        for each in self.sockets:
            each.close()


@pytest.mark.parametrize("driver", BRIDGES)
def test_a_link_that_dies_without_a_word_ends_the_motion_and_is_said(benches, driver, monkeypatch):
    bench = benches(driver)
    bench.arrange(end="no end")
    wire, said = HalfOpen(bench.robot.server.socket.getsockname()[1]), []
    cut = threading.Thread(
        target=lambda: (wait_until(lambda: bench.robot.goals), wire.is_cut.set())
    )
    try:
        with rosbridge.RosbridgeArm(
            wire.url, ACTION, JOINTS, TOPIC, limits=LIMITS, ros=bench.ros, say=said.append
        ) as arm:
            for name in ("_STOPPED_S", "_OPEN_S"):
                monkeypatch.setattr(rosbridge, name, 0.4)
            monkeypatch.setattr("simulate.drivers.watch._SILENT_S", 3.0)
            monkeypatch.setattr(rosbridge, "_SPARE_S", 60.0)
            cut.start()
            with pytest.raises(RemoteUnavailableError, match="no new joint state came"):
                arm.follow_pieces(pieces_to(START, GOAL, 1))
    finally:
        cut.join()
        wire.close()
    assert "nobody can tell whether the arm" in said[-1]


@pytest.mark.parametrize("text", ["[" * 100_000, b"\xff\xfe", '{"op": "publish"', "7"])
def test_what_is_no_message_of_the_protocol_stops_the_arm_or_is_passed_over(text):
    bridge = HostileBridge()
    plain = bridge.feedback
    bridge.end = "feedback"

    class Raw(str):
        pass

    try:
        bridge.feedback = lambda goal: Raw(plain(goal))
        with pytest.MonkeyPatch.context() as patch:
            from tests.simulate.drivers import hostile_bridge

            dumps = hostile_bridge.json.dumps
            patch.setattr(
                hostile_bridge,
                "json",
                type("Json", (), {
                    "loads": staticmethod(hostile_bridge.json.loads),
                    "dumps": staticmethod(lambda m: text if isinstance(m, Raw) else dumps(m)),
                }),
            )  # fmt: skip
            patch.setattr(rosbridge, "_SPARE_S", 0.4)
            with rosbridge.RosbridgeArm(bridge.url, ACTION, JOINTS, TOPIC, limits=LIMITS) as arm:
                words = "did not end within" if text == "7" else "what is no JSON"
                with pytest.raises(RemoteUnavailableError, match=words):
                    arm.follow_pieces(pieces_to(START, GOAL, 1))
            assert bridge.stopped.wait(60.0)
            assert set(bridge.cancelled) == set(bridge.goals)
    finally:
        bridge.close()
