"""``rtask ros zenoh``: topics of ROS 2 without ROS 2, experimental."""

from __future__ import annotations

import json
import os
import queue
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from rtask.cli.options import json_option, print_json
from rtask.errors import UsageError

__all__ = ["zenoh"]

_TYPES = {
    "cloud": "sensor_msgs/msg/PointCloud2",
    "image": "sensor_msgs/msg/CompressedImage",
}


@click.group()
def zenoh() -> None:
    """Exchange topics with ROS 2 over rmw_zenoh. Experimental: not tested against ROS 2.

    Written after the published design of rmw_zenoh; two processes of ours understand each other.
    Needs the extra zenoh, and a router: ros2 run rmw_zenoh_cpp rmw_zenohd. Services and actions of
    ROS 2 are not offered: call the operations through rosbridge.
    """
    click.echo("experimental: not tested against ROS 2", err=True)


def _connected(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that say where the router is."""
    for add in (
        click.option("--domain", default=0, show_default=True, help="ROS_DOMAIN_ID."),
        click.option(
            "--router", default="tcp/localhost:7447", show_default=True, help="Zenoh router."
        ),
    ):
        command = add(command)
    return command


@zenoh.command()
@click.option(
    "--server", metavar="URL", envvar="RTASK_SERVER", show_envvar=True, required=True,
    help="Server whose graph is followed; its token is read from RTASK_TOKEN.",
)  # fmt: skip
@click.option("--topic", default="/rtask/changes", show_default=True, help="Topic of ROS 2.")
@_connected
def changes(server: str, topic: str, router: str, domain: int) -> None:
    """Publish each commit to the graph as a std_msgs/msg/String of JSON, until Ctrl-C."""
    import rtask
    from rtask.interop.ros.zenoh.node import ZenohNode

    kind = "std_msgs/msg/String"
    with (
        rtask.connect(server, token=os.environ.get("RTASK_TOKEN")) as client,
        ZenohNode("rtask", router, domain) as node,
    ):
        publisher = node.publisher(topic, kind)
        click.echo(f"ready {topic} for {server}")
        for commit in client.follow():
            event = {
                "commit": commit.seq,
                "agent": commit.agent,
                "added": len(commit.added),
                "removed": len(commit.removed),
                "derived": len(commit.inferred_added),
            }
            publisher.publish(node.types.types[kind](data=json.dumps(event)))


@zenoh.command()
@click.argument("topic")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--kind", type=click.Choice(sorted(_TYPES)), default="cloud", show_default=True,
    help="PointCloud2 or CompressedImage.",
)  # fmt: skip
@click.option("--count", default=1, show_default=True, help="How many messages.")
@click.option("--wait", "wait_s", default=30.0, show_default=True, help="Longest wait for each, s.")
@_connected
@json_option
def save(
    topic: str,
    folder: Path,
    kind: str,
    count: int,
    wait_s: float,
    router: str,
    domain: int,
    as_json: bool,
) -> None:
    """Save what is published on TOPIC of ROS 2 in FOLDER: clouds as PCD, images as they come.

    The files are what `rtask segment` and `rtask recognise` read.
    """
    from rtask.interop.ros.zenoh.node import ZenohNode

    heard: queue.Queue[Any] = queue.Queue()
    files: list[str] = []
    with ZenohNode("rtask", router, domain) as node:
        node.subscribe(topic, _TYPES[kind], heard.put)
        click.echo(f"ready {topic}", err=True)
        folder.mkdir(parents=True, exist_ok=True)
        for number in range(count):
            try:
                message = heard.get(timeout=wait_s)
            except queue.Empty:
                raise UsageError(
                    f"nothing came on {topic} within {wait_s:g} s; do type and --domain fit?"
                ) from None
            name, data = _file(kind, message)
            file = folder / f"{number:04d}.{name}"
            file.write_bytes(data)
            files.append(str(file))
            if not as_json:
                click.echo(f"{file}")
    if as_json:
        print_json(files)


def _file(kind: str, message: Any) -> tuple[str, bytes]:
    """Return ending and bytes of the file of a message."""
    from features.codec.ros import image_bytes, pcd_from_point_cloud
    from features.imaging.recordings import message_mapping

    try:
        if kind == "cloud":
            return "pcd", pcd_from_point_cloud(message_mapping(message))
        data = image_bytes(message_mapping(message))
    except ValueError as error:
        raise UsageError(str(error)) from error
    return ("jpg" if data.startswith(b"\xff\xd8") else "png"), data
