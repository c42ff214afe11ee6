"""Known grasps of one object, recalled without an observation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Le

from grasp.messages import spatial_grasp_message
from grasp.spatial.candidate import Contacts, GraspCandidate
from grasp.spatial.gripper import EndEffector, ParallelGripper
from rtask.engine.memory.confidence import Confidence, posterior, stored_confidences
from rtask.engine.memory.promises import grown_promises, stored_scores
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.memory.statistics import GraspStatistics, lower_95, summary
from rtask.engine.operations.operation import operation
from rtask.engine.records.objects import frame_id_of, resolve_object
from rtask.engine.remembered import Remembered
from rtask.wire.message import Answer, Message
from rtask.wire.types import (
    Flag,
    GripperTranslation,
    JointTrajectory,
    PoseStamped,
    Text,
    Whole,
)

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.engine.grippers import StoredGripper
    from rtask.kb.commit.access import Access

__all__ = [
    "GraspConfidence",
    "GraspContact",
    "GraspFields",
    "GraspMessage",
    "GraspPromise",
    "RecallGrasps",
    "RecalledGrasp",
    "RecalledGrasps",
    "as_messages",
    "contact_messages",
    "recall_grasps",
    "recalled",
    "resolve_object",
]


class RecallGrasps(Message):
    """A request for the known grasps of an object."""

    object: Text
    """IRI, objectId or name of the object"""
    gripper_id: Text | None = None
    """restricts the answer to its type; default: all types"""
    max_grasps: Annotated[Whole, Ge(1), Le(10_000)] = 10
    """maximum number of grasps"""
    in_space: Flag = True
    """include grasps from any direction, not only from above"""


class GraspConfidence(Answer):
    """Confidence in a grasp over all robots: a Beta distribution and its prior."""

    mean: float
    alpha: float
    beta: float
    prior: float | None
    evaluation: str
    updated: str
    policy: str
    note: str


class GraspPromise(Answer):
    """What is promised of a grasp planned on a mesh, by the hand that asks."""

    lift_chance: float | None
    """that it lifts the object; null where nothing is promised, as for a grasp that was seen"""
    lift_at_least: float | None
    """held by nine of ten objects of that chance"""
    carry_chance: float | None
    """that the object is still held when it is shaken at 2.5 g"""
    carry_at_least: float | None
    outcomes: int
    """of the hand, from which the promises grew; 0 = as by the factory"""


class GraspFields(Answer):
    """The fields of moveit_msgs/Grasp without its id."""

    pre_grasp_posture: JointTrajectory
    grasp_posture: JointTrajectory
    grasp_pose: PoseStamped
    grasp_quality: float
    pre_grasp_approach: GripperTranslation
    post_grasp_retreat: GripperTranslation
    post_place_retreat: GripperTranslation
    max_contact_force: float
    allowed_touch_objects: list[str]


class GraspContact(Answer):
    """A place at which a lip seals or a finger pushes, in the frame of the grasp's pose."""

    x: float
    y: float
    z: float
    """of the place, m"""
    nx: float
    ny: float
    nz: float
    """normal of the surface, out of the object"""
    seal_radius: float | None
    """of the lip that seals there, m; null for fingers"""


class _Named(Answer):
    """The id of a grasp; a base class so that it comes first."""

    id: str


class GraspMessage(GraspFields, _Named):
    """A moveit_msgs/Grasp."""


class RecalledGrasp(GraspMessage):
    """One known grasp as moveit_msgs/Grasp, in the frame of its object."""

    kind: str
    """planar or spatial"""
    gripper_type: str
    contact_kind: str
    """kind of hand that can carry it out: jaws, suction or three_fingers"""
    contacts: list[GraspContact]
    """where a cup or three fingers touch; empty for jaws"""
    x: float
    y: float
    z: float
    theta: float
    width: float | None
    opening: float | None
    statistics: GraspStatistics
    confidence: GraspConfidence
    promise: GraspPromise


class RecalledGrasps(Answer):
    """The known grasps of an object, most reliable first."""

    object: str
    class_iri: str
    label: str
    grasps: list[RecalledGrasp]
    grasps_left_out: int
    """how many more are known; max_grasps asks for them"""


@operation("read", "reads", "list the known grasps of a known object")
def recall_grasps(context: Context, request: RecallGrasps, access: Access) -> RecalledGrasps:
    """Return the grasps of an object in its own frame, most reliable first."""
    name = resolve_object(context, request.object)
    memory = recall(context.kb, Question(objects=(name,), in_space=request.in_space))
    remembered = memory.objects[name]
    grasps, registered = memory.of(name), None
    if request.gripper_id:
        registered = context.grippers.find(request.gripper_id, access)
        hand_kind = (registered.gripper.gripper_type, registered.gripper.contact_kind)
        grasps = [g for g in grasps if (g.gripper_type, g.contact_kind) == hand_kind]
    return RecalledGrasps(
        object=name,
        class_iri=remembered.class_iri,
        label=remembered.label,
        grasps=recalled(context, grasps, request.max_grasps, registered),
        grasps_left_out=max(len(grasps) - request.max_grasps, 0),
    )


def recalled(
    context: Context, grasps: Iterable[Remembered], most: int, hand: StoredGripper | None = None
) -> list[RecalledGrasp]:
    """Return grasps as messages in their object's frame, most reliable first.

    They are ordered by the lower bound on their success rate, then by the stored quality; of what
    is promised, see :func:`as_messages`.
    """
    order = sorted(
        grasps, key=lambda g: (-lower_95(g.successes, g.attempts), -g.successes, -g.quality)
    )[:most]
    return as_messages(context, order, hand)


def as_messages(
    context: Context, grasps: Sequence[Remembered], hand: StoredGripper | None = None
) -> list[RecalledGrasp]:
    """Return grasps as messages in their object's frame, in the given order.

    Parameters
    ----------
    hand
        Of which something is promised, as far as grasps are of its type; None = of none.
    """
    stored = stored_confidences(context, [g.grasp for g in grasps])
    promised = _promised(context, grasps, hand)
    return [
        RecalledGrasp(
            **{**_message(context, g), "id": g.grasp, "grasp_quality": g.quality},
            kind="planar" if g.quaternion is None else "spatial",
            gripper_type=g.gripper_type,
            contact_kind=g.contact_kind,
            contacts=contact_messages(g.contacts),
            x=g.x,
            y=g.y,
            z=g.z,
            theta=g.theta,
            width=g.width,
            opening=g.opening,
            statistics=summary(g.successes, g.attempts),
            confidence=_confidence(context, g, stored.get(g.grasp, Confidence())),
            promise=promised.get(g.grasp, _NO_PROMISE),
        )
        for g in grasps
    ]


def _promised(
    context: Context, grasps: Sequence[Remembered], hand: StoredGripper | None
) -> dict[str, GraspPromise]:
    """Return what is promised of those grasps of a hand's type that keep their scores."""
    if hand is None:
        return {}
    mine = [g.grasp for g in grasps if g.gripper_type == hand.gripper.gripper_type]
    scores = stored_scores(context, mine)
    promises = grown_promises(context, hand.gripper, [hand.iri]) if scores else None
    if promises is None:
        return {}
    return {
        grasp: GraspPromise(**promises.of(told), outcomes=promises.outcomes)
        for grasp, told in scores.items()
    }


_NO_PROMISE = GraspPromise(
    lift_chance=None, lift_at_least=None, carry_chance=None, carry_at_least=None, outcomes=0
)


def contact_messages(contacts: Contacts | None) -> list[GraspContact]:
    """Return contacts as messages in their own frame; none for jaws."""
    if contacts is None:
        return []
    return [
        GraspContact(x=x, y=y, z=z, nx=nx, ny=ny, nz=nz, seal_radius=contacts.seal_radius)
        for (x, y, z), (nx, ny, nz) in zip(
            contacts.points.tolist(), contacts.normals.tolist(), strict=True
        )
    ]


def _message(context: Context, grasp: Remembered) -> dict[str, Any]:
    """Return a grasp as moveit_msgs/Grasp in its object's frame, for its gripper type."""
    kind, opening = grasp.gripper_type, grasp.opening
    hands = [
        stored.gripper for stored in context.grippers.all() if stored.gripper.gripper_type == kind
    ]
    hand: EndEffector = ParallelGripper(kind, kind, 0.0, max(opening, 1e-3))
    if hands:
        hand = hands[0]
    width = opening if grasp.width is None else grasp.width
    candidate = GraspCandidate(
        grasp.object_from_gripper, width, source="recalled", opening=opening,
        scores={"confidence": grasp.quality},
    )  # fmt: skip
    return spatial_grasp_message(candidate, hand, frame_id_of(context, grasp.object))


def _confidence(context: Context, grasp: Remembered, stored: Confidence) -> GraspConfidence:
    """Return prior and posterior of a grasp, which are equal before the first outcome.

    A belief that was stored under other rules is recomputed from the attempts.
    """
    policy, note = context.policy, ""
    prior = grasp.prior if stored.prior is None else stored.prior
    belief = stored.belief
    if belief is None:
        belief = posterior(policy, prior, ())
    elif stored.policy != policy.version:
        counts = [(t.held, t.is_fast, t.count) for t in grasp.tallies]
        belief = posterior(policy, prior, counts)
        note = f"recomputed: stored by the rules {stored.policy or 'of an older release'}"
    return GraspConfidence(
        mean=belief.mean,
        alpha=belief.alpha,
        beta=belief.beta,
        prior=prior,
        evaluation=stored.evaluation,
        updated=stored.updated,
        policy=policy.version,
        note=note,
    )
