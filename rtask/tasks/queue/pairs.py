"""What a robot with nothing to do could take over: things that others have not begun to carry.

Only whole pairs are looked at, picking a thing up and putting it down by the hand of one robot: in
between the thing is in a hand, and nobody else could go on.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from rtask.rdf.namespaces import RT
from rtask.tasks.actions import ActionClass
from rtask.tasks.planning.problem import expected_cost_s
from rtask.tasks.queue.preconditions import effects_of
from rtask.tasks.queue.reading import QueuedPlan, QueuedStep
from rtask.tasks.steps import statement_of

__all__ = ["Pair", "open_pairs"]


@dataclass(frozen=True)
class Pair:
    """Picking a thing up and putting it down, both of one robot and neither begun.

    Parameters
    ----------
    plan
        The plan that they are of.
    pick, put
        The steps.
    owner
        IRI of their robot.
    cost_s
        When it is expected to have put the thing down, s from now, with the price of what may fail.
    """

    plan: QueuedPlan
    pick: QueuedStep
    put: QueuedStep
    owner: str
    cost_s: float


def open_pairs(
    plans: Sequence[QueuedPlan], robot: str, now: dt.datetime, actions: Mapping[str, ActionClass]
) -> Iterator[Pair]:
    """Yield the pairs of other robots that nothing holds up but their own robots' other work.

    Parameters
    ----------
    actions
        By IRI.
    """
    busy = {
        step.thing for plan in plans for step in plan.steps if step.claim(now) and step.thing
    }  # fmt: skip
    for plan in plans:
        is_late = plan.deadline is not None and now >= plan.deadline
        if not plan.allows_takeover or is_late or plan.state(now) not in ("waiting", "running"):
            continue
        done = {step.task for step in plan.steps if step.is_done}
        members = {step.task for step in plan.steps}
        for pick in plan.steps:
            put = _put_of(pick, plan, actions)
            if put is None or robot in pick.robots or pick.thing in busy:
                continue
            if (
                all(step.is_untouched for step in (pick, put))
                and (_needs(pick) | _needs(put) - {pick.task}) & members <= done
            ):
                [owner] = pick.robots
                yield Pair(plan, pick, put, owner, _expected_s(plans, plan, put, owner, now))


def _put_of(
    pick: QueuedStep, plan: QueuedPlan, actions: Mapping[str, ActionClass]
) -> QueuedStep | None:
    """Return the step that puts down what a step takes into the hand that it engages.

    None for any other step, and where another robot takes part in either.
    """
    action = actions.get(pick.action)
    hand = "" if action is None else pick.arguments.get(action.parameter("engages"), "")
    held = (pick.thing, RT.locatedOn.value, hand)
    if action is None or len(pick.robots) != 1 or not all(held):
        return None
    if held not in map(statement_of, effects_of(action, pick)[0]):
        return None
    later = (s for s in plan.steps if s.number > pick.number and s.thing == pick.thing)
    put = next(later, None)
    ending = None if put is None else actions.get(put.action)
    if put is None or ending is None or put.robots != pick.robots:
        return None
    return put if held in map(statement_of, effects_of(ending, put)[1]) else None


def _needs(step: QueuedStep) -> set[str]:
    """Return what a step waits for whoever does it."""
    return set(step.after) - set(step.for_hand)


def _expected_s(
    plans: Sequence[QueuedPlan], plan: QueuedPlan, put: QueuedStep, owner: str, now: dt.datetime
) -> float:
    """Return when a robot is expected to have put down what it has not begun, s from now."""
    mine = [s for s in plan.steps if owner in s.robots and s.number <= put.number]
    rest = [step for step in mine if step.state(now) == "waiting"]
    before = sum(step.duration_s for step in rest if step.thing != put.thing)
    own = sum(expected_cost_s(s.duration_s, s.chance) for s in rest if s.thing == put.thing)
    return _free_in_s(plans, plan, rest, owner, now) + before + own


def _free_in_s(
    plans: Sequence[QueuedPlan], plan: QueuedPlan, rest: Sequence[QueuedStep], owner: str,
    now: dt.datetime,
) -> float:  # fmt: skip
    """Return when a robot is expected to begin its next step, s from now.

    Who is late is expected to be late by as much again: nobody knows more of a robot that is slow,
    or whose program has ended.
    """
    had = [
        (claim, step) for each in plans for step in each.steps for claim in step.claims
        if claim.robot == owner
    ]  # fmt: skip
    last = max(had, key=lambda item: item[0].begun, default=None)
    # Only the last one counts: it has one step at a time, and an older claim was left behind.
    if last is not None and not last[0].result:
        return abs((last[0].begun - now).total_seconds() + last[1].duration_s)
    step = next(iter(rest), None)
    by_task = {other.task: other for other in plan.steps}
    before = [by_task[task] for task in step.after if task in by_task] if step else []
    if not all(other.is_done for other in before):
        return 0.0
    ended = [
        claim.ended for each in plans for other in each.steps for claim in other.claims
        if claim.ended and (claim.robot == owner or other in before)
    ]  # fmt: skip
    since = max([*ended, *([plan.made] if plan.made else [])], default=now)
    return max((now - since).total_seconds(), 0.0)
