"""Push grasps by an arm: a jaw pushes a part until it lies flat against it, then the hand closes.

The motion of Kehoe 2014, 3.7: the open hand comes down around the part, moves along the direction
of the grasp, closes, and lifts to show that the part is held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulate.grasping.attempt.run import AttemptRun
from simulate.grasping.attempt.station import Station
from simulate.grasping.executor import Executor
from simulate.grasping.hand_rules import ParallelJaws
from simulate.grasping.judgement import CLOSED_ON_SOMETHING
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import SPEED
from simulate.motion.kinematics import Goal, IkOptions, follow_line, solve_ik
from simulate.motion.trajectory import CARRYING_ACCELERATION, Trajectory, time_path
from simulate.robots.description import Floats

__all__ = ["ArmPush", "PushRun", "plan_arm_push"]

_DOWN_M, _LIFT_M, _OVER_TABLE_M = 0.10, 0.08, 0.003
_PUSH_SPEED = 0.05
"""Share of the joints' limits: slow enough for friction beneath the part to dominate inertia."""
_CLOSE_S, _HOLD_S = 1.5, 1.0
_PURPOSE = 17
_IK = IkOptions(angle_tolerance=0.02, position_tolerance=0.0005)


@dataclass(frozen=True)
class ArmPush:
    """A push grasp as an arm carries it out, base frame.

    Parameters
    ----------
    start : (2,), m
        Of the tool, midway between the open jaws, when the hand is down.
    direction : (2,)
        Unit vector of the push, which is the closing direction as well.
    travel
        Of the push, m.
    height
        Of the part, m.
    """

    start: Floats
    direction: Floats
    travel: float
    height: float


def plan_arm_push(
    executor: Executor, arm: str, push: ArmPush, seed: int = 0
) -> tuple[PlannedGrasp, Trajectory] | str:
    """Plan a push grasp from straight above.

    Returns
    -------
    plan, push
        The plan, whose lift starts where the push ends, and the push; or a reason code: ``ik``
        where the arm does not reach, ``collision`` where it hits something, or that of the path.
    """
    space = executor.space
    chain, spheres = space.chains[arm], space.spheres(arm, 1.0)
    table = executor.world.table_height
    over = ParallelJaws.TIP_BELOW_TOOL + _OVER_TABLE_M
    along = np.array([*push.direction, 0.0])
    goal = Goal(
        np.array([*push.start, table + over]), along, np.array([0.0, 0.0, -1.0]),
        approach_must=True,
    )  # fmt: skip
    around = space.surroundings(arm, table, [])
    slack = spheres.slack(around, {("table", "finger"): 0.012, ("trunk", "upper"): np.inf})
    reason = "ik"
    for posture in solve_ik(chain, goal, np.random.default_rng((seed, _PURPOSE)), _IK):
        down = follow_line(chain, posture, np.array([0.0, 0.0, _DOWN_M]))
        way = follow_line(chain, posture, push.travel * along, tolerance=0.001)
        if down is None or way is None:
            continue
        up = follow_line(chain, way[-1], np.array([0.0, 0.0, _LIFT_M]))
        if up is None:
            continue
        if any((spheres.clearances(q, around, slack) < 0).any() for q in (down, way, up)):
            reason = "collision"
            continue
        home = np.array(space.robot.arm(arm).home)
        free = space.path(arm, spheres, around, home, down[-1], seed)
        if isinstance(free, str):
            reason = free
            continue
        request = GraspRequest(
            float(push.start[0]), float(push.start[1]), float(np.arctan2(along[1], along[0])),
            table + over, height=push.height, table_height=table, arm=arm, stances="own",
        )  # fmt: skip
        velocity = chain.velocity
        plan = PlannedGrasp(
            request=request, arm=arm, opening=1.0, closing_angle=request.theta % np.pi, tilt=0.0,
            tool_height=over, posture=posture, free=free,
            approach=time_path(down[::-1], SPEED["approach"] * velocity),
            lift=time_path(up, SPEED["lift"] * velocity, CARRYING_ACCELERATION),
            obstacles=(), ik_solutions=1, planning_s=0.0, seed=seed,
        )  # fmt: skip
        return plan, time_path(way, _PUSH_SPEED * velocity, CARRYING_ACCELERATION)
    return reason


class PushRun(AttemptRun):
    """One push grasp: down, push, close, lift, hold.

    Parameters
    ----------
    station, plan, push
        The robot at its workplace, and what :func:`plan_arm_push` returned.
    """

    def __init__(self, station: Station, plan: PlannedGrasp, push: Trajectory) -> None:
        super().__init__(station, plan, lambda phase: None)
        self._push = push

    def push(self) -> str:
        """Come down and push; return the reason code, ``ok`` with the part between the jaws."""
        self.reason = self.reach()
        if self.reason == "ok":
            self.drive.follow(self._push)
            self.drive.end("push")
        return self.reason

    def close(self) -> str:
        """Close the hand where the push ended; return ``ok``, or ``missed`` and go home."""
        self.drive.close(_CLOSE_S)
        if self.drive.end("close").opening <= CLOSED_ON_SOMETHING:
            self.reason = "missed"
            self.drive.follow(self.plan.lift)
            self.drive.start_at_home()
        return self.reason

    def lift(self) -> str:
        """Lift and hold; return what the robot makes of it by its own senses."""
        self.drive.follow(self.plan.lift)
        self.drive.end("lift")
        self.drive.steps(_HOLD_S)
        self.drive.end("hold")
        self.reason = self._judge_grasp()
        return self.reason
