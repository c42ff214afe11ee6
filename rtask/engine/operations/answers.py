"""Answers: which fields an operation gives back.

The engine fills them in, the typed client returns them, and the description of the HTTP interface
is made from them. Poses, postures and translations are those of ROS messages (moveit_msgs/Grasp).
"""

from __future__ import annotations

from typing import Any, NotRequired, TypedDict

__all__ = [
    "ANSWERS",
    "Curated",
    "Feedback",
    "GivenVerdict",
    "GraspConfidence",
    "GraspStatistics",
    "Inserted",
    "InsertedObject",
    "OfferedGrasp",
    "OfferedObject",
    "PlannedGrasps",
    "Reason",
    "RecalledGrasp",
    "RecalledGrasps",
    "Recognition",
    "RegisteredRobot",
    "ReportedOutcome",
    "ResolvedRequest",
    "SimilarObject",
    "SimilarObjects",
    "Taught",
]

Message = dict[str, Any]


class GraspStatistics(TypedDict):
    """How often a grasp held, over all robots."""

    attempts: int
    successes: int
    mean: float
    lower_95: float


class RegisteredRobot(TypedDict):
    """What `register_robot` answers."""

    robot: str
    graph: str
    commit: str


# Functional form: `class` is a word of the language.
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
    },
)
"""A known object that looks alike; position and turn of its best grasp in m and rad, or nulls."""


class SimilarObjects(TypedDict):
    """What `search_object` answers."""

    similar_objects: list[SimilarObject]
    suggestions: list[str]


class OfferedGrasp(TypedDict):
    """One grasp to try: a moveit_msgs/Grasp, and why it stands where it stands."""

    id: str
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
    explanation: Message
    in_object: Message
    pre_grasp_posture: Message
    grasp_posture: Message
    grasp_pose: Message
    grasp_quality: float
    pre_grasp_approach: Message
    post_grasp_retreat: Message
    post_place_retreat: Message
    max_contact_force: float
    allowed_touch_objects: list[str]


Recognition = TypedDict(
    "Recognition",
    {
        "task_response": str,
        "task_id": str,
        "object": str,
        "class": str,
        "class_iri": str,
        "label": str,
        "confidence": float,
        "statistics": GraspStatistics,
        "pre_grasp_posture": Message,
        "grasp_posture": Message,
        "grasp_pose": Message,
        "grasp_quality": float,
        "pre_grasp_approach": Message,
        "post_grasp_retreat": Message,
        "post_place_retreat": Message,
        "max_contact_force": float,
        "allowed_touch_objects": list[str],
        "grasps": list[OfferedGrasp],
        "shape": Message | None,
        "recognition": Message,
        "similar_objects": list[SimilarObject],
        "decision": Message | None,
        "times": Message,
    },
)
"""What `recognise_for_grasp` answers; `decision` is null unless one was asked for."""


class GraspConfidence(TypedDict):
    """How sure a grasp is over all robots: a Beta distribution, and the prior it began with."""

    mean: float
    alpha: float
    beta: float
    prior: float | None
    evaluation: str
    updated: str
    policy: str
    note: str


class RecalledGrasp(TypedDict):
    """One known grasp as moveit_msgs/Grasp, in the frame of its object."""

    id: str
    kind: str
    gripper_type: str
    x: float
    y: float
    z: float
    theta: float
    width: float | None
    opening: float | None
    pre_grasp_posture: Message
    grasp_posture: Message
    grasp_pose: Message
    grasp_quality: float | None
    pre_grasp_approach: Message
    post_grasp_retreat: Message
    post_place_retreat: Message
    max_contact_force: float
    allowed_touch_objects: list[str]
    statistics: GraspStatistics
    confidence: GraspConfidence


class RecalledGrasps(TypedDict):
    """What `recall_grasps` answers."""

    object: str
    class_iri: str
    label: str
    grasps: list[RecalledGrasp]


class PlannedGrasps(TypedDict):
    """What `plan_in_space` answers: the grasps, best first, or why there is none."""

    object: str
    shape: str
    reason: str
    commit: str
    tried: dict[str, int]
    grasps: list[RecalledGrasp]


class OfferedObject(TypedDict):
    """A seen object that serves a request; lengths in m, masses in kg."""

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


class Reason(TypedDict):
    """Why a request is not met, or not by this object."""

    code: str
    text: str
    object: str
    label: str
    value: float | None
    limit: float | None
    seen: str
    seen_by: str
    place: Message | None


class ResolvedRequest(TypedDict):
    """What `resolve_request` answers."""

    task_response: str
    object: str
    class_iri: str
    label: str
    grasps: list[RecalledGrasp]
    objects: list[OfferedObject]
    reasons: list[Reason]
    understood: Message
    explanation: Message
    suggestions: list[str]


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
    },
)
"""What became of one entry of `insert_object`."""


class Inserted(TypedDict):
    """What `insert_object` answers."""

    stored: int
    commit: str
    objects: list[InsertedObject]


class ReportedOutcome(TypedDict):
    """What `report_outcome` answers."""

    stored: int
    commit: str
    statistics: GraspStatistics
    grasp: str


class GivenVerdict(TypedDict):
    """What one person said about an attempt."""

    by: str
    held: bool
    reason: str
    comment: str
    time: str


class Feedback(TypedDict):
    """What `give_feedback` answers: all that is said about the attempt, and what counts."""

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


class Curated(TypedDict):
    """What `curate_object` answers: the object that there is now, and the commit to take back."""

    object: str
    commit: str
    added: int
    removed: int


class Taught(TypedDict):
    """What `teach_object` answers; what is stored only where something was to be stored."""

    similar_objects: list[SimilarObject]
    suggestions: list[str]
    stored: NotRequired[int]
    commit: NotRequired[str]
    objects: NotRequired[list[InsertedObject]]
    grasp: NotRequired[str]
    statistics: NotRequired[GraspStatistics]


ANSWERS: dict[str, Any] = {
    "register_robot": RegisteredRobot,
    "recognise_for_grasp": Recognition,
    "recall_grasps": RecalledGrasps,
    "plan_in_space": PlannedGrasps,
    "search_object": SimilarObjects,
    "resolve_request": ResolvedRequest,
    "insert_object": Inserted,
    "report_outcome": ReportedOutcome,
    "give_feedback": Feedback,
    "teach_object": Taught,
    "curate_object": Curated,
}
"""Type of the answer of each operation."""
