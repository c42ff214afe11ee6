"""The robot at its workplace, as an attempt uses it."""

from __future__ import annotations

from typing import Protocol

from simulate.motion.arm_space import ArmSpace
from simulate.world.eyes import Eyes
from simulate.world.robot_body import RobotBody
from simulate.world.world import PlaceBox, World

__all__ = ["Station"]


class Station(Protocol):
    """A robot, its world and its eyes, e.g. the executor."""

    world: World
    robot: RobotBody
    eyes: Eyes

    def space_of(self, stance: str) -> ArmSpace:
        """Return the space in which the arms move in a stance."""

    def box_for(self, side: int, y: float) -> PlaceBox | None:
        """Return the box that an arm of a side (0 = both) uses for something at y m, if any."""

    def next_spot(self, side: str) -> int:
        """Return how many objects were placed into a box before, and count one more."""
