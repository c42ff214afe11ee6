"""``rtask ros2 node``: the graph as services, topics and an action of ROS 2."""

from __future__ import annotations

import sys

import click

__all__ = ["node"]


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": []},
    add_help_option=False,
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def node(arguments: tuple[str, ...]) -> None:
    """Offer the operations of a server in ROS 2, until Ctrl-C. Needs rclpy, of a sourced ROS 2.

    As `ros2 run rtask_ros2 node` of the package that `rtask ros2 package` writes, which needs
    nothing of this installation. `rtask ros2 node --help` lists the options; arguments of ROS
    follow --ros-args.
    """
    from rtask.cli.ros.schema import engine_schema
    from rtask.client.base import RULES
    from rtask.ros2.contract import Contract
    from rtask.ros2.main import run

    sys.exit(run(arguments, Contract(engine_schema(), RULES)))
