"""``rtask ros node``: the graph as services, topics and an action of ROS 1."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.ros.options import (
    node_name_option,
    outbox_option,
    timeout_option,
    token_file_option,
    token_of,
)
from rtask.cli.ros.schema import engine_schema
from rtask.errors import RemoteUnavailableError, UsageError

if TYPE_CHECKING:
    from rtask.client import Client
    from rtask.interop.ros.looking import SeeOptions
    from rtask.interop.ros.node import RosNode
    from rtask.interop.ros.schema import Schema

__all__ = ["end_on_signals", "node"]


@click.command()
@click.argument("remaps", nargs=-1, metavar="[REMAPS]...")
@click.option(
    "--server",
    "url",
    metavar="URL",
    help="Server; else ~url, else RTASK_SERVER.",
)
@token_file_option
@node_name_option
@click.option("--frame", help="Frame with z up for answers; else ~frame, else base_footprint.")
@click.option("--gripper", help="Name of the end effector; else ~gripper_id.")
@outbox_option
@click.option(
    "--wait",
    "wait_s",
    type=click.FloatRange(min=0),
    default=10.0,
    show_default=True,
    help="Longest wait for the ROS master, and for /clock, s.",
)
@timeout_option
def node(
    remaps: tuple[str, ...],
    url: str | None,
    token_file: Path | None,
    name: str,
    frame: str | None,
    gripper: str | None,
    outbox: Path | None,
    wait_s: float,
    timeout_s: float,
) -> None:
    """Offer the operations of a server in ROS 1, until Ctrl-C.

    Services rtask/<operation> and rtask/segment; topics rtask/grasps, rtask/objects, rtask/world,
    rtask/planning_scene and rtask/changes; the action rtask/see, which looks at the clouds on
    ~points, or at the depth on ~depth with ~image and ~camera_info; the action
    rtask/sample_grasp_poses for the MoveIt Task Constructor. Grasps keep clear of MoveIt's planning
    scene, if there is one. REMAPS are arguments of ROS: ~points:=/camera/depth_registered/points,
    __ns:=/robot, _table_height:=0.7. Private parameters: ~url, ~frame, ~gripper_id, ~table_height,
    ~min_confidence, ~use_planning_scene, ~hand_links, ~grasp_target.
    """
    import rtask
    from rtask.interop.ros.find import use_ros
    from rtask.interop.ros.package import load_messages

    schema = engine_schema()
    load_messages(schema, use_ros())
    from rtask.interop.ros.node import NodeOptions, RosNode
    from rtask.interop.ros.operations import service_names

    offered = [*service_names(schema), "rtask/segment"]
    ros_node = RosNode(NodeOptions(name, remaps, wait_s), offered)
    try:
        end_on_signals(ros_node)
        address = url or _parameter("url", str) or os.environ.get("RTASK_SERVER")
        if not address:
            raise UsageError("no server: give --server, the parameter ~url or RTASK_SERVER")
        client = rtask.connect(
            address, token=token_of(token_file), timeout_s=timeout_s, outbox=outbox
        )
        with client:
            _serve(ros_node, schema, client, _options(frame, gripper))
            click.echo(f"ready {ros_node.name} for {address}")
            reason = ros_node.spin()
    finally:
        ros_node.end()
    if reason:
        raise RemoteUnavailableError(f"ROS ended the node {ros_node.name}: {reason}")


def _serve(ros_node: RosNode, schema: Schema, client: Client, options: SeeOptions) -> None:
    """Offer everything; the objects live on in rospy's threads."""
    import rospy

    from rtask.interop.ros.changes import ChangeTopic
    from rtask.interop.ros.scene.rospy_client import scene_source
    from rtask.interop.ros.seeing import Eyes, SampleAction, SeeAction, SegmentService
    from rtask.interop.ros.services import BestGrasps, OperationServices, world_display

    best = BestGrasps()
    OperationServices(schema, client, best.heard)
    eyes = Eyes(options.frame, str(rospy.get_param("robot_description", "")))
    SegmentService(eyes)
    scene = None
    if _parameter("use_planning_scene", bool) is not False:
        scene = scene_source(tuple(_parameter("hand_links", list) or ()))
    action = SeeAction(eyes, client, options, best.heard, scene)
    sampling = SampleAction(action, lambda: _parameter("grasp_target", str) or "")
    ChangeTopic(client.follow)
    world = world_display(client)

    last = [rospy.Time.now()]

    def each_second() -> None:
        world.refresh()
        now = rospy.Time.now()
        if now < last[0]:
            eyes.transforms.clear()
            eyes.camera.forget()
            action.forget()
            sampling.forget()
            rospy.logwarn("the time jumped back by %.1f s", (last[0] - now).to_sec())
        last[0] = now
        if client.waiting:
            try:
                client.deliver()
            except RemoteUnavailableError as error:
                rospy.logwarn_throttle(60, f"{client.waiting} calls wait in the outbox: {error}")

    ros_node.each_second(each_second)


def _options(frame: str | None, gripper: str | None) -> SeeOptions:
    from rtask.interop.ros.looking import SeeOptions

    return SeeOptions(
        frame or _parameter("frame", str) or "base_footprint",
        gripper or _parameter("gripper_id", str) or "",
        _parameter("table_height", float),
        _parameter("min_confidence", float),
    )


def _parameter(name: str, kind: type) -> Any:
    """Return a private parameter of the node; None if it is not set."""
    import rospy

    value = rospy.get_param(f"~{name}", None)
    if value is None or value == "":
        return None
    try:
        return kind(value)
    except (TypeError, ValueError):
        full = rospy.resolve_name(f"~{name}")
        raise UsageError(f"parameter {full}: expected a {kind.__name__}, got {value!r}") from None


def end_on_signals(ros_node: RosNode) -> None:
    """End a node on SIGINT and SIGTERM."""

    def stop(number: int, frame: FrameType | None) -> None:
        ros_node.ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
