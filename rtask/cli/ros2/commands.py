"""The group ``rtask ros2``."""

from __future__ import annotations

import click

from rtask.cli.ros2.dds import dds
from rtask.cli.ros2.doctor import doctor
from rtask.cli.ros2.node import node
from rtask.cli.ros2.package import package

__all__ = ["ros2"]


@click.group()
def ros2() -> None:
    """Connect a robot's ROS 2 to the graph: by a node in it, or by DDS from outside."""


ros2.add_command(dds)
ros2.add_command(doctor)
ros2.add_command(node)
ros2.add_command(package)
