"""Way home of a hand that has lost what it had lifted."""

from __future__ import annotations

import numpy as np

from simulate.grasping.candidates import AT_OBJECT, target_obstacle
from simulate.grasping.placing import plan_rise
from simulate.grasping.rules import PlannedGrasp
from simulate.motion.arm_space import SPEED, ArmSpace
from simulate.motion.trajectory import Trajectory, join
from simulate.robots.description import Floats

__all__ = ["plan_leaving"]

_UP_M = 0.060
"""The way goes up first: a tall thing that slipped down may stand between the fingers."""
_AROUND = {pair: depth for pair, depth in AT_OBJECT.items() if pair[0] != "target"}
"""Penetration allowed (m): the lift, which this begins from, was let as near to neighbours."""


def plan_leaving(space: ArmSpace, plan: PlannedGrasp, start: Floats) -> Trajectory | None:
    """Plan the way home of an empty, open hand from where it was lifted.

    Parameters
    ----------
    space
        Free space of the arms in the stance of the plan.
    plan
        The grasp that slipped. The object is avoided at its old place if there is a way around it.
    start : (dof,) float, rad
        Posture of the arm.

    Returns
    -------
    Trajectory or None
        None if there is no way that keeps clear of the neighbours.
    """
    up = plan_rise(space, plan, start, _UP_M)
    home = np.array(space.robot.arm(plan.arm).home)
    spheres = space.spheres(plan.arm, plan.opening)
    around = space.surroundings(plan.arm, plan.request.table_height, plan.obstacles)
    for there in (around.with_obstacles([target_obstacle(plan.request)]), around):
        back = space.path(
            plan.arm, spheres, there, up.positions[-1], home, plan.seed, SPEED["return"],
            allowed=_AROUND,
        )  # fmt: skip
        if not isinstance(back, str):
            return join([up, back])
    return None
