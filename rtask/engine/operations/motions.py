"""Movements that one robot recorded, offered to others that can follow them (Kehoe 2014, 1.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, MaxLen
from pydantic import Field

from rtask.engine.memory.motions import (
    Body,
    JointPart,
    MotionRecord,
    fitted,
    motion_records,
    thinned,
)
from rtask.engine.operations.operation import operation
from rtask.engine.records.objects import resolve_object
from rtask.errors import DataError, MissingBlobError, UsageError
from rtask.interop.episodes.motion import Motion
from rtask.rdf.terms import iri
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Number, Text, Whole

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["FollowingJoint", "RecallMotions", "RecalledMotions", "RecordedMotion", "recall_motions"]

_LATEST = 500
"""Recordings that are looked at, the latest first: each may have to be read to be judged."""


class FollowingJoint(Message):
    """A joint of the asking body that shall follow a recorded one."""

    name: Text
    """of the joint"""
    recorded: Text | None = None
    """name of the recorded joint whose place it takes; default: its own"""
    scale: Annotated[Number, Ge(-100), Le(100)] = 1.0
    """factor for the recorded value: -1 for a joint that turns the other way"""
    offset: Number = 0.0
    """added after that, rad or m"""
    lower: Number | None = None
    """lower limit, rad or m; default: none"""
    upper: Number | None = None
    """upper limit, rad or m; default: none"""


class RecallMotions(Message):
    """A request for movements that robots recorded in attempts."""

    object: Text | None = None
    """IRI, objectId or name of the object that was grasped; default: any"""
    gripper_id: Text | None = None
    """name or IRI of the hand that shall follow; default: the robot's only one"""
    joints: Annotated[list[FollowingJoint], MaxLen(64)] = Field(default_factory=list)
    """joints that shall follow; default: the recorded ones, so that only the same body can"""
    held: Flag = True
    """only movements of attempts that held"""
    any_body: Flag = False
    """also return the movements of other bodies, as recorded, for a caller that adapts them"""
    max_motions: Annotated[Whole, Ge(1), Le(50)] = 3
    """maximum number of movements"""
    max_samples: Annotated[Whole, Ge(2), Le(20_000)] = 200
    """maximum number of samples of each, at equal steps of time"""


class RecordedMotion(Answer):
    """The movement of one attempt."""

    attempt: str
    robot: str
    model: str
    """of the robot, as registered when it reported; empty if that was not stored"""
    hand: str
    object: str
    grasp: str
    held: bool
    ended: str
    fit: Literal["same_body", "retargeted", "other_body"]
    """recorded on this body; its joints renamed as `joints` says; or not to be followed as it is"""
    why_not: str
    """why it cannot be followed as it is; empty if it can"""
    joints: list[str]
    """names of the asking body, or the recorded ones of another body; the opening of a hand, 0
    (closed) to 1, counts as a joint by the hand's name"""
    times: list[float]
    """s since the start of the attempt; one a sample"""
    positions: list[float]
    """rad or m; all joints of the first sample, then of the second, ...; empty if it cannot be
    followed, unless any_body"""


class RecalledMotions(Answer):
    """Movements of other robots and of one's own, those that can be followed first."""

    motions: list[RecordedMotion]
    """the same body first, then the latest first"""
    rejected: list[RecordedMotion]
    """some that cannot be followed, with the reason; without positions"""
    motions_left_out: int
    """how many more are recorded; max_motions asks for more of the latest 500, object for older"""


@operation("read", "reads", "list movements that robots recorded, as far as one can follow them")
def recall_motions(context: Context, request: RecallMotions, access: Access) -> RecalledMotions:
    """Return recorded movements in the joints of the asking body.

    Whether the way is free, and where a renamed joint leads the hand, is for the robot to check.
    """
    hand = context.grippers.find(request.gripper_id, access)
    body = Body.of(context, hand, _parts(request.joints))
    thing = None if request.object is None else resolve_object(context, request.object)
    records, known = motion_records(context, thing, request.held, _LATEST)
    records.sort(key=lambda record: bool(body.difference(record)))
    offered: list[RecordedMotion] = []
    rejected: list[RecordedMotion] = []
    judged = 0
    for record in records:
        if len(offered) == request.max_motions:
            break
        judged += 1
        answer = _answer(context, record, body, request)
        if answer.positions:
            offered.append(answer)
        elif len(rejected) < request.max_motions:
            rejected.append(answer)
    return RecalledMotions(motions=offered, rejected=rejected, motions_left_out=known - judged)


def _parts(joints: Sequence[FollowingJoint]) -> list[JointPart]:
    """Check the joints of a request.

    Raises
    ------
    UsageError
        Two have the same name or take the same place, or the limits of one are swapped.
    """
    parts = [
        JointPart(
            joint.name, joint.recorded or joint.name, joint.scale, joint.offset,
            -np.inf if joint.lower is None else joint.lower,
            np.inf if joint.upper is None else joint.upper,
        )
        for joint in joints
    ]  # fmt: skip
    for names in ([part.name for part in parts], [part.recorded for part in parts]):
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise UsageError(f"joints: {', '.join(twice)} stands there twice", field="joints")
    for k, part in enumerate(parts):
        if part.lower > part.upper:
            raise UsageError(f"joints[{k}].lower is above upper", field=f"joints[{k}].lower")
    return parts


def _answer(
    context: Context, record: MotionRecord, body: Body, request: RecallMotions
) -> RecordedMotion:
    """Return a recording as it fits a body."""
    difference = body.difference(record)
    why_not = "" if body.joints else difference
    names: tuple[str, ...] = ()
    times = positions = np.zeros(0)
    if not why_not or request.any_body:
        try:
            motion = Motion.from_bytes(context.kb.blobs.read(iri(record.blob)))
        except (MissingBlobError, DataError) as error:
            why_not = f"it cannot be read: {error}"
        else:
            motion = thinned(motion, request.max_samples)
            follows = why_not or fitted(motion, record, body)
            if not isinstance(follows, str):
                names, positions = follows
            elif request.any_body:
                names, positions = motion.joints, motion.positions
            if isinstance(follows, str):
                why_not = follows
            times = motion.times if names else times
    fit: Literal["same_body", "retargeted", "other_body"] = "other_body"
    if not why_not:
        fit = "retargeted" if difference else "same_body"
    return RecordedMotion(
        attempt=record.attempt, robot=record.robot, model=record.model, hand=record.hand,
        object=record.object, grasp=record.grasp, held=record.held, ended=record.ended,
        fit=fit, why_not=why_not, joints=list(names), times=times.tolist(),
        positions=positions.ravel().tolist(),
    )  # fmt: skip
