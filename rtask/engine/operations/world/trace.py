"""The history of one thing: its places in order, and who moved it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le, MaxLen, MinLen

from rtask.engine.operations.operation import operation
from rtask.engine.operations.world.instants import asked_instant
from rtask.errors import UnknownTermError, UsageError
from rtask.wire.message import Answer, Message
from rtask.wire.types import Json, Stamp, Text, Whole
from rtask.world.names import find_exemplars, label_of
from rtask.world.tracing import Stay, stays_of

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.world.state import WorldState

__all__ = ["TraceThing", "trace_thing"]


class TraceThing(Message):
    """A question about the history of one thing."""

    name: Annotated[Text, MinLen(1), MaxLen(1000)]
    """IRI of the thing, or a name that only one thing has"""
    stamp: Stamp | None = None
    """time up to which its places are asked for; default: now"""
    max_places: Annotated[Whole, Ge(1), Le(10_000)] = 100
    """how many of the latest places are listed"""


class PastPlace(Answer):
    """A place at which the thing was."""

    relation: str
    """at a pose, on, in or held_by a place"""
    place: str
    """IRI of the support, container or hand; empty without one"""
    place_label: str
    frame: str
    """IRI of the frame of the pose; empty without one"""
    pose: Json | None
    """geometry_msgs/Pose in that frame; null if none is known"""
    arrived_after: float | None
    """Unix time, s, after which it came: when it was last seen where it surely had been before;
    null if nobody saw it elsewhere"""
    since: float
    """since when it was known to be there"""
    seen: float
    """when it was last seen there"""
    until: float | None
    """when it was first seen elsewhere, or taken; null while it lasts"""
    left_before: float | None
    """Unix time, s, by which it had surely left: after ``until`` where the next pose is so near
    that it may have stood still; null if it may be there still"""
    by: str
    """name of who said so"""
    moved_by: str
    """name of who brought it there; empty if nobody saw that"""


class Traced(Answer):
    """Places of a thing, oldest first."""

    thing: str
    """IRI"""
    object: str
    """IRI of its product"""
    label: str
    places: list[PastPlace]
    places_left_out: int
    """how many earlier ones are not listed"""


@operation("read", "reads", "tell where a thing was, one place after the other, and who moved it")
def trace_thing(context: Context, request: TraceThing, access: Access) -> Traced:
    """Return the places of a thing, oldest first.

    Raises
    ------
    UnknownTermError
        The graph has no thing of that name.
    UsageError
        Several things have the name.
    """
    world = context.world
    pairs, untried = find_exemplars(world, request.name, 2)
    if not pairs or not pairs[0][0]:
        raise UnknownTermError(f"name: the graph has no thing {request.name!r}", field="name")
    if len(pairs) > 1:
        raise UsageError(
            f"name: {len(pairs) + untried} things are called {request.name!r}; give the IRI of "
            "one, which where_is lists", field="name",
        )  # fmt: skip
    thing, product = pairs[0]
    latest, left_out = stays_of(world, thing, asked_instant(request.stamp), request.max_places)
    return Traced(
        thing=thing, object=product, label=label_of(world, thing),
        places=[_past_place(world, stay) for stay in latest],
        places_left_out=left_out,
    )  # fmt: skip


def _past_place(world: WorldState, stay: Stay) -> PastPlace:
    from grasp.messages import pose_message

    place, pose = stay.placement, stay.placement.frame_from_subject
    return PastPlace(
        relation=place.relation, place=place.place, place_label=label_of(world, place.place),
        frame=place.frame, pose=None if pose is None else pose_message(pose),
        arrived_after=stay.arrived_after_s, since=place.begin, seen=place.confirmed,
        until=place.end, left_before=stay.left_before_s, by=label_of(world, place.agent),
        moved_by=label_of(world, stay.moved_by),
    )  # fmt: skip
