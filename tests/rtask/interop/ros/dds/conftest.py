"""Processes that meet by DDS on the loopback interface."""

from __future__ import annotations

import os

import pytest

from rtask.cli.ros.schema import engine_schema
from rtask.interop.ros.dds.types import RosTypes
from tests.rtask.interop.ros.conftest import Child, running
from tests.servers import running_server

ADD = "example_interfaces/srv/AddTwoInts"
HAND = {"name": "h", "gripper_type": "t", "max_opening": 0.1, "max_payload": 1.0}


@pytest.fixture(scope="module")
def types():
    made = RosTypes(engine_schema())
    made.add_service(ADD, "int64 a\nint64 b\n---\nint64 sum\n")
    return made


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """Environment and domain of processes that meet on the loopback interface only."""
    pytest.importorskip("cyclonedds")
    file = tmp_path_factory.mktemp("dds") / "loopback.xml"
    file.write_text(
        '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces>'
        "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
        "</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
        '<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>'
    )
    before = os.environ.get("CYCLONEDDS_URI")
    os.environ["CYCLONEDDS_URI"] = file.as_uri()
    # Ports of a domain start at 7400 + 250 times its number; beyond 100 the system lends them out.
    yield str(1 + os.getpid() % 100)
    if before is None:
        del os.environ["CYCLONEDDS_URI"]
    else:
        os.environ["CYCLONEDDS_URI"] = before


def command(*arguments):
    return Child("ros2", *arguments, environment=os.environ)


@pytest.fixture(scope="module")
def served(network):
    """A server, and a node of ROS 2 for it in a process of its own."""
    with running_server(None) as server:
        child = command(
            "dds", "serve", "--server", server.url, "--domain", network, "--namespace", "/nao1"
        )
        with running(child):
            child.expect("ready /nao1/rtask_node")
            yield server


@pytest.fixture(scope="module")
def robot(network, types):
    """A node of a robot, in this process."""
    from rtask.interop.ros.dds.node import DdsNode

    with DdsNode("robot", types, "/nao1", int(network)) as made:
        yield made
