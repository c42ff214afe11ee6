"""Places on a table where a robot can grasp a product at either end.

An arm of five joints reaches many places in few closing directions. A product that lies in one of
the others, or of which only one end can be grasped, teaches nothing, and nothing learned about it
can be used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simulate.grasping.planning import GraspPlanner
from simulate.grasping.rules import GraspRequest
from simulate.motion.arm_space import ArmSpace
from simulate.motion.collision import Obstacle
from simulate.robots.description import Floats, RobotDescription
from simulate.world.objects import ObjectSpec
from simulate.world.scene import Placement, arrange, arrange_in_reach
from simulate.world.world import PlaceBox

__all__ = ["TableReach", "arrange_for", "requests_for", "takes_full_poses"]

_ROUND_FROM_ABOVE = frozenset({"can", "ball", "bottle"})
_ANGLES = np.deg2rad(np.arange(0, 180, 15))
_SPARE_M = 0.004  # room that a hand needs around an object whose position it knows to 2 mm
_ENDS = (-0.32, 0.32)
"""Shares of the length off the middle: near the weight of a rod, on the firm end of a carton."""
_MARGIN_M = 0.006
"""By which a robot may misjudge where a product lies, or another grasp may be off this one."""
_SEED = 0
_FREE_JOINTS = 6
"""Joints with which an arm closes in any direction."""


def takes_full_poses(robot: RobotDescription) -> bool:
    """Tell whether all arms of a robot have the joints to bring their hand to any pose in reach."""
    return min(len(arm.joints) for arm in robot.arms.values()) >= _FREE_JOINTS


def arrange_for(
    robot: RobotDescription, specs: Sequence[ObjectSpec], rng: np.random.Generator
) -> list[Placement]:
    """Return places for products on a robot's table, as far as possible where its arms reach them.

    Only an arm of fewer than six joints asks for more than the area of the workplace.
    """
    if takes_full_poses(robot):
        return arrange(specs, rng, workplace=robot.workplace)
    return arrange_in_reach(specs, rng, TableReach(robot), robot.workplace)


def requests_for(
    spec: ObjectSpec,
    pose: tuple[float, float, float],
    table_height: float,
    mouth: float,
    along: float = 0.0,
) -> list[GraspRequest]:
    """Return the grasps of a product's true shape that fit between the jaws, narrow side first.

    Parameters
    ----------
    pose
        x, y (m) and yaw (rad) of its middle in the base frame.
    table_height, mouth
        Height of the table and largest opening of the hand, m.
    along
        Where to grasp, along the product's x axis from its middle, m.
    """
    x, y, yaw = pose
    along_x, along_y, height = spec.extent
    is_round = spec.shape in _ROUND_FROM_ABOVE
    requests = []
    for offset in _ANGLES if is_round else (np.pi / 2, 0.0):
        width = along_y if offset else along_x
        if width > mouth - _SPARE_M:
            continue
        requests.append(
            GraspRequest(
                x=x + along * float(np.cos(yaw)),
                y=y + along * float(np.sin(yaw)),
                theta=float((yaw + offset) % np.pi),
                width=width,
                height=height,
                length=max(along_x, along_y),
                table_height=table_height,
                round=is_round,
            )
        )
    return requests


class TableReach:
    """Reach of a robot's arms over its table; nothing moves, and no physics is needed.

    Parameters
    ----------
    robot
        Description of the robot in the stance in which it works.

    Examples
    --------
    >>> from simulate.robots import describe
    >>> from simulate.world.objects import product
    >>> reach = TableReach(describe("nao"))
    >>> carton = product("carton", 3)
    >>> [reach(Placement(carton, x, 0.10, 1.0)) for x in (0.15, 0.40)]
    [True, False]
    """

    def __init__(self, robot: RobotDescription) -> None:
        place = robot.workplace
        boxes = [PlaceBox.at(place, side, place.table_height) for side in ("left", "right")]
        walls = [Obstacle.box("box", *wall) for box in boxes for wall in box.walls()]
        self._table_height = place.table_height
        self._planner = GraspPlanner(ArmSpace(robot, walls))
        self._arms = tuple(robot.arms.values())

    def __call__(self, placement: Placement) -> bool:
        """Return whether a product, alone at its place, can be grasped wherever its secret is.

        For a long one both ends must be in reach, with a margin towards the robot and away from it.
        """
        spec = placement.spec
        length = max(spec.extent[:2])
        is_long = length > min(arm.mouth for arm in self._arms)
        ends = [share * length for share in _ENDS] if is_long else [0.0]
        away = np.array([placement.x, placement.y]) / np.hypot(placement.x, placement.y)
        return all(
            self._is_graspable(placement, along, margin * away)
            for margin in (_MARGIN_M, -_MARGIN_M)
            for along in ends
        )

    def _is_graspable(self, placement: Placement, along: float, shift: Floats) -> bool:
        """Return whether the arm on that side can close exactly across the product."""
        pose = (placement.x + float(shift[0]), placement.y + float(shift[1]), placement.yaw)
        arm = max(self._arms, key=lambda arm: arm.side * placement.y)
        requests = requests_for(placement.spec, pose, self._table_height, arm.mouth, along)
        return any(
            self._planner.gets_to(arm.name, replace(request, only_theta=not request.round), _SEED)
            for request in requests
        )
