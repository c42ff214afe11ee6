"""Grasps and attempts as triples."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp.spatial.frames import angle_between_axes, matrix_from_pose, wrap_2pi
from grasp.spatial.gripper import ContactKind
from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.calibration import PLANAR, SPATIAL
from rtask.engine.memory.verdicts import Verdict
from rtask.engine.perception.images import check_picture
from rtask.engine.records.objects import body_frame
from rtask.engine.records.outcomes import TIMES, Outcome
from rtask.engine.records.received import Received
from rtask.engine.triples import Triples, stamp
from rtask.errors import UsageError
from rtask.interop.episodes.motion import MEDIA_TYPE, Motion
from rtask.rdf.namespaces import PREFIXES, PROV, RT, reason
from rtask.rdf.terms import NamedNode, iri, literal

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = [
    "CONTACT_CLASSES",
    "Attempt",
    "attempt_triples",
    "find_grasp",
    "quality_kind",
    "state_grasp",
    "state_verdict",
]

_GENERATOR, _IN_SPACE = "rtask planar outline 1", "rtask antipodal 1"
CONTACT_CLASSES: dict[ContactKind, NamedNode] = {
    "suction": RT.SuctionGrasp, "three_fingers": RT.ThreeFingerGrasp,
}  # fmt: skip
"""Classes of grasps whose contacts are stored; those of jaws are none of these."""


@dataclass(frozen=True)
class Attempt:
    """An attempt to be stored.

    Parameters
    ----------
    thing
        The object.
    grasp
        Stored, or added in the same commit.
    task
        IRI and class of the task it was for.
    started
        None if it is not known.
    times
        Durations by the names of :data:`TIMES`, s.
    """

    attempt: NamedNode
    thing: NamedNode
    grasp: NamedNode
    gripper: StoredGripper
    task: NamedNode
    task_class: NamedNode
    task_name: str
    request_id: str
    started: dt.datetime | None
    ended: dt.datetime
    outcome: Outcome
    received: Received
    recognition: NamedNode | None = None
    times: Mapping[str, float] = field(default_factory=dict)
    seed: int | None = None


def find_grasp(
    context: Context, thing: NamedNode, gripper_type: str, grasp: Received
) -> NamedNode | None:
    """Return the stored grasp of an object that equals the given one, or None."""
    if grasp.in_object is None:
        return None
    rotation = "rt:theta ?theta"
    if grasp.orientation is not None:
        rotation = "rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw"
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT * WHERE {{
  {thing} rt:hasGrasp ?grasp . ?grasp rt:gripperType ?type ; rt:graspPose ?pose .
  ?pose rt:inFrame {body_frame(context, thing)} ; rt:x ?x ; rt:y ?y ; rt:z ?z ; {rotation}
  OPTIONAL {{ ?grasp rt:jawOpening ?opening }}
  FILTER(?type = {literal(gripper_type)}) }} ORDER BY ?grasp""")
    x, y, z, _ = grasp.in_object
    near = context.policy.same_pose_m
    for row in rows:
        there: dict[str, Any] = row.to_dict()
        distance = max(abs(there["x"] - x), abs(there["y"] - y), abs(there["z"] - z))
        opening = there["opening"]
        wider = abs(opening - grasp.opening) if opening and grasp.opening else 0.0
        if (
            max(distance, wider) <= near
            and _angle_between(grasp, there) <= context.policy.same_pose_rad
            and isinstance(row["grasp"], NamedNode)
        ):
            return row["grasp"]
    return None


def _angle_between(grasp: Received, there: Mapping[str, Any]) -> float:
    """Return the angle between a received and a stored grasp, rad."""
    from scipy.spatial.transform import Rotation

    if grasp.orientation is None:
        assert grasp.in_object is not None
        return angle_between_axes(there["theta"], grasp.in_object[3])
    stored = Rotation.from_quat([float(there["q" + axis]) for axis in "xyzw"])
    turn = stored.inv() * Rotation.from_quat(grasp.orientation)
    if grasp.contacts is None:
        return float(turn.magnitude())
    # A lip is alike at all angles about its approach, three fingers at every third of a turn.
    if grasp.contacts.kind == "suction":
        return float(np.arccos(np.clip(turn.as_matrix()[2, 2], -1.0, 1.0)))
    thirds = Rotation.from_rotvec([[0.0, 0.0, 2 * np.pi * k / 3] for k in range(3)])
    return float((turn * thirds).magnitude().min())


def state_grasp(
    context: Context, triples: Triples, thing: NamedNode, gripper_type: str, grasp: Received,
    derived_from: NamedNode | None = None,
) -> NamedNode:  # fmt: skip
    """Add a new grasp of an object and return its IRI."""
    if grasp.in_object is None:
        raise UsageError("grasp: its pose on the object is unknown; send the object's data as well")
    x, y, z, theta = grasp.in_object
    node = context.names.counted("grasp")
    pose = iri(node.value + "/pose")
    triples.add(thing, RT.hasGrasp, node)
    triples.node(
        node,
        [*_classes(grasp), RT.GraspCandidate],
        {
            RT.gripperType: gripper_type,
            RT.graspPose: pose,
            RT.jawOpening: grasp.opening,
            RT.contactWidth: grasp.width,
            RT.graspQuality: grasp.quality,
            RT.generator: _generator(grasp),
            PROV.wasDerivedFrom: derived_from,
        },
    )
    if grasp.orientation is not None:
        at = matrix_from_pose(np.array([x, y, z]), np.array(grasp.orientation))
        triples.pose(pose, body_frame(context, thing), np.asarray(at, dtype=np.float64))
        _state_contacts(triples, node, grasp, body_frame(context, thing))
        return node
    triples.node(
        pose,
        [RT.PlanarPose],
        {RT.inFrame: body_frame(context, thing), RT.x: float(x), RT.y: float(y), RT.z: float(z)},
    )
    # Rounding 2 pi - 1e-9 up would leave [0, 2 pi).
    turned = round(wrap_2pi(theta), 6)
    triples.add(pose, RT.theta, 0.0 if turned >= 2 * np.pi else turned)
    return node


def _classes(grasp: Received) -> list[NamedNode]:
    if grasp.contacts is not None:
        return [CONTACT_CLASSES[grasp.contacts.kind], RT.SpatialGrasp]
    return [RT.PlanarGrasp if grasp.orientation is None else RT.SpatialGrasp]


def _generator(grasp: Received) -> str:
    if grasp.contacts is not None:
        return f"rtask {grasp.contacts.kind} 1"
    return _GENERATOR if grasp.orientation is None else _IN_SPACE


def _state_contacts(triples: Triples, node: NamedNode, grasp: Received, frame: NamedNode) -> None:
    """Add where a lip seals or fingers push, in the object's frame."""
    if grasp.contacts is None:
        return
    contacts = grasp.contacts.moved(grasp.object_from_gripper)
    for k, (place, normal) in enumerate(zip(contacts.points, contacts.normals, strict=True)):
        touch = iri(f"{node.value}/contact/{k}")
        triples.add(node, RT.hasContact, touch)
        triples.node(
            touch,
            [RT.GraspContact],
            {
                RT.contactIndex: k,
                RT.contactNormal: iri(f"{touch.value}/normal"),
                RT.sealRadius: contacts.seal_radius,
            },
        )
        triples.position(touch, frame, place)
        triples.direction(iri(f"{touch.value}/normal"), frame, normal)


def quality_kind(grasp: Received) -> str:
    """Return the kind of score that a grasp's quality is."""
    return PLANAR if grasp.orientation is None else SPATIAL


def attempt_triples(context: Context, one: Attempt) -> Triples:
    """Return the triples of an attempt: its task, outcome, evidence and pictures."""
    triples, report = Triples(), one.outcome.report
    outcome, feedback = context.names.unique("outcome"), context.names.unique("feedback")
    robot, belief = one.gripper.robot, one.received.belief
    triples.node(
        one.task,
        [one.task_class],
        {
            RT.taskName: one.task_name,
            RT.assignedTo: robot,
            RT.handles: one.thing,
            RT.through: one.attempt,
        },
    )
    preset = report.preset
    triples.node(
        one.attempt,
        [RT.GraspAttempt],
        {
            RT.performedBy: robot,
            RT.activates: one.gripper.iri,
            RT.executesGrasp: one.grasp,
            RT.hasOutcome: outcome,
            RT.usedRecognition: one.recognition,
            RT.requestId: one.request_id,
            RT.simulated: None if preset is None else preset != "real",
            RT.attemptNumber: report.attempt_number,
            RT.candidateCount: report.candidate_count,
            RT.candidateRank: report.candidate_rank,
            RT.analyticQuality: one.received.quality,
            RT.qualityKind: None if one.received.quality is None else quality_kind(one.received),
            RT.priorAlpha: belief[0] if belief else None,
            RT.priorBeta: belief[1] if belief else None,
            RT.policyVersion: context.policy.version if belief else None,
            RT.approachTilt: report.approach_tilt,
            RT.seed: one.seed if report.seed is None else report.seed,
            PROV.startedAtTime: one.started,
            PROV.endedAtTime: one.ended,
            **{TIMES[k]: float(v) for k, v in sorted(one.times.items()) if v is not None},
        },
    )
    triples.node(
        outcome,
        [RT.GraspOutcome],
        {
            RT.success: one.outcome.held,
            RT.placed: one.outcome.placed,
            RT.hasReason: reason(one.outcome.reason),
            RT.placeReason: reason(one.outcome.place_reason) if one.outcome.place_reason else None,
            RT.hasFeedback: feedback,
        },
    )
    triples.node(
        feedback,
        [RT.PhysicsFeedback],
        {
            RT.verdict: one.outcome.held,
            RT.preset: preset,
            RT.liftHeight: report.lifted_m,
            RT.slipDistance: report.slip,
            RT.linksTouching: report.links_touching,
            RT.contactForce: report.contact_force,
            RT.jawGap: report.jaw_gap,
            RT.holdTime: report.hold_s,
            RT.placeOffset: report.place_offset,
        },
    )
    for comment in one.outcome.comments:
        triples.add(feedback, RT.comment, comment)
    if report.confirmed_by == "human":
        operator = report.operator or "operator"
        said = Verdict(operator, one.outcome.held, one.ended)
        state_verdict(context, triples, outcome, said, (int(said.held), int(not said.held)))
    _state_pictures(context, triples, one)
    _state_motion(context, triples, one)
    return triples


def state_verdict(
    context: Context,
    triples: Triples,
    outcome: NamedNode,
    said: Verdict,
    votes: tuple[int, int],
) -> NamedNode:
    """Add a person's verdict on an outcome; the majority outweighs the robot's report.

    Parameters
    ----------
    votes
        Numbers of people, this one included, who judge that it held and that it did not.
    """
    person = context.kb.graphs.agent_iri(said.by, "teacher")
    triples.node(person, [RT.Human], {RT.name: said.by})
    feedback = context.names.unique("feedback")
    triples.add(outcome, RT.hasFeedback, feedback)
    return triples.node(
        feedback,
        [RT.HumanFeedback],
        {
            RT.verdict: said.held,
            RT.saidReason: reason(said.reason) if said.reason else None,
            RT.atTime: stamp(said.time),
            RT.comment: said.comment or None,
            RT.heldVotes: votes[0],
            RT.lostVotes: votes[1],
            PROV.wasAttributedTo: person,
        },
    )


def _state_motion(context: Context, triples: Triples, one: Attempt) -> None:
    told = one.outcome.report.motion
    if told is None:
        return
    motion = Motion.of_rows(
        told.joints, told.times, told.positions, told.commands, "outcome.motion"
    )
    blob = context.kb.blobs.put(motion.to_bytes(), MEDIA_TYPE)
    triples.node(
        iri(f"{one.attempt.value}/motion"),
        [RT.JointTrajectory],
        {RT.hasBlob: triples.blob(blob), PROV.wasGeneratedBy: one.attempt},
    )


def _state_pictures(context: Context, triples: Triples, one: Attempt) -> None:
    for k, picture in enumerate(one.outcome.report.images):
        media_type, width, height = check_picture(picture.data, f"outcome.images[{k}].data")
        triples.node(
            iri(f"{one.attempt.value}/image/{k + 1}"),
            [RT.ColorImage],
            {
                RT.name: picture.phase,
                RT.hasBlob: triples.blob(context.kb.blobs.put(picture.data, media_type)),
                RT.widthPx: width,
                RT.heightPx: height,
                RT.encoding: "rgb8",
                PROV.wasGeneratedBy: one.attempt,
            },
        )
