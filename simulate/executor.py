"""Carrying out a planned grasp, and judging what came of it.

Phases: pre-grasp, approach, close, lift, hold, transport, place. Whatever goes wrong is a reason
code in the record, never an exception.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulate.arm_space import SPEED, ArmSpace
from simulate.collision import Obstacle
from simulate.grasp_planning import GraspPlanner
from simulate.grasp_record import GraspRecord
from simulate.grasp_rules import GraspRequest, PlannedGrasp
from simulate.placing import PlacePlan, plan_place
from simulate.success import MIN_LINKS, ObjectState, held_reason, is_placed
from simulate.trajectory import Trajectory, time_path

if TYPE_CHECKING:
    from simulate.robot_body import RobotBody
    from simulate.world import PlaceBox, World

__all__ = ["Executor", "GraspRecord", "GraspRequest", "PlannedGrasp"]

log = logging.getLogger(__name__)

Floats = NDArray[np.float64]

_CONTROL_S = 0.010
_SETTLE_S = 0.08
_CLOSE_S, _OPEN_S, _HOLD_S, _REST_S = 0.8, 0.6, 2.0, 1.0
_TRACKING_RAD = 0.05
_CONTACT_CHECK_S = 0.05
# More torque than this does not hold better: the V of the mouth squeezes the object out. Slip from
# closing to the end of the hold, 18 grasps each: 4 mm at .06, 5 mm at .10, 10 mm at .16 N m.
_CLOSE_TORQUE, _OPEN_TORQUE = 0.06, 0.144
_NEAR_M = 0.06


class Executor:
    """Plans and carries out grasps of one robot in its world.

    Parameters
    ----------
    world, robot
        The world and the robot that stands in it.

    Notes
    -----
    Planning sees the request, the caller's obstacles, and the furniture that the robot was set up
    with: the table and its boxes. Poses of objects are read during execution only, to judge.
    """

    def __init__(self, world: World, robot: RobotBody) -> None:
        self.world = world
        self.robot = robot
        walls = [
            Obstacle.box("box", centre, size)
            for box in world.place_boxes.values()
            for centre, size in box.walls()
        ]
        self.space = ArmSpace(robot.description, walls)
        self.planner = GraspPlanner(self.space)
        self._placed_before = dict.fromkeys(world.place_boxes, 0)

    def plan(
        self,
        request: GraspRequest,
        obstacles: Sequence[Obstacle | Floats] = (),
        seed: int = 0,
    ) -> PlannedGrasp | str:
        """Plan a grasp.

        Parameters
        ----------
        request
            What to grasp.
        obstacles
            What else stands there: boxes, or point clouds (n, 3), m, base frame, of one object
            each, which become upright prisms down to the table.
        seed
            Of every random choice of the planner.

        Returns
        -------
        PlannedGrasp or str
            The plan, or the reason code why there is none.
        """
        boxes = []
        for thing in obstacles:
            if isinstance(thing, Obstacle):
                boxes.append(thing)
            elif len(thing):
                boxes.append(Obstacle.around("neighbour", thing, request.table_height))
        return self.planner.plan(request, boxes, seed)

    def execute(
        self,
        plan: PlannedGrasp,
        on_phase: Callable[[str], None] = lambda phase: None,
        *,
        place: bool = True,
    ) -> GraspRecord:
        """Carry out a plan: grasp, lift, hold, put into the box of that side, go home.

        Parameters
        ----------
        plan
            From :meth:`plan`.
        on_phase
            Called with the name of each phase when it ends.
        place
            False puts the object back where it was instead.
        """
        return _Attempt(self, plan, on_phase).run(place)

    def next_spot(self, side: str) -> int:
        """Return how many objects were put into a box before, and count one more."""
        used = self._placed_before[side]
        self._placed_before[side] = used + 1
        return used


class _Attempt:
    """One execution, phase by phase."""

    def __init__(
        self, executor: Executor, plan: PlannedGrasp, on_phase: Callable[[str], None]
    ) -> None:
        self.executor = executor
        self.world, self.robot = executor.world, executor.robot
        self.plan, self.arm = plan, plan.arm
        self._on_phase = on_phase
        self._ticks = max(round(_CONTROL_S / self.world.preset.step_s), 1)
        self._started = self._phase_started = self.world.time
        self._times: dict[str, float] = {}
        self._states: dict[str, ObjectState] = {}
        self._in_hand: dict[str, Floats] = {}
        self.target = self._find_target()

    # -- the whole -------------------------------------------------------------------------

    def run(self, place: bool) -> GraspRecord:
        self._note("start")
        reason = self._grasp()
        place_reason, offset = "", float("nan")
        if reason == "ok" and place:
            place_reason, offset = self._place()
        elif reason == "ok":
            self._put_back()
        return self._record(reason, place_reason, offset)

    def _grasp(self) -> str:
        self._start_at_home()
        self.robot.move_fingers(self.arm, self.plan.opening, _OPEN_TORQUE)
        if not self._follow(self.plan.free):
            self._go_home()
            return "tracking"
        self._end("pregrasp")
        self._follow(self.plan.approach)
        self._end("approach")
        self._fingers(0.0, _CLOSE_TORQUE, _CLOSE_S)
        closed = self._end("close")
        if closed.links < MIN_LINKS:
            self._back_off()
            return "missed" if closed.is_finite else "not_judged"
        self._follow(self.plan.lift)
        self._end("lift")
        self._steps(_HOLD_S)
        self._end("hold")
        reason = held_reason(self._states["close"], self._states["lift"], self._states["hold"])
        if reason != "ok":
            self._put_back()
        return reason

    def _place(self) -> tuple[str, float]:
        side = "left" if self.robot.arm(self.arm).side > 0 else "right"
        box = self.world.place_boxes.get(side)
        if box is None:
            self._put_back()
            return "place_plan", float("nan")
        used = self.executor.next_spot(side)
        start = self.plan.lift.positions[-1]
        way = plan_place(self.executor.space, self.plan, start, box, used)
        if isinstance(way, str):
            self._put_back()
            return way, float("nan")
        return self._carry(way, box)

    def _carry(self, way: PlacePlan, box: PlaceBox) -> tuple[str, float]:
        kept = self._follow(way.transport, watch=True)
        self._end("transport")
        self._follow(way.lower)
        self._open(1.0)
        self._end("place")
        self._follow(way.retreat)
        self.robot.rest_hand(self.arm)
        self._steps(_REST_S - (self.world.time - self._phase_started))
        state = self._end("home")
        offset = float(np.linalg.norm(state.position[:2] - box.centre))
        if is_placed(self._in_base(state), box):
            return "ok", offset
        return ("drop_outside" if kept else "slip_transport"), float("nan")

    # -- ways back -------------------------------------------------------------------------

    def _back_off(self) -> None:
        """Open at the object and go home the way the hand came."""
        self._open(self.plan.opening)
        self._follow(_reverse(self.plan.approach, 2.0))
        self._go_home()

    def _put_back(self) -> None:
        """Lower what may still hang in the hand, then back off."""
        self._follow(_reverse(self.plan.lift, 1.0))
        self._back_off()

    def _go_home(self) -> None:
        self._follow(_reverse(self.plan.free, 1.0))
        self._start_at_home()
        self.robot.rest_hand(self.arm)
        self._end("home")

    def _start_at_home(self) -> None:
        """Drive straight home in case something kept the arm from it."""
        home, now = self.robot.home(self.arm), self.robot.arm_joints(self.arm)
        if np.max(np.abs(now - home)) > _TRACKING_RAD:
            velocity = SPEED["return"] * self.robot.chains[self.arm].velocity
            self._follow(time_path(np.stack([now, home]), velocity))

    # -- motion ----------------------------------------------------------------------------

    def _steps(self, seconds: float) -> None:
        self.world.step(seconds)

    def _follow(self, way: Trajectory, watch: bool = False) -> bool:
        """Drive the arm along way points; return whether it arrived (``watch``: still touching)."""
        step = self._ticks * self.world.preset.step_s
        touching, since = True, 0.0
        time = 0.0
        while time < way.duration:
            time += step
            position, velocity = way.at(time)
            self.robot.command_arm(self.arm, position, velocity)
            self.world.step(step)
            since += step
            if watch and since >= _CONTACT_CHECK_S:
                touching, since = touching and self._touch_links() > 0, 0.0
        self._steps(_SETTLE_S)
        if watch:
            return touching
        error = np.abs(self.robot.arm_joints(self.arm) - way.positions[-1])
        return bool(np.all(error < _TRACKING_RAD))

    def _open(self, opening: float) -> None:
        self._fingers(opening, _OPEN_TORQUE, _OPEN_S)

    def _fingers(self, opening: float, torque: float, seconds: float) -> None:
        self.robot.move_fingers(self.arm, opening, torque)
        self._steps(seconds)

    # -- what is measured ------------------------------------------------------------------

    def _find_target(self) -> int:
        """Return the object nearest to the grasp, to be judged; -1 = there is none."""
        request, best, nearest = self.plan.request, -1, _NEAR_M
        wanted = self._in_world(np.array([request.x, request.y, request.table_height]))
        for body in sorted(self.world.objects):
            pose = self.world.object_pose(body)
            distance = float(np.linalg.norm(pose.position[:2] - wanted[:2]))
            if distance < nearest and abs(pose.z - wanted[2]) < 0.15:
                best, nearest = body, distance
        return best

    def _touch_links(self) -> int:
        return self.robot.touch(self.arm, self.target).links if self.target >= 0 else 0

    def _state(self) -> ObjectState:
        if self.target < 0:
            return ObjectState(np.zeros(3))
        touch = self.robot.touch(self.arm, self.target)
        position = self.world.object_pose(self.target).position
        return ObjectState(position, touch.links, touch.force_n, self.world.on_table(self.target))

    def _note(self, phase: str) -> ObjectState:
        state = self._state()
        self._states[phase] = state
        tool = self.robot.tool_pose(self.arm)
        self._in_hand[phase] = (self._in_base(state).position - tool[:3, 3]) @ tool[:3, :3]
        return state

    def _end(self, phase: str) -> ObjectState:
        """Close a phase: measure, keep its time, tell the caller."""
        self._times[phase] = self.world.time - self._phase_started
        self._phase_started = self.world.time
        state = self._note(phase)
        self._on_phase(phase)
        return state

    def _in_base(self, state: ObjectState) -> ObjectState:
        pose = self.robot.world_from_base
        return replace(state, position=(state.position - pose[:3, 3]) @ pose[:3, :3])

    def _in_world(self, point: Floats) -> Floats:
        pose = self.robot.world_from_base
        return np.asarray(pose[:3, :3] @ point + pose[:3, 3])

    def _record(self, reason: str, place_reason: str, offset: float) -> GraspRecord:
        plan, states = self.plan, self._states
        last = next(states[p] for p in ("hold", "lift", "close", "start") if p in states)
        hand = [self._in_hand[p] for p in ("close", "hold") if p in self._in_hand]
        pushed = (
            np.linalg.norm(states["approach"].position - states["start"].position)
            if "approach" in states
            else 0.0
        )
        return GraspRecord(
            grasp=plan,
            arm=plan.arm,
            end_effector=self.robot.arm(plan.arm).end_effector,
            preset=self.world.preset.name,
            seed=plan.seed,
            reason=reason,
            held=reason == "ok",
            placed=place_reason == "ok",
            place_reason=place_reason,
            pushed_m=float(pushed),
            links_touching=last.links,
            contact_force_n=last.force_n,
            lifted_m=float(last.position[2] - states["start"].position[2]),
            slip_m=float(np.linalg.norm(hand[-1] - hand[0])) if len(hand) == 2 else 0.0,
            place_offset_m=offset,
            duration_s=self.world.time - self._started,
            planning_s=plan.planning_s,
            tilt=plan.tilt,
            ik_solutions=plan.ik_solutions,
            times=self._times,
            links={phase: state.links for phase, state in states.items()},
            forces={phase: state.force_n for phase, state in states.items()},
        )


def _reverse(way: Trajectory, faster: float) -> Trajectory:
    """Return way points driven backwards, ``faster`` times as fast."""
    return Trajectory(
        way.positions[::-1],
        -way.velocities[::-1] * faster,
        way.accelerations[::-1] * faster**2,
        (way.times[-1] - way.times[::-1]) / faster,
    )
