"""Planned grasps: computed on an object's shape and stored like any other grasp."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from grasp.spatial.candidate import contacts_of
from grasp.spatial.frames import tilt
from rtask.engine.grippers import jaws_modelled, with_friction
from rtask.engine.memory.promises import SCORES, grown_promises
from rtask.engine.memory.question import Question
from rtask.engine.memory.recall import recall
from rtask.engine.operations.grasps import RecalledGrasp, as_messages
from rtask.engine.operations.operation import operation
from rtask.engine.perception.placement import MAX_TILT
from rtask.engine.records.attempts import find_grasp, state_grasp
from rtask.engine.records.objects import state_frame, stored_mass
from rtask.engine.records.received import Received, in_object
from rtask.engine.records.shapes import object_shape
from rtask.engine.triples import Triples
from rtask.errors import UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Number, Probability, Text, Unit, Whole

if TYPE_CHECKING:
    from grasp.spatial.candidate import Contacts, GraspCandidate
    from grasp.spatial.gripper import EndEffector
    from grasp.spatial.scoring.confidence import PoseNoise
    from rtask.engine.context import Context

__all__ = [
    "PlanInSpace",
    "PlannedGrasp",
    "PlannedGrasps",
    "PlannedSpatialGrasp",
    "as_planned",
    "plan_in_space",
    "store_planned",
    "store_planned_in_space",
]

_PLANNER = "planner"
_UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
_TRIES = 1500


class PlanInSpace(Message):
    """A request to plan grasps in space of a known object."""

    object: Text
    """IRI, objectId or name of the object"""
    gripper_id: Text | None = None
    """name or IRI of the end effector; default: the robot's only one"""
    mass: Annotated[Number, Unit("kg"), Ge(0.001), Le(1000)] | None = None
    """mass of the object to lift; default: as stored"""
    friction: Annotated[Number, Ge(0.01), Le(2)] | None = None
    """coefficient between pads or lip and object; default: that of the gripper"""
    position_std: Annotated[Number, Unit("m"), Ge(0), Le(0.1)] = 0.004
    """standard deviation of the object's position"""
    rotation_std: Annotated[Number, Unit("rad"), Ge(0), Le(1)] = 0.1
    """standard deviation of its rotation"""
    samples: Annotated[Whole, Ge(1), Le(1000)] = 100
    """number of perturbed poses of each grasp"""
    min_confidence: Probability = 0.3
    """c_G; grasps below it are not stored"""
    max_grasps: Annotated[Whole, Ge(1), Le(50)] = 10
    """maximum number to store"""
    seed: Annotated[Whole, Ge(0)] = 0
    """seed of the random numbers"""
    surface: Flag = False
    """plan on the reconstructed surface, if a current one is good enough, and not on the cloud"""


class PlannedGrasps(Answer):
    """The planned grasps, best first, or the reason why there are none."""

    object: str
    shape: str
    reason: str
    advice: str
    commit: str
    tried: dict[str, int]
    grasps: list[RecalledGrasp]
    grasps_left_out: int
    """how many more are as sure as min_confidence demands, and are not stored; max_grasps asks for
    them"""


Planned = TypeVar("Planned")


@dataclass(frozen=True)
class PlannedGrasp:
    """A planned grasp from above, in the object's frame.

    Parameters
    ----------
    x, y, z, theta
        Point midway between the jaws and closing direction, m and rad.
    width, opening
        Between the jaws, closed and before, m.
    quality
        Lower bound on the probability of force closure, over ``samples`` perturbations.
    vertex_sigma
        Standard deviation of the outline's vertices that was assumed, m.
    """

    x: float
    y: float
    z: float
    theta: float
    width: float
    opening: float
    quality: float
    samples: int
    vertex_sigma: float | None = None


@dataclass(frozen=True)
class PlannedSpatialGrasp:
    """A planned grasp in space, in the object's frame.

    Parameters
    ----------
    object_from_gripper : (4, 4)
        Of the tool centre point: z = approach, x = closing direction.
    width, opening
        Between the jaws, closed and before, m.
    confidence, lower_95
        s_G over ``samples`` poses off by ``position_sigma`` (m) and ``orientation_sigma`` (rad).
    epsilon
        Of Ferrari and Canny.
    contacts
        Of a cup or of three fingers, in the object's frame; None for jaws.
    quality
        Chance to hold, where it says more than the confidence in closing; None = the confidence.
    scores
        That promises rest on, by name (:data:`rtask.engine.memory.promises.SCORES`); none of a
        grasp that was planned on a cloud.
    """

    object_from_gripper: NDArray[np.float64]
    width: float
    opening: float
    confidence: float
    lower_95: float
    epsilon: float
    samples: int
    position_sigma: float
    orientation_sigma: float
    contacts: Contacts | None = None
    quality: float | None = None
    scores: Mapping[str, float] = field(default_factory=dict)


@operation("write", "writes", "plan grasps in space of a known object and store them")
def plan_in_space(context: Context, request: PlanInSpace, access: Access) -> PlannedGrasps:
    """Plan grasps in space on the best stored shape of an object, store them and return them.

    If no grasp can hold it, ``reason`` says why, and nothing is stored.
    """
    from grasp.spatial.grasp_plan import SpatialOptions
    from grasp.spatial.scoring.confidence import PoseNoise

    registered = context.grippers.find(request.gripper_id, access)
    hand = jaws_modelled(registered.gripper)
    if request.friction is not None:
        hand = with_friction(hand, request.friction)
    shape = object_shape(context, request.object, request.surface)
    noise = PoseNoise(request.position_std, request.rotation_std)
    candidates = shape.plan(
        hand,
        SpatialOptions(
            noise=noise, samples=request.samples, tries=_TRIES, seed=request.seed,
            mass=request.mass or stored_mass(context, shape.object_iri),
            promises=grown_promises(context, hand, [registered.iri]),
        ),
    )  # fmt: skip
    sure = [c for c in candidates if c.scores["confidence"] >= request.min_confidence]
    reason = candidates.reason
    if candidates and not sure:
        best = max(c.scores["confidence"] for c in candidates)
        reason = f"the best confidence is {best:.2f} < {request.min_confidence:g}"
    stored: dict[str, Any] = {"grasps": [], "commit": ""}
    if sure:
        planned = as_planned(sure[: request.max_grasps], noise, request.samples, hand)
        stored = store_planned_in_space(
            context, shape.object_iri, planned, hand.gripper_type, access, shape.sources
        )
    memory = recall(context.kb, Question(objects=(shape.object_iri,), in_space=True))
    stored_grasps = {grasp.grasp: grasp for grasp in memory.of(shape.object_iri)}
    return PlannedGrasps(
        object=shape.object_iri,
        shape=shape.kind,
        reason=reason,
        advice=candidates.advice,
        commit=stored["commit"],
        tried=dict(candidates.counts),
        grasps=as_messages(
            context, [stored_grasps[name] for name in dict.fromkeys(stored["grasps"])], registered
        ),
        grasps_left_out=max(len(sure) - request.max_grasps, 0),
    )


def as_planned(
    candidates: Sequence[GraspCandidate], noise: PoseNoise, samples: int, hand: EndEffector
) -> list[PlannedSpatialGrasp]:
    """Return candidates of a hand with confidences, in an object's frame, as they are stored."""
    return [
        PlannedSpatialGrasp(
            c.frame_from_gripper, c.width, c.width if c.opening is None else c.opening,
            c.scores["confidence"], c.scores["lower_95"], c.scores.get("epsilon", 0.0),
            samples, noise.position_std, noise.rotation_std, contacts_of(c, hand), c.score,
            {name: c.scores[name] for name in SCORES if "carry" in c.scores and name in c.scores},
        )
        for c in candidates
    ]  # fmt: skip


def store_planned(
    context: Context,
    object_iri: str,
    grasps: Sequence[PlannedGrasp],
    gripper_type: str,
    access: Access | None = None,
) -> dict[str, Any]:
    """Store planned grasps of an object with their evaluations.

    Returns
    -------
    ``object``, ``grasps`` (IRIs in the given order), ``commit``.
    """

    def as_received(planned: PlannedGrasp) -> Received:
        return Received(
            in_object=(planned.x, planned.y, planned.z, planned.theta),
            width=planned.width,
            opening=planned.opening,
            quality=planned.quality,
        )

    def evaluation(planned: PlannedGrasp) -> dict[NamedNode, Any]:
        return {
            RT.graspConfidence: planned.quality,
            RT.forceClosureLowerBound: planned.quality,
            RT.sampleCount: planned.samples,
            RT.vertexSigma: planned.vertex_sigma,
        }

    return _store(context, object_iri, grasps, gripper_type, as_received, evaluation, access)


def store_planned_in_space(
    context: Context,
    object_iri: str,
    grasps: Sequence[PlannedSpatialGrasp],
    gripper_type: str,
    access: Access | None = None,
    derived_from: Sequence[str] = (),
) -> dict[str, Any]:
    """Store grasps in space of an object with their evaluations.

    Grasps of jaws within 20 degrees of the vertical are stored as planar grasps, the others with
    their full pose, and with their contacts if they are of a cup or of three fingers.

    Parameters
    ----------
    derived_from
        IRIs of the mesh, model or views that they were planned on.

    Returns
    -------
    ``object``, ``grasps`` (IRIs in the given order), ``commit``.
    """

    def as_received(planned: PlannedSpatialGrasp) -> Received:
        at, orientation = in_object(planned.object_from_gripper)
        contacts = planned.contacts
        is_planar = tilt(planned.object_from_gripper @ _UPSIDE_DOWN) < MAX_TILT
        if contacts is not None:
            is_planar = False
            contacts = contacts.within(planned.object_from_gripper)
        return Received(
            in_object=at,
            orientation=None if is_planar else orientation,
            width=planned.width,
            opening=planned.opening,
            quality=planned.confidence if planned.quality is None else planned.quality,
            contacts=contacts,
        )

    def evaluation(planned: PlannedSpatialGrasp) -> dict[NamedNode, Any]:
        return {
            RT.graspConfidence: planned.confidence,
            RT.confidenceLower95: planned.lower_95,
            RT.epsilonQuality: planned.epsilon,
            RT.sampleCount: planned.samples,
            RT.positionSigma: planned.position_sigma,
            RT.orientationSigma: planned.orientation_sigma,
            **{SCORES[name]: score for name, score in planned.scores.items()},
        }

    return _store(
        context, object_iri, grasps, gripper_type, as_received, evaluation, access, derived_from
    )


def _store(
    context: Context,
    object_iri: str,
    grasps: Sequence[Planned],
    gripper_type: str,
    as_received: Callable[[Planned], Received],
    evaluation: Callable[[Planned], dict[NamedNode, Any]],
    access: Access | None,
    derived_from: Sequence[str] = (),
) -> dict[str, Any]:
    """Commit grasps, each with its evaluation.

    A grasp that is already stored keeps the evaluation that is its prior.
    """
    if not grasps:
        raise UsageError("there are no grasps to store")
    target = iri(object_iri)
    named: list[NamedNode] = []
    with context.writing:
        triples = Triples()
        for planned in grasps:
            received = as_received(planned)
            node = find_grasp(context, target, gripper_type, received)
            if node is None:
                node = state_grasp(context, triples, target, gripper_type, received)
            named.append(node)
            if context.kb.match(node, RT.hasEvaluation):
                continue
            judged = iri(node.value + "/evaluation")
            triples.add(node, RT.hasEvaluation, judged)
            triples.node(judged, [RT.GraspEvaluation], evaluation(planned))
            for source in derived_from:
                triples.add(judged, PROV.wasDerivedFrom, iri(source))
        commit = ""
        if len(triples):
            state_frame(context, triples, target)
            author = context.author(access or Access(), _PLANNER)
            with context.kb.transaction(access=author, note="planned grasps") as tx:
                triples.write(tx)
            commit = context.commit_id(tx.commit)
    return {"object": object_iri, "grasps": [node.value for node in named], "commit": commit}
