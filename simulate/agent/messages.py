"""Conversion of the robot's measurements into requests to the engine and the planner."""

from __future__ import annotations

import base64
import time
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from features.codec import encode_frame, to_wire
from features.perception import Perceived, Seen
from grasp.messages import matrix_from_message
from rtask.interop.episodes.motion import Motion
from simulate.agent.tracking import TrackedObject
from simulate.grasping.executor import GraspRecord, GraspRequest
from simulate.robots.description import Floats

__all__ = [
    "distinct",
    "grasp_request",
    "observation_message",
    "outcome_message",
    "pose_message",
    "tool_pose",
]


def grasp_request(
    track: TrackedObject, grasp: dict[str, Any], table: float, stances: Literal["own", "other"]
) -> GraspRequest:
    """Return the request to the planner for a grasp of an answer; one in space keeps its pose."""
    pose = tool_pose(grasp)
    if pose is not None:
        points = track.seen.points.astype(np.float64)
        return GraspRequest.at_pose(pose, grasp["width"], grasp["opening"], points, table)
    shape = track.seen.shape
    return GraspRequest(
        x=float(grasp["x"]),
        y=float(grasp["y"]),
        z=float(grasp["z"]),
        theta=float(grasp["theta"]),
        width=float(grasp["width"]),
        opening=float(grasp["opening"]),
        height=shape.height,
        length=shape.length,
        table_height=table,
        arm="auto",
        round=shape.is_round,
        stances=stances,
        outline=(
            float(shape.centre[0]),
            float(shape.centre[1]),
            float(shape.yaw),
            shape.length,
            shape.width,
        ),
    )


def tool_pose(grasp: Mapping[str, Any]) -> Floats | None:
    """Return the pose (4, 4) of the tool centre point of a grasp in space; None for a planar one.

    The grasps of an answer have no other link to refer to, so that their pose is that of the tool.
    """
    pose = grasp.get("tool_pose")
    if pose is None and grasp.get("kind") == "spatial":
        pose = grasp["grasp_pose"]
    if pose is None:
        return None
    return np.asarray(matrix_from_message(pose["pose"]), dtype=np.float64)


def distinct(grasps: Sequence[dict[str, Any]]) -> list[tuple[int, dict[str, Any]]]:
    """Return grasps with their ranks, without those that differ in height or opening only.

    The planner tries other heights and openings by itself, except for poses in space.
    """
    distinct_grasps: list[tuple[int, dict[str, Any]]] = []
    seen: set[tuple[float, ...]] = set()
    for rank, grasp in enumerate(grasps):
        aim = tuple(round(float(grasp[name]), 4) for name in ("x", "y", "theta"))
        if aim not in seen or tool_pose(grasp) is not None:
            seen.add(aim)
            distinct_grasps.append((rank, grasp))
    return distinct_grasps


def pose_message(base_from_camera: NDArray[np.float64]) -> dict[str, dict[str, float]]:
    """Return a (4, 4) pose as geometry_msgs/Pose."""
    x, y, z = (float(v) for v in base_from_camera[:3, 3])
    q = [float(v) for v in Rotation.from_matrix(base_from_camera[:3, :3]).as_quat()]
    return {
        "position": {"x": x, "y": y, "z": z},
        "orientation": {"x": q[0], "y": q[1], "z": q[2], "w": q[3]},
    }


def observation_message(
    seen: Seen, view: Perceived, base_from_camera: NDArray[np.float64], frame_id: str
) -> dict[str, Any]:
    """Return an object of a view that was just taken as an observation in the named base frame."""
    return {
        "data": to_wire(encode_frame(seen.crop)),
        "sensor_pose": pose_message(base_from_camera),
        "frame_id": frame_id,
        "stamp": time.time(),
        "support_height": view.table_height,
    }


def outcome_message(
    record: GraspRecord,
    number: int,
    answer: dict[str, Any],
    grasp: dict[str, Any],
    seconds: dict[str, float],
    pictures: list[tuple[str, bytes]],
    span: tuple[float, float],
) -> dict[str, Any]:
    """Return the outcome message of a physical attempt.

    Parameters
    ----------
    span
        When it started and ended, s since the epoch. Simulated seconds pass at another rate.
    """
    placed: dict[str, Any] = {}
    if record.judged_placed.answer != "unknown":
        placed["placed"] = record.placed
        if record.placed and record.place:
            placed["place"] = record.place
    elif record.place:  # let go there, but not seen there
        placed["place"] = record.place
    lost = record.held and (not record.kept or record.judged_placed.answer == "no")
    motion = {} if record.motion is None else {"motion": _motion_message(record.motion)}
    return {
        "success": record.kept,
        **placed,
        "reason": record.place_reason if lost else record.reason,
        "comment": record.evidence,
        "jaw_gap": record.jaw_gap_m,
        "lifted_m": record.lifted_m,
        "slip": record.slip_m,
        "started": span[0],
        "ended": span[1],
        "duration_s": record.duration_s,
        "links_touching": record.links_touching,
        "contact_force": record.contact_force_n,
        "preset": record.preset,
        "seed": record.seed,
        "attempt_number": number,
        "candidate_count": len(answer["grasps"]),
        "candidate_rank": grasp["rank"],
        "times": {
            "planning_s": seconds.get("plan", 0.0),
            "execution_s": record.duration_s,
            "transfer_s": seconds["ask"] - answer["times"].get("total_s", 0.0),
        },
        "images": [
            {"phase": phase, "data": base64.b64encode(png).decode()} for phase, png in pictures
        ],
        **motion,
    }


def _motion_message(motion: Motion) -> dict[str, Any]:
    return {
        "joints": list(motion.joints),
        "times": np.round(motion.times, 3).tolist(),
        "positions": np.round(motion.positions, 4).ravel().tolist(),
        "commands": np.round(motion.commands, 4).ravel().tolist(),
    }
