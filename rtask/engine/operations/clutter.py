"""Grasps of whatever stands on a table, things that touch and lie on each other too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from annotated_types import Ge, Le, MaxLen
from pydantic import Field

from grasp.spatial.candidate import contacts_of
from grasp.spatial.frames import closing_yaw
from rtask.engine.grippers import jaws_modelled
from rtask.engine.memory.question import question_for
from rtask.engine.memory.recall import recall
from rtask.engine.operations.grasps import GraspContact, GraspMessage, contact_messages
from rtask.engine.operations.operation import operation
from rtask.engine.records.received import CANDIDATE
from rtask.errors import DataError, UsageError
from rtask.kb.commit.access import Access
from rtask.wire.message import Answer, Message
from rtask.wire.types import Cloud, Flag, Number, Pose, PoseStamped, Probability, Text, Unit, Whole

if TYPE_CHECKING:
    from features.geometry import Frame
    from grasp.spatial.candidate import GraspCandidate
    from grasp.spatial.gripper import EndEffector
    from rtask.engine.context import Context
    from rtask.engine.grippers import StoredGripper
    from rtask.engine.perception.clutter import ClutterView

__all__ = ["PlanOnScene", "SceneGrasp", "SceneGrasps", "SceneSegment", "plan_on_scene"]


_MAX_MATCHES = 10


class PlanOnScene(Message):
    """A request to plan grasps of everything in one view of a table."""

    data: Cloud
    """base64 of the whole view: a frame with depth, compressed or as sensor_msgs/PointCloud2"""
    gripper_id: Text | None = None
    """name or IRI of the end effector; default: the robot's only one"""
    sensor_pose: Pose
    """pose of the camera, in whose frame the data is, in frame_id"""
    frame_id: Text
    """frame of the robot with z up, e.g. base_footprint"""
    support_height: Annotated[Number, Unit("m")] | None = None
    """height of the table in frame_id; default: the largest level plane"""
    region: Annotated[list[Number], MaxLen(4)] = Field(default_factory=list)
    """x from, x to, y from, y to in frame_id, m: what lies elsewhere is left out"""
    min_confidence: Probability = 0.0
    """c_G; grasps below it are not offered"""
    complete: Flag = True
    """complete the hidden sides of things"""
    recognise: Flag = False
    """look each thing up in the graph; needs colours"""
    max_grasps: Annotated[Whole, Ge(1), Le(50)] = 10
    """maximum number of grasps"""
    samples: Annotated[Whole, Ge(1), Le(1000)] = 50
    """number of perturbed poses of each grasp"""
    seed: Annotated[Whole, Ge(0)] = 0
    """seed of the random numbers"""


class SceneSegment(Answer):
    """One thing as the segmentation sees it."""

    segment: int
    """its number"""
    points: int
    """how many points belong to it"""
    centre: list[float]
    """middle of what is seen in frame_id, m"""
    size: list[float]
    """along the axes of frame_id, m"""
    object: str
    """IRI of the known object that it was recognised as; empty if none, or not asked"""
    label: str
    """its label"""
    confidence: float
    """in that identity, or of the best match that was not accepted"""


class SceneGrasp(GraspMessage):
    """A grasp of one thing, best first, as moveit_msgs/Grasp in frame_id."""

    segment: int
    """number of the thing"""
    object: str
    """IRI of the known object that it was recognised as; empty if none, or not asked"""
    kind: str
    """spatial"""
    tool_pose: PoseStamped
    """of the tool centre point; grasp_pose is that of the end effector's parent link"""
    x: float
    y: float
    z: float
    """of the tool centre point, m"""
    theta: float
    """closing direction about z, rad"""
    width: float
    """between the contacts, m"""
    opening: float
    """between the jaws before they close, m"""
    confidence: float
    """s_G: share of pose errors under which the grasp closes, or the lip seals, and touches nothing
    before"""
    lower_95: float
    """lower bound on it"""
    moves: float
    """share of pose errors under which open jaws touch other things; 0 for other hands"""
    antipodal: str
    """full or half: whether the surface opposes both jaws, or one; none for other hands"""
    completed: bool
    """whether a side was completed rather than seen"""
    contacts: list[GraspContact]
    """where a cup or three fingers touch; empty for jaws"""


class SceneGrasps(Answer):
    """The grasps of a scene, best first, or the reason why there are none."""

    reason: str
    advice: str
    table_height: float
    tried: dict[str, int]
    segments: list[SceneSegment]
    grasps: list[SceneGrasp]
    grasps_left_out: int
    """how many more are as sure as min_confidence demands; max_grasps asks for them"""


@operation("read", "reads", "plan grasps in clutter: of everything in one view of a table")
def plan_on_scene(context: Context, request: PlanOnScene, access: Access) -> SceneGrasps:
    """Plan grasps of the things in one view, each with its neighbours as obstacles.

    Nothing is stored: what was picked is reported as an observation of its own, with its grasp as
    received.
    """
    from grasp.spatial.scene_plan import SceneOptions
    from rtask.engine.perception.clutter import plan_in_view

    gripper = context.grippers.find(request.gripper_id, access)
    hand = jaws_modelled(gripper.gripper)
    frame, view = _view(request)
    if view is None:
        return SceneGrasps(
            reason="no table is seen: no level plane is large enough", advice="",
            table_height=0.0, tried={}, segments=[], grasps=[], grasps_left_out=0,
        )  # fmt: skip
    options = SceneOptions(samples=request.samples, complete=request.complete, seed=request.seed)
    grasps = plan_in_view(view, hand, options)
    sure = [c for c in grasps if c.scores["confidence"] >= request.min_confidence]
    reason = grasps.reason
    if grasps and not sure:
        best = max(c.scores["confidence"] for c in grasps)
        reason = f"the best confidence is {best:.2f} < {request.min_confidence:g}"
    identities = {}
    if request.recognise:
        if frame is None or frame.rgb is None:
            raise UsageError("recognise needs an image with colours, not a bare cloud",
                             field="recognise")  # fmt: skip
        identities = {
            k: _recognised(context, request, frame, view, k, gripper) for k in view.segments
        }
    return SceneGrasps(
        reason=reason,
        advice=grasps.advice,
        table_height=view.table_height,
        tried=dict(grasps.counts),
        segments=_segments(view, identities),
        grasps=_messages(sure[: request.max_grasps], hand, request.frame_id, identities),
        grasps_left_out=max(len(sure) - request.max_grasps, 0),
    )


@dataclass(frozen=True)
class _SegmentIdentity:
    """Identity under which a thing was recognised."""

    object: str = ""
    label: str = ""
    confidence: float = 0.0


_STRANGE = _SegmentIdentity()


def _recognised(
    context: Context,
    request: PlanOnScene,
    frame: Frame,
    view: ClutterView,
    segment: int,
    gripper: StoredGripper,
) -> _SegmentIdentity:
    """Look a segment up in the graph."""
    from features.codec import encode_frame
    from rtask.engine.perception.identity import recognise, settle
    from rtask.engine.perception.observation import OptionalLook, observe

    mask = np.zeros(frame.depth_m.shape, dtype=bool)
    mask.ravel()[view.pixels[view.labels == segment]] = True
    crop = frame.crop(mask)
    if not (crop.depth_m > 0).any():
        return _STRANGE
    look = OptionalLook.model_construct(
        data=encode_frame(crop), sensor_pose=request.sensor_pose, frame_id=request.frame_id,
        support_height=view.table_height,
    )  # fmt: skip
    seen = observe(look)
    recognition = recognise(
        context.views.recogniser, seen, context.policy, _MAX_MATCHES, None,
        context.views.embeddings, words=context.words,
    )  # fmt: skip
    question = question_for(context.policy, seen, recognition, None, gripper)
    memory = recall(context.kb, replace(question, doubts=context.honesty.doubts(question.robot)))
    recognition = settle(recognition, memory, seen, context.policy)
    if not recognition.matches:
        return _STRANGE
    best = recognition.matches[0]
    confidence = float(best.confidence)
    if not recognition.accepted:
        return _SegmentIdentity(confidence=confidence)
    return _SegmentIdentity(best.object_iri, memory.objects[best.object_iri].label, confidence)


def _view(request: PlanOnScene) -> tuple[Frame | None, ClutterView | None]:
    """Decode and segment the view of a request; a cloud that is no image has no frame."""
    from features.codec import decode
    from features.geometry import Frame
    from features.imaging.camera import frame_of_grid
    from rtask.engine.perception.clutter import view_clutter
    from rtask.engine.perception.cutting import refuse_doubtful

    x_range, y_range = (-np.inf, np.inf), (-np.inf, np.inf)
    if request.region:
        if len(request.region) != 4:
            raise UsageError(f"region has {len(request.region)} of its 4 numbers", field="region")
        x0, x1, y0, y1 = request.region
        if not (x0 < x1 and y0 < y1):
            raise UsageError(
                f"region {request.region}: x from < x to and y from < y to, in m", field="region"
            )
        x_range, y_range = (x0, x1), (y0, y1)
    try:
        decoded = decode(request.data)
        frame = decoded if isinstance(decoded, Frame) else frame_of_grid(decoded)
        if frame is not None:
            points, colours = frame.points(), frame.rgb
        else:
            assert not isinstance(decoded, Frame)
            points, colours = decoded.points(), decoded.colours
    except ValueError as error:
        raise UsageError(f"data: {error}", field="data") from error
    pose = np.asarray(request.sensor_pose, dtype=np.float64)
    try:
        view = view_clutter(points, colours, pose, x_range, y_range, request.support_height)
        # Depth in mm is the likeliest reason why nothing is seen; what shows things is in metres.
        if view is None or not view.segments:
            refuse_doubtful(decoded)
    except (ValueError, DataError) as error:
        raise UsageError(f"data: {error}", field="data") from error
    return frame, view


def _segments(view: ClutterView, identities: Mapping[int, _SegmentIdentity]) -> list[SceneSegment]:
    segments = []
    for number in view.segments:
        points = view.of(number)
        low, high = points.min(axis=0), points.max(axis=0)
        segments.append(
            SceneSegment(
                segment=number, points=len(points), centre=((low + high) / 2).tolist(),
                size=(high - low).tolist(), **asdict(identities.get(number, _STRANGE)),
            )
        )  # fmt: skip
    return segments


def _messages(
    grasps: Sequence[GraspCandidate],
    hand: EndEffector,
    frame_id: str,
    identities: Mapping[int, _SegmentIdentity],
) -> list[SceneGrasp]:
    from grasp.messages import header, pose_message, spatial_grasp_message

    return [
        SceneGrasp(
            **{
                **spatial_grasp_message(grasp, hand, frame_id),
                "id": f"{CANDIDATE}scene-{number}",
                "grasp_quality": grasp.score,
            },
            segment=grasp.segment or 0,
            object=identities.get(grasp.segment or 0, _STRANGE).object,
            kind="spatial",
            tool_pose={"header": header(frame_id), "pose": pose_message(grasp.frame_from_gripper)},
            x=float(grasp.centre[0]),
            y=float(grasp.centre[1]),
            z=float(grasp.centre[2]),
            theta=closing_yaw(grasp.frame_from_gripper),
            width=grasp.width,
            opening=grasp.width if grasp.opening is None else grasp.opening,
            confidence=grasp.scores["confidence"],
            lower_95=grasp.scores["lower_95"],
            moves=grasp.scores.get("moves", 0.0),
            antipodal=grasp.antipodal,
            completed=grasp.completed,
            contacts=contact_messages(contacts_of(grasp, hand)),
        )
        for number, grasp in enumerate(grasps, start=1)
    ]
