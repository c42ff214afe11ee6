"""Picking from piles and cluttered tables: from a frame to the grasp that the arm can carry out.

Gatto 2016, chapters 2 and 5: what touches or lies on something else is segmented, planned on with
its neighbours as obstacles, and grasped in whatever pose suits it. The frame, the kinematics and
the planner are all that this uses; true poses are not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.gripper import EndEffector, ParallelGripper
from rtask.engine.perception.clutter import ClutterView, view_clutter
from simulate.grasping.executor import Executor
from simulate.grasping.hand_rules import ParallelJaws
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.collision import PointField
from simulate.robots.description import RobotDescription
from simulate.robots.other_hands import cup_with_wrist

__all__ = ["Pick", "hand_of", "look_at_clutter", "pick_from"]

_MARGIN_M = 0.02
_PLANS_TRIED = 15
_FAR_OWN_M = 0.01


def look_at_clutter(executor: Executor) -> ClutterView | None:
    """Take a frame and return what is on the table between the robot's boxes."""
    place = executor.robot.description.workplace
    inner = place.box_centre[1] - place.box_inner / 2 - _MARGIN_M
    low, high = place.table_x
    frame, base_from_camera = executor.eyes.look("ahead")
    return view_clutter(
        frame.points(), frame.rgb, base_from_camera, (low + _MARGIN_M, high - _MARGIN_M),
        (-inner, inner),
    )  # fmt: skip


def hand_of(robot: RobotDescription, name: str) -> EndEffector:
    """Return the hand of an arm with its whole shape, about the arm's tool centre point."""
    arm = robot.arm(name)
    if arm.cup is not None:
        return cup_with_wrist(robot, arm)
    if arm.three is not None:
        return arm.three
    jaws = ParallelGripper(
        arm.end_effector, arm.gripper_type, 0.0, arm.mouth, max_payload=arm.max_payload
    )
    hand = jaws.modelled()
    if arm.grip == "parallel_jaws":
        hand = replace(hand, fingertip=ParallelJaws.TIP_BELOW_TOOL)
    return hand


@dataclass(frozen=True, eq=False)
class Pick:
    """The grasp to carry out.

    Parameters
    ----------
    candidate
        As planned on the cloud.
    plan
        Of the arm.
    rank
        How many better candidates the arm cannot carry out.
    """

    candidate: GraspCandidate
    plan: PlannedGrasp
    rank: int


def pick_from(
    view: ClutterView,
    proposals: Proposals,
    executor: Executor,
    arm: str,
    seed: int = 0,
    tries: int = _PLANS_TRIED,
) -> tuple[Pick | None, tuple[str, ...]]:
    """Return the best grasp that an arm can carry out, and why it cannot do the better ones.

    The grasp is None when it can do none of the best; the reason codes are then of all of these.

    Parameters
    ----------
    proposals
        Ranked grasps of the view.
    tries
        How many of them at most.
    """
    refused: list[str] = []
    for rank, candidate in enumerate(list(proposals)[:tries]):
        request, obstacles = _asked(view, candidate, arm)
        planned = executor.plan(request, obstacles, seed)
        if not isinstance(planned, str):
            return Pick(candidate, planned, rank), tuple(refused)
        refused.append(planned)
    return None, tuple(refused)


def _asked(
    view: ClutterView, candidate: GraspCandidate, arm: str
) -> tuple[GraspRequest, list[PointField]]:
    """Return the request for a candidate and what stands around its object."""
    own = view.labels == candidate.segment
    # Points of no segment at the edge of the object are its own, or noise.
    if own.any():
        low, high = view.points[own].min(axis=0), view.points[own].max(axis=0)
        stray = (view.labels == 0) & (
            (view.points > low - _FAR_OWN_M) & (view.points < high + _FAR_OWN_M)
        ).all(axis=1)
        own |= stray
    else:
        own = np.linalg.norm(view.points - candidate.centre, axis=1) < candidate.width
    opening = candidate.width if candidate.opening is None else candidate.opening
    request = replace(
        GraspRequest.at_pose(
            candidate.frame_from_gripper,
            candidate.width,
            opening,
            view.points[own],
            view.table_height,
        ),
        arm=arm,
    )
    others = view.points[~own]
    fields = [PointField.of("neighbour", others, view.table_height)] if len(others) else []
    return request, fields
