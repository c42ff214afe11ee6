"""``rtask ros2 doctor``: whether this machine can speak with ROS 2."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import threading

import click

from rtask.cli.options import json_option, print_json
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
@json_option
def doctor(wait_s: float, domain: int, as_json: bool) -> None:
    """Check what `rtask ros2 dds` needs: library, network, a message sent and heard, other nodes.

    Nodes are listed as they announce themselves on ros_discovery_info; none may mean another
    domain, another RMW than one on DDS, or a network without multicast (see CYCLONEDDS_URI).
    """
    import cyclonedds  # noqa: F401 - missing, it is named before its version is asked for

    from rtask.interop.ros.dds.node import DdsNode
    from rtask.interop.ros.dds.types import RosTypes

    rows: dict[str, str | list[str]] = {
        "rclpy": "importable" if importlib.util.find_spec("rclpy") else "not here; not needed",
        "cyclonedds": importlib.metadata.version("cyclonedds"),
        "network": os.environ.get("CYCLONEDDS_URI") or "chosen by Cyclone",
        "domain": str(domain),
    }
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
        rows["message"] = "sent and heard"
        threading.Event().wait(wait_s)
    rows["nodes"] = sorted(names - {node.full_name, peer.full_name})
    if as_json:
        print_json(rows)
        return
    for name, value in rows.items():
        text = value if isinstance(value, str) else ", ".join(value) or "no other heard"
        click.echo(f"{name:<11} {text}")
