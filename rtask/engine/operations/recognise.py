"""Recognition of an object and choice of a grasp (Gatto 2016, 3.2.4: recognition for grasping).

Decode, describe, match, query the graph once, propose, choose. If the caller may write, a
refusal is stored, and so is the pose of an object that is new to the robot or has moved; the robot
reports the outcome under the task that the answer names.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le, MaxLen
from numpy.typing import NDArray
from pydantic import Field

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import LOW_M
from grasp.spatial.frames import tilt
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.hand import ThreeFingerHand
from rtask.engine.context import SCOPES
from rtask.engine.decisions import MIN_EVIDENCE, Decision, Offer, Option
from rtask.engine.memory.calibration import score_maps
from rtask.engine.memory.choice import Scene, choose, options, unaided
from rtask.engine.memory.question import question_for
from rtask.engine.memory.recall import recall
from rtask.engine.memory.thresholds import Assessment, Thresholds, asked, decide, grasps_above
from rtask.engine.operations.operation import operation
from rtask.engine.operations.recognition_answer import (
    Recognition,
    Situation,
    fields_of,
    identity_of,
)
from rtask.engine.perception.identity import recognise, settle
from rtask.engine.perception.observation import Looks, observe_all
from rtask.engine.perception.placement import MAX_TILT, Placement, footprint_of
from rtask.engine.perception.poses import ObjectPose, last_heading, locate, note_heading
from rtask.engine.records.asked import DecisionRecord, PlaceRecord, RefusalRecord, keep
from rtask.engine.records.clock import clocked
from rtask.engine.records.objects import no_object, stored_mass
from rtask.engine.records.places import located
from rtask.engine.records.refusals import Refusal, refusal_iri
from rtask.engine.remembered import Memory, RememberedObject
from rtask.engine.terms import find_task
from rtask.wire.message import Message
from rtask.wire.types import Flag, Iri, Points, Probability, Text, Texts, Whole

if TYPE_CHECKING:
    from features.recognition.recogniser import Recognition as Matches
    from rtask.engine.context import Context
    from rtask.engine.grippers import StoredGripper
    from rtask.kb.commit.access import Access

__all__ = ["Clock", "RecogniseForGrasp", "recognise_for_grasp"]

_MAX_CANDIDATES = 50
_TRIES, _SAMPLES = 1500, 100
_MAX_MATCHES = 10
_REFUSED_BY = ("too_low", "confidence", "threshold", "text", "advice")
_STEPS = (
    "decode_s", "extraction_s", "matching_s", "query_s", "pose_s", "generation_s", "choice_s",
)  # fmt: skip


class GraspPurpose(Message):
    """Purpose of an observation; a base class so that these fields come first."""

    task: Text = "pick"
    """purpose of the grasp: pick, place, push"""
    gripper_id: Text
    """name or IRI of the end effector"""


class RecogniseForGrasp(Looks, GraspPurpose):
    """A request to recognise an object and to choose a grasp."""

    object: Iri | None = None
    """IRI of an object that the robot has tracked; default: recognised"""
    min_confidence: Probability | None = None
    """least confidence to count as recognised; default: by the policy"""
    max_grasps: Annotated[Whole, Ge(1), Le(50)] = 10
    """maximum number of grasps"""
    propose: Flag = False
    """propose grasps if none is known"""
    in_space: Flag = False
    """include known grasps from any direction, for arms that can reach"""
    exclude: Annotated[Texts, MaxLen(1000)] = Field(default_factory=list)
    """ids of grasps not to offer again"""
    seed: Annotated[Whole, Ge(0)] = 0
    """seed of the choice"""
    neighbours: Points | None = None
    """points of neighbouring objects in frame_id; default: none"""
    decide: Flag = False
    """answer with a grasp, or with the confidence that is too low"""
    min_identity: Probability | None = None
    """c_I, least confidence in the identity; default: decide says"""
    min_pose: Probability | None = None
    """c_T, least confidence in the pose; default: decide says"""
    min_grasp: Probability | None = None
    """c_G, least confidence in the grasp; default: decide says"""
    preset: Literal["faithful", "fast", "real"] | None = None
    """kind of physics that the robot is in: faithful, fast or real; default: not known"""
    cautious: Flag = False
    """compare c_G with the lower end of the interval90 of a grasp, not with its mean"""
    unknown: Literal["refuse", "if_new", "grasp"] = "refuse"
    """in a decision, whether to grasp what is not recognised: refuse; if_new, unless another view
    may recognise it; grasp"""


class Clock:
    """Measures the steps of a call.

    >>> clock = Clock("query_s")
    >>> clock.lap("query_s")
    >>> clock.times["query_s"] > 0
    True
    """

    def __init__(self, *names: str) -> None:
        self.times: dict[str, float] = dict.fromkeys(names, 0.0)
        self._start = self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Charge the time since the last lap to a step."""
        now = time.perf_counter()
        self.times[name] = self.times.get(name, 0.0) + now - self._last
        self._last = now

    def total(self) -> float:
        """Return the time since the start, s."""
        return time.perf_counter() - self._start


@operation("read", "records", "name an object and the grasps to try, in order")
def recognise_for_grasp(
    context: Context, request: RecogniseForGrasp, access: Access
) -> Recognition:
    """Return the object and its grasps in the learner's order, with reasons."""
    clock = Clock(*_STEPS)
    find_task(request.task)
    gripper = context.grippers.find(request.gripper_id, access)
    thresholds = asked(context.policy, request)
    seen, looks = observe_all(context, request)
    clock.lap("decode_s")
    clock.times.update(seen.seconds)
    least = request.min_confidence if thresholds is None else thresholds.identity
    recognition = recognise(
        context.views.recogniser, seen, context.policy, _MAX_MATCHES, least,
        context.views.embeddings, looks, _min_fused(request, thresholds), context.words,
    )  # fmt: skip
    clock.lap("matching_s")
    question = question_for(context.policy, seen, recognition, request.object, gripper)
    doubts = context.honesty.doubts(question.robot)
    is_jaws = gripper.gripper.contact_kind == "jaws"
    question = replace(question, in_space=request.in_space or not is_jaws, doubts=doubts)
    memory = recall(context.kb, question)
    recognition = settle(recognition, memory, seen, context.policy)
    clock.lap("query_s")
    recognised = _recognised_object(context, request.object, recognition, memory)
    heading = last_heading(context, gripper.robot, request.object, seen)
    placement, pose = locate(context.models, seen, recognition, recognised, memory, heading)
    if recognised is not None:
        note_heading(context, gripper.robot, recognised.iri, seen, placement)
    clock.lap("pose_s")
    situation = Situation(seen, recognition, memory, recognised, placement, gripper, pose)
    chosen, alone = _choose(context, situation, request, clock)
    situation = replace(situation, chosen=chosen, alone=alone)
    situation, decision = _decided(situation, thresholds)
    recognised = situation.recognised
    task = context.names.task(context.author(access, gripper.robot_name).agent).value
    fields = fields_of(situation, request.max_grasps)
    if decision is not None:
        decision = {**decision, "refusal": _refused(context, situation, decision, task, access)}
    exemplar = _remember_place(context, situation, request, access)
    clock.times["total_s"] = clock.total()
    times = {name: round(seconds, 6) for name, seconds in clock.times.items()}
    offers = {
        option.id: Offer.of(option, option.choice)
        for option in situation.chosen
        if option.choice is not None
    }
    made = Decision(
        recognised.iri if recognised else "", recognition, offers, dict(clock.times),
        request.seed, exemplar=exemplar,
    )  # fmt: skip
    _remember_decision(context, task, made, gripper, access)
    return Recognition(**fields, thing=exemplar, task_id=task, decision=decision, times=times)


def _min_fused(request: RecogniseForGrasp, thresholds: Thresholds | None) -> float | None:
    """Return the confidence required of looks that do not agree, or None if c_I is required.

    The stricter default of the fusion stays in force unless the request names c_I.
    """
    is_named = request.min_identity is not None or request.min_confidence is not None
    if thresholds is None or is_named:
        return None
    from features.recognition.fusion import FusionParams

    return max(thresholds.identity, FusionParams().min_confidence)


def _recognised_object(
    context: Context, tracked: str | None, recognition: Matches, memory: Memory
) -> RememberedObject | None:
    """Return the object in question: the tracked one, else the recognised one."""
    if tracked:
        recognised = memory.objects.get(tracked)
        if recognised is None:
            raise no_object(context, tracked)
        return recognised
    return memory.objects.get(recognition.matches[0].object_iri) if recognition.accepted else None


def _choose(
    context: Context, situation: Situation, request: RecogniseForGrasp, clock: Clock
) -> tuple[list[Option], Option | None]:
    """Return the options in order, and the first one if the graph knew of no outcomes."""
    seen, placement = situation.observation, situation.placement
    if placement is None or seen.shape is None:
        return [], None
    neighbours = request.neighbours
    if neighbours is not None and len(neighbours):
        neighbours = neighbours - np.array([0.0, 0.0, seen.shape.support_height])
    scene = Scene(
        footprint_of(seen.shape, placement), placement.frame_from_object, situation.gripper.gripper,
        neighbours, request.seed, _pose_in_space(placement, situation.pose),
        context.grippers.forces(), request.preset == "fast",
        planned=_contact_plan(context, situation, request),
        max_tilt=np.pi if request.in_space else MAX_TILT,
    )  # fmt: skip
    object_iri = situation.recognised.iri if situation.recognised else None
    candidates = options(scene, situation.memory, object_iri, request.propose, _MAX_CANDIDATES)
    excluded = set(request.exclude)
    candidates = [option for option in candidates if option.id not in excluded]
    clock.lap("generation_s")
    confidence = {m.object_iri: float(m.confidence) for m in situation.recognition.matches}
    if request.object:
        confidence[request.object] = 1.0
    maps = score_maps(context, situation.gripper)
    population = context.population.now() if context.policy.causes else None
    chosen = choose(
        candidates, scene, situation.memory, confidence, context.policy, maps=maps,
        population=population,
    )  # fmt: skip
    alone = None
    if any(max(choice.explanation["graph"]) >= MIN_EVIDENCE for choice in chosen):
        alone = unaided(candidates, scene, situation.memory, context.policy, maps)
        same = next((o for o in chosen if alone is not None and o.id == alone.id), None)
        if alone is not None and same is not None:
            alone = replace(alone, cause=same.cause)
    clock.lap("choice_s")
    return chosen, alone


def _contact_plan(
    context: Context, situation: Situation, request: RecogniseForGrasp
) -> tuple[GraspCandidate, ...]:
    """Return new grasps of a cup or of three fingers on what is seen, if they are wanted."""
    from grasp.spatial.collision import Support
    from grasp.spatial.contact_plan import plan_contacts_on_cloud
    from grasp.spatial.grasp_plan import SpatialOptions

    hand, seen = situation.gripper.gripper, situation.observation
    if isinstance(hand, ParallelGripper) or not request.propose or seen.shape is None:
        return ()
    assert isinstance(hand, SuctionCup | ThreeFingerHand)
    recognised = situation.recognised
    options = SpatialOptions(
        mass=stored_mass(context, recognised.iri) if recognised else None, seed=request.seed,
        tries=_TRIES, samples=_SAMPLES, most=_MAX_CANDIDATES,
    )  # fmt: skip
    return plan_contacts_on_cloud(
        seen.points, hand, Support(float(seen.shape.support_height)),
        seen.frame_from_camera[None, :3, 3], options, request.neighbours,
    ).candidates  # fmt: skip


def _pose_in_space(placement: Placement, pose: ObjectPose | None) -> NDArray[np.float64] | None:
    """Return the pose (4, 4) for grasps in space, or None if it is unknown.

    The measured sides are more exact while the object stands upright; otherwise an accepted pose
    is used.
    """
    if pose is not None and pose.accepted and tilt(pose.frame_from_object) >= MAX_TILT:
        return pose.frame_from_object
    return placement.frame_from_object if placement.is_verified else None


def _decided(
    situation: Situation, thresholds: Thresholds | None
) -> tuple[Situation, dict[str, Any] | None]:
    """Return the situation above the thresholds, and the decision if one was requested."""
    if thresholds is None:
        return situation, None
    decision = decide(thresholds, _assessment(situation), identity_of(situation))
    chosen = grasps_above(situation.chosen, thresholds)
    if decision["too_low"] == "identity":
        return replace(situation, recognised=None, chosen=()), decision
    return replace(situation, chosen=() if decision["too_low"] else chosen), decision


def _refused(
    context: Context, situation: Situation, decision: Mapping[str, Any], task: str, access: Access
) -> str:
    """Store a decision against a grasp; return its IRI, or "" for a grasp or a mere reader."""
    if not decision["too_low"] or "write" not in SCOPES[access.role]:
        return ""
    recognised, matches = situation.recognised, situation.recognition.matches
    object_iri = recognised.iri if recognised else matches[0].object_iri if matches else ""
    gripper, at = situation.gripper, dt.datetime.now(dt.UTC)
    author = context.author(access, gripper.robot_name)
    refusal = Refusal(task, gripper.robot, gripper.iri, object_iri, decision, at)
    stated = {name: decision[name] for name in _REFUSED_BY}
    # A copy stores nothing, and learns views under that lock, for which no robot should wait.
    with context.writing if context.pass_on is None else contextlib.nullcontext():
        node = refusal_iri(context, refusal, author).value
        record = RefusalRecord(
            node, task, gripper.robot.value, gripper.iri.value, object_iri, stated, at.isoformat()
        )
        keep(context, record, author)
    return node


def _remember_place(
    context: Context, situation: Situation, request: RecogniseForGrasp, access: Access
) -> str:
    """Store where a recognised object is if it is new there, and the caller may write.

    Returns
    -------
    The single thing, or "" if its place is not certain, or it is new to a caller that only reads.
    """
    seen, recognised, gripper = situation.observation, situation.recognised, situation.gripper
    if recognised is None:
        return ""
    place = located(
        seen, request.frame_id, situation.placement, situation.pose, identity_of(situation),
        recognised.is_round,
    )  # fmt: skip
    if place is None:
        return ""
    at, _ = clocked(seen.stamp_s, context.policy.clock_ahead_s)
    pose = tuple(float(number) for number in place.frame_from_object.ravel())
    author = context.author(access, gripper.robot_name)
    record = PlaceRecord(
        context.names.unique("pose-estimate").value, recognised.iri, gripper.robot.value,
        place.frame_id, pose, place.confidence, place.is_round, at.isoformat(),
    )  # fmt: skip
    exemplar, is_new = record.exemplar_in(context, author)
    if "write" not in SCOPES[access.role]:
        return "" if is_new else exemplar
    keep(context, replace(record, exemplar=exemplar), author)
    return exemplar


def _remember_decision(
    context: Context, task: str, decision: Decision, gripper: StoredGripper, access: Access
) -> None:
    """Remember a decision for the report of its outcome, also where that is stored."""
    asked_by = context.author(access, gripper.robot_name).agent or ""
    context.decisions.put(task, replace(decision, asked_by=asked_by))
    if context.pass_on is not None and "write" in SCOPES[access.role]:
        record = DecisionRecord(task, **decision.to_json())
        keep(context, record, context.author(access, gripper.robot_name))


def _assessment(situation: Situation) -> Assessment:
    return Assessment(
        situation.recognition,
        situation.memory,
        situation.recognised,
        None if situation.pose is None else situation.pose.estimate,
        situation.chosen,
        _lies_flat(situation),
    )


def _lies_flat(situation: Situation) -> bool:
    """Tell whether the thing is too wide for the hand from above and too low from the side."""
    shape, hand = situation.observation.shape, situation.gripper.gripper
    if shape is None:
        return False
    return shape.height <= LOW_M and not hand.fits(min(shape.length, shape.width))
