"""Grasps and attempts as triples."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

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
    exemplar
        The single thing, a specimen of the object; None if it is not known.
    grasp
        Stored, or added in the same commit.
    task
        IRI and class of the task it was for.
    started
        None if it is not known.
    times
        Durations by the names of :data:`TIMES`, s.
    place
        Where the robot knew the object when a recorded attempt began: the frame, and the pose
        (4, 4) in it, m; None if unknown.
    """

    attempt: NamedNode
    object_iri: NamedNode
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
    exemplar: NamedNode | None = None
    times: Mapping[str, float] = field(default_factory=dict)
    seed: int | None = None
    place: tuple[str, NDArray[np.float64]] | None = None


def find_grasp(
    context: Context, object_iri: NamedNode, gripper_type: str, grasp: Received
) -> NamedNode | None:
    """Return the stored grasp of an object that equals the given one, or None."""
    if grasp.in_object is None:
        return None
    rotation = "rt:theta ?theta"
    if grasp.orientation is not None:
        rotation = "rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw"
    rows = context.kb.select(f"""{PREFIXES}
SELECT DISTINCT * WHERE {{
  {object_iri} rt:hasGrasp ?grasp . ?grasp rt:gripperType ?type ; rt:graspPose ?pose .
  ?pose rt:inFrame {body_frame(context, object_iri)} ; rt:x ?x ; rt:y ?y ; rt:z ?z ; {rotation}
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
    context: Context, triples: Triples, object_iri: NamedNode, gripper_type: str, grasp: Received,
    derived_from: NamedNode | None = None,
) -> NamedNode:  # fmt: skip
    """Add a new grasp of an object and return its IRI."""
    if grasp.in_object is None:
        raise UsageError("grasp: its pose on the object is unknown; send the object's data as well")
    x, y, z, theta = grasp.in_object
    node = context.names.counted("grasp")
    pose = iri(node.value + "/pose")
    triples.add(object_iri, RT.hasGrasp, node)
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
        triples.pose(pose, body_frame(context, object_iri), np.asarray(at, dtype=np.float64))
        _state_contacts(triples, node, grasp, body_frame(context, object_iri))
        return node
    triples.node(
        pose,
        [RT.PlanarPose],
        {
            RT.inFrame: body_frame(context, object_iri),
            RT.x: float(x),
            RT.y: float(y),
            RT.z: float(z),
        },
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


def attempt_triples(context: Context, attempt: Attempt) -> Triples:
    """Return the triples of an attempt: its task, outcome, evidence and pictures."""
    triples, report = Triples(), attempt.outcome.report
    outcome, feedback = context.names.unique("outcome"), context.names.unique("feedback")
    triples.node(
        attempt.task,
        [attempt.task_class],
        {
            RT.taskName: attempt.task_name,
            RT.assignedTo: attempt.gripper.robot,
            RT.handles: attempt.object_iri,
            RT.through: attempt.attempt,
        },
    )
    _state_attempt(context, triples, attempt, outcome)
    _state_outcome(triples, attempt.outcome, outcome, feedback)
    if report.confirmed_by == "human":
        operator = report.operator or "operator"
        verdict = Verdict(operator, attempt.outcome.held, attempt.ended)
        state_verdict(
            context, triples, outcome, verdict, (int(verdict.held), int(not verdict.held))
        )
    _state_pictures(context, triples, attempt)
    _state_motion(context, triples, attempt)
    return triples


def _state_attempt(
    context: Context, triples: Triples, attempt: Attempt, outcome: NamedNode
) -> None:
    report, received = attempt.outcome.report, attempt.received
    preset, belief = report.preset, received.belief
    triples.node(
        attempt.attempt,
        [RT.GraspAttempt],
        {
            RT.performedBy: attempt.gripper.robot,
            RT.activates: attempt.gripper.iri,
            RT.executesGrasp: attempt.grasp,
            RT.hasOutcome: outcome,
            RT.usedRecognition: attempt.recognition,
            RT.handlesExemplar: attempt.exemplar,
            RT.requestId: attempt.request_id,
            # Whoever does not say leaves it open: a real robot may just not have filled it in.
            RT.simulated: None if preset is None else preset != "real",
            RT.attemptNumber: report.attempt_number,
            RT.candidateCount: report.candidate_count,
            RT.candidateRank: report.candidate_rank,
            RT.analyticQuality: received.quality,
            RT.qualityKind: None if received.quality is None else quality_kind(received),
            # What was believed before, without which nobody could say later what was learned.
            RT.priorAlpha: belief[0] if belief else None,
            RT.priorBeta: belief[1] if belief else None,
            RT.policyVersion: context.policy.version if belief else None,
            RT.approachTilt: report.approach_tilt,
            RT.seed: attempt.seed if report.seed is None else report.seed,
            PROV.startedAtTime: attempt.started,
            PROV.endedAtTime: attempt.ended,
            **{TIMES[k]: float(v) for k, v in sorted(attempt.times.items()) if v is not None},
        },
    )


def _state_outcome(
    triples: Triples, judged: Outcome, outcome: NamedNode, feedback: NamedNode
) -> None:
    """State how an attempt ended, and what the robot's senses say of it."""
    report = judged.report
    triples.node(
        outcome,
        [RT.GraspOutcome],
        {
            RT.success: judged.held,
            RT.placed: judged.placed,
            RT.hasReason: reason(judged.reason),
            RT.placeReason: reason(judged.place_reason) if judged.place_reason else None,
            RT.hasFeedback: feedback,
        },
    )
    triples.node(
        feedback,
        [RT.PhysicsFeedback],
        {
            RT.verdict: judged.held,
            RT.preset: report.preset,
            RT.liftHeight: report.lifted_m,
            RT.slipDistance: report.slip,
            RT.linksTouching: report.links_touching,
            RT.contactForce: report.contact_force,
            RT.jawGap: report.jaw_gap,
            RT.holdTime: report.hold_s,
            RT.placeOffset: report.place_offset,
        },
    )
    for comment in judged.comments:
        triples.add(feedback, RT.comment, comment)


def state_verdict(
    context: Context,
    triples: Triples,
    outcome: NamedNode,
    verdict: Verdict,
    votes: tuple[int, int],
) -> NamedNode:
    """Add a person's verdict on an outcome; the majority outweighs the robot's report.

    Parameters
    ----------
    votes
        Numbers of people, this one included, who judge that it held and that it did not.
    """
    person = context.kb.graphs.agent_iri(verdict.by, "teacher")
    triples.node(person, [RT.Human], {RT.name: verdict.by})
    feedback = context.names.unique("feedback")
    triples.add(outcome, RT.hasFeedback, feedback)
    return triples.node(
        feedback,
        [RT.HumanFeedback],
        {
            RT.verdict: verdict.held,
            RT.saidReason: reason(verdict.reason) if verdict.reason else None,
            RT.atTime: stamp(verdict.time),
            RT.comment: verdict.comment or None,
            RT.heldVotes: votes[0],
            RT.lostVotes: votes[1],
            PROV.wasAttributedTo: person,
        },
    )


def _state_motion(context: Context, triples: Triples, attempt: Attempt) -> None:
    reported_motion = attempt.outcome.report.motion
    if reported_motion is None:
        return
    motion = Motion.of_rows(
        reported_motion.joints,
        reported_motion.times,
        reported_motion.positions,
        reported_motion.commands,
        "outcome.motion",
    )
    if attempt.place is not None:
        # With the recording, because a robot keeps only its latest estimates of an object.
        motion = motion.of_object(*attempt.place)
    blob = context.kb.blobs.put(motion.to_bytes(), MEDIA_TYPE)
    node = iri(f"{attempt.attempt.value}/motion")
    triples.node(
        node,
        [RT.JointTrajectory],
        {RT.hasBlob: triples.blob(blob), PROV.wasGeneratedBy: attempt.attempt},
    )
    # With the recording, because a robot may be registered with another body later on.
    for quad in context.kb.match(attempt.gripper.robot, RT.hasRobotModel):
        triples.add(node, RT.ofRobotModel, quad.object)


def _state_pictures(context: Context, triples: Triples, attempt: Attempt) -> None:
    for k, picture in enumerate(attempt.outcome.report.images):
        media_type, width, height = check_picture(picture.data, f"outcome.images[{k}].data")
        triples.node(
            iri(f"{attempt.attempt.value}/image/{k + 1}"),
            [RT.ColorImage],
            {
                RT.name: picture.phase,
                RT.hasBlob: triples.blob(context.kb.blobs.put(picture.data, media_type)),
                RT.widthPx: width,
                RT.heightPx: height,
                RT.encoding: "rgb8",
                PROV.wasGeneratedBy: attempt.attempt,
            },
        )
