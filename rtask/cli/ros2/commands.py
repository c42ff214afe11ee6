"""The group ``rtask ros2``."""

from __future__ import annotations

import click

from rtask.cli.ros2.dds import dds
from rtask.cli.ros2.doctor import doctor

__all__ = ["ros2"]


@click.group()
def ros2() -> None:
    """Connect a robot's ROS 2 to the graph, without ROS 2 on this machine."""


ros2.add_command(dds)
ros2.add_command(doctor)
