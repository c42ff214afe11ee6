"""An arm that lies in a real ROS 1, and the driver before it, as they are told.

Reads one JSON object from each line of standard input, and answers on standard output. The topics
of the action are its own, as actionlib's server would tell no lies.
"""

from __future__ import annotations

import json
import sys
import threading

from rtask.cli.ros.schema import engine_schema
from rtask.interop.ros.convert import fill, make_message, mapping_of
from rtask.interop.ros.find import use_ros
from rtask.interop.ros.package import load_messages
from tests.simulate.drivers.hostile_arm import ACTION, JOINTS, LIMITS, START, TOPIC, HostileArm

load_messages(engine_schema(), use_ros())

import rospy  # noqa: E402  (importable from here on only)

from simulate.ros.driver import ArmDriver  # noqa: E402
from tests.simulate.drivers.benches import (  # noqa: E402
    PATIENT_S,
    Patience,
    be_patient,
    error_of,
    pieces_to,
    slowly,
)

_KIND = "control_msgs/FollowJointTrajectoryAction"


class Ros1Arm(HostileArm):
    """The robot's side: publishes joint states, takes goals, tells how they ended."""

    def __init__(self):
        super().__init__()
        self.states = rospy.Publisher(TOPIC, class_of("sensor_msgs/JointState"), queue_size=10)
        self.status = rospy.Publisher(
            f"{ACTION}/status", class_of("actionlib_msgs/GoalStatusArray"), queue_size=10
        )
        self.feedback = rospy.Publisher(f"{ACTION}/feedback", class_of(f"{_KIND}Feedback"),
                                        queue_size=10)  # fmt: skip
        self.results = rospy.Publisher(f"{ACTION}/result", class_of(f"{_KIND}Result"),
                                       queue_size=10)  # fmt: skip
        rospy.Subscriber(f"{ACTION}/goal", class_of(f"{_KIND}Goal"), self.goal_came)
        rospy.Subscriber(f"{ACTION}/cancel", class_of("actionlib_msgs/GoalID"), self.cancel_came)
        threading.Thread(target=self.publish, daemon=True).start()

    def publish(self):
        while not self.closed.wait(0.01):
            for _ in range(10 if "a second" in self.state else 1):
                if self.state != "none":
                    self.states.publish(message_of(self.joint_state()))
            self.status.publish(make_message("actionlib_msgs/GoalStatusArray"))
            while self.over:
                self.tell(self.over.pop())

    def goal_came(self, message):
        points = mapping_of(message.goal)["trajectory"]["points"]
        for point in points:
            duration = point["time_from_start"]
            point["time_from_start"] = {"sec": duration["secs"], "nanosec": duration["nsecs"]}
        if self.take(message.goal_id.id, points) or "at once" in self.end:
            self.tell(self.end.get("of", message.goal_id.id))

    def cancel_came(self, message):
        assert message.id, "an empty id cancels the goals of others"
        assert message.stamp.to_nsec() == 0, "a stamp cancels the goals of others"
        self.cancel(message.id)

    def tell(self, goal):
        result = make_message(f"{_KIND}Result")
        result.status.goal_id.id, result.status.status = goal, self.end.get("status", 3)
        result.result.error_code = self.end.get("code", 0)
        self.results.publish(result)


def class_of(type_):
    return type(make_message(type_))


def message_of(state):
    """Return a JointState; what no message can carry is left out."""
    message = make_message("sensor_msgs/JointState")
    stamp = state.get("header", {}).get("stamp", {"sec": 0, "nanosec": 0})
    message.header.stamp = rospy.Time(stamp["sec"], stamp["nanosec"])
    numbers = [float("nan") if value is None else float(value) for value in state["position"]]
    rates = [float("nan") if value is None else value for value in state.get("velocity", [])]
    return fill(message, {"name": state["name"], "position": numbers, "velocity": rates},
                make_message)  # fmt: skip


class Programs:
    """What the test tells this process to do."""

    def __init__(self, is_robot, is_client):
        self.arm = Ros1Arm() if is_robot else None
        self.said = []
        self.driver = None
        if is_client:
            self.driver = ArmDriver(ACTION, JOINTS, PATIENT_S, LIMITS, self.said.append)

    def arrange(self, patience, lies):
        Patience(**patience).apply()
        self.arm.reset()
        vars(self.arm).update(lies)

    def report(self):
        about = {"cancelled": self.arm.cancelled, "ids": self.arm.goals}
        return {**self.arm.report(), **about}

    def follow(self, goal, pieces=1):
        """Follow a way of straight pieces from the start; return the error."""
        self.said.clear()
        return error_of(lambda: self.driver.follow_pieces(pieces_to(START, goal, pieces)))

    def words(self):
        return self.said

    def follow_slowly(self, goal):
        slowly(self.driver, START, goal)


def main():
    be_patient()
    is_robot, is_client = "--robot" in sys.argv, "--client" in sys.argv
    name = "_and_".join(["arm"] * is_robot + ["client"] * is_client)
    rospy.init_node(name, argv=[name], disable_signals=True)
    programs = Programs(is_robot, is_client)
    sys.stdout.write("programs ready\n")
    sys.stdout.flush()
    for line in sys.stdin:
        told = json.loads(line)
        answer = getattr(programs, told.pop("do"))(**told)
        sys.stdout.write(f"answer {json.dumps(answer)}\n")
        sys.stdout.flush()
    rospy.signal_shutdown("told all")


if __name__ == "__main__":
    main()
