"""The act service of one robot: goal poses in, outcomes out (Gatto 2016, 4.3)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from simulate.act.request import ActRequest
from simulate.grasping.attempt.driving import ArmDrive
from simulate.grasping.attempt.run import AttemptRun
from simulate.grasping.executor import Workcell
from simulate.grasping.record import GraspRecord
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.collision import Obstacle, PointField

__all__ = ["ActService", "imagined", "plan_goal", "theta_offsets"]

_WIDTH_M, _LENGTH_M = 0.030, 0.040
_LOWEST_M = 0.010
_IMAGINED_HEIGHT_M = 0.070
_POSTURES_PER_S = 40_000
"""Postures that planning evaluates in a second of CPU (NAO 35,000, Panda 49,000 on a server core).

Planning time is limited by this work, not by the clock, so that a request has the same answer on a
busy machine.
"""


class ActService:
    """Acts in one workcell.

    Parameters
    ----------
    cell
        Robot, world and planner.
    name
        Further name of the robot, besides that of its model.
    seed
        Seed of every plan.

    Notes
    -----
    After ``reach`` the arm stays at the goal; after a successful ``grasp`` the object stays in the
    hand. The next action starts from there: ``place`` puts the object down, any other action first
    returns home.

    Examples
    --------
    >>> with Workcell("nao", preset="fast") as cell:
    ...     service = ActService(cell)
    ...     upright = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    ...     goal = {"position": {"x": 0.15, "y": -0.10, "z": 0.305}, "orientation": upright}
    ...     answer = service.act({"action_type": "reach", "goal_pose": goal})
    >>> answer["success"], answer["reason"], answer["arm"]
    (1, 'ok', 'right_arm')
    """

    def __init__(self, cell: Workcell, name: str = "", seed: int = 0) -> None:
        self.cell = cell
        self.name = name
        self.seed = seed
        self._under_way: AttemptRun | None = None
        self._holds = False

    @property
    def has_the_arm(self) -> bool:
        """Whether an arm stands at a goal or holds something, from which the next action starts."""
        return self._under_way is not None

    def act(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Carry out one request.

        Parameters
        ----------
        message
            Fields of :class:`~simulate.act.request.ActMessage`.

        Returns
        -------
        dict
            ``success`` 1 when the tool came to the goal within ``distance_error_allowed``, which
            says nothing about the object; ``held``, ``placed``, ``reason`` (a code of the
            ontology, ``ok``), ``distance_error_m``, ``theta``, ``arm``, ``record``.

        Raises
        ------
        UsageError, RobotError
            The request is invalid, or the physics diverged.
        """
        request = ActRequest.read(message, self.cell.description, self.name)
        if request.action == "place" and self._holds:
            return self._place_held(request)
        self.go_home()
        if request.action == "home":
            # A trajectory controller may have moved an arm since, of which no run knows.
            return _answer(request, "ok", 0.0 if self._are_home() else math.nan)
        if request.action == "place":
            return self._pretend_to_place(request)
        planned = plan_goal(self.cell, request, self.seed)
        if isinstance(planned, str):
            return _answer(request, planned)
        run = self.cell.executor.begin(planned)
        if request.action == "reach":
            reason = run.reach()
            self._under_way = run if reason == "ok" else None
            return _answer(request, reason, run.error_m, planned, run.record)
        reason = run.grasp()
        if reason == "ok":
            self._under_way, self._holds = run, True
        error_m = run.error_m
        if reason == "ok" and request.action == "pick_place":
            reason = run.place_in_box()
            self._under_way, self._holds = None, False
        return _answer(request, reason, error_m, planned, run.record)

    def go_home(self) -> None:
        """Put back the held object, and bring the arm home."""
        run, self._under_way = self._under_way, None
        holds, self._holds = self._holds, False
        if run is not None:
            if holds:
                run.put_back()
            else:
                run.back_off()

    def _are_home(self) -> bool:
        """Bring each arm home that is elsewhere; return whether all got there."""
        world, robot = self.cell.world, self.cell.robot
        drives = (ArmDrive(world, robot, arm, lambda phase: None) for arm in robot.arms)
        arrived = [drive.start_at_home() for drive in drives]  # the others too, if one did not
        return all(arrived)

    def _place_held(self, request: ActRequest) -> dict[str, Any]:
        run, self._under_way, self._holds = self._under_way, None, False
        assert run is not None
        reason = run.place_at(*request.position[:2])
        error_m = math.nan if reason == "place_plan" else run.error_m
        return _answer(request, reason, error_m, run.plan, run.record)

    def _pretend_to_place(self, request: ActRequest) -> dict[str, Any]:
        """Move as if an imaginary object were carried from the middle of the arm's area."""
        planned = imagined(self.cell, request, self.seed)
        if isinstance(planned, str):
            return _answer(request, planned)
        run = self.cell.executor.begin(planned)
        reason = run.pretend()
        if reason != "ok":
            return _answer(request, reason, math.nan, planned, run.record)
        reason = run.place_at(*request.position[:2])
        reached = reason != "place_plan"
        error_m = run.error_m if reached else math.nan
        return _answer(request, "ok" if reached else reason, error_m, planned)


def theta_offsets(step: float, attempts: int) -> Iterator[float]:
    """Yield the offset of theta at each attempt, rad: 0, +step, -step, +2 step ... up to 90 deg.

    Examples
    --------
    >>> [round(t, 2) for t in theta_offsets(0.5, 6)]
    [0.0, 0.5, -0.5, 1.0, -1.0, 1.5]
    """
    # Jaws turned by half a turn are the same jaws: a quarter to either side is every direction.
    widest = math.pi / 2 + 1e-9
    offsets = [0.0]
    if step > 0:
        for k in range(1, int(widest / step) + 1):
            offsets += [k * step, -k * step]
    for attempt in range(attempts):
        yield offsets[attempt % len(offsets)]


def plan_goal(
    cell: Workcell,
    request: ActRequest,
    seed: int,
    obstacles: Sequence[Obstacle | PointField] = (),
) -> PlannedGrasp | str:
    """Plan the motion to a goal pose, trying other values of theta if it is out of reach.

    Parameters
    ----------
    obstacles
        What stands around, base frame; none for an empty table.

    Returns
    -------
    PlannedGrasp or str
        Without a plan, the reason of the attempt that got furthest, or ``timed_out`` when the
        planning time, counted as work, is used up.
    """
    x, y, z = request.position
    table = cell.world.table_height
    if z <= table:
        return "grasp_collision"
    goal_request = GraspRequest(
        x=x,
        y=y,
        theta=request.theta,
        z=z - request.depth if request.depth > 0 else math.nan,
        width=_WIDTH_M,
        length=_LENGTH_M,
        height=max(2 * (z - table), _LOWEST_M),
        table_height=table,
        arm=request.arm,
        position_tolerance=request.tolerance,
        only_theta=True,
    )
    reason = ""
    executor = cell.executor
    limit = executor.planning_work + request.planning_s * _POSTURES_PER_S
    for attempt, offset in enumerate(theta_offsets(request.angle_step, request.attempts)):
        # The first attempt is always made: a request that planned nothing would say nothing about
        # the goal.
        if attempt and executor.planning_work > limit:
            return "timed_out"
        planned = executor.plan(
            replace(goal_request, theta=goal_request.theta + offset), obstacles, seed + attempt
        )
        if not isinstance(planned, str):
            return planned
        # The reason at the angle that was asked for; later ones are those of angles that nobody
        # named.
        reason = reason or planned
    return reason


def imagined(cell: Workcell, request: ActRequest, seed: int) -> PlannedGrasp | str:
    """Plan to pick an imaginary object from the middle of the placing arm's area."""
    place = cell.world.workplace
    side = -1 if request.position[1] < 0 else 1
    if request.arm != "auto":
        side = cell.description.arm(request.arm).side or side
    start = (
        sum(place.area_x) / 2,
        side * sum(place.area_abs_y) / 2,
        cell.world.table_height + _IMAGINED_HEIGHT_M / 2,
    )
    return plan_goal(cell, replace(request, position=start, depth=0.0, theta=0.0), seed)


def _answer(
    request: ActRequest,
    reason: str,
    error_m: float = math.nan,
    plan: PlannedGrasp | None = None,
    record: GraspRecord | None = None,
) -> dict[str, Any]:
    reached = math.isfinite(error_m) and error_m <= request.error_allowed
    # The motion ended as planned, and the hand is elsewhere all the same: sent is not arrived.
    if reason == "ok" and not reached:
        reason = "tracking"
    return {
        "success": int(reached),
        "held": record is not None and record.held,
        "placed": record is not None and record.placed,
        "reason": reason,
        "distance_error_m": _finite(error_m),
        "theta": plan.closing_angle if plan is not None else request.theta,
        "arm": plan.arm if plan is not None else "",
        "record": {} if record is None else _as_json(record),
    }


def _finite(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None


def _as_json(record: GraspRecord) -> dict[str, Any]:
    """Return the reported part of a record as JSON data, without values that are not finite."""
    plan = record.grasp
    numbers = {
        "lifted_m": record.lifted_m,
        "slip_m": record.slip_m,
        "jaw_gap_m": record.jaw_gap_m,
        "place_offset_m": record.place_offset_m,
        "duration_s": record.duration_s,
        "planning_s": record.planning_s,
        "contact_force_n": record.contact_force_n,
        "tilt": record.tilt,
        "opening": plan.opening,
        "tool_height": plan.tool_height,
    }
    return {
        "end_effector": record.end_effector,
        "preset": record.preset,
        "seed": record.seed,
        "grasp_reason": record.reason,
        "place_reason": record.place_reason,
        "links_touching": record.links_touching,
        "evidence": record.evidence,
        "ik_solutions": record.ik_solutions,
        **{name: round(float(v), 6) for name, v in numbers.items() if np.isfinite(v)},
        "times": {phase: round(s, 4) for phase, s in record.times.items()},
    }
