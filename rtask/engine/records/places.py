"""Places of objects: the poses at which robots saw them, and what holds them: a hand, a box.

A pose holds in a frame of one robot, and is compared with poses in that frame alone: the same name
of two robots' frames, such as ``base_link``, means two frames. An attempt that may have moved the
object ends every earlier estimate of its pose (``prov:invalidatedAtTime``), so that nothing is said
about its place until a robot sees it again.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import matrix_from_pose
from rtask.engine.observation import Observation
from rtask.engine.perception.placement import Placement
from rtask.engine.perception.poses import ObjectPose
from rtask.engine.policy import UNJUDGED
from rtask.engine.records.outcomes import Outcome
from rtask.engine.records.task_tree import is_place_of
from rtask.engine.triples import Triples, stamp
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import NamedNode, Value, iri, object_term, python_value

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.core import GraphCore

__all__ = [
    "Handled",
    "Located",
    "Sighting",
    "located",
    "may_have_moved",
    "may_have_touched",
    "state_frame_of",
    "state_moved",
    "state_seen",
]

MAX_ESTIMATES = 20
MOVED_M = 0.02
MOVED_RAD = float(np.deg2rad(15.0))

_POSITION = (RT.x, RT.y, RT.z)
_TURN = (RT.qx, RT.qy, RT.qz, RT.qw)
_AT_ANY_TIME = ("timed_out", "stopped_by_human", "hardware")


@dataclass(frozen=True, eq=False)
class Located:
    """Pose of an object in a named frame.

    Parameters
    ----------
    frame_from_object : (4, 4) float64, m
        Pose of the object's own frame.
    confidence
        s_T of Kehoe 2014, 4.3, for an accepted pose. Where the sides of an upright object were
        measured instead, the confidence in its identity.
    is_round
        A turn about the object's z axis is no motion.
    """

    frame_from_object: NDArray[np.float64]
    frame_id: str
    confidence: float
    is_round: bool


@dataclass(frozen=True)
class Sighting:
    """An object seen somewhere.

    Parameters
    ----------
    robot
        Robot to which the frame belongs.
    agent, graph
        Author, and the graph that it writes to.
    event
        Stored observation from which the pose was derived, if any.
    moved
        When an attempt that followed may have moved the object.
    estimate
        IRI of the estimate; None for a new one.
    exemplar
        IRI of the single thing that was seen; or empty.
    """

    object_iri: NamedNode
    located: Located
    robot: NamedNode
    agent: NamedNode
    graph: NamedNode
    time: dt.datetime
    event: NamedNode | None = None
    moved: dt.datetime | None = None
    estimate: NamedNode | None = None
    exemplar: str = ""


@dataclass(frozen=True)
class _Estimate:
    """A stored estimate; ``is_over`` once the object may have been moved.

    ``exemplar`` is empty in graphs older than single things.
    """

    iri: NamedNode
    pose: NamedNode
    frame: NamedNode
    time: dt.datetime
    frame_from_object: NDArray[np.float64]
    is_over: bool
    exemplar: str = ""

    def may_be_of(self, exemplar: str) -> bool:
        """Whether it is of this thing, as far as both are known."""
        return not exemplar or self.exemplar in ("", exemplar)


@dataclass(frozen=True)
class Handled:
    """The single thing that a robot handled, as far as it is known.

    Parameters
    ----------
    robot
        The robot that handled it.
    exemplar
        IRI of the thing; or empty.
    """

    robot: NamedNode
    exemplar: str = ""

    def voids(self, estimate: _Estimate) -> bool:
        """Whether an estimate no longer holds after the thing was handled."""
        if estimate.exemplar:
            return estimate.exemplar == self.exemplar
        return estimate.frame.value.startswith(f"{self.robot.value}/")


def located(
    seen: Observation,
    frame_id: str | None,
    placement: Placement | None,
    pose: ObjectPose | None,
    identity: float,
    is_round: bool,
) -> Located | None:
    """Return the pose of an observed object, or None if no pose or no frame is certain.

    Parameters
    ----------
    frame_id
        As the request names it.
    identity
        Confidence in the identity of the object, 0..1.
    """
    if not frame_id:
        return None
    if pose is not None and pose.accepted and (seen.is_posed or pose.source == "given"):
        return Located(pose.frame_from_object, frame_id, float(pose.confidence), is_round)
    if placement is None or not placement.is_verified or not seen.is_posed:
        return None
    return Located(placement.frame_from_object, frame_id, identity, placement.is_round)


def may_have_moved(outcome: Outcome) -> bool:
    """Tell whether an attempt with this outcome may have touched its object."""
    return may_have_touched(outcome.reason)


def may_have_touched(reason: str) -> bool:
    """Tell whether an attempt that ended for a reason, given by its code, may have touched it."""
    return reason not in UNJUDGED or reason in _AT_ANY_TIME


def state_frame_of(triples: Triples, robot: NamedNode, frame_id: str) -> NamedNode:
    """Add a frame of a robot by its name in tf, and return its IRI."""
    frame = NamedNode(f"{robot.value}/frame/{quote(frame_id, safe='')}")
    return triples.node(frame, [RT.Frame], {RT.frameId: frame_id})


def state_seen(
    context: Context, triples: Triples, sighting: Sighting
) -> list[tuple[NamedNode, NamedNode, Value]]:
    """Add an estimate of the pose, unless the last one in this frame still holds.

    It no longer holds if the thing is more than 2 cm or 15 degrees away from it, or may have been
    moved since. A robot keeps its last 20 estimates of an object.

    Returns
    -------
    list
        Statements to be withdrawn: the oldest estimates, and that the robot holds the object.
    """
    object_iri, place = sighting.object_iri, sighting.located
    frame = state_frame_of(Triples(), sighting.robot, place.frame_id)
    is_new = context.names.is_new(object_iri)
    stored = [] if is_new else _estimates(context.kb, object_iri, sighting.graph)
    same = (earlier for earlier in stored if earlier.may_be_of(sighting.exemplar))
    last = next((earlier for earlier in same if earlier.frame == frame), None)
    if last is not None and (
        sighting.time <= last.time or not (last.is_over or _has_moved(last, place))
    ):
        return []
    state_frame_of(triples, sighting.robot, place.frame_id)
    estimate = sighting.estimate or context.names.unique("pose-estimate")
    pose = iri(f"{estimate.value}/pose")
    triples.node(
        estimate,
        [RT.PoseEstimate],
        {
            RT.poseOf: object_iri,
            RT.poseOfExemplar: iri(sighting.exemplar) if sighting.exemplar else None,
            RT.estimatedPose: pose,
            RT.poseConfidence: float(np.clip(place.confidence, 0.0, 1.0)),
            PROV.wasAttributedTo: sighting.agent,
            PROV.wasDerivedFrom: sighting.event,
            PROV.invalidatedAtTime: None if sighting.moved is None else stamp(sighting.moved),
        },
    )
    triples.pose(pose, frame, place.frame_from_object)
    triples.add(pose, RT.atTime, stamp(sighting.time))
    hands = {gripper.iri for gripper in context.grippers.all()}
    supports = () if is_new else _supports(context.kb, object_iri, sighting.graph)
    withdrawn: list[tuple[NamedNode, NamedNode, Value]] = [
        (object_iri, RT.locatedOn, support)
        for support in supports
        if support in hands or is_place_of(sighting.robot, support)
    ]
    for earlier in stored[MAX_ESTIMATES - 1 :]:
        withdrawn += _statements(context.kb, (earlier.iri, earlier.pose), sighting.graph)
    return withdrawn


def state_moved(
    context: Context,
    triples: Triples,
    object_iri: NamedNode,
    handled: Handled,
    outcome: Outcome,
    ended: dt.datetime,
    graph: NamedNode,
) -> list[tuple[NamedNode, NamedNode, Value]]:
    """End the estimates of an object's pose that an attempt made void; return what to withdraw.

    These are the estimates of the thing that was handled, whoever made them, and those of no thing
    in the robot's own frames: what other robots see on their tables is where it was. In which hand
    or place it left the object is the placement of a single thing; see
    :func:`rtask.engine.records.exemplars.move_exemplar`.
    """
    if not may_have_moved(outcome):
        return []
    for estimate in _estimates(context.kb, object_iri):
        if handled.voids(estimate) and not estimate.is_over and estimate.time <= ended:
            triples.add(estimate.iri, PROV.invalidatedAtTime, stamp(ended))
    # Of graphs older than placements.
    supports = _supports(context.kb, object_iri, graph)
    return [(object_iri, RT.locatedOn, support) for support in supports]


def place_before(
    kb: GraphCore, object_iri: NamedNode, robot: NamedNode, graph: NamedNode, time: dt.datetime
) -> Located | None:
    """Return where a robot last estimated an object in a frame of its own, while that holds."""
    for estimate in _estimates(kb, object_iri, graph):
        if estimate.time > time or not estimate.frame.value.startswith(f"{robot.value}/"):
            continue
        names = [str(python_value(quad.object)) for quad in kb.match(estimate.frame, RT.frameId)]
        if estimate.is_over or not names:
            return None
        return Located(estimate.frame_from_object, names[0], 1.0, is_round=False)
    return None


def _has_moved(last: _Estimate, place: Located) -> bool:
    before, now = last.frame_from_object, place.frame_from_object
    if np.linalg.norm(now[:3, 3] - before[:3, 3]) > MOVED_M:
        return True
    if place.is_round:
        cosine = before[:3, 2] @ now[:3, 2]
    else:
        cosine = (np.trace(before[:3, :3].T @ now[:3, :3]) - 1.0) / 2.0
    return bool(np.arccos(np.clip(cosine, -1.0, 1.0)) > MOVED_RAD)


def _estimates(
    kb: GraphCore, object_iri: NamedNode, graph: NamedNode | None = None
) -> list[_Estimate]:
    """Return the estimates of an object's pose in one graph or in all, latest first.

    They are looked up by pattern, since a decision asks the graph only one query.
    """
    estimates = {}
    for link in kb.match(None, RT.poseOf, object_iri, graph):
        if isinstance(link.subject, NamedNode):
            for target in kb.match(link.subject, RT.estimatedPose, None, graph):
                estimate = _estimate(kb, link.subject, target.object)
                if estimate is not None:
                    estimates[estimate.iri] = estimate
    return sorted(
        estimates.values(), key=lambda estimate: (estimate.time, estimate.iri.value), reverse=True
    )


def _estimate(kb: GraphCore, estimate: NamedNode, pose: object) -> _Estimate | None:
    """Return an estimate, or None if frame, time or a number is missing."""
    if not isinstance(pose, NamedNode):
        return None
    properties = {quad.predicate: quad.object for quad in kb.match(pose)}
    frame = properties.get(RT.inFrame)
    if not isinstance(frame, NamedNode) or not {RT.atTime, *_POSITION, *_TURN} <= properties.keys():
        return None
    position, turn = (
        np.array([float(str(python_value(properties[name]))) for name in names])
        for names in (_POSITION, _TURN)
    )
    at = np.asarray(matrix_from_pose(position, turn), np.float64)
    time = dt.datetime.fromisoformat(str(python_value(properties[RT.atTime])))
    time = time if time.tzinfo else time.replace(tzinfo=dt.UTC)
    things = [quad.object for quad in kb.match(estimate, RT.poseOfExemplar)]
    return _Estimate(
        estimate, pose, frame, time, at, bool(kb.match(estimate, PROV.invalidatedAtTime)),
        things[0].value if things and isinstance(things[0], NamedNode) else "",
    )  # fmt: skip


def _supports(kb: GraphCore, object_iri: NamedNode, graph: NamedNode) -> list[NamedNode]:
    quads = kb.match(object_iri, RT.locatedOn, None, graph)
    return [quad.object for quad in quads if isinstance(quad.object, NamedNode)]


def _statements(
    kb: GraphCore, subjects: Sequence[NamedNode], graph: NamedNode
) -> list[tuple[NamedNode, NamedNode, Value]]:
    return [
        (subject, quad.predicate, object_term(quad.object))
        for subject in subjects
        for quad in kb.match(subject, None, None, graph)
    ]
