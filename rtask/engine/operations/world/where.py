"""Where something is, or was: since when, who saw it, and how sure that is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Le, MaxLen, MinLen

from rtask.engine.operations.operation import operation
from rtask.wire.message import Answer, Message
from rtask.wire.types import Json, Number, Stamp, Text, Unit, Whole

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.world import Whereabouts, World

__all__ = ["WhereIs", "answer_of", "where_is"]


class WhereIs(Message):
    """A question about where something is."""

    name: Annotated[Text, MinLen(1), MaxLen(1000)]
    """IRI or name of a thing or product, an objectId, or a kind such as cup"""
    stamp: Stamp | None = None
    """time that is asked about; default: now"""
    frame: Text | None = None
    """frame for poses: its name in tf, robot/name or its IRI; default: as measured"""
    near: Text | None = None
    """only what is in, on or near this place, robot, frame or thing; default: anywhere"""
    radius: Annotated[Number, Unit("m"), Ge(0.001), Le(1000)] = 0.5
    """how near that is; with a robot and the reach of its arm: what it can reach"""
    max_things: Annotated[Whole, Ge(1), Le(10_000)] = 200
    """how many things of that name are looked at"""


class OtherThing(Answer):
    """A thing that another one may be."""

    thing: str
    chance: float


class LocatedThing(Answer):
    """Where one thing was at the time in question."""

    thing: str
    """IRI; empty if robots saw the product before things were told apart"""
    object: str
    """IRI of its product"""
    label: str
    relation: str
    """at a pose, on, in or held_by a place; unknown if nobody knows"""
    place: str
    """IRI of the support, container or hand; empty without one"""
    place_label: str
    frame_id: str
    """name of the frame of the pose; empty without one"""
    frame: str
    """its IRI"""
    frame_reason: str
    """why the pose is in the frame in which it was measured, and not in the one asked for; empty
    if it is, or if none was asked for"""
    pose: Json | None
    """geometry_msgs/Pose of the thing in the frame; null if none is known"""
    since: float | None
    """since when it was there, Unix time, s; null if nobody ever saw it"""
    seen: float | None
    """when it was last seen there"""
    until: float | None
    """when that ended; null while it lasts"""
    by: str
    """name of who said so"""
    still_there: float
    """chance that it was still there"""
    radius90: float | None
    """distance within which it was with a chance of 90 %, m; null without a pose"""
    may_be: list[OtherThing]
    """other things that it may be"""
    text: str


class Located(Answer):
    """Where the things are that a question is about, best known first."""

    known: bool
    """whether the place of any of them is known"""
    text: str
    time: float
    """time that the answer is about, Unix time, s"""
    things: list[LocatedThing]
    things_untried: int
    """how many things of that name were not looked at; with any, what is not among the things is
    not decided"""


@operation("read", "reads", "tell where something is or was, since when, and how sure that is")
def where_is(context: Context, request: WhereIs, access: Access) -> Located:
    """Return where the things of a name are; "not known" is an answer, and no error."""
    return answer_of(context.world, request)


def answer_of(world: World, request: WhereIs) -> Located:
    """Return the answer to a request from a world, as the operation gives it."""
    answer = world.where_is(
        request.name, at=request.stamp, frame=request.frame, near=request.near,
        radius_m=request.radius, max_things=request.max_things,
    )  # fmt: skip
    return Located(
        known=answer.is_known,
        text=answer.text,
        time=answer.time_s,
        things=[_located(whereabouts) for whereabouts in answer.exemplars],
        things_untried=answer.things_untried,
    )


def _located(whereabouts: Whereabouts) -> LocatedThing:
    from grasp.messages import pose_message

    pose = whereabouts.frame_from_exemplar
    return LocatedThing(
        thing=whereabouts.exemplar,
        object=whereabouts.product,
        label=whereabouts.label,
        relation=whereabouts.relation,
        place=whereabouts.place if whereabouts.is_known else "",
        place_label=whereabouts.place_label if whereabouts.is_known else "",
        frame_id=whereabouts.frame_id,
        frame=whereabouts.frame,
        frame_reason=whereabouts.frame_reason,
        pose=None if pose is None else pose_message(pose),
        since=whereabouts.since_s,
        seen=whereabouts.seen_s,
        until=whereabouts.until_s,
        by=whereabouts.agent,
        still_there=whereabouts.still_there,
        radius90=whereabouts.radius90_m,
        may_be=[OtherThing(thing=other, chance=chance) for other, chance in whereabouts.doubts],
        text=whereabouts.text,
    )
