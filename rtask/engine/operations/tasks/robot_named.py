"""The robot that claims, ends or asks: the caller, or the one that it names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.errors import ForbiddenError, UsageError
from rtask.rdf.namespaces import CORA, RDF, RT
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["robot_named"]


def robot_named(context: Context, name: str | None, access: Access) -> tuple[str, Access]:
    """Return the IRI of the robot that is meant, and the rights to write in its name.

    Raises
    ------
    UsageError
        The caller is no robot, and names none.
    ForbiddenError
        A robot acts for another one, or a person or reader for a robot.
    """
    own = context.agent_iri(access).value if access.role == "robot" else ""
    if name is None:
        if not own:
            raise UsageError("robot is missing: its name or IRI", field="robot")
        return own, access
    robot = _named(context, name)
    if own and robot != own:
        raise ForbiddenError(f"the token belongs to {access.agent!r}: it cannot act for {name!r}")
    if own:
        return own, access
    if access.agent is not None:
        raise ForbiddenError(f"{access.agent!r} is no robot: only {name!r} claims steps for itself")
    label = robot.removeprefix(f"{context.kb.base}robot/")
    return robot, context.author(access, label if "/" not in label else None)


def _named(context: Context, name: str) -> str:
    if ":" in name and context.kb.match(iri(name), RDF.type, CORA.Robot):
        return name
    made = context.kb.graphs.agent_iri(name)
    if context.kb.match(made, RDF.type, CORA.Robot):
        return made.value
    for quad in context.kb.match(None, RT.name, name):
        if isinstance(quad.subject, NamedNode) and context.kb.match(
            quad.subject, RDF.type, CORA.Robot
        ):
            return quad.subject.value
    return made.value
