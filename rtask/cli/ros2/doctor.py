"""``rtask ros2 doctor``: say what is wrong with a machine's ROS 2, and what mends it."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import click

from rtask.cli.doctor import Finding, print_findings
from rtask.cli.options import json_option
from rtask.cli.ros2.dds import domain_option
from rtask.cli.ros2.environment import Sourced, examine_environment, examine_packages
from rtask.cli.ros2.graph import examine_graph, take_survey
from rtask.errors import AccessError, RtaskError

__all__ = ["doctor"]

_TOPIC, _TYPE = "/rtask_doctor", "std_msgs/msg/String"
_HEARD_S, _SERVER_S = 10.0, 5.0


@click.command()
@click.option(
    "--server", "url", metavar="URL", envvar="RTASK_SERVER", show_envvar=True,
    help="Also look whether this server answers.",
)  # fmt: skip
@click.option(
    "--token-file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="File with the robot's token; else RTASK_TOKEN.",
)
@click.option(
    "--wait", "wait_s", default=3.0, show_default=True, type=click.FloatRange(min=0.1),
    help="How long to listen for nodes, s.",
)  # fmt: skip
@domain_option
@json_option
def doctor(
    url: str | None, token_file: Path | None, wait_s: float, domain: int, as_json: bool
) -> None:
    """Say what is wrong with this machine's ROS 2, and what mends it.

    Exit code 1 when something must be mended; notes do not count. Looks at the distribution, the
    RMW, the domain and the discovery, the built packages and their hashes, the server, the nodes
    and their clock, and for publishers and subscribers that do not hear each other. Run it in the
    shell in which ROS 2 is sourced. Without ROS 2 it looks at what `rtask ros2 dds` needs.
    """
    print_findings(_examine(url, token_file, wait_s, domain), quiet=False, as_json=as_json)


def _examine(
    url: str | None, token_file: Path | None, wait_s: float, domain: int
) -> Iterator[Finding]:
    from rtask.cli.ros.schema import engine_schema

    ros = Sourced()
    yield from examine_environment(ros, domain)
    if url is not None:
        yield _server(url, token_file)
    if ros:
        yield from examine_packages(ros, engine_schema())
        yield from examine_graph(take_survey(ros, domain, wait_s))
    yield from _dds(domain, wait_s, is_needed=not ros)


def _server(url: str, token_file: Path | None) -> Finding:
    import rtask
    from rtask.cli.ros.node import token_of

    try:
        token = token_of(token_file)
        with rtask.connect(url, token=token, timeout_s=_SERVER_S) as client:
            client.ask("ASK { ?s ?p ?o }")
    except AccessError as error:
        mend = "rtask token create --robot NAME on the server, and --token-file or RTASK_TOKEN here"
        return Finding("server", "broken", str(error), mend)
    except RtaskError as error:
        return Finding(
            "server", "broken", str(error), f"rtask serve, or another --server than {url}"
        )
    return Finding("server", "ok", f"answers at {url}, {'with' if token else 'without'} a token")


def _dds(domain: int, wait_s: float, is_needed: bool) -> Iterator[Finding]:
    """Look at what ``rtask ros2 dds`` needs: the library, and a message sent and heard."""
    if importlib.util.find_spec("cyclonedds") is None:
        yield Finding(
            "cyclonedds", "broken" if is_needed else "note",
            "not installed; rtask ros2 dds needs it", "pip install 'rtask-kg[dds]'",
        )  # fmt: skip
        return
    network = os.environ.get("CYCLONEDDS_URI") or "chosen by Cyclone"
    version = importlib.metadata.version("cyclonedds")
    yield Finding("cyclonedds", "ok", f"{version}; network: {network}")
    try:
        names = _heard_nodes(domain, wait_s)
    except RtaskError as error:
        yield Finding("dds", "broken", str(error), "look at CYCLONEDDS_URI and the domain")
        return
    if names is None:
        yield Finding(
            "dds", "broken", "a message was sent and not heard on this machine",
            "let CYCLONEDDS_URI name an interface that is up",
        )  # fmt: skip
        return
    yield Finding("dds", "ok", "a message was sent and heard")
    yield Finding("dds nodes", "ok", ", ".join(sorted(names)) or "no other heard")


def _heard_nodes(domain: int, wait_s: float) -> set[str] | None:
    """Return the nodes that announce themselves; None if this machine does not hear itself."""
    from rtask.interop.ros.dds.node import DdsNode
    from rtask.interop.ros.dds.types import RosTypes

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
        if not heard.wait(_HEARD_S):
            return None
        threading.Event().wait(wait_s)
        return names - {node.full_name, peer.full_name}
