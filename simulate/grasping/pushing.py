"""Pushes with the closed hand that change a scene in which nothing can be grasped."""

from __future__ import annotations

import numpy as np

from rtask.engine.perception.clutter import ClutterView
from simulate.grasping.executor import Executor
from simulate.grasping.hand_rules import ParallelJaws
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import ALLOWED, SPEED
from simulate.motion.collision import PointField
from simulate.motion.kinematics import Goal, IkOptions, follow_line, solve_ik
from simulate.motion.trajectory import CARRYING_ACCELERATION, time_path
from simulate.robots.description import Floats

__all__ = ["carry_out_push", "plan_push"]

_DIRECTIONS = 12
_BESIDE_M, _BEYOND_M, _DOWN_M, _OVER_TABLE_M = 0.030, 0.050, 0.10, 0.012
_PURPOSE_PUSH = 7
_IK = IkOptions(angle_tolerance=0.05)
_PUSHING = {
    **ALLOWED,
    ("neighbour", "finger"): np.inf,
    ("neighbour", "palm"): np.inf,
    ("table", "finger"): 0.008,
}


def plan_push(
    view: ClutterView, segment: int, executor: Executor, arm: str, seed: int = 0
) -> PlannedGrasp | None:
    """Plan to push one segment with the closed hand, straight down beside it and then through it.

    Of twelve directions the one that ends nearest to the middle of what is seen comes first, so
    that things stay in reach; the others follow.

    Parameters
    ----------
    segment
        Label of the thing to push.

    Returns
    -------
    PlannedGrasp or None
        Its ``lift`` is the push, for :func:`carry_out_push`. None when the arm cannot push it from
        anywhere.
    """
    own = view.of(segment)
    if not len(own):
        return None
    centre = np.median(own[:, :2], axis=0)
    middle = np.median(view.points[:, :2], axis=0)
    ways = []
    for angle in 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        along = np.array([np.cos(angle), np.sin(angle)])
        half = float(np.abs((own[:, :2] - centre) @ along).max())
        start = centre - (half + _BESIDE_M) * along
        move = (_BESIDE_M + _BEYOND_M) * along
        end = start + move
        # Two seen things at the start would be pushed down, so free starts come first.
        crowd = int((np.linalg.norm(view.points[:, :2] - start, axis=1) < _BESIDE_M / 2).sum())
        ways.append((crowd, float(np.linalg.norm(end - middle)), start, move))
    for _, _, start, move in sorted(ways, key=lambda way: way[:2]):
        planned = _planned(view, executor, arm, start, move, seed)
        if planned is not None:
            return planned
    return None


def carry_out_push(executor: Executor, plan: PlannedGrasp) -> str:
    """Push as planned and go home; return the reason code."""
    run = executor.begin(plan)
    reason = run.pretend()
    if reason == "ok":
        run.put_back()
    return reason


def _planned(
    view: ClutterView, executor: Executor, arm: str, start: Floats, move: Floats, seed: int
) -> PlannedGrasp | None:
    space = executor.space
    chain, spheres = space.chains[arm], space.spheres(arm, 0.0)
    height = view.table_height + ParallelJaws.TIP_BELOW_TOOL + _OVER_TABLE_M
    across = np.array([-move[1], move[0], 0.0]) / np.linalg.norm(move)
    place = np.array([*start, height])
    rng = np.random.default_rng((seed, _PURPOSE_PUSH))
    goal = Goal(place, across, np.array([0.0, 0.0, -1.0]), approach_must=True)
    field = PointField.of("neighbour", view.points, view.table_height)
    around = space.surroundings(arm, view.table_height, [field])
    free_slack, push_slack = spheres.slack(around, ALLOWED), spheres.slack(around, _PUSHING)
    for posture in solve_ik(chain, goal, rng, _IK):
        down = follow_line(chain, posture, np.array([0.0, 0.0, _DOWN_M]))
        push = follow_line(chain, posture, np.array([*move, 0.0]), tolerance=0.006)
        if down is None or push is None:
            continue
        if (spheres.clearances(down, around, free_slack) < 0).any():
            continue
        if (spheres.clearances(push, around, push_slack) < 0).any():
            continue
        home = np.array(space.robot.arm(arm).home)
        free = space.path(arm, spheres, around, home, down[-1], seed)
        if isinstance(free, str):
            continue
        request = GraspRequest(
            float(start[0]), float(start[1]), float(np.arctan2(across[1], across[0])), height,
            table_height=view.table_height, arm=arm, stances="own",
        )  # fmt: skip
        velocity = chain.velocity
        # A closed cup is one that draws air, and would take what it is to push.
        opening = 0.0 if space.robot.arm(arm).cup is None else 1.0
        return PlannedGrasp(
            request=request, arm=arm, opening=opening, closing_angle=request.theta % np.pi,
            tilt=0.0, tool_height=height - view.table_height, posture=posture, free=free,
            approach=time_path(down[::-1], SPEED["approach"] * velocity),
            lift=time_path(push, SPEED["lift"] * velocity, CARRYING_ACCELERATION),
            obstacles=(field,), ik_solutions=1, planning_s=0.0, seed=seed,
        )  # fmt: skip
    return None
