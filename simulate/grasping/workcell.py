"""A robot at its table: world, body and executor."""

from __future__ import annotations

from simulate.grasping.executor import Executor
from simulate.robots import RobotDescription, describe
from simulate.world.robot_body import RobotBody
from simulate.world.world import World

__all__ = ["Workcell"]


class Workcell:
    """A world with a table, a box on either side and a robot.

    Parameters
    ----------
    robot
        Name of a robot, or its description.
    preset, gui
        Of the :class:`~simulate.world.world.World`.

    Examples
    --------
    >>> with Workcell("nao", preset="fast") as cell:
    ...     sorted(cell.world.place_boxes)
    ['left', 'right']
    """

    def __init__(
        self, robot: str | RobotDescription, preset: str = "faithful", gui: bool = False
    ) -> None:
        self.description = describe(robot) if isinstance(robot, str) else robot
        self.world = World(preset, gui, self.description.workplace)
        self.world.add_table()
        for side in ("left", "right"):
            self.world.add_place_box(side)
        self.robot = RobotBody(self.world, self.description)
        self.executor = Executor(self.world, self.robot)

    def __enter__(self) -> Workcell:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """End the physics."""
        self.world.close()
