"""Stating which tables and boxes a robot reaches, before it has taken anything from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.operations.operation import operation
from rtask.engine.records.identity import check_agent
from rtask.engine.records.task_tree import place_iri
from rtask.errors import ForbiddenError, UnknownTermError, UsageError, nearest
from rtask.rdf.namespaces import CORA, RDF, RT
from rtask.rdf.terms import NamedNode, iri, python_value
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Text

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["StateReach", "state_reach"]


class StateReach(Message):
    """Which place a robot reaches."""

    place: Text
    """IRI of the table or box, or its name: that of the robot itself before those of others"""
    robot: Text | None = None
    """name or IRI of the robot; default: the caller"""
    withdrawn: Flag = False
    """whether the caller takes back that it has stated this"""
    agent: Text | None = None
    """in whose name; default: the caller"""


class StatedReach(Answer):
    """What was stated, and the commit, which can be undone."""

    robot: str
    """IRI of the robot"""
    place: str
    """IRI of the place"""
    commit: str
    """empty where nothing changed: it was stated already"""


@operation("write", "writes", "state that a robot reaches a table or box", repeatable=True)
def state_reach(context: Context, request: StateReach, access: Access) -> StatedReach:
    """State that a robot's hand gets to a place, so that plans may count on it.

    Robots that take a thing from a place, or put one there, are known to reach it without this.

    Raises
    ------
    ForbiddenError
        A robot states it of another, or in the name of another.
    UsageError
        The caller is no robot and names none; several places have the name; or what is to be taken
        back was stated by somebody else, or follows from what the robot did.
    UnknownTermError
        The graph has no such robot or place.
    """
    check_agent(request.agent, access)
    robot = _robot(context, request.robot, access)
    place = _place(context, request.place, robot)
    author = context.author(access, request.agent)
    statement = (robot, RT.reaches, place)
    with context.writing:
        home = context.home_graph(author)
        is_stated = bool(context.kb.match(*statement, graph=home))
        if request.withdrawn and not is_stated:
            raise UsageError(
                "withdrawn: the caller has not stated that it reaches this; who or what says so, "
                "`rtask explain` tells", field="withdrawn",
            )  # fmt: skip
        if is_stated != request.withdrawn:
            return StatedReach(robot=robot.value, place=place.value, commit="")
        with context.kb.transaction(access=author, note="state what a robot reaches") as tx:
            if request.withdrawn:
                tx.remove(*statement)
            else:
                tx.add(*statement)
    commit = context.commit_id(tx.commit)
    return StatedReach(robot=robot.value, place=place.value, commit=commit)


def _robot(context: Context, name: str | None, access: Access) -> NamedNode:
    own = context.agent_iri(access) if access.role == "robot" and access.agent else None
    if name is None:
        if own is None:
            raise UsageError("robot is missing: its name or IRI", field="robot")
        robot = own
    else:
        robot = iri(name) if ":" in name else context.kb.graphs.agent_iri(name)
        if own is not None and robot != own:
            raise ForbiddenError(
                f"robot: the token belongs to {access.agent!r}: it cannot act for {name!r}",
                field="robot",
            )
    if not context.kb.match(robot, RDF.type, CORA.Robot):
        raise UnknownTermError(
            f"robot: the graph has no robot {name or robot.value!r}; register_robot introduces one",
            field="robot",
        )
    return robot


def _place(context: Context, name: str, robot: NamedNode) -> NamedNode:
    """Return the place of an IRI or a name; two robots may each have a "table"."""
    match = context.kb.match
    if ":" in name:
        if not match(iri(name), RDF.type, RT.SupportSurface):
            raise UnknownTermError(f"place: the graph has no table or box {name}", field="place")
        return iri(name)
    places = {quad.subject for quad in match(None, RDF.type, RT.SupportSurface)}
    own = place_iri(robot, name)
    if own in places:
        return own
    named = sorted(
        quad.subject.value
        for quad in match(None, RT.name, name)
        if isinstance(quad.subject, NamedNode) and quad.subject in places
    )
    if len(named) > 1:
        raise UsageError(
            f"place: {len(named)} places are called {name!r}; give the IRI: {', '.join(named)}",
            field="place",
        )
    if not named:
        known = {str(python_value(q.object)) for place in places for q in match(place, RT.name)}
        raise UnknownTermError(
            f"place: the graph has no table or box {name!r}{nearest(name, sorted(known))}; "
            "register_robot describes those of a robot", field="place",
        )  # fmt: skip
    return iri(named[0])
