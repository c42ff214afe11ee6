"""Grasps planned on an object's shape: its clouds out of the graph, the plan into it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rtask.engine.attempts import state_grasp
from rtask.engine.facts import Facts
from rtask.engine.objects import body_frame, state_frame
from rtask.engine.received import Received
from rtask.engine.vocabulary import PREFIXES, RT
from rtask.errors import DataError, MissingBlobError, UsageError
from rtask.kb.access import Access
from rtask.kb.terms import NamedNode, iri

if TYPE_CHECKING:
    from rtask.engine.engine import Engine

__all__ = [
    "PlannedGrasp",
    "PlannedSpatialGrasp",
    "object_cloud",
    "store_planned",
    "store_planned_in_space",
]

_PLANNER = "planner"
Planned = TypeVar("Planned")
_IN_SPACE = "rtask antipodal 1"


@dataclass(frozen=True)
class PlannedGrasp:
    """A grasp in the object's frame and what was computed about it.

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
    """A grasp in space in the object's frame and what was computed about it.

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


def object_cloud(engine: Engine, name: str) -> tuple[str, NDArray[np.float64]]:
    """Return the IRI of an object and the points (n, 3) of all its views in its own frame, m.

    Parameters
    ----------
    name
        IRI, objectId or name.

    Raises
    ------
    UnknownTermError
        When the graph knows no such object.
    DataError
        When no view of it has a cloud whose place is known.
    """
    thing = str(engine.call("recall_grasps", {"object": name})["object"])
    rows = engine.kb.select(f"""{PREFIXES}
SELECT DISTINCT ?view ?blob ?x ?y ?z ?qx ?qy ?qz ?qw WHERE {{
  {iri(thing)} rt:hasView ?view . ?view rt:viewContent ?content ; rt:viewpoint ?pose .
  ?content a rt:CompressedPointCloud ; rt:hasBlob ?blob .
  ?pose rt:x ?x ; rt:y ?y ; rt:z ?z ; rt:qx ?qx ; rt:qy ?qy ; rt:qz ?qz ; rt:qw ?qw
}} ORDER BY ?view""")
    clouds = []
    for row in rows:
        at: dict[str, Any] = row.to_dict()
        pose = [float(at[k]) for k in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        try:
            clouds.append(_points(engine.kb.blobs.read(str(row.value("blob"))), pose))
        except (MissingBlobError, ValueError):
            continue
    if not clouds:
        raise DataError(f"no view of {thing} has a cloud whose place is known: insert one first")
    return thing, np.vstack(clouds)


def _points(data: bytes, pose: Sequence[float]) -> NDArray[np.float64]:
    from features.codec import decode
    from features.geometry import Frame
    from grasp.spatial.frames import matrix_from_pose
    from rtask.engine.images import frame_of_cloud

    decoded = decode(data)
    if isinstance(decoded, Frame):
        frame = decoded
    else:
        frame, _ = frame_of_cloud(decoded.points(), decoded.colours)
    points = frame.points()[frame.object_mask()].astype(np.float64)
    object_from_camera = matrix_from_pose(np.array(pose[:3]), np.array(pose[3:]))
    moved = points @ object_from_camera[:3, :3].T + object_from_camera[:3, 3]
    return np.asarray(moved[np.isfinite(moved).all(axis=1)])


def store_planned(
    engine: Engine,
    thing: str,
    grasps: Sequence[PlannedGrasp],
    gripper_type: str,
    access: Access | None = None,
) -> dict[str, Any]:
    """Write planned grasps of an object with their evaluations; they are recalled like any other.

    Returns
    -------
    ``object``, ``grasps`` (IRIs in the given order), ``commit``.
    """

    def state(facts: Facts, target: NamedNode, planned: PlannedGrasp) -> NamedNode:
        received = Received(
            in_object=(planned.x, planned.y, planned.z, planned.theta),
            width=planned.width,
            opening=planned.opening,
            quality=planned.quality,
        )
        return state_grasp(engine, facts, target, gripper_type, received)

    def evaluation(planned: PlannedGrasp) -> dict[NamedNode, Any]:
        return {
            RT.graspConfidence: planned.quality,
            RT.forceClosureLowerBound: planned.quality,
            RT.sampleCount: planned.samples,
            RT.vertexSigma: planned.vertex_sigma,
        }

    return _store(engine, thing, grasps, state, evaluation, access)


def store_planned_in_space(
    engine: Engine,
    thing: str,
    grasps: Sequence[PlannedSpatialGrasp],
    gripper_type: str,
    access: Access | None = None,
) -> dict[str, Any]:
    """Write grasps in space of an object with their evaluations.

    Those that come within 20 degrees from above are planar grasps as well: they are stored as such
    and recalled like any other. The others are stored with their full pose.

    Returns
    -------
    ``object``, ``grasps`` (IRIs in the given order), ``commit``.
    """
    from grasp.spatial.frames import planar_from_pose

    def state(facts: Facts, target: NamedNode, planned: PlannedSpatialGrasp) -> NamedNode:
        try:
            at = planar_from_pose(planned.object_from_gripper)
        except ValueError:
            return _state_spatial(engine, facts, target, gripper_type, planned)
        received = Received(
            in_object=at,
            width=planned.width,
            opening=planned.opening,
            quality=planned.confidence,
        )
        return state_grasp(engine, facts, target, gripper_type, received)

    def evaluation(planned: PlannedSpatialGrasp) -> dict[NamedNode, Any]:
        return {
            RT.graspConfidence: planned.confidence,
            RT.confidenceLower95: planned.lower_95,
            RT.epsilonQuality: planned.epsilon,
            RT.sampleCount: planned.samples,
            RT.positionSigma: planned.position_sigma,
            RT.orientationSigma: planned.orientation_sigma,
        }

    return _store(engine, thing, grasps, state, evaluation, access)


def _state_spatial(
    engine: Engine, facts: Facts, thing: NamedNode, gripper_type: str, planned: PlannedSpatialGrasp
) -> NamedNode:
    """State a new grasp with a full pose, and return its IRI."""
    node = engine.names.counted("grasp")
    pose = iri(node.value + "/pose")
    facts.add(thing, RT.hasGrasp, node)
    facts.node(
        node,
        [RT.SpatialGrasp, RT.GraspCandidate],
        {
            RT.gripperType: gripper_type,
            RT.graspPose: pose,
            RT.jawOpening: planned.opening,
            RT.contactWidth: planned.width,
            RT.graspQuality: planned.confidence,
            RT.generator: _IN_SPACE,
        },
    )
    facts.pose(pose, body_frame(engine, thing), planned.object_from_gripper)
    return node


def _store(
    engine: Engine,
    thing: str,
    grasps: Sequence[Planned],
    state: Callable[[Facts, NamedNode, Planned], NamedNode],
    evaluation: Callable[[Planned], dict[NamedNode, Any]],
    access: Access | None,
) -> dict[str, Any]:
    """Commit grasps, each with its evaluation, and return what a caller learns of it."""
    if not grasps:
        raise UsageError("there are no grasps to store")
    target = iri(thing)
    stored: list[NamedNode] = []
    with engine.writing:
        facts = Facts()
        state_frame(engine, facts, target)
        for planned in grasps:
            node = state(facts, target, planned)
            judged = iri(node.value + "/evaluation")
            facts.add(node, RT.hasEvaluation, judged)
            facts.node(judged, [RT.GraspEvaluation], evaluation(planned))
            stored.append(node)
        author = engine.author(access or Access(), _PLANNER)
        with engine.kb.transaction(access=author, note="planned grasps") as tx:
            facts.write(tx)
        return {
            "object": thing,
            "grasps": [node.value for node in stored],
            "commit": engine.commit_id(tx.commit),
        }
