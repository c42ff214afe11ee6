"""Answers to a robot that asks what it sees and how to grasp it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from grasp.messages import empty_grasp_message, grasp_message, spatial_grasp_message
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.frames import closing_yaw
from grasp.spatial.gripper import ParallelGripper
from rtask.engine.decisions import Option, graph_against_geometry
from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.statistics import GraspStatistics, summary
from rtask.engine.observation import Observation
from rtask.engine.operations.grasps import (
    GraspContact,
    GraspFields,
    GraspMessage,
    contact_messages,
)
from rtask.engine.operations.search import (
    SimilarObject,
    match_message,
    similar_objects,
    word_fields,
)
from rtask.engine.perception.identity import verdict
from rtask.engine.perception.placement import Placement
from rtask.engine.perception.poses import ObjectPose, pose_fields
from rtask.engine.remembered import Memory, RememberedObject
from rtask.wire.message import Answer, named
from rtask.wire.types import Json

if TYPE_CHECKING:
    from features.recognition.recogniser import Recognition as Matches

__all__ = ["OfferedGrasp", "Recognition", "Situation", "fields_of", "identity_of"]


class OfferedGrasp(GraspMessage):
    """A grasp to try: a moveit_msgs/Grasp with its belief and the reasons for its rank."""

    kind: str
    """planar or spatial"""
    source: str
    """memory or candidate"""
    x: float
    y: float
    z: float
    theta: float
    width: float
    opening: float
    mean: float
    interval90: list[float]
    alpha: float
    beta: float
    statistics: GraspStatistics
    explanation: Json
    in_object: Json
    contacts: list[GraspContact]
    """where a cup or three fingers touch; empty for jaws"""


class _Recognised(Answer):
    """The recognised object; a base class so that its fields come first."""

    task_response: str
    """grasp, candidate, no_grasp or unknown"""
    task_id: str
    object: str
    thing: str = ""
    """IRI of the single thing, a specimen of the object; empty if its place is not certain"""
    class_: str = named("class")
    class_iri: str
    label: str
    confidence: float
    statistics: GraspStatistics


class Recognition(GraspFields, _Recognised):
    """The object and its grasps; `decision` is null unless requested."""

    grasps: list[OfferedGrasp]
    grasps_left_out: int
    """how many more could be tried; max_grasps asks for them"""
    shape: Json | None
    recognition: Json
    similar_objects: list[SimilarObject]
    alone: Json | None
    """the first grasp if the graph knew of no outcomes; null if it knew of none"""
    decision: Json | None
    times: Json


@dataclass(frozen=True)
class Situation:
    """Input of the choice of a grasp."""

    observation: Observation
    recognition: Matches
    memory: Memory
    recognised: RememberedObject | None
    placement: Placement | None
    gripper: StoredGripper
    pose: ObjectPose | None = None
    chosen: Sequence[Option] = ()
    alone: Option | None = None


def identity_of(situation: Situation) -> float:
    """Return the confidence in the identity, of the best match if none was accepted."""
    recognised, matches = situation.recognised, situation.recognition.matches
    if recognised is None:
        return float(matches[0].confidence) if matches else 0.0
    object_matches = [m for m in matches if m.object_iri == recognised.iri]
    # The robot itself said which object it is.
    if not situation.recognition.accepted or not object_matches:
        return 1.0
    return float(object_matches[0].confidence)


def fields_of(situation: Situation, max_grasps: int) -> dict[str, Any]:
    """Return the fields of the answer for a situation."""
    seen, recognised = situation.observation, situation.recognised
    grasps = [_grasp(option, situation) for option in situation.chosen[:max_grasps]]
    first = situation.chosen[0] if situation.chosen else None
    if first is None:
        kind = "no_grasp" if recognised else "unknown"
    else:
        kind = "grasp" if first.remembered is not None else "candidate"
    top = dict(grasps[0]) if grasps else empty_grasp_message(seen.frame_id)
    shape = seen.shape
    return {
        "task_response": kind,
        "object": recognised.iri if recognised else "",
        "class_": recognised.short_id if recognised else "",
        "class_iri": recognised.class_iri if recognised else "",
        "label": recognised.label if recognised else "",
        "confidence": 0.0 if recognised is None else identity_of(situation),
        "statistics": grasps[0].statistics if grasps else summary(0, 0),
        **{name: top[name] for name in GraspFields.model_fields},
        "grasps": grasps,
        "grasps_left_out": max(len(situation.chosen) - max_grasps, 0),
        "shape": None if shape is None else {
            "x": float(shape.centre[0]),
            "y": float(shape.centre[1]),
            "yaw": float(shape.yaw),
            "length": float(shape.length),
            "width": float(shape.width),
            "height": float(shape.height),
            "support_height": float(shape.support_height),
            "roundness": float(shape.roundness),
        },
        "recognition": {
            "outcome": situation.recognition.outcome,
            "accepted": bool(situation.recognition.accepted),
            "family": situation.recognition.family,
            "ask_again": situation.recognition.ask_again,
            "views_untried": situation.recognition.views_untried,
            "message": verdict(situation.recognition, situation.memory, seen),
            **word_fields(situation.recognition),
            "matches": [
                match_message(match, situation.memory) for match in situation.recognition.matches
            ],
            **pose_fields(situation.pose, seen),
        },
        "similar_objects": similar_objects(seen, situation.recognition, situation.memory),
        "alone": _alone(situation),
    }  # fmt: skip


def _alone(situation: Situation) -> dict[str, Any] | None:
    """Return the grasp that the robot would try first without the graph's outcomes."""
    option = situation.alone
    if option is None or option.choice is None or not situation.chosen:
        return None
    return {
        "id": option.id,
        "in_object": dict(zip(("x", "y", "z", "theta"), option.in_object, strict=True)),
        "mean": option.choice.mean,
        "quality": option.quality,
        "cause": None if option.cause is None else asdict(option.cause),
        "text": graph_against_geometry(situation.chosen[0], option),
    }


def _grasp(option: Option, situation: Situation) -> OfferedGrasp:
    """Return one entry of ``grasps``."""
    assert option.choice is not None
    assert situation.observation.shape is not None
    grasp, choice, recognised = option.grasp, option.choice, option.remembered
    support = float(situation.observation.shape.support_height)
    frame_id = situation.observation.frame_id or "base"
    hand = situation.gripper.gripper
    if isinstance(grasp, GraspCandidate):
        kind, at = "spatial", (*grasp.centre.tolist(), closing_yaw(grasp.frame_from_gripper))
        message = spatial_grasp_message(grasp, hand, frame_id)
        contacts = option.contacts and option.contacts.moved(grasp.frame_from_gripper)
    else:
        assert isinstance(hand, ParallelGripper)
        kind, at = "planar", (grasp.x, grasp.y, support + grasp.z, grasp.theta)
        message, contacts = grasp_message(grasp, hand, frame_id, support), None
    in_object = dict(zip(("x", "y", "z", "theta"), option.in_object, strict=True))
    if option.quaternion is not None:
        in_object.update(zip(("qx", "qy", "qz", "qw"), option.quaternion, strict=True))
    return OfferedGrasp(
        **{**message, "id": option.id},
        kind=kind,
        source="memory" if recognised is not None else "candidate",
        **dict(zip(("x", "y", "z", "theta"), at, strict=True)),
        width=grasp.width,
        opening=option.opening,
        mean=choice.mean,
        interval90=list(choice.interval90),
        alpha=choice.alpha,
        beta=choice.beta,
        statistics=summary(recognised.successes, recognised.attempts)
        if recognised
        else summary(0, 0),
        explanation=option.explanation,
        in_object=in_object,
        contacts=contact_messages(contacts),
    )
