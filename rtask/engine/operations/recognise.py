"""Which object is this, and how is it taken? (Gatto 2016, 3.2.4: request recognition for grasping)

Decode, describe, match, ask the graph once, propose, choose. Nothing is written; the outcome is,
under the task that the answer names.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from grasp.messages import empty_grasp_message, grasp_message, spatial_grasp_message
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.frames import closing_turn, tilt
from rtask.engine.memory.choice import Option, Scene, choose, options
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import KnownObject, Memory, recall
from rtask.engine.memory.statistics import summary
from rtask.engine.memory.tasks import Decision
from rtask.engine.memory.thresholds import DECISION, Thresholds, asked, decide, grasps_above
from rtask.engine.operations.messages import Field
from rtask.engine.operations.robots import KnownGripper
from rtask.engine.operations.search import match_message, similar_objects
from rtask.engine.perception.identity import recognise, settle
from rtask.engine.perception.observation import Observation
from rtask.engine.perception.placement import MOST_TILT, Placement, footprint_of, place, posed
from rtask.engine.perception.poses import ObjectPose, find_pose, pose_fields
from rtask.engine.policy import Policy
from rtask.engine.records.objects import guess_class
from rtask.engine.terms import find_task
from rtask.errors import UnknownTermError
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import iri

if TYPE_CHECKING:
    from features.recognition.recogniser import Match, Recognition
    from rtask.engine.engine import Engine
    from rtask.kb.commit.access import Access

__all__ = ["RECOGNISE_FOR_GRASP", "SIGHT", "Clock", "locate", "question_for", "recognise_for_grasp"]

_MOST_CANDIDATES = 50
_MOST_MATCHES = 10
_STEPS = (
    "decode_s", "extraction_s", "matching_s", "query_s", "pose_s", "generation_s", "choice_s",
)  # fmt: skip

SIGHT = (
    Field("data", "bytes", "base64 of one object's compressed cloud", required=True,
          aliases=("new_point_cloud",)),
    Field("image", "bytes", "base64 PNG or JPEG of the object"),
    Field("sensor_pose", "pose", "pose of the camera in frame_id; default: identity"),
    Field("frame_id", "string", "frame of the robot with z up, e.g. base_footprint"),
    Field("support_height", "number", "height of the table in frame_id, m; default: lowest point"),
    Field("stamp", "time", "when the cloud was taken"),
)  # fmt: skip
"""Fields of one look at one object."""

RECOGNISE_FOR_GRASP = (
    Field("task", "string", "what it is for: pick, place, push", default="pick"),
    Field("gripper_id", "string", "name or IRI of the end effector", required=True),
    *SIGHT,
    Field("object", "string", "IRI of the object, when the robot followed it and knows"),
    Field("min_confidence", "number", "for the object to count as recognised", low=0.0, high=1.0),
    Field("max_grasps", "integer", "length of the answer's list", default=10, low=1, high=50),
    Field("propose", "boolean", "propose grasps where none is known", default=False),
    Field(
        "in_space",
        "boolean",
        "offer known grasps from any direction too, for arms that can",
        default=False,
    ),
    Field("exclude", "strings", "ids of grasps not to offer again", default=[], high=1000),
    Field("seed", "integer", "of the choice", default=0, low=0),
    Field("neighbours", "points", "points of what stands around, m, frame_id"),
    *DECISION,
)


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


@dataclass(frozen=True)
class Situation:
    """What is known when the choice is made."""

    observation: Observation
    recognition: Recognition
    memory: Memory
    known: KnownObject | None
    placement: Placement | None
    gripper: KnownGripper
    pose: ObjectPose | None = None
    chosen: Sequence[Option] = ()


def recognise_for_grasp(engine: Engine, request: dict[str, Any], access: Access) -> dict[str, Any]:
    """Answer with the object, its grasps in the learner's order, and why."""
    clock = Clock(*_STEPS)
    find_task(request["task"])
    gripper = engine.grippers.find(request["gripper_id"], access.agent)
    thresholds = asked(engine.policy, request)
    seen = engine.observations.observe(request)
    clock.lap("decode_s")
    clock.times.update(seen.seconds)
    least = request["min_confidence"] if thresholds is None else thresholds.identity
    recognition = recognise(engine.recogniser, seen, engine.policy, _MOST_MATCHES, least)
    clock.lap("matching_s")
    question = question_for(engine, seen, recognition, request["object"], gripper)
    question = replace(question, in_space=request["in_space"])
    memory = recall(engine.kb, question)
    recognition = settle(recognition, memory, seen, engine.policy)
    clock.lap("query_s")
    known = _known(request["object"], recognition, memory)
    placement, pose = locate(engine, seen, recognition, known, memory)
    clock.lap("pose_s")
    situation = Situation(seen, recognition, memory, known, placement, gripper, pose)
    chosen = _choose(engine, situation, request, clock)
    situation = replace(situation, chosen=chosen)
    situation, decision = _decided(situation, thresholds)
    known = situation.known
    task = engine.names.unique("task").value
    answer = {**_answer(engine, situation, request["max_grasps"], task), "decision": decision}
    clock.times["total_s"] = clock.total()
    answer["times"] = {name: round(seconds, 6) for name, seconds in clock.times.items()}
    engine.decisions.put(
        task,
        Decision(
            known.iri if known else "",
            recognition,
            {option.id: option for option in situation.chosen},
            dict(clock.times),
            request["seed"],
        ),
    )
    return answer


def question_for(
    engine: Engine,
    seen: Observation,
    recognition: Recognition,
    tracked: str | None,
    gripper: KnownGripper | None,
    only: tuple[str, ...] = (),
) -> Question:
    """Return what to ask the graph about a look: the matches, the kind, the robot's own tries."""
    objects = {match.object_iri for match in recognition.matches}
    kinds: set[str] = set()
    if recognition.accepted and not tracked:
        kinds.add(recognition.matches[0].class_iri)
    guess = guess_class(seen)
    if guess is not None:
        kinds.add(guess[0].value)
    kinds -= {RT.ManipulableObject.value, ""}
    shape, policy = seen.shape, engine.policy
    return Question(
        objects=tuple(sorted(objects | ({iri(tracked).value} if tracked else set()))),
        classes=tuple(sorted(kinds)) if gripper is not None else (),
        size=None if shape is None
        else (float(shape.length), float(shape.width), float(shape.height)),
        size_tolerance=policy.size_tolerance,
        tracked=tracked,
        robot=None if gripper is None else gripper.robot.value,
        views=tuple(sorted({m.view_iri for m in recognition.matches if m.view_iri})),
        only=only,
        doubtful=_doubtful(recognition, tracked, policy),
    )  # fmt: skip


def _doubtful(recognition: Recognition, tracked: str | None, policy: Policy) -> tuple[str, ...]:
    """Return the matches that say less as the object itself than as another of its kind.

    Both together never count more than an outcome of the object itself.
    """
    most = 1 - policy.same_class
    others = recognition.matches[1:] if recognition.accepted else recognition.matches
    names = (m.object_iri for m in others if m.confidence < most)
    return tuple(sorted(name for name in names if name != tracked))


def _known(tracked: str | None, recognition: Recognition, memory: Memory) -> KnownObject | None:
    """Return the object in question: the one the robot followed, else the one recognised."""
    if tracked:
        known = memory.objects.get(tracked)
        if known is None:
            raise UnknownTermError(f"object: the graph knows no object {tracked}")
        return known
    return memory.objects.get(recognition.matches[0].object_iri) if recognition.accepted else None


def locate(
    engine: Engine,
    seen: Observation,
    recognition: Recognition,
    known: KnownObject | None,
    memory: Memory,
) -> tuple[Placement | None, ObjectPose | None]:
    """Return where the object stands, and its pose where something stored can tell.

    The frame comes from an accepted pose; else from a matching view; else from the measured sides.
    """
    if known is None:
        return place(seen), None
    match: Match | None = next((m for m in recognition.matches if m.object_iri == known.iri), None)
    query_from_view, viewpoint = None, None
    if match is not None and match.query_from_view is not None:
        query_from_view = np.asarray(match.query_from_view, dtype=np.float64)
        viewpoint = memory.viewpoints.get(match.view_iri)
    placement = place(seen, known.is_round, query_from_view, viewpoint)
    pose = find_pose(engine.models, seen, known, match, memory, placement)
    return posed(placement, pose), pose


def _choose(
    engine: Engine, situation: Situation, request: dict[str, Any], clock: Clock
) -> list[Option]:
    seen, placement = situation.observation, situation.placement
    if placement is None or seen.shape is None:
        return []
    neighbours = request["neighbours"]
    if neighbours is not None and len(neighbours):
        neighbours = neighbours - np.array([0.0, 0.0, seen.shape.support_height])
    scene = Scene(
        footprint_of(seen.shape, placement), placement, situation.gripper.gripper,
        neighbours, request["seed"], _pose_in_space(placement, situation.pose),
    )  # fmt: skip
    object_iri = situation.known.iri if situation.known else None
    found = options(scene, situation.memory, object_iri, request["propose"], _MOST_CANDIDATES)
    excluded = set(request["exclude"])
    found = [option for option in found if option.id not in excluded]
    clock.lap("generation_s")
    confidence = {m.object_iri: float(m.confidence) for m in situation.recognition.matches}
    if request["object"]:
        confidence[request["object"]] = 1.0
    chosen = choose(found, scene, situation.memory, confidence, engine.policy)
    clock.lap("choice_s")
    return chosen


def _pose_in_space(placement: Placement, pose: ObjectPose | None) -> NDArray[np.float64] | None:
    """Return the pose (4, 4) in which grasps in space hold, None where it is not known.

    The measured sides are the more exact as long as the object stands; an accepted pose tells how
    it lies.
    """
    if pose is not None and pose.accepted and tilt(pose.frame_from_object) >= MOST_TILT:
        return pose.frame_from_object
    return placement.frame_from_object if placement.is_verified else None


def _decided(
    situation: Situation, thresholds: Thresholds | None
) -> tuple[Situation, dict[str, Any] | None]:
    """Return what is left of a situation by the thresholds, and the decision, if one was asked."""
    if thresholds is None:
        return situation, None
    decision = decide(thresholds, situation, _identity(situation))
    chosen = grasps_above(situation.chosen, thresholds.grasp)
    if decision["too_low"] == "identity":
        return replace(situation, known=None, chosen=()), decision
    return replace(situation, chosen=() if decision["too_low"] else chosen), decision


def _identity(situation: Situation) -> float:
    """Return how sure it is that this is the object: of the best match where none was accepted."""
    known, matches = situation.known, situation.recognition.matches
    if known is None:
        return float(matches[0].confidence) if matches else 0.0
    found = [m for m in matches if m.object_iri == known.iri]
    if not situation.recognition.accepted or not found:
        return 1.0
    return float(found[0].confidence)


def _answer(engine: Engine, situation: Situation, max_grasps: int, task: str) -> dict[str, Any]:
    seen, known = situation.observation, situation.known
    grasps = [_grasp(option, situation) for option in situation.chosen[:max_grasps]]
    first = situation.chosen[0] if situation.chosen else None
    if first is None:
        kind = "no_grasp" if known else "unknown"
    else:
        kind = "grasp" if first.remembered is not None else "candidate"
    top = grasps[0] if grasps else empty_grasp_message(seen.frame_id)
    shape = seen.shape
    return {
        "task_response": kind,
        "task_id": task,
        "object": known.iri if known else "",
        "class": known.short_id if known else "",
        "class_iri": known.class_iri if known else "",
        "label": known.label if known else "",
        "confidence": 0.0 if known is None else _identity(situation),
        "statistics": top.get("statistics") or summary(0, 0),
        **{name: top[name] for name in empty_grasp_message(seen.frame_id)},
        "grasps": grasps,
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
            "matches": [
                match_message(match, situation.memory) for match in situation.recognition.matches
            ],
            **pose_fields(situation.pose, seen),
        },
        "similar_objects": similar_objects(seen, situation.recognition, situation.memory),
    }  # fmt: skip


def _grasp(option: Option, situation: Situation) -> dict[str, Any]:
    """Return one entry of ``grasps``."""
    assert option.choice is not None
    assert situation.observation.shape is not None
    grasp, choice, known = option.grasp, option.choice, option.remembered
    support = float(situation.observation.shape.support_height)
    frame_id = situation.observation.frame_id or "base"
    hand = situation.gripper.gripper
    if isinstance(grasp, GraspCandidate):
        kind, at = "spatial", (*grasp.centre.tolist(), closing_turn(grasp.frame_from_gripper))
        message = spatial_grasp_message(grasp, hand, frame_id)
    else:
        kind, at = "planar", (grasp.x, grasp.y, support + grasp.z, grasp.theta)
        message = grasp_message(grasp, hand, frame_id, support)
    in_object = dict(zip(("x", "y", "z", "theta"), option.in_object, strict=True))
    if option.quaternion is not None:
        in_object.update(zip(("qx", "qy", "qz", "qw"), option.quaternion, strict=True))
    return {
        **message,
        "id": option.id,
        "kind": kind,
        "source": "memory" if known is not None else "candidate",
        **dict(zip(("x", "y", "z", "theta"), at, strict=True)),
        "width": grasp.width,
        "opening": option.opening,
        "mean": choice.mean,
        "interval90": list(choice.interval90),
        "alpha": choice.alpha,
        "beta": choice.beta,
        "statistics": summary(known.successes, known.attempts) if known else summary(0, 0),
        "explanation": option.explanation,
        "in_object": in_object,
    }
