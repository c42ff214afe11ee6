"""``rtask ros2 doctor``: whether this machine can speak with ROS 2."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import threading

import click

from rtask.cli.ros2.dds import domain_option
from rtask.errors import RemoteUnavailableError

__all__ = ["doctor"]

_TOPIC, _TYPE = "/rtask_doctor", "std_msgs/msg/String"


@click.command()
@click.option(
    "--wait", "wait_s", default=3.0, show_default=True, type=click.FloatRange(min=0.1),
    help="How long to listen for nodes, s.",
)  # fmt: skip
@domain_option
def doctor(wait_s: float, domain: int) -> None:
    """Check what `rtask ros2 dds` needs: library, network, a message sent and heard, other nodes.

    Nodes are listed as they announce themselves on ros_discovery_info; none may mean another
    domain, another RMW than one on DDS, or a network without multicast (see CYCLONEDDS_URI).
    """
    import cyclonedds  # noqa: F401 - missing, it is named before its version is asked for

    from rtask.interop.ros.dds.node import DdsNode
    from rtask.interop.ros.dds.types import RosTypes

    has_rclpy = importlib.util.find_spec("rclpy") is not None
    click.echo(f"rclpy       {'can be imported here' if has_rclpy else 'not here; not needed'}")
    click.echo(f"cyclonedds  {importlib.metadata.version('cyclonedds')}")
    click.echo(f"network     {os.environ.get('CYCLONEDDS_URI') or 'chosen by Cyclone'}")
    click.echo(f"domain      {domain}")
    heard, names = threading.Event(), set[str]()
    with (
        DdsNode("rtask_doctor", RosTypes(), domain=domain) as node,
        DdsNode("rtask_doctor_peer", RosTypes(), domain=domain) as peer,
    ):
        node.watch_nodes(names.update)
        peer.subscribe(_TOPIC, _TYPE, lambda _: heard.set(), is_latched=True)
        publisher = node.publisher(_TOPIC, _TYPE, is_latched=True)
        message = publisher.make()
        message.data = "hello"
        publisher.publish(message)
        if not heard.wait(10.0):
            raise RemoteUnavailableError(
                "a message was sent and not heard on this machine; does CYCLONEDDS_URI name an "
                "interface that is up?"
            )
        click.echo("message     sent and heard")
        threading.Event().wait(wait_s)
    others = sorted(names - {node.full_name, peer.full_name})
    click.echo(f"nodes       {', '.join(others) or 'no other heard'}")
