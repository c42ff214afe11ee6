"""Plans in the graph: a task with the steps as its sub-tasks, assigned and in order."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from rtask.errors import UsageError
from rtask.rdf.namespaces import PROV, RDF, RDFS, RT, local_name, mint
from rtask.rdf.terms import NamedNode, Value
from rtask.tasks.plan import PlannedStep, TaskPlan
from rtask.tasks.questions.price import Prices

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["Order", "store_plan"]

_Statement = tuple[NamedNode, NamedNode, Value]


@dataclass(frozen=True)
class Order:
    """How urgent a plan is, what it takes the place of, and whether people may be asked.

    Parameters
    ----------
    priority
        Plans with a greater number are begun first.
    deadline
        No step is begun later.
    replaces
        IRI of an earlier plan for the same goal.
    prices
        Of asking a person and of failing; None = nobody is asked.
    allows_part
        Whether the steps for what can be reached are to be done where the rest is out of reach.
    """

    priority: int = 0
    deadline: dt.datetime | None = None
    replaces: str = ""
    prices: Prices | None = None
    allows_part: bool = False

    def due_by(self, deadline: dt.datetime | None) -> Order:
        """Return the order with a deadline that a goal names, unless it has one of its own."""
        return self if self.deadline is not None else replace(self, deadline=deadline)

    def late_s(self, duration_s: float, now: dt.datetime) -> float:
        """Return by how much what begins now is expected to end after the deadline, s.

        0 if it is in time, or without a deadline.

        Examples
        --------
        >>> now = dt.datetime(2026, 1, 1, 12, tzinfo=dt.UTC)
        >>> Order(deadline=now + dt.timedelta(seconds=10)).late_s(32.0, now)
        22.0
        """
        if self.deadline is None:
            return 0.0
        return max(duration_s - (self.deadline - now).total_seconds(), 0.0)


def store_plan(
    kb: GraphCore,
    plan: TaskPlan,
    agent: str | None = None,
    *,
    access: Access | None = None,
    order: Order | None = None,
) -> tuple[str, Commit]:
    """Store a plan in one commit; return the IRI of its task, and the commit.

    Parameters
    ----------
    agent, access
        In whose name, or with whose rights; None for the owner of the store.
    order
        How urgent it is.

    Raises
    ------
    UsageError
        There is no plan, it has no step, a part of the goal is out of reach and no part is
        allowed, or its deadline is over, so that no step would ever be begun.
    ForbiddenError
        The agent may not write; nothing is stored.
    """
    order = (order or Order()).due_by(plan.deadline)
    if order.deadline is not None and order.deadline <= dt.datetime.now(dt.UTC):
        over = order.deadline.isoformat(timespec="seconds")
        raise UsageError(f"the deadline {over} is over already: no step would ever be begun")
    if plan.refusals and not order.allows_part:
        raise UsageError(
            f"only a plan for the whole goal can be stored; not possible: {plan.refusals[0].goal}. "
            "Allow a part (--partly), or ask for the rest alone"
        )
    if not plan.refusals and not (plan.is_complete and plan.steps):
        raise UsageError("only a plan that has steps can be stored")
    root = NamedNode(mint(kb.base, "TaskPlan"))
    with kb.transaction(agent, note=f"plan: {plan.goal[:200]}", access=access) as tx:
        for statement in _statements(kb, plan, root, order):
            tx.add(*statement)
    return root.value, tx.commit


def _statements(
    kb: GraphCore, plan: TaskPlan, root: NamedNode, order: Order
) -> Iterator[_Statement]:
    yield root, RDF.type, RT.TaskPlan
    yield root, RT.goalText, plan.goal
    if plan.settled:
        yield root, RT.settledGoal, plan.settled
    yield root, RT.plannedDuration, float(plan.duration_s)
    yield root, RT.plannedChance, float(plan.chance)
    yield root, PROV.generatedAtTime, dt.datetime.now(dt.UTC)
    if order.priority:
        yield root, RT.taskPriority, order.priority
    if order.deadline is not None:
        yield root, RT.taskDeadline, order.deadline
    if order.replaces:
        yield root, RT.replacesPlan, NamedNode(order.replaces)
    if order.prices is not None:
        yield root, RT.askingPrice, float(order.prices.asking)
        yield root, RT.failingPrice, float(order.prices.failing)
    if order.allows_part:
        yield root, RT.allowsPart, True
    yield root, RT.allowsTakeover, plan.allows_takeover
    for refusal in plan.refusals:
        yield root, RT.openGoal, f"{refusal.goal}: {refusal.text}"
    for text in plan.assumptions:
        yield root, RT.planAssumption, text
    for robot in sorted({robot for step in plan.steps for robot in step.robots}):
        yield root, RT.assignedTo, NamedNode(robot)
    tasks = {step.number: NamedNode(f"{root.value}/{step.number}") for step in plan.steps}
    for before, after in pairwise(tasks.values()):
        yield before, RT.precedes, after
    for step in plan.steps:
        task = tasks[step.number]
        yield root, RT.hasSubTask, task
        yield from ((task, RT.waitsFor, tasks[number]) for number in step.after)
        yield from ((task, RT.waitsForHand, tasks[number]) for number in step.for_hand)
        yield from _step(kb, step, task)


def _step(kb: GraphCore, step: PlannedStep, task: NamedNode) -> Iterator[_Statement]:
    yield task, RDF.type, NamedNode(step.action)
    yield task, RT.stepNumber, step.number
    yield task, RT.plannedDuration, float(step.duration_s)
    yield task, RT.plannedChance, float(step.chance)
    yield task, RT.parameterValues, json.dumps(dict(step.arguments), sort_keys=True)
    yield task, RDFS.label, step.text
    for prop, value in step.statements:
        yield task, NamedNode(prop), NamedNode(value)
        if local_name(prop) == "handlesExemplar":
            for quad in kb.match(NamedNode(value), RT.exemplarOf):
                yield task, RT.handles, quad.object
