"""The clause on ``rtask ros2 dds``: a node without ROS 2, in RTASK's own Python."""

from __future__ import annotations

import contextlib
import os
import queue
import re
import subprocess
from pathlib import Path

from tests.clients.ros2.programs import ROOT, Program, own_python
from tests.clients.ros2.registry import HAND

NAMESPACE = "/dds"
# The node of ROS 2 may be told to look on this machine only; so is this one.
LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces>'
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
    "</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>"
    '<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
)


def check(shell):
    """Serve by DDS, and see from ROS 2 the node, its services and the topic of changes."""
    from rclpy.utilities import get_rmw_implementation_identifier

    rtask = shell.options.rtask.split()
    python = str(Path(rtask[0]).with_name("python"))
    found = subprocess.run(
        [python, "-c", "import cyclonedds; print(cyclonedds.__file__)"], check=False,
        env=own_python(), capture_output=True, text=True, cwd=ROOT,
    )  # fmt: skip
    if found.returncode:
        return "not run: no cyclonedds in the Python of RTASK"
    environment = {**own_python(), "CYCLONEDDS_URI": LOOPBACK}
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    served = Program(
        [*rtask, "ros2", "dds", "serve", "--server", shell.url, "--namespace", NAMESPACE,
         "--domain", domain],
        environment,
    )  # fmt: skip
    try:
        served.expect(f"ready {NAMESPACE}/rtask_node")
        robot = shell.robot
        shell.wait_for(
            lambda: ("rtask_node", NAMESPACE) in robot.node.get_node_names_and_namespaces(),
            "the node of DDS in the graph",
        )
        offered = dict(robot.node.get_service_names_and_types())
        assert offered[f"{NAMESPACE}/rtask/where_is"] == ["rtask_msgs/srv/WhereIs"], offered
        rmw = get_rmw_implementation_identifier()
        if "cyclone" in rmw:
            return hear_and_call(robot)
        return refuse(robot, served, rmw)
    finally:
        served.end()


def register(robot, name, wait_s=30.0):
    """Call an operation of the node of DDS; return its response."""
    from rtask_msgs.srv import RegisterRobot

    from tests.clients.ros2.robot import set_fields

    fields = {"name": name, "model": "m", "end_effectors": [HAND]}
    return robot.call(
        "rtask/register_robot", RegisterRobot, lambda request: set_fields(request, fields),
        namespace=NAMESPACE, wait_s=wait_s,
    )  # fmt: skip


def changes(robot):
    from rtask_msgs.msg import Change

    return robot.hear(f"{NAMESPACE}/rtask/changes", Change, 100)


def change_of(heard, name):
    """Return whether the commit of a robot is among the messages."""
    try:
        while True:
            change = heard.get(timeout=2.0)
            if any(re.search(f"{name}$", graph) for graph in change.graphs):
                return True
    except queue.Empty:
        return False


def hear_and_call(robot):
    heard = changes(robot)
    answer = register(robot, "dds-0")
    assert (answer.refused, answer.robot.rpartition("/")[2]) == ("", "dds-0")
    for number in range(1, 20):  # until the subscription is matched
        assert register(robot, f"dds-{number}").refused == ""
        if change_of(heard, f"dds-{number}"):
            return "services, a topic and the node in the graph, with Cyclone"
    raise AssertionError("no commit was heard")


def refuse(robot, served, rmw):
    """See that a request of another RMW is refused in the log, and that topics come."""
    answer = None
    with contextlib.suppress(AssertionError):  # none comes
        answer = register(robot, "dds-0", wait_s=5.0)
    assert answer is None, f"a request of {rmw} was answered"
    served.expect("services work only with Cyclone as the peer's RMW")
    heard = changes(robot)
    for number in range(20):
        robot.operation("register_robot", name=f"by-{number}", model="m", end_effectors=[HAND])
        if change_of(heard, f"by-{number}"):
            return f"a topic and the node in the graph; requests of {rmw} are refused in its log"
    raise AssertionError("no commit was heard")
