"""Choice of the grasp that a robot can reach, among those that it was offered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

from features.geometry import FloatArray
from features.perception import Perceived
from simulate.agent.interfaces import Body
from simulate.agent.messages import distinct, grasp_request, tool_pose
from simulate.agent.tracking import TrackedObject
from simulate.grasping.executor import PlannedGrasp
from simulate.world.seeds import mix_seed

__all__ = ["GraspChoice", "choose_grasp"]

_STANCES: tuple[Literal["own", "other"], ...] = ("own", "other")


@dataclass(frozen=True)
class GraspChoice:
    """Result of planning the grasps in the learner's order.

    Parameters
    ----------
    plan
        None if no grasp can be reached.
    grasp
        The planned grasp, or the learner's first; None if the server proposed nothing.
    reason
        ``ok``, or why the learner's first grasp cannot be reached.
    """

    plan: PlannedGrasp | None
    grasp: dict[str, Any] | None
    reason: str


def choose_grasp(
    body: Body,
    track: TrackedObject,
    view: Perceived,
    offered: Sequence[Mapping[str, Any]],
    max_plans: int,
    seed: int,
    remembered: Sequence[FloatArray] = (),
) -> GraspChoice:
    """Return the first grasp in the learner's order that the robot can reach well.

    Other stances are tried only if no grasp is reachable in the present one. What is remembered is
    left out only if no way passes it: it may be gone, and forbids nothing.

    Parameters
    ----------
    body
        Robot that plans.
    track
        The object.
    view
        View that shows it; its other objects are obstacles.
    offered
        Grasps of the server's answer, best first.
    max_plans
        Number of them that are planned.
    seed
        Of the planner's choices.
    remembered
        Points (n, 3), m, base frame, of each further thing, which the view does not show.
    """
    seen = [other.points for other in view.objects if other is not track.seen]
    choice = _choose(body, track, view.table_height, offered, max_plans, seed, [*seen, *remembered])
    if choice.plan is None and remembered:
        return _choose(body, track, view.table_height, offered, max_plans, seed, seen)
    return choice


def _choose(
    body: Body,
    track: TrackedObject,
    table_height: float,
    offered: Sequence[Mapping[str, Any]],
    max_plans: int,
    seed: int,
    obstacles: list[FloatArray],
) -> GraspChoice:
    grasps = distinct([dict(grasp) for grasp in offered])[:max_plans]
    first: dict[str, Any] | None = None
    best: GraspChoice | None = None
    reason = "no_grasp"
    for stances, (rank, grasp) in product(_STANCES, grasps):
        if stances == "other" and tool_pose(grasp) is not None:
            continue
        request = grasp_request(track, grasp, table_height, stances)
        planned = body.plan(request, obstacles, seed=mix_seed(seed, rank))
        ranked = {**grasp, "rank": rank + 1}
        if not isinstance(planned, str):
            choice = GraspChoice(planned, ranked, "ok")
            if not planned.is_doubtful:
                return choice
            best = best or choice
        elif first is None:
            first, reason = ranked, planned
    return best or GraspChoice(None, first, reason)
