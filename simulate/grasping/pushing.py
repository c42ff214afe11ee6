"""Pushes with the closed hand that change a scene in which nothing can be grasped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rtask.engine.perception.clutter import ClutterView
from simulate.grasping.executor import Executor
from simulate.grasping.hand_rules import ParallelJaws
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import ALLOWED, SPEED
from simulate.motion.collision import ArmSpheres, PointField, Surroundings
from simulate.motion.kinematics import Chain, Goal, IkOptions, follow_line, solve_ik
from simulate.motion.trajectory import CARRYING_ACCELERATION, time_path
from simulate.robots.description import Floats

__all__ = ["carry_out_push", "plan_push"]

_DIRECTIONS = 12
_BESIDE_M, _OVER_TABLE_M = 0.030, 0.012
_STABLE = 1.5
"""Height of a push over the half depth of the thing: with friction of .6 on the table, one higher
up tips the thing over its far edge instead of moving it."""
_PURPOSE_PUSH = 7
_DOWN = np.array([0.0, 0.0, -1.0])
_PUSHING = {
    **ALLOWED,
    ("neighbour", "finger"): np.inf,
    ("neighbour", "palm"): np.inf,
    ("table", "finger"): 0.008,
}


@dataclass(frozen=True)
class _Ways:
    """How an arm comes down beside a thing and pushes it.

    Parameters
    ----------
    beyond_m
        Way of the thing, m.
    over_table
        Heights of the fingertips of a hand that points down, m, best first.
    retreats
        Up, and away from the thing, m, best first: the way down is their reverse.
    ik
        Tolerances of the posture in which the push starts.
    parts
        Whether to prefer ways on which the thing meets no other, so that it parts from its
        neighbours, before those that end in the middle.
    """

    beyond_m: float
    over_table: tuple[float, ...]
    retreats: tuple[tuple[float, float], ...]
    ik: IkOptions
    parts: bool


_FREELY = _Ways(0.050, (_OVER_TABLE_M,), ((0.10, 0.0),), IkOptions(angle_tolerance=0.05), False)
# An arm of few joints cannot point its hand down wherever it pushes: the hand leans, and its lower
# side rather than its tips would touch the table, so it pushes higher up where it must. Neither
# does it rise far without turning; a few cm clear what is as low as its own hand.
_AS_IT_CAN = _Ways(
    0.030,
    (_OVER_TABLE_M, 0.022, 0.032),
    ((0.07, 0.0), (0.05, 0.0), (0.05, 0.03), (0.03, 0.03)),
    IkOptions(starts=12, angle_tolerance=0.6),
    True,
)


def _ways_of(chain: Chain) -> _Ways:
    return _FREELY if chain.orients_freely else _AS_IT_CAN


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
    how = _ways_of(executor.space.chains[arm])
    centre = np.median(own[:, :2], axis=0)
    middle = np.median(view.points[:, :2], axis=0)
    others = view.points[view.labels != segment][:, :2]
    ways = []
    for angle in 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
        along = np.array([np.cos(angle), np.sin(angle)])
        half = float(np.abs((own[:, :2] - centre) @ along).max())
        start = centre - (half + _BESIDE_M) * along
        move = (_BESIDE_M + how.beyond_m) * along
        end = start + move
        # Two seen things at the start would be pushed down, so free starts come first.
        crowd = int((np.linalg.norm(view.points[:, :2] - start, axis=1) < _BESIDE_M / 2).sum())
        ahead = _in_the_way(own[:, :2], others, along, how.beyond_m) if how.parts else 0
        away = float(np.linalg.norm(end - middle))
        ways.append((crowd + ahead, away, start, move, _STABLE * half))
    for _, _, start, move, highest in sorted(ways, key=lambda way: way[:2]):
        planned = _planned(view, executor, arm, start, move, seed, highest)
        if planned is not None:
            return planned
    return None


def _in_the_way(own: Floats, others: Floats, along: Floats, way: float) -> int:
    """Return how many points (n, 2) of others a thing would meet on its way, m."""
    across = np.array([-along[1], along[0]])
    low, high = np.min(own @ across), np.max(own @ across)
    front = np.median(own @ along)
    ahead, aside = others @ along - front, others @ across
    reach = np.max(own @ along) - front + way
    return int(((ahead > 0) & (ahead < reach) & (aside > low) & (aside < high)).sum())


def carry_out_push(executor: Executor, plan: PlannedGrasp) -> str:
    """Push as planned and go home; return the reason code."""
    run = executor.begin(plan)
    reason = run.pretend()
    if reason == "ok":
        run.put_back()
    return reason


def _planned(
    view: ClutterView,
    executor: Executor,
    arm: str,
    start: Floats,
    move: Floats,
    seed: int,
    highest: float,
) -> PlannedGrasp | None:
    space = executor.space
    chain, spheres = space.chains[arm], space.spheres(arm, 0.0)
    free_hand = chain.orients_freely
    ways = _ways_of(chain)
    across = np.array([-move[1], move[0], 0.0]) / np.linalg.norm(move)
    rng = np.random.default_rng((seed, _PURPOSE_PUSH))
    field = PointField.of("neighbour", view.points, view.table_height)
    around = space.surroundings(arm, view.table_height, [field])
    free_slack, push_slack = spheres.slack(around, ALLOWED), spheres.slack(around, _PUSHING)
    lowest = ways.over_table[0]
    for over in ways.over_table:
        height = view.table_height + ParallelJaws.TIP_BELOW_TOOL + over
        if over > lowest and height - view.table_height > highest:
            break
        goal = Goal(np.array([*start, height]), across if free_hand else None, _DOWN, free_hand)
        for posture in solve_ik(chain, goal, rng, ways.ik):
            push = follow_line(
                chain, posture, np.array([*move, 0.0]), tolerance=0.006, level=not free_hand
            )
            if push is None or (spheres.clearances(push, around, push_slack) < 0).any():
                continue
            back = _way_down(chain, posture, ways, move, spheres, around, free_slack)
            if back is None:
                continue
            home = np.array(space.robot.arm(arm).home)
            free = space.path(arm, spheres, around, home, back[-1], seed)
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
                approach=time_path(back[::-1], SPEED["approach"] * velocity),
                lift=time_path(push, SPEED["lift"] * velocity, CARRYING_ACCELERATION),
                obstacles=(field,), ik_solutions=1, planning_s=0.0, seed=seed,
            )  # fmt: skip
    return None


def _way_down(
    chain: Chain,
    posture: Floats,
    ways: _Ways,
    move: Floats,
    spheres: ArmSpheres,
    around: Surroundings,
    slack: Floats,
) -> Floats | None:
    """Return postures (k, dof) from the start of a push back up to where it is clear, if any."""
    behind = -np.array([*move, 0.0]) / np.linalg.norm(move)
    for up, aside in ways.retreats:
        line = follow_line(
            chain,
            posture,
            np.array([0.0, 0.0, up]) + aside * behind,
            level=not chain.orients_freely,
        )
        if line is not None and not (spheres.clearances(line, around, slack) < 0).any():
            return line
    return None
