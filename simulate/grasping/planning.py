"""Grasp planning: postures, straight lines and free paths (Gatto 2016, 4.2 and 4.3)."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simulate.grasping.candidates import (
    AT_OBJECT,
    AT_POSE,
    Candidate,
    can_get_there,
    find_candidates,
    groups_as_good,
    iterate_candidates,
    target_obstacle,
)
from simulate.grasping.hand_rules import HandRules, rules_for
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.grasping.whole_motion import WholeMotion
from simulate.motion.arm_space import ALLOWED, SPEED, ArmSpace
from simulate.motion.collision import ArmSpheres, Obstacle, PointField, Surroundings
from simulate.motion.kinematics import Chain, follow_line
from simulate.motion.stance import UPRIGHT, balance_margin
from simulate.motion.trajectory import CARRYING_ACCELERATION, time_path
from simulate.robots.description import Floats
from simulate.world.world import PlaceBox

__all__ = ["REASONS", "GraspPlanner"]

REASONS = (
    "too_heavy",
    "too_wide",
    "ik",
    "unreachable_tilt",
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
"""Reasons why there is no plan; a later one means that the planner got further."""


@dataclass(frozen=True)
class _Retreats:
    """Retreats from the object: back along the approach, along the open mouth, up, m."""

    offsets: tuple[tuple[float, float, float], ...]
    touch: float
    """Penetration of the fingers into the object that is allowed during the approach, m."""


# The mouth is open on three sides, but what comes from the side sweeps the object away when it
# stands a little elsewhere; so that comes second, and with a touch last.
_ASIDE = ((0.030, 0.030, 0.0), (0.030, -0.030, 0.0), (0.0, 0.050, 0.005), (0.0, -0.050, 0.005))
_POSED = _Retreats(((0.10, 0.0, 0.0), (0.07, 0.0, 0.0), (0.05, 0.0, 0.0)), np.inf)
"""Of a pose as it was asked for: back along its approach alone."""
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

_LIFTING: Mapping[tuple[str, str], float] = {
    **ALLOWED,
    ("table", "finger"): 0.008,
    ("target", "finger"): np.inf,
    ("target", "palm"): np.inf,
    ("neighbour", "finger"): AT_OBJECT["neighbour", "finger"],
}
_LIFTING_CLOSELY: Mapping[tuple[str, str], float] = {
    **_LIFTING,
    ("neighbour", "finger"): AT_POSE["neighbour", "finger"],
    ("neighbour", "palm"): AT_POSE["neighbour", "palm"],
}
_POSTURES_TRIED = 14
_BALANCED_M = 0.010
"""Of the centre of mass inside the edge of the feet: the hand goes on moving by some cm."""


@dataclass(frozen=True, eq=False)
class _Ranked:
    """A candidate, the group that holds as well, and the least time of its motion, s."""

    candidate: Candidate
    group: int
    motion: WholeMotion
    bound_s: float


class GraspPlanner:
    """Plans grasps of one robot in one stance, starting from home.

    Parameters
    ----------
    space
        Free space of its arms.
    stance
        Name of the stance. One that is not the robot's own must leave all arms collision-free at
        home, and the robot in balance, wherever the arm goes.
    box_for
        Returns the box into which an arm of a side (1 left, -1 right, 0 both) puts an object at
        y m, if any; by it postures are ranked.
    """

    def __init__(
        self,
        space: ArmSpace,
        stance: str = UPRIGHT,
        box_for: Callable[[int, float], PlaceBox | None] = lambda side, y: None,
    ) -> None:
        self.space = space
        self.robot = space.robot
        self.stance = stance
        self._box_for = box_for
        self.takes_shortest = True
        """Whether the fastest of postures that hold as well is taken, or the first that is free."""

    def plan(
        self, request: GraspRequest, obstacles: Sequence[Obstacle | PointField], seed: int
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

    def gets_to(
        self, arm: str, request: GraspRequest, seed: int, beside: Sequence[Obstacle] = ()
    ) -> bool:
        """Return whether an arm has a posture for a grasp of something.

        The ways there and back are not planned, which is most of the work of :meth:`plan`.

        Parameters
        ----------
        beside
            What stands around it, base frame.
        """
        parts = self.robot.arm(arm)
        if request.width > parts.mouth:
            return False
        solids = [target_obstacle(request), *beside]
        around = self.space.surroundings(arm, request.table_height, solids)
        steepest = rules_for(parts).largest_tilt(request)
        return any(
            not candidate.collides and candidate.tilt <= steepest
            for candidate in iterate_candidates(self.space, arm, request, around, seed)
        )

    def _arms_for(self, request: GraspRequest) -> tuple[str, ...]:
        if request.arm != "auto":
            return (self.robot.arm(request.arm).name,)
        near = sorted(self.robot.arms.values(), key=lambda arm: -arm.side * request.y)
        return tuple(arm.name for arm in near)

    def _plan_with(
        self,
        arm: str,
        request: GraspRequest,
        obstacles: tuple[Obstacle | PointField, ...],
        seed: int,
    ) -> PlannedGrasp | str:
        parts = self.robot.arm(arm)
        if request.mass is not None and request.mass > parts.max_payload:
            return "too_heavy"
        if request.width > parts.mouth:
            return "too_wide"
        if self.stance and not self._is_home_free(request, obstacles):
            return "rrt_start"
        around = self.space.surroundings(arm, request.table_height, obstacles)
        with_target = around.with_obstacles([target_obstacle(request)])
        candidates = find_candidates(self.space, arm, request, with_target, seed)
        rules = rules_for(parts)
        posed = request.pose is not None
        if posed and not candidates:
            anyhow = can_get_there(self.space, arm, request, seed)
            return "unreachable_tilt" if anyhow else "ik"
        steep = [c for c in candidates if posed or c.tilt <= rules.largest_tilt(request)]
        if self.stance:
            steep = [c for c in steep if self._balances(arm, request, c)]
        ranked = self._ranked(arm, request, [c for c in steep if not c.collides], rules)
        reason = "grasp_collision" if steep else "tilt" if candidates else "ik"
        for retreats in (_POSED,) if posed else (_BACKWARDS, _SIDEWAYS, _SWEEPING):
            planned = self._fastest(arm, request, with_target, ranked, retreats, seed)
            if not isinstance(planned, str):
                return replace(planned, obstacles=obstacles, ik_solutions=len(candidates))
            reason = max(reason, planned, key=REASONS.index)
        return reason

    def _ranked(
        self, arm: str, request: GraspRequest, free: Sequence[Candidate], rules: HandRules
    ) -> list[_Ranked]:
        """Return the candidates to complete, by groups that hold as well; the fastest first."""
        parts = self.robot.arm(arm)
        within = rules.EQUAL if self.takes_shortest else 0.0
        groups = groups_as_good(free, request, rules, within, _POSTURES_TRIED)
        if not groups:
            return []
        postures = [np.stack([c.posture for c in group]) for group in groups]
        motion = WholeMotion(
            self.space.chains[arm], np.array(parts.home), self._box_for(parts.side, request.y),
            np.concatenate(postures),
        )  # fmt: skip
        ranked: list[_Ranked] = []
        for number, group in enumerate(groups):
            bounds = motion.bounds(postures[number])
            order = np.argsort(bounds, kind="stable")
            ranked += [_Ranked(group[i], number, motion, float(bounds[i])) for i in order]
        return ranked[:_POSTURES_TRIED]

    def _fastest(
        self,
        arm: str,
        request: GraspRequest,
        with_target: Surroundings,
        ranked: Sequence[_Ranked],
        retreats: _Retreats,
        seed: int,
    ) -> PlannedGrasp | str:
        """Return the fastest plan of the first group that has one, or the reason code."""
        reason, best, best_s, of = REASONS[0], None, np.inf, -1
        for entry in ranked:
            # The lines and detours come on top of a bound, and are much alike within a group.
            if best is not None and (entry.group != of or entry.bound_s >= best_s):
                break
            planned = self._complete(arm, request, with_target, entry.candidate, retreats, seed)
            if isinstance(planned, str):
                reason = max(reason, planned, key=REASONS.index)
                continue
            whole_s = entry.motion.duration(planned)
            ways_s = whole_s - planned.approach.duration - planned.lift.duration
            if ways_s < best_s:
                best, best_s, of = replace(planned, least_s=whole_s), ways_s, entry.group
        return best or reason

    def _is_home_free(
        self, request: GraspRequest, obstacles: tuple[Obstacle | PointField, ...]
    ) -> bool:
        """Tell whether every arm is free of collisions at home in this stance."""
        everything = (*obstacles, target_obstacle(request))
        for name, parts in self.robot.arms.items():
            around = self.space.surroundings(name, request.table_height, everything)
            spheres = self.space.spheres(name, 1.0)
            home = np.array(parts.home)[None]
            if spheres.clearances(home, around, spheres.slack(around, ALLOWED))[0] < 0:
                return False
        return True

    def _balances(self, arm: str, request: GraspRequest, candidate: Candidate) -> bool:
        """Tell whether the robot stays balanced in a posture at the object."""
        homes = {
            joint: value
            for parts in self.robot.arms.values()
            for joint, value in zip(parts.joints, parts.home, strict=True)
        }
        chain = self.space.chains[arm]
        values = {**homes, **dict(zip(chain.names, candidate.posture, strict=True))}
        _, tool = chain.tool_poses(candidate.posture[None])
        margin = balance_margin(self.robot, values, request.mass or 0.0, tool[0])
        return margin >= _BALANCED_M

    def _complete(
        self,
        arm: str,
        request: GraspRequest,
        with_target: Surroundings,
        candidate: Candidate,
        retreats: _Retreats,
        seed: int,
    ) -> PlannedGrasp | str:
        """Find the lines and the free path of one posture, or return the reason code."""
        chain = self.space.chains[arm]
        spheres = self.space.spheres(arm, candidate.opening)
        close = request.pose is not None
        posture = candidate.posture
        back = self._approach(chain, posture, retreats, spheres, with_target, close)
        if isinstance(back, str):
            return back
        lift = self._lift(chain, posture, spheres, with_target, close)
        if lift is None:
            return "lift_ik"
        free = self.space.path(
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
            stance=self.stance,
        )

    def _approach(
        self,
        chain: Chain,
        posture: Floats,
        retreats: _Retreats,
        spheres: ArmSpheres,
        around: Surroundings,
        close: bool,
    ) -> Floats | str:
        """Return the line (k, dof) from the grasp back to the pre-grasp, or the reason code."""
        rotation, _ = chain.tool_poses(posture[None])
        at_object = AT_POSE if close else AT_OBJECT
        near = spheres.slack(around, {**at_object, ("target", "finger"): retreats.touch})
        far = spheres.slack(around, ALLOWED)
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
        self,
        chain: Chain,
        posture: Floats,
        spheres: ArmSpheres,
        around: Surroundings,
        close: bool,
    ) -> Floats | None:
        """Return the line (k, dof) up or, if the arm is too folded for that, up and away."""
        slack = spheres.slack(around, _LIFTING_CLOSELY if close else _LIFTING)
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
