"""Free space of the arms: what they can hit, and collision-free paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from simulate.motion.collision import (
    ArmSpheres,
    Obstacle,
    PointField,
    Surroundings,
    body_obstacles,
)
from simulate.motion.kinematics import Chain
from simulate.motion.remembered import PathMemory, arm_version
from simulate.motion.rrt import plan_path
from simulate.motion.trajectory import ACCELERATION, Trajectory, time_path
from simulate.robots.description import Floats, RobotDescription

__all__ = ["ALLOWED", "SPEED", "ArmSpace"]

SPEED = {"free": 0.30, "approach": 0.12, "lift": 0.12, "transport": 0.10, "return": 0.30}
"""Share of the joints' velocity limits, by phase."""

ALLOWED: Mapping[tuple[str, str], float] = {("trunk", "upper"): np.inf}
"""Allowed penetration (m) by obstacle and sphere group: the shoulder sits in the trunk."""

_MARGIN = 0.004
_TABLE_THICK = 0.10
_LIMIT_SLACK = 1e-6
_PURPOSE_PATH = 1


class ArmSpace:
    """Free space of the arms of one robot.

    Parameters
    ----------
    robot
        Its description.
    furniture
        Static obstacles (walls of the boxes), base frame.
    """

    def __init__(
        self,
        robot: RobotDescription,
        furniture: Sequence[Obstacle] = (),
    ) -> None:
        self.robot = robot
        self.furniture = tuple(furniture)
        self.chains = {name: Chain.of(robot, name) for name in robot.arms}
        self.memory: PathMemory | None = None
        """Paths that worked, as first guesses; None: each path is planned anew."""
        self._spheres: dict[tuple[str, float], ArmSpheres] = {}
        self._versions: dict[str, str] = {}
        homes = {
            joint: value
            for arm in robot.arms.values()
            for joint, value in zip(arm.joints, arm.home, strict=True)
        }
        self._body = {name: body_obstacles(robot, arm, homes) for name, arm in robot.arms.items()}

    @property
    def work(self) -> int:
        """Number of postures evaluated so far; unlike time, the same on every machine."""
        covers = [spheres.chain for spheres in self._spheres.values()]
        return sum(chain.evaluations for chain in (*self.chains.values(), *covers))

    def spheres(self, arm: str, opening: float) -> ArmSpheres:
        """Return the spheres that cover an arm at an opening of its hand; cached."""
        key = (arm, opening)
        if key not in self._spheres:
            self._spheres[key] = ArmSpheres.of(self.robot, self.robot.arm(arm), opening)
        return self._spheres[key]

    def version(self, arm: str) -> str:
        """Return the version of an arm: paths of another version are none of this one's."""
        if arm not in self._versions:
            self._versions[arm] = arm_version(self.robot, arm, self.spheres(arm, 1.0))
        return self._versions[arm]

    def surroundings(
        self, arm: str, table_height: float, obstacles: Sequence[Obstacle | PointField]
    ) -> Surroundings:
        """Return everything that an arm can hit: body, table, furniture, perceived obstacles."""
        (x0, x1), (y0, y1) = self.robot.workplace.table_x, self.robot.workplace.table_y
        table = Obstacle.box(
            "table",
            ((x0 + x1) / 2, (y0 + y1) / 2, table_height - _TABLE_THICK / 2),
            (x1 - x0, y1 - y0, _TABLE_THICK),
        )
        fixed = Surroundings((*self._body[arm], table, *self.furniture))
        return fixed.with_obstacles(obstacles)

    def path(
        self,
        arm: str,
        spheres: ArmSpheres,
        around: Surroundings,
        start: Floats,
        goal: Floats,
        seed: int,
        speed: float = SPEED["free"],
        acceleration: float = ACCELERATION,
        tolerance: float = 0.0,
        allowed: Mapping[tuple[str, str], float] = ALLOWED,
    ) -> Trajectory | str:
        """Return a timed free path between two postures, or the reason code why there is none.

        Parameters
        ----------
        arm, spheres, around
            The arm, its collision model and the obstacles.
        start, goal : (dof,) float, rad
        seed
            Of the samples.
        speed, acceleration
            Share of the velocity limits; rad/s^2.
        tolerance
            Penetration (m) allowed at the start, because the pose of a held object is given.
        allowed
            Penetration (m) by obstacle name and sphere group.
        """
        chain = self.chains[arm]
        slack = spheres.slack(around, allowed)
        # The margin fades towards the ends: a pre-grasp may stand closer to its object than that.
        ends = spheres.clearances(np.stack([start, goal]), around, slack)
        if ends[0] < -tolerance:
            return "rrt_start"
        if ends[1] < 0:
            return "rrt_goal"
        margin = min(_MARGIN, float(ends.min()) - 1e-9)

        low, high = chain.lower - _LIMIT_SLACK, chain.upper + _LIMIT_SLACK

        def is_free(q: Floats) -> NDArray[np.bool_]:
            within = ((q >= low) & (q <= high)).all(axis=1)  # a spline may swing beyond its corners
            return np.asarray(within & (spheres.clearances(q, around, slack) >= margin))

        rng = np.random.default_rng((seed, _PURPOSE_PATH))
        if self.memory is None:
            corners = plan_path(start, goal, chain.lower, chain.upper, is_free, rng)
        else:
            limits = (chain.lower, chain.upper)
            version = self.version(arm)
            corners = self.memory.plan(version, (start, goal), limits, is_free, rng)
        if isinstance(corners, str):
            return corners
        return time_path(corners, speed * chain.velocity, acceleration, is_free)
