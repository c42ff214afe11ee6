"""A node of ROS 2 in RTASK's own Python."""

from __future__ import annotations

import contextlib
import shlex
import threading
from collections.abc import Callable, Iterator
from typing import Any

import click

from rtask.errors import UsageError

__all__ = ["ros2_node", "ros_arguments"]

_END_S = 2.0

ros_arguments: Callable[..., Any] = click.option(
    "--ros-args", default="", metavar="TEXT",
    help="Arguments of ROS 2, such as '-r __ns:=/nao1 -p use_sim_time:=true'.",
)  # fmt: skip


@contextlib.contextmanager
def ros2_node(name: str, arguments: str = "", threads: int = 2) -> Iterator[Any]:
    """Yield a node of ROS 2 whose callbacks are run in threads of its own.

    Parameters
    ----------
    name
        Of the node.
    arguments
        Of ROS, as they follow ``--ros-args``: ``-r __ns:=/nao1 -p use_sim_time:=true``.
    threads
        In which its callbacks are run.

    Raises
    ------
    UsageError
        There is no rclpy here, or ROS does not start, as with arguments that it refuses.
    """
    try:
        import rclpy
        from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
        from rclpy.signals import SignalHandlerOptions
    except ImportError as error:
        raise UsageError(
            f"no rclpy in this Python ({error}): source a ROS 2 for this version of Python, or go "
            "by --rosbridge"
        ) from error
    given = ["rtask", "--ros-args", *shlex.split(arguments)] if arguments else ["rtask"]
    try:
        # Ctrl-C has to reach whoever waits for the arm, which then stops it.
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # the errors of rcl and of each middleware share no other base
        raise UsageError(f"ROS does not start with {arguments!r}: {error}") from error
    try:
        node = rclpy.create_node(name)
        executor = MultiThreadedExecutor(num_threads=threads)
        executor.add_node(node)

        def spin() -> None:
            with contextlib.suppress(ExternalShutdownException):
                executor.spin()

        thread = threading.Thread(target=spin, daemon=True, name="rtask-spin")
        thread.start()
        try:
            yield node
        finally:
            executor.shutdown(timeout_sec=_END_S)
            thread.join(_END_S)
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
