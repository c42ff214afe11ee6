"""The token determines who acts: tasks and persons that a caller may name in its messages."""

from __future__ import annotations

import uuid
from typing import TYPE_CHECKING

from rtask.errors import ForbiddenError
from rtask.kb.commit.access import unnamed_person
from rtask.rdf.namespaces import PREFIXES, is_owned
from rtask.rdf.terms import literal

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.engine.records.outcomes import OutcomeReport
    from rtask.kb.commit.access import Access

__all__ = ["check_agent", "check_operator", "check_task", "confirmed"]


def check_task(context: Context, task_id: str | None, access: Access, where: str = "") -> None:
    """Refuse a robot the task of another robot.

    Ids that robots chose themselves may be alike; those that the engine gave belong to the robot
    that asked for the decision, which the id itself says (:func:`~rtask.rdf.namespaces.is_owned`),
    also after a restart.

    Parameters
    ----------
    where
        Path of the message inside a larger one, ``objects[2].``.

    Raises
    ------
    ForbiddenError
        Naming the robot.
    """
    given = f"{context.kb.base}task/"
    if access.role != "robot" or task_id is None or not task_id.startswith(given):
        return
    decision = context.decisions.get(task_id)
    owners = {decision.asked_by} if decision is not None else set()
    owners |= _reporters(context, task_id)
    others = sorted(owners - {"", access.agent})
    if others:
        raise ForbiddenError(
            f"{where}task_id: the token belongs to {access.agent!r}, and {task_id} is a task of "
            f"{', '.join(others)}",
            field=f"{where}task_id",
        )
    if not owners and _is_of_another(task_id.removeprefix(given), access.agent or ""):
        raise ForbiddenError(
            f"{where}task_id: the token belongs to {access.agent!r}, and {task_id} was given to "
            "another robot; name a task of your own, or leave task_id out",
            field=f"{where}task_id",
        )


def _is_of_another(name: str, agent: str) -> bool:
    """Whether the engine gave an id to another caller that has a name."""
    try:
        made = uuid.UUID(name)
    except ValueError:
        return False  # no id of the engine
    return made.version == 7 and not any(is_owned(made, owner) for owner in (agent, ""))


def _reporters(context: Context, task_id: str) -> set[str]:
    """Return the names of the robots that stored an attempt at a task."""
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?name WHERE {{
  ?event rt:requestId {literal(task_id)} ; rt:performedBy/rt:name ?name
}}""")
    return {str(row.value("name")) for row in rows}


def check_operator(operator: str | None, access: Access, where: str = "") -> None:
    """Refuse a caller that confirms an outcome in the name of somebody else.

    Whether that person has a token plays no part: one may be issued tomorrow.

    Parameters
    ----------
    where
        Path of the message inside a larger one, ``objects[2].``.

    Raises
    ------
    ForbiddenError
        Naming the field.
    """
    if access.agent and operator and operator != access.agent:
        raise ForbiddenError(
            f"{where}operator: the token belongs to {access.agent!r}: it cannot confirm for "
            f"{operator!r}, who needs a token of their own to do so (give_feedback); leave "
            "operator out",
            field=f"{where}operator",
        )


def confirmed(report: OutcomeReport, access: Access, where: str = "") -> OutcomeReport:
    """Return an outcome with the name of the confirming person: the caller, or nobody's.

    Whoever confirms through a robot has a name that no token can have
    (:func:`~rtask.kb.commit.access.unnamed_person`).

    Raises
    ------
    ForbiddenError
        As :func:`check_operator`.
    """
    check_operator(report.operator, access, where)
    if report.confirmed_by != "human" or not access.agent:
        return report
    person = unnamed_person(access.agent) if access.role == "robot" else access.agent
    return report.model_copy(update={"operator": person})


def check_agent(named: str | None, access: Access, field: str = "agent") -> None:
    """Refuse a caller that says that somebody else acts.

    Administrators and the program that opened the store have no name of their own, and may name
    whom they act for.

    Raises
    ------
    ForbiddenError
        Naming whose token it is.
    """
    if access.agent and named and named != access.agent:
        raise ForbiddenError(
            f"{field}: the token belongs to {access.agent!r}: it cannot act for {named!r}",
            field=field,
        )
