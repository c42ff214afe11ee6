"""The group ``rtask ros``."""

from __future__ import annotations

import click

from rtask.cli.ros.doctor import doctor
from rtask.cli.ros.messages import messages
from rtask.cli.ros.node import node

__all__ = ["ros"]


@click.group()
def ros() -> None:
    """Connect a robot's ROS to the graph: node, messages, diagnosis."""


ros.add_command(doctor)
ros.add_command(messages)
ros.add_command(node)
