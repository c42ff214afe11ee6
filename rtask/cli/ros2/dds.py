"""``rtask ros2 dds``: services and topics of ROS 2 without ROS 2."""

from __future__ import annotations

import json
import queue
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import json_option, print_json
from rtask.cli.ros.options import (
    node_name_option,
    outbox_option,
    timeout_option,
    token_file_option,
    token_of,
)
from rtask.cli.ros.schema import engine_schema
from rtask.errors import CallFailedError, DataError, RemoteUnavailableError, UsageError

if TYPE_CHECKING:
    from rtask.client import Client

__all__ = ["dds", "domain_option", "ended_by_signals"]

_TYPES = {
    "cloud": "sensor_msgs/msg/PointCloud2",
    "image": "sensor_msgs/msg/CompressedImage",
}
_EACH_S = 1.0


@click.group()
def dds() -> None:
    """Exchange topics and services with ROS 2 by DDS. Needs the extra dds, no ROS 2.

    Topics work with every DDS, services only with Cyclone as the peer's RMW:
    RMW_IMPLEMENTATION=rmw_cyclonedds_cpp. The network is set as for Cyclone: by CYCLONEDDS_URI.
    """


domain_option: Callable[..., Any] = click.option(
    "--domain", default=0, show_default=True, envvar="ROS_DOMAIN_ID", show_envvar=True,
    type=click.IntRange(0, 232), help="Domain of ROS 2.",
)  # fmt: skip


@dds.command()
@click.option(
    "--server", metavar="URL", envvar="RTASK_SERVER", show_envvar=True, required=True,
    help="Server whose operations are offered.",
)  # fmt: skip
@token_file_option
@node_name_option
@click.option("--namespace", default="/", show_default=True, help="Before all names: /nao1.")
@outbox_option
@timeout_option
@domain_option
def serve(
    server: str,
    token_file: Path | None,
    name: str,
    namespace: str,
    outbox: Path | None,
    timeout_s: float,
    domain: int,
) -> None:
    """Offer the operations of a server as services of ROS 2, until Ctrl-C.

    Services rtask/<operation> with the types of `rtask ros messages`; topics rtask/changes and
    rtask/grasps (latched). An operation that is refused is answered with the reason in the field
    refused.
    """
    import rtask
    from rtask.interop.ros.dds.graph import ChangeFeed, GraphServices
    from rtask.interop.ros.dds.node import DdsNode
    from rtask.interop.ros.dds.types import RosTypes

    schema, ended = engine_schema(), ended_by_signals()
    with (
        rtask.connect(
            server, token=token_of(token_file), timeout_s=timeout_s, outbox=outbox
        ) as client,
        DdsNode(name, RosTypes(schema), namespace, domain) as node,
    ):
        GraphServices(node, schema, client)
        feed = ChangeFeed(node, client.follow, ended)
        click.echo(f"ready {node.full_name} for {server}")
        while not ended.wait(_EACH_S):
            _deliver(client)
        if feed.failure is not None:
            raise feed.failure


@dds.command()
@click.argument("operation")
@click.argument("request", default="{}", metavar="[JSON]")
@click.option("--namespace", default="/", show_default=True, help="Of the node that answers.")
@click.option("--wait", "wait_s", default=10.0, show_default=True, help="Longest wait, s.")
@domain_option
def call(operation: str, request: str, namespace: str, wait_s: float, domain: int) -> None:
    """Call an OPERATION of a node in ROS 2, and print the response as JSON.

    JSON has the fields of the service's request: `rtask ros2 dds call where_is '{"name": "cup"}'`.
    """
    from rtask.interop.ros.convert import fill, mapping_of
    from rtask.interop.ros.dds.node import DdsNode
    from rtask.interop.ros.dds.types import RosTypes
    from rtask.interop.ros.schema import PACKAGE, REFUSED

    schema = engine_schema()
    service = schema.services.get(operation)
    if service is None:
        raise UsageError(f"no operation {operation!r}; there are {', '.join(schema.services)}")
    try:
        fields = json.loads(request)
    except ValueError as error:
        raise UsageError(f"JSON: {error}") from error
    types = RosTypes(schema)
    with DdsNode("rtask_call", types, namespace, domain) as node:
        client = node.client(f"rtask/{operation}", f"{PACKAGE}/srv/{service.name}")
        try:
            message = fill(client.make(), fields, types.make)
        except (TypeError, ValueError, KeyError) as error:
            raise UsageError(f"the request does not fit {service.name}: {error!r}") from error
        response = mapping_of(client.call(message, wait_s))
    print_json(response)
    if refused := response[REFUSED]:
        raise CallFailedError(refused)


@dds.command()
@click.argument("topic")
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--kind", type=click.Choice(sorted(_TYPES)), default="cloud", show_default=True,
    help="PointCloud2 or CompressedImage.",
)  # fmt: skip
@click.option("--count", default=1, show_default=True, help="How many messages.")
@click.option("--wait", "wait_s", default=30.0, show_default=True, help="Longest wait for each, s.")
@domain_option
@json_option
def save(
    topic: str,
    folder: Path,
    kind: str,
    count: int,
    wait_s: float,
    domain: int,
    as_json: bool,
) -> None:
    """Save what is published on TOPIC of ROS 2 in FOLDER: clouds as PCD, images as they come.

    The files are what `rtask segment` and `rtask recognise` read.
    """
    from rtask.interop.ros.dds.node import DdsNode
    from rtask.interop.ros.dds.types import RosTypes

    heard: queue.Queue[bytes] = queue.Queue()
    files: list[str] = []
    types = RosTypes()
    with DdsNode("rtask_save", types, domain=domain) as node:
        node.subscribe(topic, _TYPES[kind], heard.put)
        click.echo(f"ready {topic}", err=True)
        folder.mkdir(parents=True, exist_ok=True)
        for number in range(count):
            try:
                cdr = heard.get(timeout=wait_s)
            except queue.Empty:
                raise RemoteUnavailableError(
                    f"nothing came on {topic} within {wait_s:g} s; do type and --domain fit?"
                ) from None
            name, data = _file(kind, types.decode_arrays(cdr, _TYPES[kind]))
            file = folder / f"{number:04d}.{name}"
            file.write_bytes(data)
            files.append(str(file))
            if not as_json:
                click.echo(f"{file}")
    if as_json:
        print_json(files)


def ended_by_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set."""
    ended = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    return ended


def _deliver(client: Client) -> None:
    """Send what waits in the outbox, if the server is back."""
    if client.waiting:
        try:
            client.deliver()
        except RemoteUnavailableError as error:
            click.echo(f"{client.waiting} calls wait in the outbox: {error}", err=True)


def _file(kind: str, message: Any) -> tuple[str, bytes]:
    """Return ending and bytes of the file of a message."""
    from features.codec.ros import image_bytes, pcd_from_point_cloud
    from features.imaging.recordings import message_mapping

    try:
        if kind == "cloud":
            return "pcd", pcd_from_point_cloud(message_mapping(message))
        data = image_bytes(message_mapping(message))
    except ValueError as error:
        raise DataError(str(error)) from error
    return ("jpg" if data.startswith(b"\xff\xd8") else "png"), data
