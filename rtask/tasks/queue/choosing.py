"""Which step a robot takes next, and why; or why it takes none."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from rtask.tasks.queue.reading import Claim, QueuedPlan, QueuedStep

__all__ = ["Choice", "Wait", "choose", "reason_of"]

Failing = Callable[[QueuedStep], str]
"""Returns the first precondition of a step that does not hold now, in words; empty if all do."""


@dataclass(frozen=True)
class Wait:
    """A step of the robot that it cannot begin now.

    Parameters
    ----------
    plan, task
        IRIs.
    text
        The step.
    why
        What it waits for.
    is_stuck
        Whether waiting does not help: nothing that is under way or to come in the plan can make the
        precondition true, so that the rest of the goal has to be planned again.
    """

    plan: str
    task: str
    text: str
    why: str
    is_stuck: bool = False


@dataclass(frozen=True)
class Choice:
    """What a robot is to do next.

    Parameters
    ----------
    plan, step
        The step; None where there is none for it.
    claim
        The claim that the robot has on it already.
    reason
        Why this robot, and why now.
    waits
        Its other steps that were looked at before.
    taken
        What is to be done yet of its steps that others took over; ``why`` says who has it.
    plans
        What was chosen from.
    """

    plan: QueuedPlan | None
    step: QueuedStep | None
    claim: Claim | None
    reason: str
    waits: tuple[Wait, ...]
    taken: tuple[Wait, ...] = ()
    plans: Sequence[QueuedPlan] = field(default=(), repr=False, compare=False)


def choose(
    plans: Sequence[QueuedPlan], robot: str, now: dt.datetime, failing: Failing,
    names: Mapping[str, str],
) -> Choice:  # fmt: skip
    """Return the next step of a robot.

    What it has claimed comes first, so that a restarted robot goes on where it was. Then come
    steps by the priority of their plans, their deadlines, and the order in which they were stored;
    a robot never waits for a plan while it can do a step of another one.

    Parameters
    ----------
    plans
        In the order in which they were stored.
    names
        Names of robots.
    """
    taken = tuple(_taken(plans, robot, now, names))
    # First what it has: a robot that was restarted goes on with its own step.
    for plan in plans:
        for step in plan.steps:
            claim = step.claim(now)
            if claim is not None and claim.robot == robot:
                return Choice(plan, step, claim, claim.why, (), taken, plans)
    busy = dict(_busy_things(plans, now))
    waits: list[Wait] = []
    for plan, step in _in_order(plans, robot, now):
        why = _what_it_waits_for(plan, step, now, busy, names)
        if why:
            waits.append(Wait(plan.task, step.task, step.text, why))
            continue
        missing = failing(step)
        if missing:
            # Somebody's step may still make it true; with nobody at work only a new plan can.
            is_idle = all(other.state(now) not in ("claimed", "asked") for other in plan.steps)
            waits.append(
                Wait(plan.task, step.task, step.text, f"it does not hold that {missing}", is_idle)
            )
            continue
        why_now = reason_of(plan, step, waits, names)
        return Choice(plan, step, None, why_now, tuple(waits), taken, plans)
    return Choice(None, None, None, "", tuple(waits), taken, plans)


def _taken(
    plans: Sequence[QueuedPlan], robot: str, now: dt.datetime, names: Mapping[str, str]
) -> Iterator[Wait]:
    for plan in plans:
        for step in plan.steps if plan.state(now) in ("waiting", "running") else ():
            if robot in step.taken_from and robot not in step.robots and not step.is_done:
                who = ", ".join(names.get(other, other) for other in step.robots)
                yield Wait(plan.task, step.task, step.text, f"{who} has it: {step.assignment}")


def _busy_things(plans: Sequence[QueuedPlan], now: dt.datetime) -> Iterator[tuple[str, str]]:
    for plan in plans:
        for step in plan.steps:
            claim = step.claim(now)
            if claim is not None and step.thing:
                yield step.thing, claim.robot


def _in_order(
    plans: Sequence[QueuedPlan], robot: str, now: dt.datetime
) -> Iterator[tuple[QueuedPlan, QueuedStep]]:
    # Of one priority, what is due first comes first, and what has no time last.
    latest = dt.datetime.max.replace(tzinfo=dt.UTC)
    ranked = sorted(plans, key=lambda plan: (-plan.priority, plan.deadline or latest))
    for plan in ranked:
        if plan.state(now) not in ("waiting", "running"):
            continue
        # Begun too late it would end too late.
        if plan.deadline is not None and now >= plan.deadline:
            continue
        for step in plan.steps:
            if robot in step.robots and step.state(now) in ("waiting", "asked"):
                yield plan, step


def _what_it_waits_for(
    plan: QueuedPlan, step: QueuedStep, now: dt.datetime, busy: Mapping[str, str],
    names: Mapping[str, str],
) -> str:  # fmt: skip
    asked = step.open_question(now)
    if asked is not None:
        return f"a person is asked: {asked.text}"
    by_task = {other.task: other for other in plan.steps}
    # A step that is no longer part of the plan holds nobody up.
    before = [by_task[task] for task in step.after if task in by_task]
    pending = next((other for other in before if not other.is_done), None)
    if pending is not None:
        who = ", ".join(names.get(robot, robot) for robot in pending.robots)
        return f"step {pending.number} of {who} comes before"
    # Two hands at one thing are what a queue is there to prevent.
    if step.thing in busy:
        return f"{names.get(busy[step.thing], busy[step.thing])} has the thing"
    return ""


def reason_of(
    plan: QueuedPlan, step: QueuedStep, waits: Sequence[Wait], names: Mapping[str, str]
) -> str:
    """Return why a step is its robot's, and why it is its turn."""
    who = ", ".join(names.get(robot, robot) for robot in step.robots)
    of = f"step {step.number} of {len(plan.steps)}"
    expected = f"expected to take {step.duration_s:.0f} s with a chance of {step.chance:.2f}"
    if step.assignment:
        parts = [f"{of} is {who}'s: {step.assignment}", f"it is {expected}"]
    else:
        parts = [f"the plan gives {of} to {who}, which is {expected}"]
    if plan.priority:
        parts.append(f"priority {plan.priority}")
    if plan.deadline is not None:
        parts.append(f"due {plan.deadline:%Y-%m-%d %H:%M} UTC")
    parts.append("its preconditions hold, and nobody has the thing")
    if waits:
        parts.append(f"{len(waits)} steps before it have to wait: {waits[0].why}")
    return "; ".join(parts)
