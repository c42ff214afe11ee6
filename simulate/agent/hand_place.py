"""Where a hand closed on a product, in the product's own frame: ground truth, for pictures only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from simulate.world.objects import ObjectSpec
from simulate.world.robot_body import RobotBody
from simulate.world.world import BodyPose

__all__ = ["HandPlace", "describe_product", "place_hand"]


@dataclass(frozen=True)
class HandPlace:
    """Place of an open hand at a product, in the plane in which the hand closes.

    Parameters
    ----------
    along_m, across_m
        Middle of the jaws along the product's longest edge and across it, from its middle, m.
    angle
        Closing direction from the longest edge, rad, in 0..pi.
    opening_m
        Between the jaws, m.
    width_m
        Of the product across, m.
    """

    along_m: float
    across_m: float
    angle: float
    opening_m: float
    width_m: float


def place_hand(robot: RobotBody, arm: str, product: ObjectSpec, pose: BodyPose) -> HandPlace:
    """Return where an arm's hand is at a product.

    Parameters
    ----------
    pose
        True pose of the product.
    """
    world_from_tool = robot.world_from_base @ robot.tool_pose(arm)
    middle = pose.rotation.T @ (world_from_tool[:3, 3] - pose.position)
    closing = pose.rotation.T @ world_from_tool[:3, 0]
    along = int(np.argmax(product.extent))
    across = max((axis for axis in range(3) if axis != along), key=lambda k: abs(closing[k]))
    return HandPlace(
        along_m=round(float(middle[along]), 4),
        across_m=round(float(middle[across]), 4),
        angle=round(float(np.arctan2(closing[across], closing[along]) % np.pi), 3),
        opening_m=round(robot.finger_opening(arm) * robot.arm(arm).mouth, 4),
        width_m=round(product.extent[across], 4),
    )


def describe_product(product: ObjectSpec) -> dict[str, Any]:
    """Return the length of a product and what it hides, along its longest edge.

    ``weak_m`` is the part that breaks, from and to; ``mass_m`` the centre of mass; both from the
    middle, m, and None if there is nothing to hide.
    """
    weak = [
        [round(x - part.size[0] / 2, 4), round(x + part.size[0] / 2, 4)]
        for part in product.secret.parts
        if part.breaks_at_n < float("inf")
        for x in part.position[:1]
    ]
    return {
        "length_m": round(max(product.extent), 4),
        "weak_m": weak[0] if weak else None,
        "mass_m": product.secret.mass_offset_m or None,
    }
