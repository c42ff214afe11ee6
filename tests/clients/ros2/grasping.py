"""Clauses on grasps for MoveIt, on reliable views, and on moving an arm."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from concurrent.futures import ThreadPoolExecutor

from tests.clients.ros2.programs import NAMESPACE, ROOT, WAIT_S, Program
from tests.clients.ros2.registry import ABORTED, SUCCEEDED, clause
from tests.clients.ros2.views import show, since

AT_ONCE = 3
# Where a Panda reaches over the table that RTASK gives it, m.
GOAL = ("0.47", "0.1", "0.235")
ABOUT_ARM = (
    "import control_msgs.action, json, rclpy; from importlib.metadata import distribution; "
    "distribution('rtask-kg'); from simulate.robots import describe; "
    "arm, = describe('panda').arms.values(); "
    "print(json.dumps([arm.name, arm.joints, arm.home]))"
)
HOW_GOALS_END = {
    "aborts": "aborted (status 6 of ROS 2)",
    "leaves the path": "-4 (PATH_TOLERANCE_VIOLATED): joint 2 is off its path",
    "is cancelled by another": "canceled (status 5 of ROS 2)",
    "rejects": "the driver rejected the goal",
    "stands": "rad from its goal",
}
HOW_STATES_END = {
    "old": "s old; restart the driver",
    "frozen": "s old; restart the driver",
    "falls silent": "no new joint state came for 3 s during the motion",
    "dies": "no new joint state came for 3 s during the motion",
}
"""What an arm does, and the words that then say why the motion was given up."""


def sample(shell, name, namespace=NAMESPACE):
    """Ask for the grasps of an object; return status, words and what was heard."""
    from rclpy.action import ActionClient
    from rtask_msgs.action import SampleGraspPoses

    client = ActionClient(
        shell.robot.node, SampleGraspPoses, f"{namespace}/rtask/sample_grasp_poses"
    )
    try:
        assert client.wait_for_server(timeout_sec=WAIT_S)
        heard = []
        goal = SampleGraspPoses.Goal(action_name=name)
        sent = client.send_goal_async(goal, lambda message: heard.append(message.feedback))
        handle = shell.robot.wait(sent, WAIT_S, "the goal")
        answer = shell.robot.wait(handle.get_result_async(), 90.0, "the result")
        return answer.status, answer.result.grasp_state, heard
    finally:
        client.destroy()


@clause("rtask/sample_grasp_poses gives the grasps of the object that is named, with costs")
def _(shell):
    show(shell, 230.0)
    status, result, _ = shell.robot.see_again(
        header=since(230.0), gripper_id=shell.gripper, propose=True
    )
    assert status == SUCCEEDED, result.refused
    status, state, heard = sample(shell, "soap")
    assert (status, bool(heard)) == (SUCCEEDED, True), state
    poses, costs = heard[0].grasp_candidates, list(heard[0].costs)
    assert len(poses) == len(costs) > 0
    assert costs == sorted(costs)
    assert all(0.0 <= cost <= 1.0 for cost in costs), costs
    assert {pose.header.frame_id for pose in poses} == {"base_footprint"}
    status, refused, heard = sample(shell, "a piano")
    assert (status, heard) == (ABORTED, []), refused
    assert "a piano" in refused
    return state


@clause("with reliable_views it hears clouds reliably, and a best-effort camera not at all")
def _(shell):
    from rclpy.qos import QoSReliabilityPolicy

    shell.end_camera()
    shell.robot.forget_publishers("/camera/points")
    node = shell.start_node("--gripper", "hand", namespace="/reliable",
                            ros=("-p", "reliable_views:=true"))  # fmt: skip
    try:

        def ends():
            return [
                end.qos_profile.reliability
                for end in shell.robot.node.get_subscriptions_info_by_topic("/camera/points")
                if end.node_namespace == "/reliable"
            ]

        shell.wait_for(ends, "the subscription in the graph")
        assert ends() == [QoSReliabilityPolicy.RELIABLE], ends()
        show(shell, 240.0)
        status, result, _ = shell.robot.see(header=since(240.0), namespace="/reliable")
        assert (status, "within 5 s" in result.refused) == (ABORTED, True), result.refused
        shell.end_camera()
        shell.robot.forget_publishers("/camera/points")
        show(shell, 250.0, reliable=True)
        status, result, _ = shell.robot.see_again(header=since(250.0), namespace="/reliable")
        assert (status, len(result.objects)) == (SUCCEEDED, 2), result.refused
    finally:
        node.end()
        shell.end_camera()
        shell.robot.forget_publishers("/camera/points")


def reach_with(shell, behaviour):
    """Let the command move an arm that behaves so; return its exit code, its words, the arm."""
    _, joints, home = json.loads(shell.arm)
    space = "/" + behaviour.replace(" ", "_")  # several are moved at once
    action, topic = f"{space}/follow_joint_trajectory", f"{space}/joint_states"
    command = [*shell.options.reach.split(), "-m", "tests.clients.ros2.arm", behaviour]
    arm = Program([*command, action, topic, ",".join(joints), ",".join(str(q) for q in home)])
    try:
        arm.expect("ready")
        done = subprocess.run(
            [*shell.options.reach.split(), "-m", "rtask", "robot", "reach", *GOAL, "--robot",
             "panda", "--ros2", "--seed", "1", "--action", action, "--joints", topic],
            cwd=ROOT, capture_output=True, text=True, check=False, timeout=150,
        )  # fmt: skip
    finally:
        arm.end(signal.SIGKILL)
    return behaviour, done.returncode, done.stdout, done.stderr, "".join(arm.all)


def reach_with_each(shell, behaviours):
    """Let the command move arms that behave so, some at once; yield what ended how."""
    with ThreadPoolExecutor(AT_ONCE) as pool:
        yield from pool.map(lambda behaviour: reach_with(shell, behaviour), behaviours)


def why_no_arm(shell):
    """Return why no arm can be moved here, or none; the command runs in a Python with rclpy."""
    done = subprocess.run(
        [*shell.options.reach.split(), "-c", ABOUT_ARM],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=120, env=os.environ,
    )  # fmt: skip
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        return f"not run: --reach {shell.options.reach} lacks rclpy, control_msgs or RTASK: {last}"
    shell.arm = done.stdout
    return ""


@clause("rtask robot reach --ros2 moves an arm by its driver, and measures that it is there")
def _(shell):
    if words := why_no_arm(shell):
        return words
    _, code, out, err, _ = reach_with(shell, "follows")
    assert (code, f"is at ({GOAL[0]}, {GOAL[1]}, {GOAL[2]})" in out) == (0, True), (out, err[-900:])
    return out.strip()


@clause("rtask robot reach --ros2 gives up, and says why, where the driver ends a goal otherwise")
def _(shell):
    if words := why_no_arm(shell):
        return words
    for behaviour, code, out, err, _ in reach_with_each(shell, HOW_GOALS_END):
        assert (code, out) == (3, ""), (behaviour, code, out, err[-900:])
        assert HOW_GOALS_END[behaviour] in err, (behaviour, err[-900:])
    return ", ".join(HOW_GOALS_END)


@clause("rtask robot reach --ros2 gives up where joint states are old or stop, or the link is lost")
def _(shell):
    if words := why_no_arm(shell):
        return words
    for behaviour, code, out, err, arm in reach_with_each(shell, HOW_STATES_END):
        assert (code, out) == (3, ""), (behaviour, code, out, err[-900:])
        assert HOW_STATES_END[behaviour] in err, (behaviour, err[-900:])
        if behaviour == "falls silent":
            assert "cancelled" in arm, (behaviour, arm)
        elif behaviour == "dies":
            assert "nobody can tell whether the arm" in err, err[-900:]
    return ", ".join(HOW_STATES_END)
