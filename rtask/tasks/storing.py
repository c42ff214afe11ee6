"""Plans in the graph: a task with the steps as its sub-tasks, assigned and in order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rtask.errors import UsageError
from rtask.rdf.namespaces import RDF, RT, local_name, mint
from rtask.rdf.terms import NamedNode, Value
from rtask.tasks.plan import PlannedStep, TaskPlan

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["store_plan"]

_Statement = tuple[NamedNode, NamedNode, Value]


def store_plan(
    kb: GraphCore, plan: TaskPlan, agent: str | None = None, *, access: Access | None = None
) -> tuple[str, Commit]:
    """Store a plan in one commit; return the IRI of its task, and the commit.

    Parameters
    ----------
    agent, access
        In whose name, or with whose rights; None for the owner of the store.

    Raises
    ------
    UsageError
        There is no plan, or it has no step.
    ForbiddenError
        The agent may not write; nothing is stored.
    """
    if not plan.is_complete or not plan.steps:
        raise UsageError("only a plan that has steps can be stored")
    root = NamedNode(mint(kb.base, "TaskPlan"))
    with kb.transaction(agent, note=f"plan: {plan.goal[:200]}", access=access) as tx:
        for statement in _statements(kb, plan, root):
            tx.add(*statement)
    return root.value, tx.commit


def _statements(kb: GraphCore, plan: TaskPlan, root: NamedNode) -> Iterator[_Statement]:
    yield root, RDF.type, RT.TaskPlan
    yield root, RT.goalText, plan.goal
    yield root, RT.plannedDuration, float(plan.duration_s)
    yield root, RT.plannedChance, float(plan.chance)
    for text in plan.assumptions:
        yield root, RT.planAssumption, text
    for robot in sorted({robot for step in plan.steps for robot in step.robots}):
        yield root, RT.assignedTo, NamedNode(robot)
    before: NamedNode | None = None
    for step in plan.steps:
        task = NamedNode(f"{root.value}/{step.number}")
        yield root, RT.hasSubTask, task
        if before is not None:
            yield before, RT.precedes, task
        yield from _step(kb, step, task)
        before = task


def _step(kb: GraphCore, step: PlannedStep, task: NamedNode) -> Iterator[_Statement]:
    yield task, RDF.type, NamedNode(step.action)
    yield task, RT.stepNumber, step.number
    yield task, RT.plannedDuration, float(step.duration_s)
    yield task, RT.plannedChance, float(step.chance)
    for prop, value in step.statements:
        yield task, NamedNode(prop), NamedNode(value)
        if local_name(prop) == "handlesExemplar":
            for quad in kb.match(NamedNode(value), RT.exemplarOf):
                yield task, RT.handles, quad.object
