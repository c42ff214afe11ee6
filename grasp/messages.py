"""Grasps as messages: dictionaries shaped like moveit_msgs/Grasp.

Fields and rules as in the message definition: before the grasp the positions of a posture count,
in the grasp positions and effort. Stamps carry the names of ROS 1 and ROS 2 alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.frames import (
    matrix_from_pose,
    planar_from_pose,
    pose_from_matrix,
    pose_from_planar,
)
from grasp.spatial.gripper import EndEffector, ParallelGripper
from grasp.spatial.planar import PlanarGrasp

__all__ = [
    "candidate_from_message",
    "empty_grasp_message",
    "grasp_message",
    "matrix_from_message",
    "planar_from_message",
    "pose_message",
    "spatial_grasp_message",
]

_ZERO_TIME = {"secs": 0, "nsecs": 0, "sec": 0, "nanosec": 0}


def header(frame_id: str) -> dict[str, Any]:
    """Return a std_msgs/Header that clients of ROS 1 and ROS 2 read alike."""
    return {"seq": 0, "stamp": dict(_ZERO_TIME), "frame_id": frame_id}


def pose_message(frame_from_body: FloatArray) -> dict[str, Any]:
    """Return a (4, 4) transform as geometry_msgs/Pose with w >= 0."""
    position, quaternion = pose_from_matrix(frame_from_body)
    return {
        "position": dict(zip("xyz", (float(v) for v in position), strict=True)),
        "orientation": dict(zip("xyzw", (float(v) for v in quaternion), strict=True)),
    }


def matrix_from_message(pose: dict[str, Any]) -> FloatArray:
    """Return the (4, 4) transform of a geometry_msgs/Pose.

    Raises
    ------
    ValueError
        When a number is missing, not finite, or the orientation is no unit quaternion.
    """
    try:
        position = np.array([float(pose["position"][axis]) for axis in "xyz"])
        quaternion = np.array([float(pose["orientation"][axis]) for axis in "xyzw"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            "a pose has position {x, y, z} and orientation {x, y, z, w}, all numbers"
        ) from error
    if not np.all(np.isfinite(position)):
        raise ValueError(f"position must be finite, got {position.tolist()}")
    return matrix_from_pose(position, quaternion)


def posture(
    positions: Mapping[str, float], frame_id: str, effort: float | None = None
) -> dict[str, Any]:
    """Return a trajectory_msgs/JointTrajectory of one point, or of none without joints."""
    point = {
        "positions": list(positions.values()),
        "velocities": [],
        "accelerations": [],
        "effort": [] if effort is None else [effort] * len(positions),
        "time_from_start": dict(_ZERO_TIME),
    }
    return {
        "header": header(frame_id),
        "joint_names": list(positions),
        "points": [point] if positions else [],
    }


def translation(
    direction: tuple[float, float, float], desired_m: float, least_m: float, frame_id: str
) -> dict[str, Any]:
    """Return a moveit_msgs/GripperTranslation along a unit vector."""
    return {
        "direction": {
            "header": header(frame_id),
            "vector": dict(zip("xyz", direction, strict=True)),
        },
        "desired_distance": desired_m,
        "min_distance": least_m,
    }


def grasp_message(
    grasp: PlanarGrasp,
    gripper: ParallelGripper,
    frame_id: str,
    support_height: float = 0.0,
    parent_from_gripper: FloatArray | None = None,
    effort: float = 0.0,
) -> dict[str, Any]:
    """Return a planar grasp as moveit_msgs/Grasp, without its ``id``.

    Parameters
    ----------
    grasp
        In the frame ``frame_id``, its z over the support.
    support_height
        Of the support in that frame, m.
    parent_from_gripper : (4, 4) or None
        Tool centre point in the end effector's parent link; None = the pose is the gripper's own.
    effort
        Of the closed posture, N or N m as the joint's type says.

    Notes
    -----
    The one joint of the postures is the distance between the jaws, m, named after the gripper: the
    robot knows which of its joints make it.
    """
    if not frame_id:
        raise ValueError("a grasp message needs the name of its frame")
    pose = pose_from_planar(grasp.x, grasp.y, support_height + grasp.z, grasp.theta)
    if parent_from_gripper is not None:
        pose = pose @ np.linalg.inv(parent_from_gripper)
    return {
        "pre_grasp_posture": posture({gripper.name: grasp.opening}, frame_id),
        "grasp_posture": posture({gripper.name: grasp.width}, frame_id, effort),
        "grasp_pose": {"header": header(frame_id), "pose": pose_message(pose)},
        "grasp_quality": grasp.quality,
        "pre_grasp_approach": translation((0.0, 0.0, -1.0), 0.055, 0.033, frame_id),
        "post_grasp_retreat": translation((0.0, 0.0, 1.0), 0.06, 0.035, frame_id),
        "post_place_retreat": translation((0.0, 0.0, 1.0), 0.06, 0.035, frame_id),
        "max_contact_force": 0.0,
        "allowed_touch_objects": [],
    }


def empty_grasp_message(frame_id: str) -> dict[str, Any]:
    """Return the message of "no grasp", with every field so that a typed client can read it."""
    return {
        "pre_grasp_posture": posture({}, frame_id),
        "grasp_posture": posture({}, frame_id),
        "grasp_pose": {"header": header(frame_id), "pose": pose_message(np.eye(4))},
        "grasp_quality": 0.0,
        "pre_grasp_approach": translation((0.0, 0.0, 0.0), 0.0, 0.0, frame_id),
        "post_grasp_retreat": translation((0.0, 0.0, 0.0), 0.0, 0.0, frame_id),
        "post_place_retreat": translation((0.0, 0.0, 0.0), 0.0, 0.0, frame_id),
        "max_contact_force": 0.0,
        "allowed_touch_objects": [],
    }


def planar_from_message(
    message: dict[str, Any],
    support_height: float = 0.0,
    parent_from_gripper: FloatArray | None = None,
) -> PlanarGrasp:
    """Return the planar grasp of a message made by :func:`grasp_message`.

    Raises
    ------
    ValueError
        When a field is missing or the approach is not from above.

    Examples
    --------
    >>> hand = ParallelGripper("hand", "nao_hand", 0.0, 0.05)
    >>> there = PlanarGrasp(0.15, -0.1, 0.03, 2.0, 0.03, 0.05, 0.9)
    >>> back = planar_from_message(grasp_message(there, hand, "base_footprint", 0.27), 0.27)
    >>> round(back.theta, 6), round(back.z, 6)
    (2.0, 0.03)
    """
    try:
        pose = matrix_from_message(message["grasp_pose"]["pose"])
        opening = float(message["pre_grasp_posture"]["points"][0]["positions"][0])
        width = float(message["grasp_posture"]["points"][0]["positions"][0])
        quality = float(message["grasp_quality"])
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(f"not a grasp message: {error!r} is missing") from error
    if parent_from_gripper is not None:
        pose = pose @ parent_from_gripper
    x, y, z, theta = planar_from_pose(pose)
    return PlanarGrasp(x, y, z - support_height, theta, width, opening, quality)


_SPARE_M = 0.02
_UP = (0.0, 0.0, 1.0)


def spatial_grasp_message(
    candidate: GraspCandidate,
    gripper: EndEffector,
    frame_id: str,
    *,
    grasp_id: str = "",
    up: tuple[float, float, float] = _UP,
    allowed: Sequence[str] = (),
) -> dict[str, Any]:
    """Return a grasp in space as moveit_msgs/Grasp.

    Parameters
    ----------
    candidate
        In the frame ``frame_id``.
    gripper
        Gives the parent link, whose pose the message states, the joints of the postures and the
        lengths of approach and retreat.
    up
        Unit vector against gravity in ``frame_id``: the way out with the object.
    allowed
        Names of what may be touched.

    Notes
    -----
    The pre-grasp posture leaves 2 cm, or what was checked for collisions, within the stroke.
    """
    if not frame_id:
        raise ValueError("a grasp message needs the name of its frame")
    pose = candidate.frame_from_gripper
    if gripper.parent_from_gripper is not None:
        pose = pose @ np.linalg.inv(gripper.parent_from_gripper)
    opening = candidate.opening
    if opening is None:
        opening = min(candidate.width + _SPARE_M, gripper.max_opening)
    into = _triple(candidate.approach)
    back = _triple(-candidate.approach)
    out = _triple(np.asarray(up, dtype=np.float64))
    return {
        "id": grasp_id,
        "pre_grasp_posture": posture(gripper.joint_positions(opening), frame_id),
        "grasp_posture": posture(
            gripper.joint_positions(candidate.width), frame_id, gripper.max_effort
        ),
        "grasp_pose": {"header": header(frame_id), "pose": pose_message(pose)},
        "grasp_quality": candidate.scores.get("confidence", 0.0),
        "pre_grasp_approach": translation(into, *gripper.approach, frame_id),
        "post_grasp_retreat": translation(out, *gripper.retreat, frame_id),
        "post_place_retreat": translation(back, *gripper.retreat, frame_id),
        "max_contact_force": 0.0,
        "allowed_touch_objects": list(allowed),
    }


def candidate_from_message(message: Mapping[str, Any], gripper: ParallelGripper) -> GraspCandidate:
    """Return the grasp in space of a moveit_msgs/Grasp for a gripper.

    Raises
    ------
    ValueError
        When a field is missing, not finite, or the postures name other joints.

    Examples
    --------
    >>> from grasp.spatial.gripper import panda_hand
    >>> there = GraspCandidate(pose_from_planar(0.4, 0.1, 0.05, 1.0), 0.03, opening=0.05)
    >>> message = spatial_grasp_message(there, panda_hand(), "panda_link0")
    >>> back = candidate_from_message(message, panda_hand())
    >>> bool(np.allclose(back.frame_from_gripper, there.frame_from_gripper)), round(back.width, 6)
    (True, 0.03)
    """
    try:
        pose = matrix_from_message(message["grasp_pose"]["pose"])
        opening = _opening(message["pre_grasp_posture"], gripper)
        width = _opening(message["grasp_posture"], gripper)
        quality = float(message["grasp_quality"])
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(f"not a grasp message: {error!r} is missing") from error
    if not np.isfinite([opening, width, quality]).all():
        raise ValueError(f"postures and quality must be finite, got {opening}, {width}, {quality}")
    if gripper.parent_from_gripper is not None:
        pose = pose @ gripper.parent_from_gripper
    return GraspCandidate(
        np.asarray(pose, dtype=np.float64), width, source="recalled", opening=opening,
        scores={"confidence": quality},
    )  # fmt: skip


def _opening(stated: Mapping[str, Any], gripper: ParallelGripper) -> float:
    joints = list(gripper.joint_positions(0.0))
    values = dict(zip(stated["joint_names"], stated["points"][0]["positions"], strict=True))
    if joints[0] not in values:
        raise ValueError(f"postures of {gripper.name!r} name {', '.join(joints)}, got {[*values]}")
    return gripper.opening_at(float(values[joints[0]]))


def _triple(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector)
    return x, y, z
