"""Stating where a single thing is, by whoever put or saw it there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.operations.operation import operation
from rtask.engine.operations.world.instants import stated_instant
from rtask.engine.records.identity import check_agent
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Iri, Stamp, Text
from rtask.world import Relation, WorldEdit
from rtask.world.names import label_of, present

if TYPE_CHECKING:
    from collections.abc import Collection

    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.world.statements import Statement

__all__ = ["StatePlace", "check_hand", "check_held", "moved", "state_place"]


class StatePlace(Message):
    """Where a thing is from now on."""

    thing: Iri
    """IRI of the thing"""
    place: Text | None = None
    """IRI of the place or end effector; default: none, which must be said by lost"""
    inside: Flag = False
    """whether it is in the place, and not on it"""
    lost: Flag = False
    """whether it is no longer where it was, and nobody knows where"""
    stamp: Stamp | None = None
    """since when; default: now"""
    agent: Text | None = None
    """in whose name; default: the caller"""


class StatedPlace(Answer):
    """The commit, which can be undone."""

    commit: str


@operation("write", "writes", "state where a thing is from now on", repeatable=True)
def state_place(context: Context, request: StatePlace, access: Access) -> StatedPlace:
    """End the last placement of a thing and begin a new one, in one commit.

    A thing that was seen on or in the place keeps the pose at which it was seen.

    Raises
    ------
    ForbiddenError
        A robot states it in the name of another, or what is in the hand of another.
    UsageError
        Neither a place nor that it is lost is given, or both.
    UnknownTermError
        The graph has no such thing or place.
    """
    check_agent(request.agent, access)
    if (request.place is None) != request.lost:
        raise UsageError("give place, or lost", field="place")
    thing = iri(request.thing)
    if not context.kb.match(thing, RDF.type, RT.Exemplar):
        raise UnknownTermError(f"thing: the graph has no thing {request.thing}", field="thing")
    author = context.author(access, request.agent)
    check_hand(context, request.place, access)
    if request.lost:
        check_held(context, request.thing, access, "thing")
    with context.writing:
        time_s = stated_instant(request.stamp)
        added, withdrawn = moved(
            context, request.thing, request.place, author, time_s, inside=request.inside,
            was_carried=False,
        )  # fmt: skip
        with context.kb.transaction(access=author, note="state a place") as tx:
            for statement in withdrawn:
                tx.remove(*statement)
            for statement in added:
                tx.add(*statement)
    return StatedPlace(commit=context.commit_id(tx.commit))


def check_hand(
    context: Context, place: str | None, access: Access, givers: Collection[str] = ()
) -> None:
    """Refuse a robot to say what another one holds.

    Parameters
    ----------
    givers
        IRIs of robots whose hands it may name as well: those with which it does a step.

    Raises
    ------
    ForbiddenError
        The place is a hand of yet another robot.
    """
    if access.role != "robot" or place is None:
        return
    owners = {quad.subject for quad in context.kb.match(None, RT.hasEndEffector, iri(place))}
    allowed = {context.agent_iri(access), *map(NamedNode, givers)}
    if owners and not owners & allowed:
        raise ForbiddenError(
            f"place: the token belongs to {access.agent!r}, and {place} is a hand of another "
            "robot, which says itself what it holds",
            field="place",
        )


def check_held(context: Context, thing: str, access: Access, field: str) -> None:
    """Refuse a robot to say that a thing is gone which another one has in its hand.

    To take it over, it says that it holds it itself; where it lies, a look says.

    Raises
    ------
    ForbiddenError
        Another robot holds it, as far as is known.
    """
    last = context.world.last_placement(present(context.world, thing))
    if access.role != "robot" or last is None or not last.is_current:
        return
    if last.relation != "held_by":
        return
    owners = {quad.subject for quad in context.kb.match(None, RT.hasEndEffector, iri(last.place))}
    if owners and context.agent_iri(access) not in owners:
        raise ForbiddenError(
            f"{field}: the token belongs to {access.agent!r}, and {thing} is in "
            f"{label_of(context.world, last.place)}, which says itself that it lost it",
            field=field,
        )


def moved(
    context: Context,
    thing: str,
    place: str | None,
    author: Access,
    time_s: float | None = None,
    *,
    inside: bool = False,
    was_carried: bool = True,
) -> tuple[list[Statement], list[Statement]]:
    """Return what to state and to withdraw if a thing is at a place from a time on; None if lost.

    Parameters
    ----------
    time_s
        Unix time; default: now.
    inside
        Whether it is in the place, and not on it.
    was_carried
        Whether it was brought there; if not, it keeps a pose that is there.

    Raises
    ------
    UnknownTermError
        The graph has no such place.
    UsageError
        The place is a frame, or the thing itself, or what is on or in it.
    """
    edit = WorldEdit(context.world, context.home_graph(author))
    time_s = stated_instant(None) if time_s is None else time_s
    if place is None:
        edit.lose(thing, time_s)
        return edit.drain()
    node = iri(place)
    if not (isinstance(node, NamedNode) and context.kb.match(node)):
        raise UnknownTermError(f"place: the graph has no {place}", field="place")
    if context.kb.match(node, RDF.type, RT.Frame):
        raise UsageError(
            f"place: {place} is a frame, in which things have poses; name the place or thing that "
            "stands there", field="place",
        )  # fmt: skip
    agent = context.agent_iri(author).value
    relation: Relation = "in" if inside else "on"
    if context.kb.match(None, RT.hasEndEffector, node):
        relation = "held_by"
    _check_nesting(context, thing, place, time_s)
    edit.put(thing, relation, place, time_s, agent, was_carried=was_carried)
    return edit.drain()


def _check_nesting(context: Context, thing: str, place: str, time_s: float) -> None:
    """Refuse to put a thing on or into itself, or what is in or on it.

    Raises
    ------
    UsageError
        The place is the thing, or is in or on it, at whatever depth.
    """
    world, node = context.world, present(context.world, place)
    passed = {node}
    while node != present(world, thing):
        around = world.placement_at(node, time_s)
        if around is None or not around.place or around.place in passed:
            return
        node = around.place
        passed.add(node)
    raise UsageError(
        f"place: {label_of(world, place)} is {label_of(world, thing)} itself, or on or in it",
        field="place",
    )
