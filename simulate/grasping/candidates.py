"""Candidate postures at an object for every height, closing direction and opening."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simulate.grasping.hand_rules import HandRules, rules_for
from simulate.grasping.rules import GraspRequest
from simulate.motion.arm_space import ALLOWED, ArmSpace
from simulate.motion.collision import Obstacle, PointField, Surroundings
from simulate.motion.kinematics import Goal, IkOptions, solve_ik
from simulate.robots.description import Arm, Floats

__all__ = [
    "AT_OBJECT",
    "AT_POSE",
    "Candidate",
    "can_get_there",
    "find_candidates",
    "groups_as_good",
    "iterate_candidates",
    "target_obstacle",
]

_DIFFERENT = 0.15
_OPENING_STEPS = 20
_ANGLE_TOLERANCE = 0.4
_POSE_TOLERANCE_RAD = 0.03
_PURPOSE_IK = 0
_BESIDE_M = 0.006
"""Room between an object and a jaw that stands still."""

AT_OBJECT: Mapping[tuple[str, str], float] = {
    **ALLOWED,
    ("table", "finger"): 0.008,
    ("target", "finger"): 0.012,
    ("target", "palm"): 0.008,
    ("neighbour", "finger"): 0.006,
}
"""Penetration (m) allowed around the grasp: fingers are compliant, and the object gives way. So
does a neighbour, if it is touched at all: the spheres of a finger are wider than the finger.
"""

AT_POSE: Mapping[tuple[str, str], float] = {
    **ALLOWED,
    ("table", "finger"): 0.008,
    ("target", "finger"): np.inf,
    ("target", "palm"): 0.012,
    ("neighbour", "finger"): 0.014,
    ("neighbour", "palm"): 0.008,
}
"""The same (m) for a pose that was planned on the points: there the gripper's own boxes were kept
clear of them exactly, while spheres and cells are larger than what they stand for."""

_TOUCHING: Mapping[tuple[str, str], float] = {
    **ALLOWED,
    ("table", "finger"): 0.008,
    ("target", "finger"): 0.002,
    ("target", "palm"): 0.0,
}


@dataclass(frozen=True, eq=False)
class Candidate:
    """One posture at the object and its costs.

    Parameters
    ----------
    posture : (dof,) float, rad
    opening
        Opening of the hand, 0..1.
    height
        Height of the tool over the table, m.
    tilt
        Angle of the approach to the vertical, rad.
    off
        Angle between the closing axis and the requested one, rad.
    depth
        Penetration of the open hand into the object or anything else, m.
    collides
        Whether that is more than the fingers comply with.
    raised, direction, widened
        Number of the height, closing direction and opening tried; 0 = the rule's first choice.
    """

    posture: Floats
    opening: float
    height: float
    tilt: float
    off: float
    depth: float
    raised: int
    direction: int
    widened: int
    collides: bool = False

    def cost(self, request: GraspRequest, rules: HandRules) -> float:
        """Return the sum of the costs; lower is better."""
        return (
            rules.cost(request, self.tilt, self.height, self.direction)
            + 1.5 * self.off
            + 60.0 * self.depth
            + 0.2 * self.raised
            + 0.2 * self.widened
        )


def find_candidates(
    space: ArmSpace, arm: str, request: GraspRequest, around: Surroundings, seed: int
) -> list[Candidate]:
    """Return the postures for all heights, closing directions and openings.

    Parameters
    ----------
    space
        Of the robot.
    arm
        Name.
    request
        The requested grasp.
    around
        All obstacles, including the object itself as ``target``.
    seed
        Of the starts of inverse kinematics.
    """
    if request.pose is not None:
        return _at_pose(space, arm, request, around, seed)
    return list(iterate_candidates(space, arm, request, around, seed))


def iterate_candidates(
    space: ArmSpace, arm: str, request: GraspRequest, around: Surroundings, seed: int
) -> Iterator[Candidate]:
    """Yield the postures of :func:`find_candidates` for a request without a pose, one by one."""
    chain = space.chains[arm]
    rules = rules_for(space.robot.arm(arm))
    approach = rules.approach(request)
    options = IkOptions(
        angle_tolerance=_ANGLE_TOLERANCE, position_tolerance=request.position_tolerance
    )
    rng = np.random.default_rng((seed, _PURPOSE_IK))
    aside = _aside(space.robot.arm(arm), request)
    for raised, height in enumerate(rules.heights(request)):
        for (direction, angle), sign in itertools.product(
            enumerate(rules.angles(request)), (1, -1) if aside else (0,)
        ):
            position = np.array([request.x, request.y, request.table_height + height])
            closing = None if angle is None else np.array([np.cos(angle), np.sin(angle), 0.0])
            if closing is not None:
                position += sign * aside * closing
            goal = Goal(position, closing, approach, approach is not None)
            postures = solve_ik(chain, goal, rng, options)
            if sign and closing is not None and len(postures):
                rotation, _ = chain.tool_poses(postures)
                postures = postures[sign * (rotation[:, :, 0] @ closing) > 0]
            if len(postures):
                draft = Candidate(postures[0], 1.0, height, 0.0, 0.0, 0.0, raised, direction, 0)
                yield from _judged(space, arm, request, around, draft, postures, closing)


def _aside(arm: Arm, request: GraspRequest) -> float:
    """Return how far (m) a hand is shifted, so that a jaw that stands still is beside the object.

    The other one would push the object over the table to it.
    """
    if not arm.has_single_jaw:
        return 0.0
    return max((arm.mouth - request.width) / 2 - _BESIDE_M, 0.0)


def can_get_there(space: ArmSpace, arm: str, request: GraspRequest, seed: int) -> bool:
    """Tell whether the tool reaches the place of a request in any orientation."""
    place = np.array([request.x, request.y, request.z])
    rng = np.random.default_rng((seed, _PURPOSE_IK))
    options = IkOptions(angle_tolerance=np.inf, position_tolerance=request.position_tolerance)
    return len(solve_ik(space.chains[arm], Goal(place), rng, options)) > 0


def _at_pose(
    space: ArmSpace, arm: str, request: GraspRequest, around: Surroundings, seed: int
) -> list[Candidate]:
    """Return the postures in which the tool has the requested pose."""
    pose = request.pose
    assert pose is not None
    chain, hand = space.chains[arm], space.robot.arm(arm)
    goal = Goal(pose[:3, 3], pose[:3, 0], pose[:3, 2], approach_must=True)
    options = IkOptions(
        angle_tolerance=_POSE_TOLERANCE_RAD, position_tolerance=request.position_tolerance
    )
    rng = np.random.default_rng((seed, _PURPOSE_IK))
    postures = solve_ik(chain, goal, rng, options)
    if not len(postures):
        return []
    # In steps, as the spheres of each opening are kept.
    share = hand.opening_share(request.opening)
    opening = float(min(np.ceil(_OPENING_STEPS * share) / _OPENING_STEPS, 1))
    spheres = space.spheres(arm, opening)
    spaces = spheres.clearances(postures, around, spheres.slack(around, AT_POSE))
    tilt = float(np.arccos(np.clip(-pose[2, 2], -1, 1)))
    height = request.z - request.table_height
    return [
        Candidate(q, opening, height, tilt, 0.0, 0.0, 0, 0, 0, collides=bool(room < 0))
        for q, room in zip(postures, spaces, strict=True)
    ]


def _judged(
    space: ArmSpace,
    arm: str,
    request: GraspRequest,
    around: Surroundings,
    draft: Candidate,
    postures: Floats,
    closing: Floats | None,
) -> list[Candidate]:
    rotation, _ = space.chains[arm].tool_poses(postures)
    tilts = np.arccos(np.clip(-rotation[:, 2, 2], -1, 1))
    axes = rotation[:, :, 0]
    if closing is None:
        off = np.abs(axes[:, 2])
    else:
        off = np.sqrt(np.maximum(1 - (axes @ closing) ** 2, 0))
    judged = []
    for widened, opening in enumerate(rules_for(space.robot.arm(arm)).openings(request)):
        spheres = space.spheres(arm, opening)
        depths = -spheres.clearances(postures, around, spheres.slack(around, _TOUCHING))
        spaces = spheres.clearances(postures, around, spheres.slack(around, AT_OBJECT))
        judged += [
            replace(
                draft,
                posture=posture,
                opening=opening,
                tilt=float(tilts[i]),
                off=float(off[i]),
                depth=float(max(depths[i], 0.0)),
                collides=bool(spaces[i] < 0),
                widened=widened,
            )
            for i, posture in enumerate(postures)
        ]
    return judged


def groups_as_good(
    candidates: Sequence[Candidate],
    request: GraspRequest,
    rules: HandRules,
    within: float,
    least: int,
) -> list[list[Candidate]]:
    """Return candidates in groups of about the same cost, the cheapest first.

    Parameters
    ----------
    candidates
        Free of collisions. Of those with nearly the same posture the cheapest is left.
    within
        By which costs may differ in a group: 0 = each stands alone.
    least
        Number of candidates after which no further group begins.
    """
    groups: list[list[Candidate]] = []
    separate: list[Floats] = []
    cheapest = -np.inf
    for cost, candidate in sorted(
        ((c.cost(request, rules), c) for c in candidates), key=lambda pair: pair[0]
    ):
        if (
            separate
            and (np.abs(np.stack(separate) - candidate.posture).max(axis=1) < _DIFFERENT).any()
        ):
            continue
        if not groups or cost > cheapest + within:
            if len(separate) >= least:
                break
            groups.append([])
            cheapest = cost
        groups[-1].append(candidate)
        separate.append(candidate.posture)
    return groups


def target_obstacle(request: GraspRequest) -> Obstacle | PointField:
    """Return the object itself as an obstacle."""
    if request.points is not None:
        return PointField.of("target", request.points)
    if request.round:
        diameter = max(request.width, 1e-3)
        return Obstacle.upright(
            "target", request.x, request.y, request.table_height, (diameter, request.height)
        )
    centre = (request.x, request.y, request.table_height + request.height / 2)
    # The hand closes across the width, so the longer side lies at a right angle to theta.
    size = (request.width, max(request.length, request.width), request.height)
    return Obstacle.box("target", centre, size, request.theta)
