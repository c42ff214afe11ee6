"""An arm in ROS 2 behind its driver, as a process: it follows, or misbehaves as it is told.

    python -m tests.clients.ros2.arm BEHAVIOUR ACTION TOPIC JOINTS HOME

The action server and its states are rclpy's own. JOINTS and HOME are separated by commas. Killed,
it is an arm whose link is lost.
"""

from __future__ import annotations

import os
import sys
import threading
import time

HURRY = 2.0
"""How many times as fast as it was asked the arm moves, so that a run is short."""


class Arm:
    """Joint states and goals of one arm."""

    def __init__(self, node, behaviour, action, topic, joints, home):
        from action_msgs.srv import CancelGoal
        from control_msgs.action import FollowJointTrajectory
        from rclpy.action import ActionServer, CancelResponse, GoalResponse
        from rclpy.callback_groups import ReentrantCallbackGroup
        from sensor_msgs.msg import JointState

        self.node, self.behaviour, self.joints, self.at = node, behaviour, joints, list(home)
        self.is_silent, self.began = False, time.time_ns()
        self.state, self.kind = JointState, FollowJointTrajectory
        group = ReentrantCallbackGroup()
        self.states = node.create_publisher(JointState, topic, 10)
        self.timer = node.create_timer(0.02, self.tell, callback_group=group)
        self.other = node.create_client(
            CancelGoal, f"{action}/_action/cancel_goal", callback_group=group
        )
        answer = GoalResponse.REJECT if behaviour == "rejects" else GoalResponse.ACCEPT
        self.server = ActionServer(
            node, FollowJointTrajectory, action, self.carry_out, callback_group=group,
            goal_callback=lambda goal: answer, cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )  # fmt: skip

    def tell(self):
        """Publish the joints, with those of a hand that nobody asked for."""
        if self.is_silent:
            return
        now = {"old": time.time_ns() - 3_600 * 10**9, "frozen": self.began}.get(self.behaviour)
        state = self.state(name=["finger", *self.joints[::-1]], position=[0.0, *self.at[::-1]])
        state.header.stamp.sec, state.header.stamp.nanosec = divmod(now or time.time_ns(), 10**9)
        self.states.publish(state)

    def carry_out(self, handle):
        result = self.kind.Result()
        if self.behaviour == "aborts":
            handle.abort()
        elif self.behaviour == "leaves the path":
            result.error_code, result.error_string = -4, "joint 2 is off its path"
            handle.abort()
        elif self.behaviour == "is cancelled by another":
            self.cancel_all(handle)
        elif self.behaviour == "falls silent":
            self.wait_for_cancel(handle)
        elif self.behaviour == "dies":
            os._exit(1)
        else:
            if self.behaviour != "stands":
                self.follow(handle.request.trajectory)
            handle.succeed()
        return result

    def follow(self, way):
        order = [way.joint_names.index(name) for name in self.joints]
        passed = 0.0
        for point in way.points:
            until = point.time_from_start.sec + point.time_from_start.nanosec / 1e9
            time.sleep(max(until - passed, 0.0) / HURRY)
            passed, self.at = until, [point.positions[k] for k in order]

    def cancel_all(self, handle):
        from action_msgs.srv import CancelGoal

        self.other.call_async(CancelGoal.Request())  # no id and no time: every goal
        while not handle.is_cancel_requested:
            time.sleep(0.01)
        handle.canceled()

    def wait_for_cancel(self, handle):
        """Say nothing more until the goal is cancelled, which is printed."""
        self.is_silent = True
        while not handle.is_cancel_requested:
            time.sleep(0.01)
        handle.canceled()
        sys.stdout.write("cancelled\n")
        sys.stdout.flush()
        self.is_silent = False


def main():
    import rclpy
    from rclpy.executors import MultiThreadedExecutor

    behaviour, action, topic, joints, home = sys.argv[1:6]
    rclpy.init(args=[])
    node = rclpy.create_node("arm")
    at_home = [float(q) for q in home.split(",")]
    arm = Arm(node, behaviour, action, topic, joints.split(","), at_home)
    executor = MultiThreadedExecutor(num_threads=6)
    executor.add_node(node)
    sys.stdout.write(f"ready {len(arm.joints)} joints\n")
    sys.stdout.flush()
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    thread.join()


if __name__ == "__main__":
    main()
