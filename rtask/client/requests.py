"""Requests: the fields that each operation takes, for type checkers and editors.

The engine's own declarations decide; a test holds these types against them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Required, TypedDict

__all__ = [
    "REQUESTS",
    "Camera",
    "EndEffector",
    "GiveFeedback",
    "InsertObject",
    "NewObject",
    "Outcome",
    "PlanInSpace",
    "RecallGrasps",
    "RecogniseForGrasp",
    "RegisterRobot",
    "ReportOutcome",
    "ResolveRequest",
    "SearchObject",
    "TeachObject",
]

Bytes = str | bytes
"""Base64 text, or the bytes themselves."""
Pose = Mapping[str, Any]
Stamp = float | Mapping[str, int]
Grasp = str | Mapping[str, Any]


class EndEffector(TypedDict, total=False):
    """One gripper of a robot; lengths in m, force in N, payload in kg."""

    name: Required[str]
    gripper_type: Required[str]
    kind: Literal["Hand", "ParallelJawGripper"]
    min_opening: float
    max_opening: Required[float]
    jaw_width: float
    finger_length: float
    max_force: float
    max_payload: Required[float]
    parent_link: str
    planning_group: str


class Camera(TypedDict, total=False):
    """One camera of a robot; lengths in px, ranges in m."""

    name: Required[str]
    frame_id: Required[str]
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    min_range: float
    max_range: float


class RegisterRobot(TypedDict, total=False):
    """What a robot says about itself."""

    name: Required[str]
    model: Required[str]
    simulated: bool
    end_effectors: Required[Sequence[EndEffector | Mapping[str, Any]]]
    cameras: Sequence[Camera | Mapping[str, Any]]
    frames: Sequence[str]


class _Sight(TypedDict, total=False):
    """One look at one object."""

    data: Bytes
    new_point_cloud: Bytes
    image: Bytes
    sensor_pose: Pose
    frame_id: str
    support_height: float
    stamp: Stamp


class RecogniseForGrasp(_Sight, total=False):
    """A question: which object is this, and how is it taken?"""

    task: str
    gripper_id: Required[str]
    object: str
    min_confidence: float
    max_grasps: int
    propose: bool
    in_space: bool
    exclude: Sequence[str]
    seed: int
    neighbours: Sequence[Sequence[float]]
    decide: bool
    min_identity: float
    min_pose: float
    min_grasp: float


class RecallGrasps(TypedDict, total=False):
    """A question about a known object."""

    object: Required[str]
    gripper_id: str
    max_grasps: int
    in_space: bool


class PlanInSpace(TypedDict, total=False):
    """Grasps in space of a known object are to be planned."""

    object: Required[str]
    gripper_id: str
    mass: float
    friction: float
    position_std: float
    rotation_std: float
    samples: int
    min_confidence: float
    max_grasps: int
    seed: int


class SearchObject(_Sight, total=False):
    """A question: what looks like this?"""

    class_description: str
    max_results: int
    min_confidence: float


class ResolveRequest(TypedDict, total=False):
    """A wish: which of the objects that are seen serves it?"""

    wanted: Required[str]
    gripper_id: str
    objects: Sequence[str]
    seen_within_s: float
    exclude: Sequence[str]
    max_grasps: int
    prove: bool


class Outcome(TypedDict, total=False):
    """What came of a grasp; lengths in m, force in N, times in s."""

    success: Required[bool]
    placed: bool
    reason: str
    lifted_m: float
    slip: float
    duration_s: float
    links_touching: int
    contact_force: float
    jaw_gap: float
    hold_s: float
    place_offset: float
    approach_tilt: float
    preset: Literal["faithful", "fast", "real"]
    seed: int
    attempt_number: int
    candidate_count: int
    candidate_rank: int
    confirmed_by: Literal["physics", "human"]
    operator: str
    comment: str
    times: Mapping[str, float]
    images: Sequence[Mapping[str, Any]]


class NewObject(_Sight, total=False):
    """Something that was seen, and what came of grasping it."""

    object: str
    name: str
    class_description: str
    function: str
    gripper_id: str
    task: str
    grasp: Grasp
    X: float
    Y: float
    Z: float
    rad: float
    success: bool
    confirmed_by: Literal["physics", "human"]
    operator: str
    outcome: Outcome | Mapping[str, Any]
    task_id: str
    merge: bool


class InsertObject(NewObject, total=False):
    """A list of things that were seen, or one thing's fields."""

    objects: Sequence[NewObject | Mapping[str, Any]]


class ReportOutcome(TypedDict, total=False):
    """What came of a grasp on a known object."""

    task_id: str
    object: str
    grasp: Grasp
    grasp_pose: Grasp
    gripper_id: str
    task: str
    outcome: Outcome | Mapping[str, Any]
    success: bool
    reason: str
    lifted_m: float
    slip: float
    duration_s: float
    confirmed_by: Literal["physics", "human"]
    operator: str
    stamp: Stamp


class GiveFeedback(TypedDict, total=False):
    """What a person thinks of what a robot reported."""

    verdict: Required[Literal["confirm", "refuse", "correct"]]
    task_id: str
    object: str
    grasp: str
    held: bool
    reason: str
    operator: str
    comment: str


class TeachObject(_Sight, total=False):
    """What a person wants."""

    operation: Required[Literal["search", "teach", "confirm", "reject"]]
    class_description: str
    name: str
    task_id: str
    object: str
    grasp: str
    operator: str
    comment: str


class CurateObject(TypedDict, total=False):
    """What a person puts right about objects."""

    operation: Required[Literal["merge", "split", "forget", "undo"]]
    object: str
    into: str
    views: list[str]
    name: str
    purge: bool
    commit: str
    operator: str


REQUESTS: dict[str, Any] = {
    "register_robot": RegisterRobot,
    "recognise_for_grasp": RecogniseForGrasp,
    "recall_grasps": RecallGrasps,
    "plan_in_space": PlanInSpace,
    "search_object": SearchObject,
    "resolve_request": ResolveRequest,
    "insert_object": InsertObject,
    "report_outcome": ReportOutcome,
    "give_feedback": GiveFeedback,
    "teach_object": TeachObject,
    "curate_object": CurateObject,
}
"""Type of the request of each operation."""
