"""From a request to way points: postures, straight lines, free paths (Gatto 2016, 4.2 and 4.3)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from simulate.collision import ArmSpheres, Obstacle, Surroundings, body_obstacles
from simulate.grasp_rules import (
    GraspRequest,
    PlannedGrasp,
    closing_angles,
    grasp_heights,
    openings,
)
from simulate.kinematics import Chain, Goal, IkOptions, follow_line, solve_ik
from simulate.planning import plan_path
from simulate.robots.description import RobotDescription
from simulate.trajectory import ACCELERATION, CARRYING_ACCELERATION, Trajectory, time_path

__all__ = ["REASONS", "SPEED", "GraspPlanner"]

Floats = NDArray[np.float64]

REASONS = (
    "too_heavy",
    "too_wide",
    "ik",
    "tilt",
    "grasp_collision",
    "approach_ik",
    "approach_collision",
    "pregrasp_collision",
    "lift_ik",
    "rrt_start",
    "rrt_goal",
    "rrt_time",
)
"""Why there is no plan; a later one means that the planner got further."""

SPEED = {"free": 0.30, "approach": 0.12, "lift": 0.12, "transport": 0.10, "return": 0.30}
"""Share of the joints' velocity limits, by phase."""

_LARGEST_TILT = 1.35
_POSTURES_TRIED = 12


@dataclass(frozen=True)
class _Retreats:
    """Ways out from the object: back along the approach, aside along the open mouth, up, m."""

    offsets: tuple[tuple[float, float, float], ...]
    touch: float
    """How deep the fingers may run into the object on the way, m."""


# The mouth is open on three sides, but what comes from the side sweeps the object away when it
# stands a little elsewhere; so that comes second, and with a touch last.
_ASIDE = ((0.030, 0.030, 0.0), (0.030, -0.030, 0.0), (0.0, 0.050, 0.005), (0.0, -0.050, 0.005))
_BACKWARDS = _Retreats(((0.055, 0.0, 0.0), (0.033, 0.0, 0.0), (0.020, 0.0, 0.050)), 0.012)
_SIDEWAYS = _Retreats(_ASIDE, 0.002)
_SWEEPING = _Retreats(_ASIDE, 0.010)
# Up and away from the shoulder, m; and whether the hand may turn about the vertical.
_LIFTS = (
    (0.060, 0.0, False),
    (0.060, 0.030, True),
    (0.045, 0.0, True),
    (0.045, 0.045, True),
    (0.035, 0.0, True),
)
_MARGIN = 0.004
_IK = IkOptions(angle_tolerance=0.4)
_PURPOSE_IK, _PURPOSE_PATH = 0, 1

_ALLOWED: Mapping[tuple[str, str], float] = {
    ("trunk", "upper"): np.inf,
}
_AT_OBJECT: Mapping[tuple[str, str], float] = {
    **_ALLOWED,
    ("table", "finger"): 0.008,  # they comply
    ("target", "finger"): 0.012,
    ("target", "palm"): 0.008,
}
_TOUCHING: Mapping[tuple[str, str], float] = {
    **_ALLOWED,
    ("table", "finger"): 0.008,
    ("target", "finger"): 0.002,
    ("target", "palm"): 0.0,
}
_LIFTING: Mapping[tuple[str, str], float] = {
    **_ALLOWED,
    ("table", "finger"): 0.008,
    ("target", "finger"): np.inf,
    ("target", "palm"): np.inf,
}


@dataclass(frozen=True)
class Candidate:
    """One posture at the object, and what speaks against it.

    Parameters
    ----------
    posture : (dof,) float, rad
    opening
        Of the hand, 0..1.
    height
        Of the tool over the table, m.
    tilt
        Of the approach from the vertical, rad.
    off
        Angle between the closing axis and the wanted one, rad.
    depth
        How deep the open hand sits in the object or anything else, m.
    raised, turned, widened
        Number of the height, closing direction and opening tried; 0 = the rule's first choice.
    """

    posture: Floats
    opening: float
    height: float
    tilt: float
    off: float
    depth: float
    raised: int
    turned: int
    widened: int

    def cost(self, request: GraspRequest) -> float:
        """Return what makes a grasp fail, summed: lower is better."""
        return (
            request.tilt_weight * abs(self.tilt - request.preferred_tilt(self.height))
            + 1.5 * self.off
            + 60.0 * self.depth
            + 0.3 * self.raised
            + 0.2 * self.turned
            + 0.2 * self.widened
        )


class GraspPlanner:
    """Plans grasps of one robot.

    Parameters
    ----------
    robot
        Its description; the planner has no other access to it.
    furniture
        What stands around for good (walls of the boxes), base frame.
    table : (2,) sequence of (low, high), m
        Ranges of x and y of the table top.
    """

    def __init__(
        self,
        robot: RobotDescription,
        furniture: Sequence[Obstacle] = (),
        table: tuple[tuple[float, float], tuple[float, float]] = ((0.09, 0.59), (-0.4, 0.4)),
    ) -> None:
        self.robot = robot
        self.furniture = tuple(furniture)
        self._table = table
        self.chains = {name: Chain.of(robot, name) for name in robot.arms}
        self._spheres: dict[tuple[str, float], ArmSpheres] = {}
        homes = {
            joint: value
            for arm in robot.arms.values()
            for joint, value in zip(arm.joints, arm.home, strict=True)
        }
        self._body = {name: body_obstacles(robot, arm, homes) for name, arm in robot.arms.items()}

    def spheres(self, arm: str, opening: float) -> ArmSpheres:
        """Return the cover of an arm with its hand opened so far; made once."""
        key = (arm, opening)
        if key not in self._spheres:
            self._spheres[key] = ArmSpheres.of(self.robot, self.robot.arm(arm), opening)
        return self._spheres[key]

    def surroundings(
        self, arm: str, table_height: float, obstacles: Sequence[Obstacle]
    ) -> Surroundings:
        """Return all that an arm can hit: body, table, furniture, perceived obstacles."""
        (x0, x1), (y0, y1) = self._table
        thick = 0.10
        table = Obstacle.box(
            "table",
            ((x0 + x1) / 2, (y0 + y1) / 2, table_height - thick / 2),
            (x1 - x0, y1 - y0, thick),
        )
        return Surroundings((*self._body[arm], table, *self.furniture, *obstacles))

    def plan(
        self, request: GraspRequest, obstacles: Sequence[Obstacle], seed: int
    ) -> PlannedGrasp | str:
        """Plan a grasp from the arm's home.

        Returns
        -------
        PlannedGrasp or str
            A code of :data:`REASONS`.
        """
        started = time.process_time()
        reason = "ik"
        for arm in self._arms_for(request):
            planned = self._plan_with(arm, request, tuple(obstacles), seed)
            if not isinstance(planned, str):
                return replace(planned, planning_s=time.process_time() - started)
            reason = max(reason, planned, key=REASONS.index) if reason != "ik" else planned
        return reason

    def _arms_for(self, request: GraspRequest) -> tuple[str, ...]:
        if request.arm != "auto":
            name = request.arm if request.arm in self.robot.arms else f"{request.arm}_arm"
            return (self.robot.arm(name).name,)
        near = sorted(self.robot.arms.values(), key=lambda arm: -arm.side * request.y)
        return tuple(arm.name for arm in near)

    def _plan_with(
        self, arm: str, request: GraspRequest, obstacles: tuple[Obstacle, ...], seed: int
    ) -> PlannedGrasp | str:
        parts = self.robot.arm(arm)
        if request.mass is not None and request.mass > parts.max_payload:
            return "too_heavy"
        if request.width > parts.mouth:
            return "too_wide"
        around = self.surroundings(arm, request.table_height, obstacles)
        with_target = around.with_obstacles([_target(request)])
        candidates = self.candidates(arm, request, with_target, seed)
        best = sorted(candidates, key=lambda c: c.cost(request))[:_POSTURES_TRIED]
        reason = "ik"
        for retreats in (_BACKWARDS, _SIDEWAYS, _SWEEPING):
            for candidate in best:
                planned = self._complete(arm, request, with_target, candidate, retreats, seed)
                if not isinstance(planned, str):
                    return replace(planned, obstacles=obstacles, ik_solutions=len(candidates))
                reason = max(reason, planned, key=REASONS.index)
        return reason

    def candidates(
        self, arm: str, request: GraspRequest, around: Surroundings, seed: int
    ) -> list[Candidate]:
        """Return the postures for all heights, closing directions and openings, judged."""
        chain = self.chains[arm]
        rng = np.random.default_rng((seed, _PURPOSE_IK))
        found: list[Candidate] = []
        for raised, height in enumerate(grasp_heights(request)):
            for turned, angle in enumerate(closing_angles(request)):
                position = np.array([request.x, request.y, request.table_height + height])
                closing = None if angle is None else np.array([np.cos(angle), np.sin(angle), 0.0])
                postures = solve_ik(chain, Goal(position, closing), rng, _IK)
                if len(postures):
                    draft = Candidate(postures[0], 1.0, height, 0.0, 0.0, 0.0, raised, turned, 0)
                    found += self._judged(arm, request, around, draft, postures, closing)
        return found

    def _judged(
        self,
        arm: str,
        request: GraspRequest,
        around: Surroundings,
        draft: Candidate,
        postures: Floats,
        closing: Floats | None,
    ) -> list[Candidate]:
        rotation, _ = self.chains[arm].tool_poses(postures)
        tilts = np.arccos(np.clip(-rotation[:, 2, 2], -1, 1))
        axes = rotation[:, :, 0]
        if closing is None:
            off = np.abs(axes[:, 2])
        else:
            off = np.sqrt(np.maximum(1 - (axes @ closing) ** 2, 0))
        judged = []
        for wider, opening in enumerate(openings(request)):
            spheres = self.spheres(arm, opening)
            depths = -spheres.clearances(postures, around, spheres.slack(around, _TOUCHING))
            for posture, tilt, angle, depth in zip(postures, tilts, off, depths, strict=True):
                judged.append(
                    replace(
                        draft,
                        posture=posture,
                        opening=opening,
                        tilt=float(tilt),
                        off=float(angle),
                        depth=float(max(depth, 0.0)),
                        widened=wider,
                    )
                )
        return judged

    def _complete(
        self,
        arm: str,
        request: GraspRequest,
        with_target: Surroundings,
        candidate: Candidate,
        retreats: _Retreats,
        seed: int,
    ) -> PlannedGrasp | str:
        """Find the lines and the free path of one posture, or say what fails."""
        if candidate.tilt > _LARGEST_TILT:
            return "tilt"
        chain = self.chains[arm]
        spheres = self.spheres(arm, candidate.opening)
        at_object = spheres.slack(with_target, _AT_OBJECT)
        if spheres.clearances(candidate.posture[None], with_target, at_object)[0] < 0:
            return "grasp_collision"
        back = self._approach(chain, candidate.posture, retreats, spheres, with_target)
        if isinstance(back, str):
            return back
        lift = self._lift(chain, candidate.posture, spheres, with_target)
        if lift is None:
            return "lift_ik"
        free = self.path(
            arm, spheres, with_target, np.array(self.robot.arm(arm).home), back[-1], seed
        )
        if isinstance(free, str):
            return "pregrasp_collision" if free == "rrt_goal" else free
        rotation, _ = chain.tool_poses(candidate.posture[None])
        closing = rotation[0, :, 0]
        return PlannedGrasp(
            request=request,
            arm=arm,
            opening=candidate.opening,
            closing_angle=float(np.arctan2(closing[1], closing[0]) % np.pi),
            tilt=candidate.tilt,
            tool_height=candidate.height,
            posture=candidate.posture,
            free=free,
            approach=time_path(back[::-1], SPEED["approach"] * chain.velocity),
            lift=time_path(lift, SPEED["lift"] * chain.velocity, CARRYING_ACCELERATION),
            obstacles=(),
            ik_solutions=0,
            planning_s=0.0,
            seed=seed,
        )

    def _approach(
        self,
        chain: Chain,
        posture: Floats,
        retreats: _Retreats,
        spheres: ArmSpheres,
        around: Surroundings,
    ) -> Floats | str:
        """Return the line (k, dof) from the grasp back to the pre-grasp, or why there is none."""
        rotation, _ = chain.tool_poses(posture[None])
        near = spheres.slack(around, {**_AT_OBJECT, ("target", "finger"): retreats.touch})
        far = spheres.slack(around, _ALLOWED)
        reason = "approach_ik"
        for back, aside, up in retreats.offsets:
            offset = rotation[0] @ np.array([0.0, aside, -back]) + np.array([0.0, 0.0, up])
            line = follow_line(chain, posture, offset)
            if line is None:
                continue
            if (spheres.clearances(line, around, near) < 0).any():
                reason = max(reason, "approach_collision", key=REASONS.index)
            elif spheres.clearances(line[-1:], around, far)[0] < 0:
                reason = "pregrasp_collision"
            else:
                return line
        return reason

    def _lift(
        self, chain: Chain, posture: Floats, spheres: ArmSpheres, around: Surroundings
    ) -> Floats | None:
        """Return the line (k, dof) up; where the arm is too folded for that, up and away."""
        slack = spheres.slack(around, _LIFTING)
        _, positions = chain.link_frames(posture[None])
        _, tool = chain.tool_poses(posture[None])
        away = (tool[0] - positions[0, 0]) * [1.0, 1.0, 0.0]
        away /= max(float(np.linalg.norm(away)), 1e-6)
        for up, out, level in _LIFTS:
            offset = np.array([0.0, 0.0, up]) + out * away
            line = follow_line(chain, posture, offset, level=level)
            if line is not None and (spheres.clearances(line, around, slack) >= 0).all():
                return line
        return None

    def path(
        self,
        arm: str,
        spheres: ArmSpheres,
        around: Surroundings,
        start: Floats,
        goal: Floats,
        seed: int,
        speed: float = SPEED["free"],
        acceleration: float = ACCELERATION,
        tolerance: float = 0.0,
        allowed: Mapping[tuple[str, str], float] = _ALLOWED,
    ) -> Trajectory | str:
        """Return a timed free path between two postures, or the reason code why there is none.

        Parameters
        ----------
        arm, spheres, around
            What moves among what.
        start, goal : (dof,) float, rad
        seed
            Of the samples.
        speed, acceleration
            Share of the velocity limits; rad/s^2.
        tolerance
            Collision (m) that the start may have: something held hangs where it hangs.
        allowed
            Penetration (m) by obstacle name and sphere group.
        """
        chain = self.chains[arm]
        slack = spheres.slack(around, allowed)
        # The margin fades towards the ends: a pre-grasp may stand closer to its object than that.
        ends = spheres.clearances(np.stack([start, goal]), around, slack)
        if ends[0] < -tolerance:
            return "rrt_start"
        if ends[1] < 0:
            return "rrt_goal"
        margin = min(_MARGIN, float(ends.min()) - 1e-9)

        def is_free(q: Floats) -> NDArray[np.bool_]:
            return np.asarray(spheres.clearances(q, around, slack) >= margin)

        rng = np.random.default_rng((seed, _PURPOSE_PATH))
        corners = plan_path(start, goal, chain.lower, chain.upper, is_free, rng)
        if isinstance(corners, str):
            return corners
        return time_path(corners, speed * chain.velocity, acceleration, is_free)


def _target(request: GraspRequest) -> Obstacle:
    """Return the object itself as an obstacle."""
    if request.round:
        diameter = max(request.width, 1e-3)
        return Obstacle.upright(
            "target", request.x, request.y, request.table_height, (diameter, request.height)
        )
    centre = (request.x, request.y, request.table_height + request.height / 2)
    # The hand closes across the width, so the longer side lies at a right angle to theta.
    size = (request.width, max(request.length, request.width), request.height)
    return Obstacle.box("target", centre, size, request.theta)
