"""The operations of the engine as methods; made by ``python -m rtask.engine.operations.table``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NotRequired, Required, TypedDict

from rtask.wire.request_id import RequestId

__all__ = [
    "DEFERRABLE",
    "REPEATABLE",
    "REQUEST_IDS",
    "AnsweredQuestion",
    "AskedPerson",
    "Calls",
    "Camera",
    "CancelledPlan",
    "ClaimedStep",
    "ComparedContributors",
    "Contributor",
    "Curated",
    "DrawnNode",
    "DrawnScene",
    "EndEffector",
    "EndedStep",
    "FailureCause",
    "FailureChange",
    "FailureExplained",
    "Feedback",
    "FollowingJoint",
    "GivenVerdict",
    "GoalPlan",
    "GraspConfidence",
    "GraspContact",
    "GraspPromise",
    "GraspStatistics",
    "Inserted",
    "InsertedObject",
    "ListedChoice",
    "ListedPlan",
    "ListedPlans",
    "ListedQuestion",
    "ListedQuestions",
    "ListedStep",
    "Located",
    "LocatedFrame",
    "LocatedThing",
    "Look",
    "MotionReport",
    "NewObject",
    "OfferedChoice",
    "OfferedGrasp",
    "OfferedObject",
    "OtherThing",
    "OutcomeReport",
    "PastPlace",
    "Picture",
    "PlaceOfWork",
    "PlanReason",
    "PlanRefusal",
    "PlanStep",
    "PlannedGrasps",
    "Reason",
    "RecalledGrasp",
    "RecalledGrasps",
    "RecalledMotions",
    "Recognition",
    "ReconstructedMesh",
    "RecordedMotion",
    "RegisteredRobot",
    "ReportedOutcome",
    "ReportedRefusal",
    "ReportedSightings",
    "Resembled",
    "ResolvedRequest",
    "SceneGrasp",
    "SceneGrasps",
    "SceneSegment",
    "SeenThing",
    "SimilarObject",
    "SimilarObjects",
    "StatedFrame",
    "StatedPlace",
    "StatedReach",
    "StepAnswer",
    "StepTimes",
    "StoredPlan",
    "TakenStep",
    "Taught",
    "Traced",
    "WaitingStep",
    "WithdrawnContributor",
]

Bytes = str | bytes
"""Base64 text, or the bytes themselves."""

REPEATABLE = frozenset(
    (
        "register_robot",
        "recognise_for_grasp",
        "recall_grasps",
        "recall_motions",
        "plan_on_scene",
        "search_object",
        "resolve_request",
        "where_is",
        "state_place",
        "state_reach",
        "report_sightings",
        "trace_thing",
        "show_world",
        "locate_frame",
        "state_frame",
        "plan_goal",
        "list_plans",
        "claim_step",
        "end_step",
        "cancel_plan",
        "ask_person",
        "list_questions",
        "answer_question",
        "explain_failure",
        "insert_object",
        "report_outcome",
        "report_refusal",
        "compare_contributors",
    )
)
"""Operations whose request may be sent again: it changes nothing, or is stored once."""

DEFERRABLE = frozenset(
    (
        "insert_object",
        "report_outcome",
        "report_refusal",
    )
)
"""Operations whose answer a robot need not wait for: an outbox keeps them until they arrive."""

REQUEST_IDS: Mapping[str, RequestId] = {
    "insert_object": RequestId("task_id", entries="objects"),
    "report_outcome": RequestId("task_id"),
    "teach_object": RequestId("task_id", where=("operation", "teach")),
}
"""Where requests carry the ids by which they are stored once, by operation."""


class EndEffector(TypedDict, total=False):
    """One gripper of a robot."""

    name: Required[str]
    """name, unique on the robot"""
    gripper_type: Required[str]
    """grasps carry over between grippers of one type"""
    kind: Literal["Hand", "ParallelJawGripper", "SuctionCup", "ThreeFingerHand"]
    """class of end effector; default: Hand"""
    min_opening: float
    """smallest width that it can hold (m); default: 0.0"""
    max_opening: float
    """largest width that it can hold; 0 for a suction cup, all others need it (m); default: 0.0"""
    jaw_width: float
    """width of a jaw face or finger; default: 0.0124 (m)"""
    finger_length: float
    """reach of the fingers, or length of a cup's stem; default: 0.05 (m)"""
    lip_radius: float
    """of the lip of a suction cup, which needs it; default: no lip (m)"""
    lip_compliance: float
    """difference in depth at which a lip still seals; default: 0.4 of its radius (m)"""
    flange_radius: float
    """of the arm's flange behind the stem of a suction cup, kept off what stands around; 0: none
    (m); default: 0.0
    """
    pressure: float
    """of a suction cup, below that of the air; default: 60,000 (Pa)"""
    max_force: float
    """largest closing force; default: not known (N)"""
    max_payload: Required[float]
    """largest mass that it can lift (kg)"""
    parent_link: str
    """link that a grasp pose refers to; default: the pose is that of the gripper itself"""
    planning_group: str
    """MoveIt group of its arm; default: none"""


class Camera(TypedDict, total=False):
    """One camera of a robot."""

    name: Required[str]
    """name, unique on the robot"""
    frame_id: Required[str]
    """optical frame, as in tf"""
    width: int
    """image width; default: not known (px)"""
    height: int
    """image height; default: not known (px)"""
    fx: float
    """focal length; default: not known (px)"""
    fy: float
    """focal length; default: not known (px)"""
    cx: float
    """principal point; default: not known (px)"""
    cy: float
    """principal point; default: not known (px)"""
    min_range: float
    """nearest depth; default: not known (m)"""
    max_range: float
    """farthest depth; default: not known (m)"""


class PlaceOfWork(TypedDict, total=False):
    """A table or box at which a robot works."""

    name: Required[str]
    """name by which the robot reports that it put something there"""
    pose: Required[Mapping[str, Any]]
    """geometry_msgs/Pose of the middle of its surface (a box: of its floor), z up, in frame_id"""
    frame_id: str
    """frame of the robot, as in tf; default: its base frame"""
    length: Required[float]
    """size of the surface along x of the pose; of a box, inside the walls (m)"""
    width: Required[float]
    """size of the surface along y of the pose (m)"""
    rim_height: float
    """height of the walls of a box above its floor; 0 for a table (m); default: 0.0"""


class Look(TypedDict, total=False):
    """An observation of one object: data, an image, or both."""

    data: Bytes | Mapping[str, Any]
    """base64 of one object's cloud, compressed or as sensor_msgs/PointCloud2; default: the image"""
    new_point_cloud: Bytes | Mapping[str, Any]
    image: Bytes | Mapping[str, Any]
    """base64 PNG or JPEG, or a sensor_msgs/CompressedImage; default: the colours of the cloud"""
    mask: Bytes | Mapping[str, Any]
    """the object's pixels, base64 PNG of labels or COCO run lengths; default: by depth or colour"""
    label: int
    """which label of the mask; default: all"""
    box: Sequence[float]
    """around the object: left, top, width, height in the image, px; default: the whole"""
    object_pose: Mapping[str, Any]
    """pose of the object in frame_id that another estimator found; default: estimated"""
    sensor_pose: Mapping[str, Any]
    """pose of the camera in frame_id; default: identity"""
    frame_id: str
    """frame of the robot with z up, e.g. base_footprint; default: that of the camera"""
    support_height: float
    """height of the table in frame_id; default: lowest point (m)"""
    stamp: float | Mapping[str, int]
    """time of the observation; default: now (s)"""


class FollowingJoint(TypedDict, total=False):
    """A joint of the asking body that shall follow a recorded one."""

    name: Required[str]
    """of the joint"""
    recorded: str
    """name of the recorded joint whose place it takes; default: its own"""
    scale: float
    """factor for the recorded value: -1 for a joint that turns the other way; default: 1.0"""
    offset: float
    """added after that, rad or m; default: 0.0"""
    lower: float
    """lower limit, rad or m; default: none"""
    upper: float
    """upper limit, rad or m; default: none"""


class SeenThing(TypedDict, total=False):
    """A thing that was recognised and located."""

    object: Required[str]
    """IRI, objectId or name of its product"""
    pose: Required[Mapping[str, Any]]
    """geometry_msgs/Pose of the thing in the frame of the report"""
    sigma: float
    """standard deviation of the position per axis (m); default: 0.01"""
    confidence: float
    """that it is of this product and there; default: 1.0"""
    thing: str
    """IRI of the thing, if the robot knows which one it is; default: decided by place and time"""


class OfferedChoice(TypedDict, total=False):
    """One answer to choose from."""

    code: Required[str]
    """what the robot does with it, in a code of its own"""
    text: Required[str]
    """for people"""
    place: str
    """IRI of the place that it names; default: none"""
    helps: bool
    """whether the step is expected to succeed with it; default: False"""


class StepTimes(TypedDict, total=False):
    """Durations of the steps of an attempt."""

    segmentation_s: float
    """time for segmentation; default: not measured (s)"""
    transfer_s: float
    """time for the transfer; default: not measured (s)"""
    decode_s: float
    """time for decoding; default: not measured (s)"""
    extraction_s: float
    """time for feature extraction; default: not measured (s)"""
    matching_s: float
    """time for matching; default: not measured (s)"""
    query_s: float
    """time for the query; default: not measured (s)"""
    pose_s: float
    """time for the pose; default: not measured (s)"""
    generation_s: float
    """time for generating grasps; default: not measured (s)"""
    choice_s: float
    """time for the choice; default: not measured (s)"""
    planning_s: float
    """time for motion planning; default: not measured (s)"""
    execution_s: float
    """time for the execution; default: not measured (s)"""
    total_s: float
    """total time; default: not measured (s)"""


class Picture(TypedDict, total=False):
    """A picture of an attempt."""

    phase: Required[str]
    """pre_grasp, closed, lifted, placed, ..."""
    data: Required[Bytes | Mapping[str, Any]]
    """base64 PNG or JPEG"""


class MotionReport(TypedDict, total=False):
    """Joints of a robot during an attempt, sample by sample."""

    joints: Required[Sequence[str]]
    """names; the opening of a hand, 0 (closed) to 1, counts as a joint by the hand's name"""
    times: Required[Sequence[float]]
    """s since the start of the attempt, rising; one a sample"""
    positions: Required[Sequence[float]]
    """as measured, rad or m; all joints of the first sample, then of the second, ..."""
    commands: Required[Sequence[float]]
    """as commanded at the same moments, in the same order"""


class OutcomeReport(TypedDict, total=False):
    """Outcome of an attempt as reported."""

    success: Required[bool]
    """whether the object was held"""
    placed: bool
    """whether it reached its destination; default: not known"""
    place: str
    """name of the place where it was put, such as "left box"; default: not known"""
    reason: str
    """code of the reason: ok, missed, slip_lift, ...; default: ok if it held, else not judged"""
    lifted_m: float
    """height reached; default: not known (m)"""
    slip: float
    """distance that the object slipped in the hand; default: not known (m)"""
    started: float
    """start of the attempt since the epoch; default: duration_s before its end, unless simulated
    (s)
    """
    ended: float
    """end of the attempt since the epoch, by the same clock; default: now (s)"""
    duration_s: float
    """of the attempt; by the clock of the simulation if there is one; default: not known (s)"""
    links_touching: int
    """number of hand links in contact at the end; default: not known"""
    contact_force: float
    """contact force at the jaws; default: not known (N)"""
    jaw_gap: float
    """opening of the closed jaws; default: not known (m)"""
    hold_s: float
    """duration of the hold; default: not known (s)"""
    place_offset: float
    """distance from the destination; default: not known (m)"""
    approach_tilt: float
    """angle between approach and vertical; default: not known (rad)"""
    preset: Literal["faithful", "fast", "real"]
    """kind of physics: faithful, fast or real; default: not known"""
    seed: int
    """seed of the simulation; default: none"""
    attempt_number: int
    """counted from 1 for each object and episode; default: not known"""
    candidate_count: int
    """number of grasps to choose from; default: not known"""
    candidate_rank: int
    """rank of the chosen grasp; default: not known"""
    confirmed_by: Literal["physics", "human"]
    """who confirmed it; default: nobody"""
    operator: str
    """name of the person who confirmed it; default: nobody"""
    comment: str
    """remark of the person or the robot; default: none"""
    times: StepTimes | Mapping[str, Any]
    """durations of the steps; default: not known"""
    images: Sequence[Picture | Mapping[str, Any]]
    """pictures of the attempt"""
    motion: MotionReport | Mapping[str, Any]
    """the joints during the attempt; default: not recorded"""


class NewObject(TypedDict, total=False):
    """An observed object and the outcome of grasping it."""

    data: Bytes | Mapping[str, Any]
    """base64 of one object's cloud, compressed or as sensor_msgs/PointCloud2; default: the image"""
    new_point_cloud: Bytes | Mapping[str, Any]
    image: Bytes | Mapping[str, Any]
    """base64 PNG or JPEG, or a sensor_msgs/CompressedImage; default: the colours of the cloud"""
    mask: Bytes | Mapping[str, Any]
    """the object's pixels, base64 PNG of labels or COCO run lengths; default: by depth or colour"""
    label: int
    """which label of the mask; default: all"""
    box: Sequence[float]
    """around the object: left, top, width, height in the image, px; default: the whole"""
    object_pose: Mapping[str, Any]
    """pose of the object in frame_id that another estimator found; default: estimated"""
    sensor_pose: Mapping[str, Any]
    """pose of the camera in frame_id; default: identity"""
    frame_id: str
    """frame of the robot with z up, e.g. base_footprint; default: that of the camera"""
    support_height: float
    """height of the table in frame_id; default: lowest point (m)"""
    stamp: float | Mapping[str, int]
    """time of the observation; default: now (s)"""
    object: str
    """IRI of an object that the robot has tracked; default: recognised, or new"""
    thing: str
    """IRI of the single thing, if the robot knows which one it is; default: by place and time"""
    name: str
    """name of the object; default: made of kind and number"""
    class_description: str
    """kind of object in words; default: guessed from the shape"""
    function: str
    """function of the object: write, contain liquid, ...; default: not known"""
    gripper_id: str
    """name or IRI of the end effector used; default: the robot's only one"""
    task: str
    """purpose of the grasp: pick, place, push; default: pick"""
    grasp: str | Mapping[str, Any]
    """the attempted grasp, as received; default: given by X, Y, Z and rad"""
    X: float
    """of the grasp, in the frame of the cloud; default: no grasp (m)"""
    Y: float
    """of the grasp, in the frame of the cloud; default: no grasp (m)"""
    Z: float
    """of the grasp, in the frame of the cloud; default: no grasp (m)"""
    rad: float
    """closing direction of the grasp, in the frame of the cloud; default: no grasp (rad)"""
    success: bool
    """whether the grasp held, without an outcome; default: True"""
    confirmed_by: Literal["physics", "human"]
    """who confirmed it; default: a person"""
    operator: str
    """name of the person who confirmed it; default: nobody"""
    outcome: OutcomeReport | Mapping[str, Any]
    """the outcome; default: given by success"""
    task_id: str
    """from recognise_for_grasp, or any id; stored once for each id; default: a new task"""
    merge: bool
    """add the view to the object if it is recognised; default: True"""


class RegisteredRobot(TypedDict):
    """Result of a registration."""

    robot: str
    graph: str
    commit: str


class GraspStatistics(TypedDict):
    """Attempts and successes of a grasp, over all robots."""

    attempts: int
    successes: int
    mean: float
    lower_95: float


class GraspContact(TypedDict):
    """A place at which a lip seals or a finger pushes, in the frame of the grasp's pose."""

    x: float
    y: float
    z: float
    nx: float
    ny: float
    nz: float
    seal_radius: float | None


class OfferedGrasp(TypedDict):
    """A grasp to try: a moveit_msgs/Grasp with its belief and the reasons for its rank."""

    id: str
    pre_grasp_posture: dict[str, Any]
    grasp_posture: dict[str, Any]
    grasp_pose: dict[str, Any]
    grasp_quality: float
    pre_grasp_approach: dict[str, Any]
    post_grasp_retreat: dict[str, Any]
    post_place_retreat: dict[str, Any]
    max_contact_force: float
    allowed_touch_objects: list[str]
    kind: str
    source: str
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
    explanation: dict[str, Any]
    in_object: dict[str, Any]
    contacts: list[GraspContact]


SimilarObject = TypedDict(
    "SimilarObject",
    {
        "class": str,
        "class_iri": str,
        "object": str,
        "label": str,
        "confidence": float,
        "X": float | None,
        "Y": float | None,
        "Z": float | None,
        "rad": float | None,
        "grasp": str | None,
        "view": NotRequired[str],
        "picture": NotRequired[str],
        "why": NotRequired[str],
    },
)
"""A similar known object, with position and yaw of its best grasp, m and rad, or nulls."""


Recognition = TypedDict(
    "Recognition",
    {
        "task_response": str,
        "task_id": str,
        "object": str,
        "thing": NotRequired[str],
        "class": str,
        "class_iri": str,
        "label": str,
        "confidence": float,
        "statistics": GraspStatistics,
        "pre_grasp_posture": dict[str, Any],
        "grasp_posture": dict[str, Any],
        "grasp_pose": dict[str, Any],
        "grasp_quality": float,
        "pre_grasp_approach": dict[str, Any],
        "post_grasp_retreat": dict[str, Any],
        "post_place_retreat": dict[str, Any],
        "max_contact_force": float,
        "allowed_touch_objects": list[str],
        "grasps": list[OfferedGrasp],
        "grasps_left_out": int,
        "shape": dict[str, Any] | None,
        "recognition": dict[str, Any],
        "similar_objects": list[SimilarObject],
        "alone": dict[str, Any] | None,
        "decision": dict[str, Any] | None,
        "times": dict[str, Any],
    },
)
"""The object and its grasps; `decision` is null unless requested."""


class GraspConfidence(TypedDict):
    """Confidence in a grasp over all robots: a Beta distribution and its prior."""

    mean: float
    alpha: float
    beta: float
    prior: float | None
    evaluation: str
    updated: str
    policy: str
    note: str


class GraspPromise(TypedDict):
    """What is promised of a grasp planned on a mesh, by the hand that asks."""

    lift_chance: float | None
    lift_at_least: float | None
    carry_chance: float | None
    carry_at_least: float | None
    outcomes: int


class RecalledGrasp(TypedDict):
    """One known grasp as moveit_msgs/Grasp, in the frame of its object."""

    id: str
    pre_grasp_posture: dict[str, Any]
    grasp_posture: dict[str, Any]
    grasp_pose: dict[str, Any]
    grasp_quality: float
    pre_grasp_approach: dict[str, Any]
    post_grasp_retreat: dict[str, Any]
    post_place_retreat: dict[str, Any]
    max_contact_force: float
    allowed_touch_objects: list[str]
    kind: str
    gripper_type: str
    contact_kind: str
    contacts: list[GraspContact]
    x: float
    y: float
    z: float
    theta: float
    width: float | None
    opening: float | None
    statistics: GraspStatistics
    confidence: GraspConfidence
    promise: GraspPromise


class RecalledGrasps(TypedDict):
    """The known grasps of an object, most reliable first."""

    object: str
    class_iri: str
    label: str
    grasps: list[RecalledGrasp]
    grasps_left_out: int


class RecordedMotion(TypedDict):
    """The movement of one attempt."""

    attempt: str
    robot: str
    model: str
    hand: str
    object: str
    grasp: str
    held: bool
    ended: str
    fit: Literal["same_body", "retargeted", "other_body"]
    why_not: str
    joints: list[str]
    times: list[float]
    positions: list[float]


class RecalledMotions(TypedDict):
    """Movements of other robots and of one's own, those that can be followed first."""

    motions: list[RecordedMotion]
    rejected: list[RecordedMotion]
    motions_left_out: int


class PlannedGrasps(TypedDict):
    """The planned grasps, best first, or the reason why there are none."""

    object: str
    shape: str
    reason: str
    advice: str
    commit: str
    tried: dict[str, int]
    grasps: list[RecalledGrasp]
    grasps_left_out: int


class SceneSegment(TypedDict):
    """One thing as the segmentation sees it."""

    segment: int
    points: int
    centre: list[float]
    size: list[float]
    object: str
    label: str
    confidence: float


class SceneGrasp(TypedDict):
    """A grasp of one thing, best first, as moveit_msgs/Grasp in frame_id."""

    id: str
    pre_grasp_posture: dict[str, Any]
    grasp_posture: dict[str, Any]
    grasp_pose: dict[str, Any]
    grasp_quality: float
    pre_grasp_approach: dict[str, Any]
    post_grasp_retreat: dict[str, Any]
    post_place_retreat: dict[str, Any]
    max_contact_force: float
    allowed_touch_objects: list[str]
    segment: int
    object: str
    kind: str
    tool_pose: dict[str, Any]
    x: float
    y: float
    z: float
    theta: float
    width: float
    opening: float
    confidence: float
    lower_95: float
    moves: float
    antipodal: str
    completed: bool
    contacts: list[GraspContact]


class SceneGrasps(TypedDict):
    """The grasps of a scene, best first, or the reason why there are none."""

    reason: str
    advice: str
    table_height: float
    tried: dict[str, int]
    segments: list[SceneSegment]
    grasps: list[SceneGrasp]
    grasps_left_out: int


class ReconstructedMesh(TypedDict):
    """A closed surface, how well it fits, and how much of it was seen. ``commit`` is empty if it
    was there already. The bytes ``blob`` are a PLY file, m, in the object's frame, whose
    vertices say by ``seen`` whether they were measured or filled in.
    """

    object: str
    mesh: str
    blob: str
    views: int
    seen_share: float
    median_residual: float
    residual_90: float
    watertight: bool
    commit: str


class SimilarObjects(TypedDict):
    """Similar known objects, best first, or suggested kinds."""

    similar_objects: list[SimilarObject]
    suggestions: list[str]
    outcome: NotRequired[str]
    accepted: NotRequired[bool]
    family: NotRequired[str]
    differs: NotRequired[str]
    ask_again: NotRequired[bool]
    in_other_light: NotRequired[bool]
    views_untried: NotRequired[int]
    word_seen: NotRequired[str]
    word_stored: NotRequired[str]
    message: NotRequired[str]


class OfferedObject(TypedDict):
    """A visible object that fits a request; lengths in m, masses in kg."""

    object: str
    class_iri: str
    label: str
    capability: str
    text: str
    width: float | None
    mass: float | None
    mass_bound: float | None
    chance: float | None
    seen: str
    thing: str


class Reason(TypedDict):
    """Reason why a request is not met, or not by this object."""

    code: str
    text: str
    object: str
    label: str
    value: float | None
    limit: float | None
    seen: str
    seen_by: str
    place: dict[str, Any] | None


class ResolvedRequest(TypedDict):
    """An object that fits a request, with its grasps, or the reasons why there is none."""

    task_response: str
    object: str
    thing: str
    class_iri: str
    label: str
    grasps: list[RecalledGrasp]
    grasps_left_out: int
    objects: list[OfferedObject]
    reasons: list[Reason]
    understood: dict[str, Any]
    explanation: dict[str, Any]
    suggestions: list[str]
    objects_untried: int


class OtherThing(TypedDict):
    """A thing that another one may be."""

    thing: str
    chance: float


class LocatedThing(TypedDict):
    """Where one thing was at the time in question."""

    thing: str
    object: str
    label: str
    relation: str
    place: str
    place_label: str
    frame_id: str
    frame: str
    frame_reason: str
    pose: dict[str, Any] | None
    since: float | None
    seen: float | None
    until: float | None
    by: str
    still_there: float
    radius90: float | None
    may_be: list[OtherThing]
    text: str


class Located(TypedDict):
    """Where the things are that a question is about, best known first."""

    known: bool
    text: str
    time: float
    things: list[LocatedThing]
    things_untried: int


class StatedPlace(TypedDict):
    """The commit, which can be undone."""

    commit: str


class StatedReach(TypedDict):
    """What was stated, and the commit, which can be undone."""

    robot: str
    place: str
    commit: str


class ReportedSightings(TypedDict):
    """Which things these are, and the commit, which can be undone."""

    things: list[str]
    new: int
    commit: str


class PastPlace(TypedDict):
    """A place at which the thing was."""

    relation: str
    place: str
    place_label: str
    frame: str
    pose: dict[str, Any] | None
    arrived_after: float | None
    since: float
    seen: float
    until: float | None
    left_before: float | None
    by: str
    moved_by: str


class Traced(TypedDict):
    """Places of a thing, oldest first."""

    thing: str
    object: str
    label: str
    places: list[PastPlace]
    places_left_out: int


class DrawnNode(TypedDict):
    """A frame, robot, place or thing."""

    kind: str
    node: str
    label: str
    pose: dict[str, Any]
    size: list[float]
    radius90: float | None
    still_there: float
    somewhere: str
    region: list[float]


class DrawnScene(TypedDict):
    """What is where in one tree of frames, each after its parent."""

    time: float
    root: str
    frame_id: str
    nodes: list[DrawnNode]
    nodes_left_out: int
    unplaced: list[str]


class LocatedFrame(TypedDict):
    """Where a frame stood in another; "not known" is an answer."""

    known: bool
    text: str
    frame: str
    target: str
    pose: dict[str, Any] | None
    sigma: float | None
    time: float
    path: list[str]


class StatedFrame(TypedDict):
    """The frame, and the commit, which can be undone."""

    frame: str
    parent: str
    commit: str


class PlanReason(TypedDict):
    """Why a precondition of a step holds when its turn comes."""

    text: str
    step: int | None
    assumed: bool
    statement: list[str] | None


class PlanStep(TypedDict):
    """One task of a plan."""

    step: int
    action: str
    arguments: dict[str, Any]
    robots: list[str]
    text: str
    duration_s: float
    start_s: float
    chance: float
    successes: int
    attempts: int
    after: list[int]
    because: list[PlanReason]
    why: str
    outcomes: str


class PlanRefusal(TypedDict):
    """Why one goal is out of reach."""

    goal: str
    text: str
    missing: list[str]
    by_robot: dict[str, Any]


class GoalPlan(TypedDict):
    """A plan, or the reasons why there is none."""

    goal: str
    understood: list[str]
    sparql: list[str]
    complete: bool
    steps: list[PlanStep]
    refusals: list[PlanRefusal]
    assumptions: list[str]
    names: dict[str, Any]
    duration_s: float
    chance: float
    deadline: NotRequired[float | None]
    settled: NotRequired[str]
    digest: str
    text: str
    domain: NotRequired[str]
    problem: NotRequired[str]
    behaviour_tree: NotRequired[str]


class StoredPlan(TypedDict):
    """A plan, and where it is stored."""

    goal: str
    understood: list[str]
    sparql: list[str]
    complete: bool
    steps: list[PlanStep]
    refusals: list[PlanRefusal]
    assumptions: list[str]
    names: dict[str, Any]
    duration_s: float
    chance: float
    deadline: NotRequired[float | None]
    settled: NotRequired[str]
    digest: str
    text: str
    domain: NotRequired[str]
    problem: NotRequired[str]
    behaviour_tree: NotRequired[str]
    task: str
    commit: str
    late_s: NotRequired[float]


class ListedStep(TypedDict):
    """A step of a stored plan."""

    task: str
    step: int
    text: str
    state: str
    robots: list[str]
    claimed_by: str
    why: str
    comment: str
    question: str
    assignment: str
    taken_from: list[str]


class ListedPlan(TypedDict):
    """A stored plan."""

    task: str
    goal: str
    state: str
    priority: int
    deadline: float | None
    cancelled: str
    asking_price: float | None
    failing_price: float | None
    steps: list[ListedStep]
    open_goals: list[str]
    allows_part: bool
    settled: str
    behaviour_tree: NotRequired[str]


class ListedPlans(TypedDict):
    """Stored plans in the order in which they were stored."""

    plans: list[ListedPlan]


class StepAnswer(TypedDict):
    """What came of the last question about a step."""

    question: str
    kind: str
    code: str
    place: str
    by: str
    remark: str


class WaitingStep(TypedDict):
    """A step of the robot that cannot be begun now."""

    plan: str
    task: str
    text: str
    why: str
    stuck: bool


class TakenStep(TypedDict):
    """A step that another robot took over."""

    plan: str
    task: str
    text: str
    why: str


class ClaimedStep(TypedDict):
    """The step that is the robot's now, or why there is none."""

    claimed: bool
    plan: NotRequired[str]
    goal: NotRequired[str]
    task: NotRequired[str]
    action: NotRequired[str]
    arguments: NotRequired[dict[str, Any]]
    text: NotRequired[str]
    until: NotRequired[float]
    resumed: NotRequired[bool]
    reason: NotRequired[str]
    chance: NotRequired[float]
    answer: NotRequired[StepAnswer | None]
    asks: NotRequired[bool]
    asked: NotRequired[list[str]]
    waiting: list[WaitingStep]
    taken: list[TakenStep]


class EndedStep(TypedDict):
    """The commit; empty if it ended in that way before."""

    commit: str


class CancelledPlan(TypedDict):
    """The commit, which can be undone; empty if it was cancelled before."""

    commit: str


class AskedPerson(TypedDict):
    """Whether the question waits for an answer, and why."""

    asked: bool
    question: str
    gain: float
    reason: str
    commit: str


class ListedChoice(TypedDict):
    """One answer to choose from."""

    number: int
    code: str
    text: str
    place: str
    helps: bool


class ListedQuestion(TypedDict):
    """A question of a robot."""

    question: str
    task: str
    step: str
    plan: str
    goal: str
    robot: str
    robot_name: str
    thing: str
    kind: str
    text: str
    reason: str
    state: str
    asked: float
    until: float
    choices: list[ListedChoice]
    otherwise: int
    chosen: int
    answered_by: str
    remark: str
    picture: str


class ListedQuestions(TypedDict):
    """Questions in the order in which they were asked."""

    questions: list[ListedQuestion]
    helped: int
    ended: int


class AnsweredQuestion(TypedDict):
    """The commit, which can be undone; empty if the same was answered before."""

    commit: str


class FailureCause(TypedDict):
    """What may have made it fail."""

    kind: str
    chance: float
    text: str
    evidence: list[str]


class FailureChange(TypedDict):
    """A single fact that could have been otherwise."""

    kind: str
    text: str
    chance: float
    robot: str
    hand: str
    grasp: str
    along: float | None


class FailureExplained(TypedDict):
    """Causes with their chances, and the smallest change under which it would have held."""

    subject: str
    attempt: str
    step: str
    ended: bool
    assignment: str
    held: bool
    reason: str
    causes: list[FailureCause]
    change: FailureChange | None
    mends: bool
    others: list[FailureChange]
    text: str


class Resembled(TypedDict):
    """A stored object that a new one may be."""

    object: str
    label: str
    confidence: float


InsertedObject = TypedDict(
    "InsertedObject",
    {
        "object": str,
        "class": str,
        "class_iri": str,
        "label": str,
        "grasp": str,
        "view": str,
        "new": bool,
        "features": int,
        "commit": str,
        "thing": NotRequired[str],
        "same_print": NotRequired[list[str]],
        "resembles": NotRequired[Resembled | None],
        "message": NotRequired[str],
    },
)
"""Result for one entry."""


class Inserted(TypedDict):
    """Result of an insertion."""

    stored: int
    commit: str
    objects: list[InsertedObject]


class ReportedOutcome(TypedDict):
    """The attempt as it was stored, and the statistics of its grasp over all robots."""

    stored: int
    commit: str
    statistics: GraspStatistics
    grasp: str
    thing: NotRequired[str]
    message: NotRequired[str]


class ReportedRefusal(TypedDict):
    """Whether the action was stored."""

    stored: int
    commit: str


class GivenVerdict(TypedDict):
    """One person's verdict on an attempt."""

    by: str
    held: bool
    reason: str
    comment: str
    time: str


class Feedback(TypedDict):
    """All verdicts on an attempt, and the resulting label."""

    stored: int
    commit: str
    attempt: str
    grasp: str
    decided: bool
    reason: str
    held: bool | None
    disputed: bool
    held_votes: int
    lost_votes: int
    verdicts: list[GivenVerdict]
    text: str
    statistics: GraspStatistics
    confidence: float | None


class Taught(TypedDict):
    """The objects found or stored; its own fields are there only if something was stored."""

    similar_objects: list[SimilarObject]
    suggestions: list[str]
    outcome: NotRequired[str]
    accepted: NotRequired[bool]
    family: NotRequired[str]
    differs: NotRequired[str]
    ask_again: NotRequired[bool]
    in_other_light: NotRequired[bool]
    views_untried: NotRequired[int]
    word_seen: NotRequired[str]
    word_stored: NotRequired[str]
    message: NotRequired[str]
    stored: NotRequired[int]
    commit: NotRequired[str]
    objects: NotRequired[list[InsertedObject]]
    grasp: NotRequired[str]
    statistics: NotRequired[GraspStatistics | None]


class Curated(TypedDict):
    """The resulting object, and the commit, which can be undone."""

    object: str
    commit: str
    added: int
    removed: int


class Contributor(TypedDict):
    """Reports of a robot, and their agreement with others' reports on the same grasps."""

    name: str
    attempts: int
    comparable: int
    agreement: float | None
    interval95: list[float]
    truthful: float
    manner: str
    weight: float
    finding: Literal["agrees", "doubtful", "contradicts"]
    text: str


class ComparedContributors(TypedDict):
    """Contributors, the least truthful first."""

    contributors: list[Contributor]


class WithdrawnContributor(TypedDict):
    """Statements that were withdrawn, and the commit, which can be undone."""

    commit: str
    attempts: int
    verdicts: int
    objects: int
    kept: int
    grasps: int
    added: int
    removed: int


class Calls(ABC):
    """One method for each operation; what is left out, or None, is not sent."""

    @abstractmethod
    def _operate(self, operation: str, given: dict[str, Any]) -> Any:
        """Carry out an operation with the local variables of its method."""

    def register_robot(
        self,
        *,
        name: str,
        model: str,
        simulated: bool | None = None,
        end_effectors: Sequence[EndEffector | Mapping[str, Any]],
        cameras: Sequence[Camera | Mapping[str, Any]] | None = None,
        frames: Sequence[str] | None = None,
        places: Sequence[PlaceOfWork | Mapping[str, Any]] | None = None,
        replace: bool | None = None,
    ) -> RegisteredRobot:
        """Register a robot with its grippers, cameras and frames.

        Parameters
        ----------
        name
            the robot's name; with a token, the token's agent
        model
            make and version, such as nao-h25-v5
        simulated
            whether it is simulated; default: False
        end_effectors
            its grippers
        cameras
            its cameras
        frames
            names of its frames, the base frame first
        places
            tables and boxes at which it works, where they are now; what was put there is drawn
            there
        replace
            whether the body has changed since the last registration; default: another one is
            refused; default: False
        """
        answer: RegisteredRobot = self._operate("register_robot", locals())
        return answer

    def recognise_for_grasp(
        self,
        *,
        task: str | None = None,
        gripper_id: str,
        data: Bytes | Mapping[str, Any] | None = None,
        new_point_cloud: Bytes | Mapping[str, Any] | None = None,
        image: Bytes | Mapping[str, Any] | None = None,
        mask: Bytes | Mapping[str, Any] | None = None,
        label: int | None = None,
        box: Sequence[float] | None = None,
        object_pose: Mapping[str, Any] | None = None,
        sensor_pose: Mapping[str, Any] | None = None,
        frame_id: str | None = None,
        support_height: float | None = None,
        stamp: float | Mapping[str, int] | None = None,
        looks: Sequence[Look | Mapping[str, Any]] | None = None,
        object: str | None = None,
        min_confidence: float | None = None,
        max_grasps: int | None = None,
        propose: bool | None = None,
        in_space: bool | None = None,
        exclude: Sequence[str] | None = None,
        seed: int | None = None,
        neighbours: Sequence[Sequence[float]] | None = None,
        decide: bool | None = None,
        min_identity: float | None = None,
        min_pose: float | None = None,
        min_grasp: float | None = None,
        preset: Literal["faithful", "fast", "real"] | None = None,
        cautious: bool | None = None,
        unknown: Literal["refuse", "if_new", "grasp"] | None = None,
    ) -> Recognition:
        """Name an object and the grasps to try, in order.

        Parameters
        ----------
        task
            purpose of the grasp: pick, place, push; default: pick
        gripper_id
            name or IRI of the end effector
        data, new_point_cloud
            base64 of one object's cloud, compressed or as sensor_msgs/PointCloud2; default: the
            image
        image
            base64 PNG or JPEG, or a sensor_msgs/CompressedImage; default: the colours of the cloud
        mask
            the object's pixels, base64 PNG of labels or COCO run lengths; default: by depth or
            colour
        label
            which label of the mask; default: all
        box
            around the object: left, top, width, height in the image, px; default: the whole
        object_pose
            pose of the object in frame_id that another estimator found; default: estimated
        sensor_pose
            pose of the camera in frame_id; default: identity
        frame_id
            frame of the robot with z up, e.g. base_footprint; default: that of the camera
        support_height
            height of the table in frame_id; default: lowest point (m)
        stamp
            time of the observation; default: now (s)
        looks
            further observations of the same object: the answer is that of all of them together
        object
            IRI of an object that the robot has tracked; default: recognised
        min_confidence
            least confidence to count as recognised; default: by the policy
        max_grasps
            maximum number of grasps; default: 10
        propose
            propose grasps if none is known; default: False
        in_space
            include known grasps from any direction, for arms that can reach; default: False
        exclude
            ids of grasps not to offer again
        seed
            seed of the choice; default: 0
        neighbours
            points of neighbouring objects in frame_id; default: none
        decide
            answer with a grasp, or with the confidence that is too low; default: False
        min_identity
            c_I, least confidence in the identity; default: decide says
        min_pose
            c_T, least confidence in the pose; default: decide says
        min_grasp
            c_G, least confidence in the grasp; default: decide says
        preset
            kind of physics that the robot is in: faithful, fast or real; default: not known
        cautious
            compare c_G with the lower end of the interval90 of a grasp, not with its mean; default:
            False
        unknown
            in a decision, whether to grasp what is not recognised: refuse; if_new, unless another
            view may recognise it; grasp; default: refuse
        """
        answer: Recognition = self._operate("recognise_for_grasp", locals())
        return answer

    def recall_grasps(
        self,
        *,
        object: str,
        gripper_id: str | None = None,
        max_grasps: int | None = None,
        in_space: bool | None = None,
    ) -> RecalledGrasps:
        """List the known grasps of a known object.

        Parameters
        ----------
        object
            IRI, objectId or name of the object
        gripper_id
            restricts the answer to its type; default: all types
        max_grasps
            maximum number of grasps; default: 10
        in_space
            include grasps from any direction, not only from above; default: True
        """
        answer: RecalledGrasps = self._operate("recall_grasps", locals())
        return answer

    def recall_motions(
        self,
        *,
        object: str | None = None,
        gripper_id: str | None = None,
        joints: Sequence[FollowingJoint | Mapping[str, Any]] | None = None,
        held: bool | None = None,
        any_body: bool | None = None,
        max_motions: int | None = None,
        max_samples: int | None = None,
    ) -> RecalledMotions:
        """List movements that robots recorded, as far as one can follow them.

        Parameters
        ----------
        object
            IRI, objectId or name of the object that was grasped; default: any
        gripper_id
            name or IRI of the hand that shall follow; default: the robot's only one
        joints
            joints that shall follow; default: the recorded ones, so that only the same body can
        held
            only movements of attempts that held; default: True
        any_body
            also return the movements of other bodies, as recorded, for a caller that adapts them;
            default: False
        max_motions
            maximum number of movements; default: 3
        max_samples
            maximum number of samples of each, at equal steps of time; default: 200
        """
        answer: RecalledMotions = self._operate("recall_motions", locals())
        return answer

    def plan_in_space(
        self,
        *,
        object: str,
        gripper_id: str | None = None,
        mass: float | None = None,
        friction: float | None = None,
        position_std: float | None = None,
        rotation_std: float | None = None,
        samples: int | None = None,
        min_confidence: float | None = None,
        max_grasps: int | None = None,
        seed: int | None = None,
        surface: bool | None = None,
    ) -> PlannedGrasps:
        """Plan grasps in space of a known object and store them.

        Parameters
        ----------
        object
            IRI, objectId or name of the object
        gripper_id
            name or IRI of the end effector; default: the robot's only one
        mass
            mass of the object to lift; default: as stored (kg)
        friction
            coefficient between pads or lip and object; default: that of the gripper
        position_std
            standard deviation of the object's position (m); default: 0.004
        rotation_std
            standard deviation of its rotation (rad); default: 0.1
        samples
            number of perturbed poses of each grasp; default: 100
        min_confidence
            c_G; grasps below it are not stored; default: 0.3
        max_grasps
            maximum number to store; default: 10
        seed
            seed of the random numbers; default: 0
        surface
            plan on the reconstructed surface, if a current one is good enough, and not on the
            cloud; default: False
        """
        answer: PlannedGrasps = self._operate("plan_in_space", locals())
        return answer

    def plan_on_scene(
        self,
        *,
        data: Bytes | Mapping[str, Any],
        gripper_id: str | None = None,
        sensor_pose: Mapping[str, Any],
        frame_id: str,
        support_height: float | None = None,
        region: list[float] | None = None,
        min_confidence: float | None = None,
        complete: bool | None = None,
        recognise: bool | None = None,
        max_grasps: int | None = None,
        samples: int | None = None,
        seed: int | None = None,
    ) -> SceneGrasps:
        """Plan grasps in clutter: of everything in one view of a table.

        Parameters
        ----------
        data
            base64 of the whole view: a frame with depth, compressed or as sensor_msgs/PointCloud2
        gripper_id
            name or IRI of the end effector; default: the robot's only one
        sensor_pose
            pose of the camera, in whose frame the data is, in frame_id
        frame_id
            frame of the robot with z up, e.g. base_footprint
        support_height
            height of the table in frame_id; default: the largest level plane (m)
        region
            x from, x to, y from, y to in frame_id, m: what lies elsewhere is left out
        min_confidence
            c_G; grasps below it are not offered; default: 0.0
        complete
            complete the hidden sides of things; default: True
        recognise
            look each thing up in the graph; needs colours; default: False
        max_grasps
            maximum number of grasps; default: 10
        samples
            number of perturbed poses of each grasp; default: 50
        seed
            seed of the random numbers; default: 0
        """
        answer: SceneGrasps = self._operate("plan_on_scene", locals())
        return answer

    def reconstruct_mesh(
        self,
        *,
        object: str,
        again: bool | None = None,
    ) -> ReconstructedMesh:
        """Reconstruct the surface of a known object from its views.

        Parameters
        ----------
        object
            IRI, objectId or name of the object
        again
            reconstruct it even if there is one that was made from the present model; default: False
        """
        answer: ReconstructedMesh = self._operate("reconstruct_mesh", locals())
        return answer

    def search_object(
        self,
        *,
        data: Bytes | Mapping[str, Any] | None = None,
        new_point_cloud: Bytes | Mapping[str, Any] | None = None,
        image: Bytes | Mapping[str, Any] | None = None,
        mask: Bytes | Mapping[str, Any] | None = None,
        label: int | None = None,
        box: Sequence[float] | None = None,
        object_pose: Mapping[str, Any] | None = None,
        sensor_pose: Mapping[str, Any] | None = None,
        frame_id: str | None = None,
        support_height: float | None = None,
        stamp: float | Mapping[str, int] | None = None,
        looks: Sequence[Look | Mapping[str, Any]] | None = None,
        class_description: str | None = None,
        max_results: int | None = None,
        min_confidence: float | None = None,
    ) -> SimilarObjects:
        """List known objects that look like this one.

        Parameters
        ----------
        data, new_point_cloud
            base64 of one object's cloud, compressed or as sensor_msgs/PointCloud2; default: the
            image
        image
            base64 PNG or JPEG, or a sensor_msgs/CompressedImage; default: the colours of the cloud
        mask
            the object's pixels, base64 PNG of labels or COCO run lengths; default: by depth or
            colour
        label
            which label of the mask; default: all
        box
            around the object: left, top, width, height in the image, px; default: the whole
        object_pose
            pose of the object in frame_id that another estimator found; default: estimated
        sensor_pose
            pose of the camera in frame_id; default: identity
        frame_id
            frame of the robot with z up, e.g. base_footprint; default: that of the camera
        support_height
            height of the table in frame_id; default: lowest point (m)
        stamp
            time of the observation; default: now (s)
        looks
            further observations of the same object: the answer is that of all of them together
        class_description
            restricts the answer to kinds of objects, in words; default: all kinds
        max_results
            maximum number of objects; default: 10
        min_confidence
            least confidence of an entry; default: by the policy
        """
        answer: SimilarObjects = self._operate("search_object", locals())
        return answer

    def resolve_request(
        self,
        *,
        wanted: str,
        gripper_id: str | None = None,
        objects: Sequence[str] | None = None,
        seen_within_s: float | None = None,
        exclude: Sequence[str] | None = None,
        max_grasps: int | None = None,
        prove: bool | None = None,
    ) -> ResolvedRequest:
        """Choose a seen object that serves a request, and its grasps.

        Parameters
        ----------
        wanted
            words, or the IRI of a class or function
        gripper_id
            name or IRI of the end effector to hold it; default: the robot's only one
        objects
            IRIs of the objects seen now, perhaps none; default: those seen within seen_within_s
        seen_within_s
            without objects: maximum age of an observation (s); default: 600.0
        exclude
            IRIs of objects not to offer again
        max_grasps
            maximum number of grasps; default: 10
        prove
            include the reasoner's proofs; default: True
        """
        answer: ResolvedRequest = self._operate("resolve_request", locals())
        return answer

    def where_is(
        self,
        *,
        name: str,
        stamp: float | Mapping[str, int] | None = None,
        frame: str | None = None,
        near: str | None = None,
        radius: float | None = None,
        max_things: int | None = None,
    ) -> Located:
        """Tell where something is or was, since when, and how sure that is.

        Parameters
        ----------
        name
            IRI or name of a thing or product, an objectId, or a kind such as cup
        stamp
            time that is asked about; default: now (s)
        frame
            frame for poses: its name in tf, robot/name or its IRI; default: as measured
        near
            only what is in, on or near this place, robot, frame or thing; default: anywhere
        radius
            how near that is; with a robot and the reach of its arm: what it can reach (m); default:
            0.5
        max_things
            how many things of that name are looked at; default: 200
        """
        answer: Located = self._operate("where_is", locals())
        return answer

    def state_place(
        self,
        *,
        thing: str,
        place: str | None = None,
        inside: bool | None = None,
        lost: bool | None = None,
        stamp: float | Mapping[str, int] | None = None,
        agent: str | None = None,
    ) -> StatedPlace:
        """State where a thing is from now on.

        Parameters
        ----------
        thing
            IRI of the thing
        place
            IRI of the place or end effector; default: none, which must be said by lost
        inside
            whether it is in the place, and not on it; default: False
        lost
            whether it is no longer where it was, and nobody knows where; default: False
        stamp
            since when; default: now (s)
        agent
            in whose name; default: the caller
        """
        answer: StatedPlace = self._operate("state_place", locals())
        return answer

    def state_reach(
        self,
        *,
        place: str,
        robot: str | None = None,
        withdrawn: bool | None = None,
        agent: str | None = None,
    ) -> StatedReach:
        """State that a robot reaches a table or box.

        Parameters
        ----------
        place
            IRI of the table or box, or its name: that of the robot itself before those of others
        robot
            name or IRI of the robot; default: the caller
        withdrawn
            whether the caller takes back that it has stated this; default: False
        agent
            in whose name; default: the caller
        """
        answer: StatedReach = self._operate("state_reach", locals())
        return answer

    def report_sightings(
        self,
        *,
        frame: str,
        seen: Sequence[SeenThing | Mapping[str, Any]] | None = None,
        gone: Sequence[str] | None = None,
        stamp: float | Mapping[str, int] | None = None,
        agent: str | None = None,
    ) -> ReportedSightings:
        """Store which things a robot saw where, and which are gone.

        Parameters
        ----------
        frame
            frame of the poses: its name in tf, robot/name or its IRI
        seen
            what was seen
        gone
            IRIs of things that were looked for where they were, in plain view, and are not there
        stamp
            when the robot looked; default: now (s)
        agent
            in whose name; default: the caller
        """
        answer: ReportedSightings = self._operate("report_sightings", locals())
        return answer

    def trace_thing(
        self,
        *,
        name: str,
        stamp: float | Mapping[str, int] | None = None,
        max_places: int | None = None,
    ) -> Traced:
        """Tell where a thing was, one place after the other, and who moved it.

        Parameters
        ----------
        name
            IRI of the thing, or a name that only one thing has
        stamp
            time up to which its places are asked for; default: now (s)
        max_places
            how many of the latest places are listed; default: 100
        """
        answer: Traced = self._operate("trace_thing", locals())
        return answer

    def show_world(
        self,
        *,
        stamp: float | Mapping[str, int] | None = None,
        frame: str | None = None,
        max_nodes: int | None = None,
    ) -> DrawnScene:
        """List what is where at a time: frames, robots, places and things.

        Parameters
        ----------
        stamp
            time that is asked about; default: now (s)
        frame
            any frame of the tree: its name in tf, robot/name or its IRI; default: the fullest tree
        max_nodes
            how many frames, robots, places and things are answered; default: 2000
        """
        answer: DrawnScene = self._operate("show_world", locals())
        return answer

    def locate_frame(
        self,
        *,
        frame: str,
        target: str | None = None,
        stamp: float | Mapping[str, int] | None = None,
    ) -> LocatedFrame:
        """Tell where a frame stood in another one at a time.

        Parameters
        ----------
        frame
            its name in tf, robot/name or its IRI
        target
            frame in which its pose is asked for; default: the root of its tree
        stamp
            time that is asked about; default: now (s)
        """
        answer: LocatedFrame = self._operate("locate_frame", locals())
        return answer

    def state_frame(
        self,
        *,
        frame: str,
        parent: str | None = None,
        pose: Mapping[str, Any] | None = None,
        sigma: float | None = None,
        stamp: float | Mapping[str, int] | None = None,
        lost: bool | None = None,
        agent: str | None = None,
    ) -> StatedFrame:
        """State where a frame stands in another one.

        Parameters
        ----------
        frame
            its name in tf, robot/name or its IRI; made if the graph has none of that name
        parent
            the frame in which it stands; default: none, for the root of a tree
        pose
            geometry_msgs/Pose of the frame in its parent; default: none, for the root of a tree
        sigma
            standard deviation of the position per axis (m); default: 0.0
        stamp
            since when; default: now (s)
        lost
            whether it no longer stands where it did, and nobody knows where; default: False
        agent
            in whose name; default: the caller
        """
        answer: StatedFrame = self._operate("state_frame", locals())
        return answer

    def plan_goal(
        self,
        *,
        goal: str,
        assume_reach: bool | None = None,
        pddl: bool | None = None,
        behaviour_tree: bool | None = None,
        branch: str | None = None,
    ) -> GoalPlan:
        """Plan what robots do for a goal, or say why none can reach it.

        Parameters
        ----------
        goal
            words such as "every cup into the left box", PATTERN WHERE { SPARQL }, or JSON
        assume_reach
            plan as if robots reached places of which that is not known, and say so; default: False
        pddl
            also answer domain and problem for other planners; default: False
        behaviour_tree
            also answer XML of BehaviorTree.CPP 4; default: False
        branch
            name of the branch of the graph to plan in; default: the graph itself
        """
        answer: GoalPlan = self._operate("plan_goal", locals())
        return answer

    def store_plan(
        self,
        *,
        goal: str,
        assume_reach: bool | None = None,
        digest: str | None = None,
        agent: str | None = None,
        priority: int | None = None,
        deadline: float | None = None,
        replaces: str | None = None,
        asking_price: float | None = None,
        failing_price: float | None = None,
        allow_part: bool | None = None,
    ) -> StoredPlan:
        """Store the plan for a goal, so that robots can carry it out.

        Parameters
        ----------
        goal
            the goal, as for plan_goal
        assume_reach
            as for plan_goal; default: False
        digest
            digest of the plan that was agreed to: another one is not stored; default: any
        agent
            in whose name; default: the caller
        priority
            plans with a greater one are begun first; default: 0
        deadline
            Unix time after which no step is begun; default: what the goal says, or none (s)
        replaces
            IRI of an earlier plan for the goal, of which nothing more is begun; default: none
        asking_price
            what a question to a person costs, in any unit; default: nobody is asked
        failing_price
            what a failed step costs, in the unit of asking_price; default: nobody is asked
        allow_part
            store the steps for what can be reached, and the rest as open goals; else all or
            nothing; default: False
        """
        answer: StoredPlan = self._operate("store_plan", locals())
        return answer

    def list_plans(
        self,
        *,
        state: Literal["open", "all"] | None = None,
        behaviour_tree: bool | None = None,
    ) -> ListedPlans:
        """List stored plans with their steps, and who does what and why.

        Parameters
        ----------
        state
            open: those that are not done, cancelled or replaced; default: open
        behaviour_tree
            also answer XML of BehaviorTree.CPP 4; default: False
        """
        answer: ListedPlans = self._operate("list_plans", locals())
        return answer

    def claim_step(
        self,
        *,
        robot: str | None = None,
        lease: float | None = None,
    ) -> ClaimedStep:
        """Claim the next step that a robot can begin.

        Parameters
        ----------
        robot
            name or IRI of the robot; default: the caller
        lease
            how long the step is the robot's unless it asks again (s); default: 300.0
        """
        answer: ClaimedStep = self._operate("claim_step", locals())
        return answer

    def end_step(
        self,
        *,
        task: str,
        result: Literal["done", "failed", "declined", "released"],
        robot: str | None = None,
        outcome: str | None = None,
        place: str | None = None,
        lost: bool | None = None,
        comment: str | None = None,
    ) -> EndedStep:
        """Say how a claimed step ended.

        Parameters
        ----------
        task
            IRI of the step
        result
            declined: by a person; released: untouched, so that it may be claimed again
        robot
            name or IRI of the robot; default: the caller
        outcome
            task_id of the report_outcome about it, whose attempt is linked to it; default: none
        place
            IRI of the place or end effector where the thing is now; default: as the graph has it
        lost
            whether nobody knows where the thing is now; default: False
        comment
            what happened; default: nothing to say
        """
        answer: EndedStep = self._operate("end_step", locals())
        return answer

    def cancel_plan(
        self,
        *,
        plan: str,
        reason: str,
        operator: str | None = None,
    ) -> CancelledPlan:
        """Cancel a stored plan.

        Parameters
        ----------
        plan
            IRI of the plan
        reason
            why
        operator
            name of the person; default: the caller
        """
        answer: CancelledPlan = self._operate("cancel_plan", locals())
        return answer

    def ask_person(
        self,
        *,
        task: str,
        kind: str,
        text: str,
        choices: Sequence[OfferedChoice | Mapping[str, Any]],
        otherwise: int | None = None,
        chance: float | None = None,
        retries: int | None = None,
        patience: float | None = None,
        picture: Bytes | Mapping[str, Any] | None = None,
        robot: str | None = None,
    ) -> AskedPerson:
        """Ask a person about a claimed step, if that is worth its price.

        Parameters
        ----------
        task
            IRI of the step
        kind
            code of what is asked, such as act or where; a robot asks once about a step in each
        text
            the question
        choices
            the answers to choose from
        otherwise
            number of the choice that the robot makes where nobody answers in time, from 1; default:
            1
        chance
            that the step succeeds if nobody is asked; default: as planned
        retries
            how often the step is tried again where it fails; default: 0
        patience
            how long the step waits for an answer (s); default: 600.0
        picture
            what the robot sees; default: none
        robot
            name or IRI of the robot; default: the caller
        """
        answer: AskedPerson = self._operate("ask_person", locals())
        return answer

    def list_questions(
        self,
        *,
        state: Literal["open", "all"] | None = None,
    ) -> ListedQuestions:
        """List what robots ask, with the answers to choose from.

        Parameters
        ----------
        state
            open: those that wait for an answer; default: open
        """
        answer: ListedQuestions = self._operate("list_questions", locals())
        return answer

    def answer_question(
        self,
        *,
        question: str,
        choice: int,
        remark: str | None = None,
        operator: str | None = None,
    ) -> AnsweredQuestion:
        """Answer a question of a robot.

        Parameters
        ----------
        question
            IRI of the question
        choice
            number of the choice, from 1
        remark
            what the person says besides; default: nothing
        operator
            name of the person; default: the caller
        """
        answer: AnsweredQuestion = self._operate("answer_question", locals())
        return answer

    def explain_failure(
        self,
        *,
        subject: str,
    ) -> FailureExplained:
        """Say why an attempt or a step failed, and what would have mended it.

        Parameters
        ----------
        subject
            IRI of an attempt, a task, a step of a plan or a stored plan, or an object's IRI or
            name: its latest attempt that failed
        """
        answer: FailureExplained = self._operate("explain_failure", locals())
        return answer

    def insert_object(
        self,
        *,
        objects: Sequence[NewObject | Mapping[str, Any]] | None = None,
        data: Bytes | Mapping[str, Any] | None = None,
        new_point_cloud: Bytes | Mapping[str, Any] | None = None,
        image: Bytes | Mapping[str, Any] | None = None,
        mask: Bytes | Mapping[str, Any] | None = None,
        label: int | None = None,
        box: Sequence[float] | None = None,
        object_pose: Mapping[str, Any] | None = None,
        sensor_pose: Mapping[str, Any] | None = None,
        frame_id: str | None = None,
        support_height: float | None = None,
        stamp: float | Mapping[str, int] | None = None,
        object: str | None = None,
        thing: str | None = None,
        name: str | None = None,
        class_description: str | None = None,
        function: str | None = None,
        gripper_id: str | None = None,
        task: str | None = None,
        grasp: str | Mapping[str, Any] | None = None,
        X: float | None = None,
        Y: float | None = None,
        Z: float | None = None,
        rad: float | None = None,
        success: bool | None = None,
        confirmed_by: Literal["physics", "human"] | None = None,
        operator: str | None = None,
        outcome: OutcomeReport | Mapping[str, Any] | None = None,
        task_id: str | None = None,
        merge: bool | None = None,
    ) -> Inserted:
        """Store what was seen and the outcome of grasping it.

        Parameters
        ----------
        objects
            the observed objects
        data, new_point_cloud
            base64 of one object's cloud, compressed or as sensor_msgs/PointCloud2; default: the
            image
        image
            base64 PNG or JPEG, or a sensor_msgs/CompressedImage; default: the colours of the cloud
        mask
            the object's pixels, base64 PNG of labels or COCO run lengths; default: by depth or
            colour
        label
            which label of the mask; default: all
        box
            around the object: left, top, width, height in the image, px; default: the whole
        object_pose
            pose of the object in frame_id that another estimator found; default: estimated
        sensor_pose
            pose of the camera in frame_id; default: identity
        frame_id
            frame of the robot with z up, e.g. base_footprint; default: that of the camera
        support_height
            height of the table in frame_id; default: lowest point (m)
        stamp
            time of the observation; default: now (s)
        object
            IRI of an object that the robot has tracked; default: recognised, or new
        thing
            IRI of the single thing, if the robot knows which one it is; default: by place and time
        name
            name of the object; default: made of kind and number
        class_description
            kind of object in words; default: guessed from the shape
        function
            function of the object: write, contain liquid, ...; default: not known
        gripper_id
            name or IRI of the end effector used; default: the robot's only one
        task
            purpose of the grasp: pick, place, push; default: pick
        grasp
            the attempted grasp, as received; default: given by X, Y, Z and rad
        X
            of the grasp, in the frame of the cloud; default: no grasp (m)
        Y
            of the grasp, in the frame of the cloud; default: no grasp (m)
        Z
            of the grasp, in the frame of the cloud; default: no grasp (m)
        rad
            closing direction of the grasp, in the frame of the cloud; default: no grasp (rad)
        success
            whether the grasp held, without an outcome; default: True
        confirmed_by
            who confirmed it; default: a person
        operator
            name of the person who confirmed it; default: nobody
        outcome
            the outcome; default: given by success
        task_id
            from recognise_for_grasp, or any id; stored once for each id; default: a new task
        merge
            add the view to the object if it is recognised; default: True
        """
        answer: Inserted = self._operate("insert_object", locals())
        return answer

    def report_outcome(
        self,
        *,
        task_id: str | None = None,
        object: str | None = None,
        thing: str | None = None,
        grasp: str | Mapping[str, Any] | None = None,
        grasp_pose: str | Mapping[str, Any] | None = None,
        gripper_id: str | None = None,
        task: str | None = None,
        outcome: OutcomeReport | Mapping[str, Any] | None = None,
        success: bool | None = None,
        reason: str | None = None,
        lifted_m: float | None = None,
        slip: float | None = None,
        duration_s: float | None = None,
        confirmed_by: Literal["physics", "human"] | None = None,
        operator: str | None = None,
        stamp: float | Mapping[str, int] | None = None,
    ) -> ReportedOutcome:
        """Store the outcome of a grasp on a known object.

        Parameters
        ----------
        task_id
            of the decision; stored once for each id; default: a new task
        object
            IRI of the object; default: that of the decision
        thing
            IRI of the single thing; default: that of the decision, else the last one it handled
        grasp
            its id, or the whole grasp as received; default: given by grasp_pose
        grasp_pose
            geometry_msgs/PoseStamped of a grasp that was never offered; default: given by grasp
        gripper_id
            name or IRI of the end effector; default: the robot's only one
        task
            purpose of the grasp: pick, place, push; default: pick
        outcome
            the outcome; default: given by success and the fields after it
        success
            whether it held, without an outcome; default: given by outcome
        reason
            code of the reason, without an outcome; default: ok if it held, else not judged
        lifted_m
            height reached, without an outcome; default: not known (m)
        slip
            slip in the hand, without an outcome; default: not known (m)
        duration_s
            of the attempt, without an outcome; default: not known (s)
        confirmed_by
            who confirmed it; default: nobody
        operator
            name of the person who confirmed it; default: nobody
        stamp
            when the attempt ended, unless its outcome tells; default: now (s)
        """
        answer: ReportedOutcome = self._operate("report_outcome", locals())
        return answer

    def report_refusal(
        self,
        *,
        refusal: str,
        response: Literal[
            "second_look",
            "new_object",
            "measured_sides",
            "other_grasp",
            "postponed",
            "pushed",
            "left_alone",
        ],
    ) -> ReportedRefusal:
        """Store what a robot did after a refusal to grasp.

        Parameters
        ----------
        refusal
            IRI of the refusal, from the decision
        response
            second_look, new_object (grasped although not recognised), measured_sides (located
            without the doubtful pose), other_grasp (of another planner), postponed, pushed or
            left_alone
        """
        answer: ReportedRefusal = self._operate("report_refusal", locals())
        return answer

    def give_feedback(
        self,
        *,
        verdict: Literal["confirm", "refuse", "correct"],
        task_id: str | None = None,
        object: str | None = None,
        grasp: str | None = None,
        held: bool | None = None,
        reason: str | None = None,
        operator: str | None = None,
        comment: str | None = None,
    ) -> Feedback:
        """Confirm, correct or refuse what a robot reported.

        Parameters
        ----------
        verdict
            the person's verdict on the report
        task_id
            of the attempt to judge; default: found by grasp or object
        object
            IRI of the object whose last attempt is meant; default: found by task_id or grasp
        grasp
            IRI of the grasp whose last attempt is meant; default: found by task_id or object
        held
            whether it held, to correct the report; default: as the verdict says
        reason
            code of the reason in the person's opinion; default: none
        operator
            name of the person, or of the token's owner; default: the caller
        comment
            remark of the person; default: none
        """
        answer: Feedback = self._operate("give_feedback", locals())
        return answer

    def teach_object(
        self,
        *,
        operation: Literal["search", "teach", "confirm", "reject"],
        class_description: str | None = None,
        data: Bytes | Mapping[str, Any] | None = None,
        new_point_cloud: Bytes | Mapping[str, Any] | None = None,
        image: Bytes | Mapping[str, Any] | None = None,
        mask: Bytes | Mapping[str, Any] | None = None,
        label: int | None = None,
        box: Sequence[float] | None = None,
        object_pose: Mapping[str, Any] | None = None,
        sensor_pose: Mapping[str, Any] | None = None,
        frame_id: str | None = None,
        support_height: float | None = None,
        stamp: float | Mapping[str, int] | None = None,
        name: str | None = None,
        task_id: str | None = None,
        object: str | None = None,
        grasp: str | None = None,
        operator: str | None = None,
        comment: str | None = None,
    ) -> Taught:
        """Search by words, name an object, confirm or reject a grasp.

        Parameters
        ----------
        operation
            the kind of request
        class_description
            kind of object in words; default: no kind
        data, new_point_cloud
            base64 of one object's cloud, compressed or as sensor_msgs/PointCloud2; default: the
            image
        image
            base64 PNG or JPEG, or a sensor_msgs/CompressedImage; default: the colours of the cloud
        mask
            the object's pixels, base64 PNG of labels or COCO run lengths; default: by depth or
            colour
        label
            which label of the mask; default: all
        box
            around the object: left, top, width, height in the image, px; default: the whole
        object_pose
            pose of the object in frame_id that another estimator found; default: estimated
        sensor_pose
            pose of the camera in frame_id; default: identity
        frame_id
            frame of the robot with z up, e.g. base_footprint; default: that of the camera
        support_height
            height of the table in frame_id; default: lowest point (m)
        stamp
            time of the observation; default: now (s)
        name
            name of the object; default: made of kind and number
        task_id
            of the attempt to judge, or of what is taught; default: found by grasp or object
        object
            IRI of the object, in place of data or of task_id; default: given by data
        grasp
            IRI of the grasp whose last attempt is meant; default: found by task_id or object
        operator
            name of the person; default: the caller
        comment
            remark of the person; default: none
        """
        answer: Taught = self._operate("teach_object", locals())
        return answer

    def curate_object(
        self,
        *,
        operation: Literal["merge", "split", "forget", "undo"],
        object: str | None = None,
        into: str | None = None,
        views: Sequence[str] | None = None,
        name: str | None = None,
        purge: bool | None = None,
        commit: str | None = None,
        operator: str | None = None,
    ) -> Curated:
        """Merge two objects, split one, forget one, or undo such a change.

        Parameters
        ----------
        operation
            the kind of correction
        object
            IRI of the object, or its name; default: none, as for undo
        into
            merge: IRI or name of the object that is kept; default: none
        views
            split: IRIs of the views that show another object; forget: only these views
        name
            split: name of the new object; default: made of kind and number
        purge
            forget: also delete its attempts, and its bytes at once; default: False
        commit
            undo: the commit to undo, as answered; default: none
        operator
            name of the person; default: the caller
        """
        answer: Curated = self._operate("curate_object", locals())
        return answer

    def compare_contributors(
        self,
        *,
        contributor: str | None = None,
    ) -> ComparedContributors:
        """Tell how far the reports of each robot agree with those of the others.

        Parameters
        ----------
        contributor
            name of one robot; default: all
        """
        answer: ComparedContributors = self._operate("compare_contributors", locals())
        return answer

    def withdraw_contributor(
        self,
        *,
        contributor: str,
        operator: str | None = None,
        since: float | None = None,
        until: float | None = None,
    ) -> WithdrawnContributor:
        """Withdraw all that a robot or a person reported, and all that followed from it.

        Parameters
        ----------
        contributor
            name of the robot or person
        operator
            name of the person who withdraws it; default: the caller
        since
            Unix time: only what was stored from then on; default: all (s)
        until
            Unix time: only what was stored before; default: all (s)
        """
        answer: WithdrawnContributor = self._operate("withdraw_contributor", locals())
        return answer
