"""Starts the node: ``ros2 run rtask_ros2 node`` or ``rtask ros2 node``."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from rtask.errors import RtaskError, UsageError
from rtask.ros2.contract import Contract
from rtask.ros2.node import GraphNode, NodeOptions

__all__ = ["main", "run"]

_THREADS = 16
_DISCOVERY_S, _WATCH_S = 2.0, 5.0
_NEEDED = (
    "websockets.sync.client",
    "rclpy",
    "rtask_msgs.msg",
    "moveit_msgs.msg",
    "tf2_msgs.msg",
    "visualization_msgs.msg",
)
_ABOUT = """Offer the operations of a server in ROS 2, until Ctrl-C: services rtask/<operation> and
rtask/segment, the action rtask/see, topics rtask/grasps, rtask/objects, rtask/world,
rtask/planning_scene and rtask/changes. Views come on ~/points, or on ~/depth with ~/image and
~/camera_info. Arguments of ROS follow --ros-args: -r __ns:=/robot,
-r '~/points:=/camera/depth_registered/points', -p table_height:=0.7."""


def main() -> int:
    """Run the node with the contract of the distribution, and return the exit code."""
    return run(sys.argv[1:], Contract.read())


def run(arguments: Sequence[str], contract: Contract) -> int:
    """Run the node until a signal ends it, and return the exit code.

    Parameters
    ----------
    arguments
        Of the command line, those of ROS included.
    """
    try:
        for name in _NEEDED:
            _check_import(name)
        return _run(list(arguments), contract)
    except RtaskError as error:
        print(f"Error: {error}", file=sys.stderr)  # noqa: T201 - a command says what is wrong
        return 2 if isinstance(error, UsageError) else 3


def _run(arguments: list[str], contract: Contract) -> int:
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args

    given = _parser().parse_args(remove_ros_args(["node", *arguments])[1:])
    options = NodeOptions(
        given.name, given.server, given.frame, given.gripper, _token(given.token_file),
        given.timeout, given.outbox,
    )  # fmt: skip
    ended = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    rclpy.init(args=["node", *arguments], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = GraphNode(options, contract)
        try:
            _spin(node, given, ended)
        finally:
            node.close()
    finally:
        rclpy.try_shutdown()
    return 0


def _spin(node: GraphNode, given: argparse.Namespace, ended: threading.Event) -> None:
    """Serve ROS until the end."""
    from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor

    executor = MultiThreadedExecutor(num_threads=_THREADS)
    executor.add_node(node.node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            ended.set()

    thread = threading.Thread(target=spin, daemon=True, name="rtask-spin")
    thread.start()
    try:
        node.wait_for_clock(given.wait)
        node.check_free(_DISCOVERY_S)
        if given.managed:
            _say(f"unconfigured {node.full_name}")
        else:
            _start(node)
            _say(f"ready {node.full_name} for {node.url}")
        while not ended.wait(_WATCH_S):
            node.watch_for_rival()
    finally:
        executor.shutdown(timeout_sec=5.0)
        thread.join(5.0)


def _start(node: GraphNode) -> None:
    from rclpy.lifecycle import TransitionCallbackReturn

    for transition in (node.node.trigger_configure, node.node.trigger_activate):
        if transition() != TransitionCallbackReturn.SUCCESS:
            raise UsageError(node.trouble or f"{node.full_name} could not be started")


def _say(words: str) -> None:
    print(words, flush=True)  # noqa: T201 - who started it waits for this line


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("node", description=_ABOUT)
    add = parser.add_argument
    add("--server", metavar="URL", default="", help="server; else url, else RTASK_SERVER")
    add("--token-file", type=Path, help="file with the robot's token; else RTASK_TOKEN")
    add("--name", default="rtask_node", help="name of the node")
    add("--frame", default="", help="frame with z up for answers; else the parameter frame")
    add("--gripper", default="", help="name of the end effector; else gripper_id")
    add("--outbox", type=Path, help="file that keeps what could not be sent; it is sent later")
    add("--wait", type=float, default=10.0, metavar="S", help="longest wait for /clock, s")
    add("--timeout", type=float, default=30.0, metavar="S",
        help="longest wait for an answer of the server, s")  # fmt: skip
    add("--managed", action="store_true",
        help="stay unconfigured until `ros2 lifecycle set` configures and activates")  # fmt: skip
    return parser


def _token(file: Path | None) -> str | None:
    """Return the token in a file, or else that of the environment."""
    if file is None:
        return os.environ.get("RTASK_TOKEN")
    try:
        token = file.read_text("utf-8").strip()
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from error
    if not token:
        raise UsageError(f"{file}: the file is empty; expected a token")
    return token


def _check_import(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError as error:
        if name == "rclpy":
            raise UsageError(
                f"no rclpy ({error}): source a ROS 2, such as /opt/ros/jazzy/setup.bash"
            ) from error
        package = name.partition(".")[0]
        if package == "websockets":
            raise UsageError(
                f"no websocket client ({error}): pip install 'websockets>=15'; that of apt is older"
            ) from error
        raise UsageError(
            f"no {package} ({error}): `rtask ros messages ~/ws/src`, build it with colcon and "
            "source the workspace"
            if package == "rtask_msgs"
            else f"no {package} ({error}): apt-get install ros-$ROS_DISTRO-"
            f"{package.replace('_', '-')}"
        ) from error
