"""Estimate the pose of a recognised object in six degrees of freedom (Kehoe 2014, 4.3 and 4.4).

The observation is registered with the model grown from the object's views, or with the stored view
that matched when there is no model. A pose below c_T is reported as "cannot be determined".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.engine.observation import Observation
from rtask.engine.perception.observation import stored_frame
from rtask.engine.perception.placement import Placement, is_lying, oriented, place
from rtask.engine.perception.surroundings import surrounded
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    from features.pose import PoseEstimate, PoseModel
    from features.recognition.recogniser import Match, Recognition
    from rtask.engine.context import Context
    from rtask.engine.remembered import Memory, RememberedObject
    from rtask.engine.stored import Models
    from rtask.kb.core import GraphCore

__all__ = [
    "ObjectPose", "find_pose", "last_heading", "locate", "note_heading", "pose_fields",
]  # fmt: skip

# Bounded by work and not by time, so that the result does not depend on the machine's load.
_STARTS, _MAX_REFINED, _POINTS = 160, 12, 800


@dataclass(frozen=True, eq=False)
class ObjectPose:
    """Pose of a recognised object.

    Parameters
    ----------
    camera_from_object : (4, 4) float64, m
        Pose of the object's own frame, in which its grasps are given.
    frame_from_object : (4, 4) float64, m
        Pose of the object's own frame in the robot's frame.
    confidence
        s_T of Kehoe 2014, 0..1.
    accepted
        Whether s_T reaches c_T.
    estimate
        Fit, contradictions and alternative poses.
    source
        What the pose was estimated with, ``model`` or ``view``; ``given`` when the request brought
        it.
    views
        Number of views used.
    """

    camera_from_object: NDArray[np.float64]
    frame_from_object: NDArray[np.float64]
    confidence: float
    accepted: bool
    estimate: PoseEstimate
    source: str
    views: int

    @property
    def object_from_camera(self) -> NDArray[np.float64]:
        """Pose of the camera in the object's frame, (4, 4)."""
        return np.linalg.inv(self.camera_from_object).astype(np.float64)


def locate(
    models: Models,
    seen: Observation,
    recognition: Recognition,
    recognised: RememberedObject | None,
    memory: Memory,
    heading: float | None = None,
) -> tuple[Placement | None, ObjectPose | None]:
    """Return the placement of an object, and its pose if stored data determine it.

    The frame comes from an accepted pose, otherwise from a matching view, otherwise from the
    measured sides.

    Parameters
    ----------
    heading
        See :func:`rtask.engine.perception.placement.place`.
    """
    if recognised is None:
        return place(seen), None
    # A bottle that fell over is round no longer from above: as a circle as wide as it is long it
    # would fit into no hand.
    lies = seen.shape is not None and is_lying(seen.shape, recognised.size)
    is_round = recognised.is_round and not lies
    if seen.object_pose is not None:
        given, placement = _given(seen, seen.object_pose), place(seen, is_round)
        return (placement and oriented(placement, given.frame_from_object)), given
    match: Match | None = next(
        (m for m in recognition.matches if m.object_iri == recognised.iri), None
    )
    query_from_view, viewpoint = None, None
    if match is not None and match.query_from_view is not None:
        query_from_view = np.asarray(match.query_from_view, dtype=np.float64)
        viewpoint = memory.viewpoints.get(match.view_iri)
    placement = place(seen, is_round, query_from_view, viewpoint, heading)
    pose = find_pose(models, seen, recognised, match, memory, placement)
    if placement is not None and pose is not None and pose.accepted:
        placement = oriented(placement, pose.frame_from_object)
    return placement, pose


def last_heading(
    context: Context, robot: NamedNode | None, object_iri: str | None, seen: Observation
) -> float | None:
    """Return the direction of an object's x axis when a robot last saw it, rad, or None."""
    return None if object_iri is None else context.headings.get(_of(robot, object_iri, seen))


def note_heading(
    context: Context, robot: NamedNode | None, object_iri: str, seen: Observation,
    placement: Placement | None,
) -> None:  # fmt: skip
    """Keep in which direction a robot sees the x axis of an object."""
    if placement is not None and not placement.is_round:
        context.headings.put(_of(robot, object_iri, seen), placement.yaw)


def _of(robot: NamedNode | None, object_iri: str, seen: Observation) -> str:
    return f"{robot} {object_iri} {seen.frame_id}"


def _given(seen: Observation, frame_from_object: NDArray[np.float64]) -> ObjectPose:
    """Return a pose that another estimator found, as it is."""
    from features.pose import PoseEstimate

    camera_from_object = np.linalg.inv(seen.frame_from_camera) @ frame_from_object
    estimate = PoseEstimate(
        camera_from_object, confidence=1.0, accepted=True, fit=1.0, violation=0.0, coverage=1.0,
        explained=1.0, alternatives=(), ambiguous=False, symmetric_axes=np.zeros((0, 3)),
        segments_used=(),
    )  # fmt: skip
    return _posed(seen, estimate, "given", 0)


def find_pose(
    models: Models,
    seen: Observation,
    recognised: RememberedObject | None,
    match: Match | None,
    memory: Memory,
    upright: Placement | None = None,
) -> ObjectPose | None:
    """Return the pose of a known object, or None if no stored view or model can be compared.

    Parameters
    ----------
    models
        Models in the knowledge base.
    match
        Match found by recognition; its rigid motion of keypoints is tried first.
    upright
        Upright pose derived from the measured sides; it is tried with each side in front.
    """
    if recognised is None:
        return None
    viewpoint = None if match is None else memory.viewpoints.get(match.view_iri)
    movement = None if match is None else match.query_from_view
    matched = None
    if movement is not None and viewpoint is not None:
        matched = np.asarray(movement, np.float64) @ np.linalg.inv(viewpoint)
    stored = models.of(iri(recognised.iri))
    if stored is not None:
        model = stored[1].pose_model(recognised.is_round)
        estimate = _against_model(seen, model, matched, upright)
        return None if estimate is None else _posed(seen, estimate, "model", len(stored[0].views))
    if matched is None or viewpoint is None or movement is None or match is None:
        return None
    return _against_view(models.kb, seen, match.view_iri, np.asarray(movement, np.float64),
                         viewpoint)  # fmt: skip


def _against_model(
    seen: Observation,
    model: PoseModel,
    matched: NDArray[np.float64] | None,
    upright: Placement | None,
) -> PoseEstimate | None:
    from features.pose import PoseParams, estimate_pose

    frame, plane = surrounded(seen)
    labels = (frame.object_mask() & (frame.depth_m > 0)).astype(np.int32)
    params = PoseParams(starts=_STARTS, keep=_MAX_REFINED, max_points=_POINTS, merge=False)
    begun = _stored_poses(seen, matched, upright)
    is_matched = matched is not None
    return estimate_pose(model, frame, labels, 1, params, plane, begun, is_matched)


def _stored_poses(
    seen: Observation, matched: NDArray[np.float64] | None, upright: Placement | None
) -> NDArray[np.float64] | None:
    """Return the poses worth trying before any search, (k, 4, 4).

    A motion matched by keypoints is returned alone, since print distinguishes poses that shape
    cannot.
    """
    if matched is not None:
        return matched[None]
    if upright is None or not seen.is_posed:
        return None
    camera_from_frame = np.linalg.inv(seen.frame_from_camera)
    poses = []
    for quarter in range(4):
        rotation, angle = np.eye(4), quarter * np.pi / 2
        rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        poses.append(camera_from_frame @ upright.frame_from_object @ rotation)
    return np.stack(poses)


def _against_view(
    kb: GraphCore,
    seen: Observation,
    view: str,
    movement: NDArray[np.float64],
    object_from_view: NDArray[np.float64],
) -> ObjectPose | None:
    from dataclasses import replace

    from features.pose import estimate_pose_from_views

    stored = stored_frame(kb, view)
    if stored is None:
        return None
    estimate = estimate_pose_from_views(stored[0], surrounded(seen)[0], movement)
    if estimate is None:
        return None
    pose = estimate.camera_from_object @ np.linalg.inv(object_from_view)
    return _posed(seen, replace(estimate, camera_from_object=pose), "view", 1)


def _posed(seen: Observation, estimate: PoseEstimate, source: str, views: int) -> ObjectPose:
    return ObjectPose(
        camera_from_object=estimate.camera_from_object,
        frame_from_object=seen.frame_from_camera @ estimate.camera_from_object,
        confidence=estimate.confidence,
        accepted=estimate.accepted,
        estimate=estimate,
        source=source,
        views=views,
    )


def pose_fields(pose: ObjectPose | None, seen: Observation) -> dict[str, Any]:
    """Return the fields of a recognition answer that describe the pose."""
    from grasp.messages import pose_message

    if pose is None:
        return {"pose": None, "pose_confidence": 0.0, "pose_accepted": False}
    estimate = pose.estimate
    return {
        "pose": {
            "camera_from_object": pose_message(pose.camera_from_object),
            "frame_from_object": pose_message(pose.frame_from_object) if seen.is_posed else None,
            "fit": estimate.fit,
            "violation": estimate.violation,
            "coverage": estimate.coverage,
            "ambiguous": estimate.ambiguous,
            "symmetric_axes": estimate.symmetric_axes.tolist(),
            "alternatives": [
                {
                    "camera_from_object": pose_message(other.camera_from_object),
                    "score": other.score,
                }
                for other in estimate.alternatives[:2]
            ],
            "source": pose.source,
            "views": pose.views,
        },
        "pose_confidence": pose.confidence,
        "pose_accepted": pose.accepted,
    }
