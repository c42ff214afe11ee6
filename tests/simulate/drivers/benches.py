"""Drivers before robots that lie, each with the same few calls, whatever lies between."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rtask.errors import RtaskError
from simulate.drivers import action_arm, naoqi, rosbridge, watch
from simulate.drivers.joint_states import JointLimits
from simulate.drivers.slowed_arm import SlowedArm
from simulate.motion.motion_limits import MotionLimits
from simulate.motion.trajectory import time_path
from simulate.robots import describe
from tests.processes import wait_until
from tests.rtask.interop.ros.conftest import Child
from tests.simulate.drivers.endings import ENDS, SUCCEEDED
from tests.simulate.drivers.hostile_arm import ACTION, JOINTS, LIMITS, START, TOPIC, HostileArm
from tests.simulate.drivers.hostile_bridge import HostileBridge

BRIDGE2, BRIDGE1, ROS1, ROS2, NAOQI = DRIVERS = (
    "rosbridge, ROS 2", "rosbridge, ROS 1", "rospy", "rclpy", "NAOqi",
)  # fmt: skip
BRIDGES = (BRIDGE2, BRIDGE1)
HORIZON_S, STEP_S, SLOW_RAD_S = 0.5, 0.02, 0.3
GOAL, FAR = (0.9, 0.5), (0.9, 2.5)
PATIENT_S = 60.0
"""For what comes: a busy machine may take as long."""
_IN_VAIN_S = 0.4
_LOST_S = 3.0
"""Of silence; only pieces before a link is lost are heard in less."""


@dataclass(frozen=True)
class Patience:
    """How long drivers wait, s: shortly only for what never comes."""

    state_s: float = PATIENT_S
    stopped_s: float = PATIENT_S
    spare_s: float = PATIENT_S
    silent_s: float = PATIENT_S
    times_faster: float = 1e9
    """From when on an arm is too fast: those of tests jump to their goals, or hurry."""

    @classmethod
    def of(cls, end):
        match end:
            case (
                "no end" | "feedback and no end" | "the end of another's goal"
                | "another begins as well"
            ):  # fmt: skip
                return cls(spare_s=_IN_VAIN_S)
            case (
                "no end, and states that stop" | "no end, and joints get other names"
                | "success, and the time jumps back" | "no end, and NaN in one joint"
                | "no end, and one joint drops out" | "success, and NaN in one joint"
                | "success, and one joint drops out" | "success, and the time steps back"
            ):  # fmt: skip
                return cls(silent_s=_IN_VAIN_S, stopped_s=_IN_VAIN_S)
            case "no end, and it goes on when cancelled":
                return cls(spare_s=_IN_VAIN_S, stopped_s=_IN_VAIN_S)
            case "success, but it goes on" | "canceled, and it goes on":
                return cls(stopped_s=_IN_VAIN_S)
            case "no end, as its controller was switched":
                return cls(spare_s=_IN_VAIN_S)
        return cls()

    def apply(self):
        """Have the drivers of this process wait so long."""
        for module in (rosbridge, action_arm, naoqi):
            module._STATE_S, module._STOPPED_S = self.state_s, self.stopped_s
            module._SPARE_S = self.spare_s
        watch._SILENT_S, watch._TIMES_FASTER = self.silent_s, self.times_faster
        # NAOqi carries a motion out 20 times as fast: one that has not ended by then does not end.
        naoqi._SPARE_S = self.spare_s if self.spare_s == PATIENT_S else -0.2


_WAITS = {"_STATE_S", "_STOPPED_S", "_SPARE_S", "_SILENT_S", "_CALL_S", "_TASK_S", "_OPEN_S",
          "_TIMES_FASTER"}  # fmt: skip


def be_patient():
    """Have the drivers of this process wait as long as a busy machine may take."""
    Patience().apply()
    naoqi._CALL_S = naoqi._TASK_S = rosbridge._OPEN_S = PATIENT_S


def pieces_to(start, goal, count):
    corners = np.linspace(start, goal, count + 1)
    return [time_path(corners[k : k + 2], np.full(len(start), 1.0)) for k in range(count)]


def slowly(arm, start, far):
    """Have an arm follow a long way as commands do, in pieces of the horizon.

    It is slow, so that it is still far from its goal when a busy machine gets to stopping it.
    """
    dof = len(start)
    limits = MotionLimits(np.full(dof, SLOW_RAD_S), np.full(dof, 5.0), np.full(dof, np.inf))
    way = time_path(np.array([start, far]), np.full(dof, SLOW_RAD_S))
    SlowedArm(arm, limits, HORIZON_S).follow(way)


def error_of(follow):
    try:
        follow()
    except RtaskError as error:
        return str(error)
    return ""


class Bench:
    """A driver before a HostileArm in this process."""

    ros, horizon_s, step_s, joint, far = 2, HORIZON_S, STEP_S, 1, FAR[1]

    def __init__(self, robot):
        self.robot, self.words = robot, []

    def arrange(self, state="good", end="good", is_timed=False, state_s=PATIENT_S):
        """Have the robot lie; drivers wait ``state_s`` for a state from which a motion starts."""
        replace(Patience.of(end), state_s=state_s).apply()
        self.words.clear()
        self.robot.reset()
        self.robot.state, self.robot.is_timed = state, is_timed
        self.robot.end = ENDS[end](SUCCEEDED[self.ros])

    def goals(self):
        return list(self.robot.goals)

    def cancelled(self):
        return list(self.robot.cancelled)

    def said(self):
        return list(self.words)

    def report(self):
        return self.robot.report()

    def begin_another(self):
        return "theirs"

    def end_another(self):
        pass

    def close(self):
        self.robot.close()


class BridgeBench(Bench):
    """The driver of rosbridge."""

    def __init__(self, robot, ros):
        super().__init__(robot)
        self.ros = ros

    def arrange(self, *lies, **more):
        super().arrange(*lies, **more)
        self.robot.ros = self.ros

    def arm(self):
        return rosbridge.RosbridgeArm(
            self.robot.url,
            ACTION,
            JOINTS,
            TOPIC,
            limits=LIMITS,
            ros=self.ros,
            say=self.words.append,
        )

    def follow(self, pieces=1):
        with self.arm() as arm:
            return error_of(lambda: arm.follow_pieces(pieces_to(START, GOAL, pieces)))

    def follow_until_cut(self):
        """Follow a long way; the bridge goes down in the middle of a piece, for good."""
        cut = threading.Thread(target=self._cut_in_the_middle)
        cut.start()
        with self.arm() as arm:
            error = error_of(lambda: slowly(arm, START, FAR))
        cut.join()
        return error

    def _cut_in_the_middle(self):
        wait_until(lambda: len(self.robot.goals) >= 2 and self.robot.motion is not None)
        self.robot.is_cut = True

    def start_program(self):
        return start_program("rosbridge", self.robot.url, str(self.ros))


class RclpyBench(Bench):
    """The driver of rclpy, in the world of a stand-in."""

    def __init__(self, world):
        from tests.rtask.ros2.standin import ActionServer

        super().__init__(HostileArm())
        self.world, self.handles, self.is_deaf = world, [], False
        self.rejects = False
        self.node = sys.modules["rclpy.lifecycle"].LifecycleNode("reach")
        ActionServer(
            self.node, sys.modules["control_msgs.action"].FollowJointTrajectory, ACTION,
            self._execute, goal_callback=lambda goal: "reject" if self.rejects else "accept",
            handle_accepted_callback=lambda handle: handle.execute(),
        )  # fmt: skip
        from simulate.drivers.rclpy_arm import RclpyArm

        self.arm = RclpyArm(self.node, ACTION, JOINTS, limits=LIMITS, say=self.words.append)
        self._thread = threading.Thread(target=self._publish, daemon=True)
        self._thread.start()

    def arrange(self, state="good", end="good", **more):
        super().arrange(state, end, **more)
        self.handles, self.is_deaf, self.rejects = [], False, end == "rejected"

    def _publish(self):
        while not self.robot.closed.wait(0.005):
            for _ in range(10 if "a second" in self.robot.state else 1):
                if self.robot.state != "none" and not self.is_deaf:
                    self.world.publish("/joint_states", self._message())

    def _message(self):
        told = self.robot.joint_state()
        state = self.world.types.make("sensor_msgs/JointState")
        stamp = told["header"]["stamp"]
        state.header.stamp.secs, state.header.stamp.nsecs = stamp["sec"], stamp["nanosec"]
        state.name = told["name"]
        state.position = [float("nan") if at is None else at for at in told["position"]]
        state.velocity = told["velocity"]
        return state

    def _execute(self, handle):
        self.handles.append(handle)
        points = [
            {"positions": list(point.positions),
             "time_from_start": {"sec": point.time_from_start.secs,
                                 "nanosec": point.time_from_start.nsecs}}
            for point in handle.request.trajectory.points
        ]  # fmt: skip
        end, name = self.robot.end, f"goal {len(self.robot.goals)}"
        if not self.robot.take(name, points) and "at once" not in end:
            if self.robot.is_timed:
                wait_until(lambda: self.robot.motion is None)
            else:
                wait_until(lambda: handle.is_cancel_requested)
                end = {"status": 5}
        handle.status = end["status"]
        result = self.world.class_of("control_msgs/msg/FollowJointTrajectory_Result")()
        result.error_code, result.error_string = end.get("code", 0), ""
        return result

    def goals(self):
        return ["rejected"] if self.rejects else super().goals()

    def cancelled(self):
        pairs = zip(self.robot.goals, self.handles, strict=True)
        return [name for name, handle in pairs if handle.is_cancel_requested]

    def follow(self, pieces=1):
        return error_of(lambda: self.arm.follow_pieces(pieces_to(START, GOAL, pieces)))

    def follow_until_cut(self):
        """Follow a long way; neither states nor cancels get through from its middle on."""

        def cut():
            wait_until(lambda: len(self.robot.goals) >= 2 and self.robot.motion is not None)
            Patience(_IN_VAIN_S, _IN_VAIN_S, silent_s=_LOST_S).apply()
            self.is_deaf = True

        Patience(silent_s=_LOST_S).apply()
        thread = threading.Thread(target=cut)
        thread.start()
        error = error_of(lambda: slowly(self.arm, START, FAR))
        thread.join()
        return error

    def close(self):
        super().close()
        self._thread.join()


class RospyBench(Bench):
    """The driver of rospy before a robot in a real ROS 1, both in a process of their own."""

    ros = 1

    def __init__(self, roscore):
        self.roscore = roscore
        self.child = self._start("--robot", "--client")

    def _start(self, *options):
        child = Child(
            *options, environment=self.roscore.environment, module="tests.simulate.drivers.ros1_arm"
        )
        child.expect("programs ready")
        return child

    def tell(self, do, **fields):
        return tell(self.child, do, **fields)

    def arrange(self, state="good", end="good", is_timed=False, state_s=PATIENT_S):
        patience = replace(Patience.of(end), state_s=state_s)
        lies = {"state": state, "end": ENDS[end](3), "is_timed": is_timed}
        self.tell("arrange", patience=asdict(patience), lies=lies)

    def follow(self, pieces=1):
        return self.tell("follow", goal=GOAL, pieces=pieces)

    def goals(self):
        return self.tell("report")["ids"]

    def cancelled(self):
        return self.tell("report")["cancelled"]

    def said(self):
        return self.tell("words")

    def report(self):
        return self.tell("report")

    def start_program(self):
        """Start a client that is to be killed."""
        child = self._start("--client")
        send(child, "follow_slowly", goal=FAR)
        return SimpleNamespace(kill=child.process.kill, wait=child.finish)

    def close(self):
        self.child.end()


class NaoqiBench(Bench):
    """The driver of NAOqi before a stand-in in a process of its own."""

    joint, far = 0, 2.0
    arm = describe("nao").arm("right")
    start = np.array(arm.home)

    def __init__(self):
        import qi

        program = Path(__file__).with_name("naoqi_robot.py")
        self.process = subprocess.Popen(
            [sys.executable, str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        lines = iter(self.process.stdout.readline, "")
        self.address = next(line for line in lines if line.startswith("ready ")).split()[1]
        self.session = qi.Session()
        self.session.connect(self.address)
        self.motion = self.session.service("ALMotion")
        self.memory = self.session.service("ALMemory")
        self.words = []

    def arrange(self, state="good", end="good", is_timed=False, state_s=PATIENT_S):
        replace(Patience.of(end), state_s=state_s).apply()
        self.words.clear()
        home = dict(zip(self.arm.joints, self.arm.home, strict=True))
        self.motion.forget()
        self.motion.put(home)
        self.motion.lie("uneven" if state == "uneven" else end)
        blocked = self.arm.joints[0] if end == "success, but it stayed" else ""
        slow = end.startswith("no end") or end == "another begins as well"
        self.motion.arrange(0.0, blocked, 5.0 if is_timed else 0.01 if slow else 20.0)
        self.motion.drift("RElbowRoll", 0.5 if state == "unannounced motion" else 0.0)
        self.memory.freeze(state == "frozen")
        wrong = {"NaN": float("nan"), "degrees": 80.0, "outside": 2.2}
        if state in wrong:
            self.motion.put({"RShoulderPitch": wrong[state]})

    def driver(self):
        limits = JointLimits.of(describe("nao"), self.arm.joints)
        return naoqi.NaoqiArm(self.address, self.arm.joints, "RHand", limits, self.words.append)

    def follow(self, pieces=1):
        goal = self.start + [0.4, 0.0, 0.0, 0.0, 0.0]  # noqa: RUF005

        def go():
            with self.driver() as arm:
                arm.follow_pieces(pieces_to(self.start, goal, pieces))

        return error_of(go)

    def goals(self):
        return list(self.motion.begun())

    def cancelled(self):
        return list(self.motion.killed())

    def report(self):
        told = dict(self.motion.report())
        return {**told, "at": [told["at"]]}

    def begin_another(self):
        """Have another program move the other arm."""
        self.motion.setStiffnesses(["LElbowRoll"], 1.0)
        self.theirs = self.motion.angleInterpolation(
            ["LElbowRoll"], [[-0.5]], [[1.0]], True, _async=True
        )
        wait_until(lambda: self.motion.getTaskList())
        [(_, number)] = self.motion.getTaskList()
        return number

    def end_another(self):
        assert self.theirs.isRunning()
        for _, number in self.motion.getTaskList():
            self.motion.killTask(number)
        self.theirs.wait()

    def start_program(self):
        return start_program("naoqi", self.address)

    def close(self):
        self.session.close()
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()


def start_program(*arguments):
    """Start a program that follows a long way, and is to be killed."""
    module = "tests.simulate.drivers.following_program"
    return subprocess.Popen([sys.executable, "-m", module, *arguments])


def send(child, do, **fields):
    child.process.stdin.write(json.dumps({"do": do, **fields}) + "\n")
    child.process.stdin.flush()


def tell(child, do, **fields):
    """Have a process do something, and return its answer."""
    send(child, do, **fields)
    # Longer than a driver's own patience: an answer that comes late would be that to the next.
    return json.loads(child.expect("answer ", 2 * PATIENT_S).removeprefix("answer "))


@contextlib.contextmanager
def waits_restored():
    """Set back, at the end of the block, how long the drivers of this process wait."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (rosbridge, action_arm, watch, naoqi):
            for name in vars(module).keys() & _WAITS:
                patch.setattr(module, name, getattr(module, name))
        yield


def open_bench(driver, request):
    if driver in BRIDGES:
        return BridgeBench(HostileBridge(), 2 if driver == BRIDGE2 else 1)
    if driver == ROS1:
        return RospyBench(request.getfixturevalue("roscore"))
    if driver == ROS2:
        return RclpyBench(request.getfixturevalue("ros2_world"))
    return NaoqiBench()
