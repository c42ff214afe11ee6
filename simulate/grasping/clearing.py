"""Clear a cluttered table: look, pick what can be held, push what cannot, look again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.scene_plan import SceneOptions
from rtask.engine.perception.clutter import ClutterView, plan_in_view
from simulate.grasping.clutter import hand_of, look_at_clutter, pick_from
from simulate.grasping.executor import Executor
from simulate.grasping.pushing import carry_out_push, plan_push

__all__ = ["Move", "clear_clutter"]

_SAME_M, _SAME_COS = 0.015, float(np.cos(np.deg2rad(25)))
_FEWEST_POINTS = 40
_PUSHES_IN_A_ROW = 4


@dataclass(frozen=True, eq=False)
class Move:
    """One thing that the robot did, as it knows itself.

    Parameters
    ----------
    kind
        ``pick``, ``push``, or ``none``: nothing could be done any more.
    reason
        ``ok``, or the reason code of the failure; for ``none`` why nothing was found.
    placed
        Whether the robot judged what it picked to be in its box.
    segments
        Seen before the move.
    candidates
        Grasps found in the view.
    candidate
        That was carried out; None for pushes.
    refused
        Why the arm cannot carry out better candidates, a reason code each; for ``push`` and
        ``none`` those of all that were tried.
    """

    kind: Literal["pick", "push", "none"]
    reason: str
    placed: bool = False
    segments: int = 0
    candidates: int = 0
    candidate: GraspCandidate | None = None
    refused: tuple[str, ...] = ()


def clear_clutter(
    executor: Executor,
    arm: str,
    seed: int = 0,
    most_moves: int = 30,
    on_phase: Callable[[str], None] = lambda phase: None,
    pushes: bool = True,
) -> Iterator[Move]:
    """Pick and place what lies on the table until it is empty or nothing works any more.

    Parameters
    ----------
    executor
        Of the robot, with its eyes.
    arm
        Name of the arm.
    seed
        Of every draw.
    most_moves
        Picks and pushes at most.
    on_phase
        Called with the name of each phase of a pick at its end.
    pushes
        Whether to push what cannot be picked.

    Yields
    ------
    Move
        After each pick or push; the last is of kind ``none`` unless the moves were used up.

    Notes
    -----
    A grasp that failed is not tried again until something has changed. What cannot be grasped, or
    failed three times in a row, is pushed.
    """
    failed: list[GraspCandidate] = []
    in_a_row = 0
    hand = hand_of(executor.robot.description, arm)
    for number in range(most_moves):
        view = look_at_clutter(executor)
        if view is None or len(view.points) < _FEWEST_POINTS:
            yield Move("none", "empty" if view is not None else "no_table")
            return
        proposals = plan_in_view(view, hand, SceneOptions(seed=seed + number))
        proposals = _without(proposals, failed)
        pick, refused = None, tuple[str, ...]()
        if len(failed) < 3:
            pick, refused = pick_from(view, proposals, executor, arm, seed + number)
        seen = (len(view.segments), len(proposals))
        if pick is None:
            pushed = ""
            if pushes and in_a_row < _PUSHES_IN_A_ROW:
                pushed = _push(executor, view, arm, seed + number)
            if not pushed:
                reason = proposals.reason or "out_of_reach"
                yield Move("none", reason, False, *seen, refused=refused)
                return
            in_a_row += 1
            failed.clear()
            yield Move("push", pushed, False, *seen, refused=refused)
            continue
        run = executor.begin(pick.plan, on_phase)
        reason = run.grasp()
        placed = reason == "ok" and run.place_in_box() == "ok"
        if reason == "ok":
            failed.clear()
            in_a_row = 0
        else:
            failed.append(pick.candidate)
        yield Move("pick", reason, placed, *seen, pick.candidate, refused)


def _push(executor: Executor, view: ClutterView, arm: str, seed: int) -> str:
    """Push the largest segment that can be pushed; return the reason code, "" if there is none."""
    labels, sizes = np.unique(view.labels[view.labels > 0], return_counts=True)
    for label in labels[np.argsort(-sizes, kind="stable")].tolist():
        plan = plan_push(view, int(label), executor, arm, seed)
        if plan is not None:
            return carry_out_push(executor, plan)
    return ""


def _without(proposals: Proposals, failed: list[GraspCandidate]) -> Proposals:
    """Return the proposals without those that repeat a failed one."""
    if not failed:
        return proposals
    untried = tuple(
        candidate
        for candidate in proposals
        if not any(
            np.linalg.norm(candidate.centre - other.centre) < _SAME_M
            and abs(float(candidate.closing @ other.closing)) > _SAME_COS
            for other in failed
        )
    )
    return replace(proposals, candidates=untried)
