"""Execution of a planned grasp in the physics world, phase by phase.

Phases: pre-grasp, approach, close, lift, hold, transport, place. Whatever goes wrong with the
grasp is a reason code, never an exception; only a world that has ceased to make sense is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from rtask.errors import RobotError
from simulate.grasping.placing import PlacePlan, PlaceSpot, plan_place
from simulate.grasping.record import GraspRecord
from simulate.grasping.rules import PlannedGrasp
from simulate.grasping.success import MIN_LINKS, ObjectState, held_reason, is_placed, lies_at
from simulate.motion.arm_space import SPEED, ArmSpace
from simulate.motion.stance import UPRIGHT
from simulate.motion.trajectory import Trajectory, time_path
from simulate.robots.description import Floats
from simulate.world.robot_body import RobotBody
from simulate.world.world import World

__all__ = ["AttemptRun", "Station"]

_CONTROL_S = 0.010
_SETTLE_S = 0.08
_CLOSE_S, _OPEN_S, _HOLD_S, _REST_S = 0.8, 0.6, 2.0, 1.0
_TRACKING_RAD = 0.05
_CONTACT_CHECK_S = 0.05
# Shares of the opening: a finger that moves less than this when it closes is stuck, one that is
# further than that from where it should be did not open.
_MOVED_OPENING, _OFF_OPENING = 0.05, 0.25
_NEAR_M = 0.06
_TARGET_HEIGHT_M = 0.15


class Station(Protocol):
    """The robot at its workplace, as an attempt needs it, e.g. the executor."""

    world: World
    robot: RobotBody

    def space_of(self, stance: str) -> ArmSpace:
        """Return the space in which the arms move in a stance."""

    def next_spot(self, side: str) -> int:
        """Return how many objects were placed into a box before, and count one more."""


class AttemptRun:
    """One attempt to grasp and place an object.

    Parameters
    ----------
    station
        World, robot and the space of its arms.
    plan
        What to carry out.
    on_phase
        Called with the name of each phase when it ends.

    Notes
    -----
    :meth:`grasp` ends with the object in the hand, or with the arm at home. After a success one of
    :meth:`place_in_box`, :meth:`place_at` and :meth:`put_back` brings the arm home. :attr:`record`
    is what came of it so far.
    """

    def __init__(
        self, station: Station, plan: PlannedGrasp, on_phase: Callable[[str], None]
    ) -> None:
        self._station = station
        self.world, self.robot = station.world, station.robot
        self.plan, self.arm = plan, plan.arm
        self.reason = "not_judged"
        self.place_reason = ""
        self.error_m = float("nan")
        """Distance of the tool from where it should be, at the grasp, later where it sets down."""
        self._hand = self.robot.arm(plan.arm)
        self._place_offset = float("nan")
        self._on_phase = on_phase
        self._ticks = max(round(_CONTROL_S / self.world.preset.step_s), 1)
        self._started = self._phase_started = self.world.time
        self._times: dict[str, float] = {}
        self._states: dict[str, ObjectState] = {}
        self._in_hand: dict[str, Floats] = {}
        self.target = self._find_target()
        self._note("start")

    # -- the phases ------------------------------------------------------------------------

    def reach(self) -> str:
        """Go to the pre-grasp and on to the grasp with an open hand, and stay there.

        Returns
        -------
        str
            ``ok``; ``tracking`` when something kept the arm from it, ``hardware`` when the hand
            does not open as planned: then the arm is at home.
        """
        self._start_at_home()
        self.robot.take_stance(self.plan.stance)
        self.robot.move_fingers(self.arm, self.plan.opening, self._hand.open_effort)
        arrived = self._follow(self.plan.free)
        opens = abs(self.robot.finger_opening(self.arm) - self.plan.opening) < _OFF_OPENING
        if not arrived or not opens:
            self._go_home()
            return "hardware" if arrived else "tracking"
        self._end("pregrasp")
        self._follow(self.plan.approach)
        self._end("approach")
        request = self.plan.request
        height = request.table_height + self.plan.tool_height
        self._measure_error(np.array([request.x, request.y, height]))
        return "ok"

    def pretend(self) -> str:
        """Reach and lift with an open hand, as if something were held."""
        reason = self.reach()
        if reason == "ok":
            self._follow(self.plan.lift)
            self._end("lift")
        return reason

    def grasp(self) -> str:
        """Grasp, lift and hold; return the reason code, ``ok`` with the object in the hand."""
        self.reason = self.reach()
        if self.reason != "ok":
            return self.reason
        before = self.robot.finger_opening(self.arm)
        self._fingers(0.0, self._hand.close_effort, _CLOSE_S)
        closed = self._end("close")
        if closed.links < MIN_LINKS:
            jammed = before - self.robot.finger_opening(self.arm) < _MOVED_OPENING
            self.back_off()
            self.reason = "hardware" if jammed else "missed"
            if not closed.is_finite:
                self.reason = "not_judged"
            return self.reason
        self._follow(self.plan.lift)
        self._end("lift")
        self._steps(_HOLD_S)
        self._end("hold")
        self.reason = held_reason(self._states["close"], self._states["lift"], self._states["hold"])
        if self.reason != "ok":
            self.put_back()
        return self.reason

    def place_in_box(self) -> str:
        """Place the held object into the box of its side and go home; return the reason code."""
        box = self.world.box_for(self._hand.side, self.plan.request.y)
        if box is None:
            self.put_back()
            self.place_reason = "place_plan"
            return self.place_reason
        used = self._station.next_spot(box.side)
        request = self.plan.request
        spot = PlaceSpot.in_box(box, used, max(request.height, request.length))
        return self._place(spot, lambda state: is_placed(state, box), np.array(box.centre))

    def place_at(self, x: float, y: float) -> str:
        """Place the held object on the table at (x, y) m, base frame, and go home."""
        spot = PlaceSpot.on_table(x, y, self.plan.request.table_height)
        wanted = np.array([x, y])
        return self._place(spot, lambda state: lies_at(state, wanted, spot.floor), wanted)

    def put_back(self) -> None:
        """Lower whatever is still in the hand, back off and go home."""
        self._follow(_reverse(self.plan.lift, 1.0))
        self.back_off()

    def back_off(self) -> None:
        """Open the hand at the object and go home along the approach."""
        self._open(self.plan.opening)
        self._follow(_reverse(self.plan.approach, 2.0))
        self._go_home()

    def _measure_error(self, wanted: Floats) -> None:
        tool = self.robot.tool_pose(self.arm)[:3, 3]
        self.error_m = float(np.linalg.norm(tool - wanted))

    def _place(
        self, spot: PlaceSpot, is_there: Callable[[ObjectState], bool], wanted: Floats
    ) -> str:
        start = self.plan.lift.positions[-1]
        way = plan_place(self._station.space_of(self.plan.stance), self.plan, start, spot)
        if isinstance(way, str):
            self.put_back()
            self.place_reason = way
            return way
        kept = self._follow(way.transport, watch=True)
        self._end("transport")
        self._set_down(way)
        state = self._end("home")
        if is_there(self._in_base(state)):
            self.place_reason = "ok"
            self._place_offset = float(np.linalg.norm(self._in_base(state).position[:2] - wanted))
        else:
            self.place_reason = "drop_outside" if kept else "slip_transport"
        return self.place_reason

    def _set_down(self, way: PlacePlan) -> None:
        self._follow(way.lower)
        self._measure_error(way.tool)
        self._open(1.0)
        self._end("place")
        self._follow(way.retreat)
        self.robot.rest_hand(self.arm)
        self.robot.take_stance(UPRIGHT)
        self._steps(_REST_S - (self.world.time - self._phase_started))

    # -- ways back -------------------------------------------------------------------------

    def _go_home(self) -> None:
        self._follow(_reverse(self.plan.free, 1.0))
        self._start_at_home()
        self.robot.rest_hand(self.arm)
        self.robot.take_stance(UPRIGHT)
        self._end("home")

    def _start_at_home(self) -> None:
        """Move straight home if something kept the arm from getting there."""
        home, now = self.robot.home(self.arm), self._joints()
        if np.max(np.abs(now - home)) > _TRACKING_RAD:
            velocity = SPEED["return"] * self.robot.chains[self.arm].velocity
            self._follow(time_path(np.stack([now, home]), velocity))

    # -- motion ----------------------------------------------------------------------------

    def _steps(self, seconds: float) -> None:
        self.world.step(seconds)

    def _joints(self) -> Floats:
        """Return the arm's measured joints.

        Raises
        ------
        RobotError
            Physics broke down: a joint is not a number, and nothing in this world makes sense now.
        """
        joints = self.robot.arm_joints(self.arm)
        if not np.isfinite(joints).all():
            names = self.robot.chains[self.arm].names
            broken = ", ".join(n for n, q in zip(names, joints, strict=True) if not np.isfinite(q))
            raise RobotError(
                f"the simulation broke down after {self.world.time:.2f} s: {broken} of "
                f"{self.robot.description.name} is not a number; make a new world",
                reason="not_judged",
            )
        return joints

    def _follow(self, way: Trajectory, watch: bool = False) -> bool:
        """Move the arm along way points; return whether it arrived (``watch``: kept contact)."""
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
        error = np.abs(self._joints() - way.positions[-1])
        return touching if watch else bool(np.all(error < _TRACKING_RAD))

    def _open(self, opening: float) -> None:
        self._fingers(opening, self._hand.open_effort, _OPEN_S)

    def _fingers(self, opening: float, effort: float, seconds: float) -> None:
        self.robot.move_fingers(self.arm, opening, effort)
        self._steps(seconds)

    # -- what is measured ------------------------------------------------------------------

    def _find_target(self) -> int:
        """Return the object nearest to the grasp, to be judged; -1 = there is none."""
        request, best, nearest = self.plan.request, -1, _NEAR_M
        wanted = self._in_world(np.array([request.x, request.y, request.table_height]))
        for body in sorted(self.world.objects):
            pose = self.world.object_pose(body)
            distance = float(np.linalg.norm(pose.position[:2] - wanted[:2]))
            if distance < nearest and abs(pose.z - wanted[2]) < _TARGET_HEIGHT_M:
                best, nearest = body, distance
        return best

    def _is_there(self) -> bool:
        """Whether the object is still in the world: somebody may have taken it away."""
        return self.target >= 0 and self.target in self.world.objects

    def _touch_links(self) -> int:
        return self.robot.touch(self.arm, self.target).links if self._is_there() else 0

    def _state(self) -> ObjectState:
        if not self._is_there():  # taken away: where it was last, touched by nothing
            return replace(self._states.get("start", ObjectState(np.zeros(3))), links=0, force_n=0)
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
        """End a phase: measure the state, note the duration, call back."""
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

    @property
    def record(self) -> GraspRecord:
        """Record of the attempt so far."""
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
            end_effector=self._hand.end_effector,
            preset=self.world.preset.name,
            seed=plan.seed,
            reason=self.reason,
            held=self.reason == "ok",
            placed=self.place_reason == "ok",
            place_reason=self.place_reason,
            pushed_m=float(pushed),
            links_touching=last.links,
            contact_force_n=last.force_n,
            lifted_m=float(last.position[2] - states["start"].position[2]),
            slip_m=float(np.linalg.norm(hand[-1] - hand[0])) if len(hand) == 2 else 0.0,
            place_offset_m=self._place_offset,
            duration_s=self.world.time - self._started,
            planning_s=plan.planning_s,
            tilt=plan.tilt,
            ik_solutions=plan.ik_solutions,
            times=self._times,
            links={phase: state.links for phase, state in states.items()},
            forces={phase: state.force_n for phase, state in states.items()},
        )


def _reverse(way: Trajectory, faster: float) -> Trajectory:
    """Return way points in reverse order, ``faster`` times as fast."""
    return Trajectory(
        way.positions[::-1],
        -way.velocities[::-1] * faster,
        way.accelerations[::-1] * faster**2,
        (way.times[-1] - way.times[::-1]) / faster,
    )
