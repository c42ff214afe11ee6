"""Execution of a planned grasp in the physics world, phase by phase.

Phases: pre-grasp, approach, close, lift, hold, transport, place. A grasp that fails gives a reason
code, never an exception; only diverging physics raises one. The robot judges by its own senses
(:mod:`simulate.grasping.judgement`); true poses of objects are not used here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from rtask.errors import RobotError
from simulate.grasping.judgement import (
    CLOSED_ON_SOMETHING,
    MIN_RISE_M,
    HeightMap,
    Judgement,
    judge_held,
    judge_off_table,
    judge_old_place,
    judge_placed,
    new_cells,
)
from simulate.grasping.motion_log import MotionLog
from simulate.grasping.placing import PlacePlan, PlaceSpot, held_load, plan_place, plan_rise
from simulate.grasping.record import GraspRecord
from simulate.grasping.rules import PlannedGrasp
from simulate.motion.arm_space import SPEED, ArmSpace
from simulate.motion.stance import UPRIGHT
from simulate.motion.trajectory import Trajectory, reverse, time_path
from simulate.robots.description import Floats
from simulate.world.eyes import Eyes
from simulate.world.robot_body import REST_OPENING, FingerTouch, RobotBody
from simulate.world.world import PlaceBox, World

__all__ = ["AttemptRun", "Station"]

_CONTROL_S = 0.010
_SETTLE_S = 0.08
_CLOSE_S, _OPEN_S, _HOLD_S, _REST_S = 0.8, 0.6, 2.0, 1.0
_TRACKING_RAD = 0.05
_CONTACT_CHECK_S = 0.05
# Shares of the opening: a finger is stuck that moves less than this when it closes, and less than a
# quarter of its way to the object; one that is further than that from its command did not open.
_MOVED_OPENING, _OFF_OPENING = 0.05, 0.25
_HIGHEST_M = 0.20
_BESIDE_M = 0.05
_MARGIN_M = 0.005
_OVER_TABLE_M = 0.010
_HIGHER_M = 0.060
"""By which a hand is lifted further if an end of what it holds is still low."""
_ARM_MARGIN_M = 0.010
_LOW_M = 0.030
"""Over the table: a lifted hand and what it holds are higher."""


class Station(Protocol):
    """The robot at its workplace, as an attempt uses it, e.g. the executor."""

    world: World
    robot: RobotBody
    eyes: Eyes

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
        The plan to execute.
    on_phase
        Called with the name of each phase at its end.

    Notes
    -----
    :meth:`grasp` ends with the object in the hand, or with the arm at home. After a success one of
    :meth:`place_in_box`, :meth:`place_at` and :meth:`put_back` brings the arm home. :attr:`record`
    is the outcome so far.
    """

    def __init__(
        self, station: Station, plan: PlannedGrasp, on_phase: Callable[[str], None]
    ) -> None:
        self._station = station
        self.world, self.robot = station.world, station.robot
        self.plan, self.arm = plan, plan.arm
        self.reason = "not_judged"
        self.place_reason = ""
        self.place = ""
        self.error_m = float("nan")
        """Error of the tool position (m) at the grasp, and later at the place of release."""
        self._hand = self.robot.arm(plan.arm)
        self._place_offset = float("nan")
        self._on_phase = on_phase
        self._ticks = max(round(_CONTROL_S / self.world.preset.step_s), 1)
        self._started = self._phase_started = self.world.time
        self._log = MotionLog(self.robot, plan.arm)
        self._times: dict[str, float] = {}
        self._touch: dict[str, FingerTouch] = {}
        self._tool_height: dict[str, float] = {}
        self._old_place: HeightMap | None = None
        self._box_before: HeightMap | None = None
        self._turn = 0.0
        self._raised: Trajectory | None = None
        self.held, self.placed = Judgement("no"), Judgement("no")
        """The robot's own judgements of the grasp and of placing."""
        self.old_place = Judgement()
        """Whether the object still stands where it was."""

    # -- the phases ------------------------------------------------------------------------

    def reach(self) -> str:
        """Go to the pre-grasp and on to the grasp with an open hand, and stay there.

        Returns
        -------
        str
            ``ok``; ``tracking`` if something kept the arm off its path, ``hardware`` if the hand
            did not open as planned: the arm is then at home.
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
        self._look_before()
        self.reason = self.reach()
        if self.reason != "ok":
            return self.reason
        before = self.robot.finger_opening(self.arm)
        self._fingers(0.0, self._hand.close_effort, _CLOSE_S)
        closed = self._end("close").opening
        stuck = self._is_stuck(before, closed)
        if closed <= CLOSED_ON_SOMETHING or stuck:
            self.reason = "hardware" if stuck else "missed"
            self.held = Judgement("no", f"opening {before:.2f} -> {closed:.2f} after closing")
            self.back_off()
            self._look_after()
            return self.reason
        self._follow(self.plan.lift)
        self._lift_further()
        self._end("lift")
        self._steps(_HOLD_S)
        self._end("hold")
        self.reason = self._judge_grasp()
        if self.reason == "ok":
            self._look_in_hand()
        else:
            self.put_back()
            self._look_after()
        return self.reason

    def _lift_further(self) -> None:
        """Lift what still has an end on the table higher: it may have turned in the hand."""
        if self._grips and self._judge_clear().answer == "no":
            space = self._station.space_of(self.plan.stance)
            top = self.plan.lift.positions[-1]
            self._raised = plan_rise(space, self.plan, top, _HIGHER_M)
            self._follow(self._raised)

    def _is_stuck(self, before: float, closed: float) -> bool:
        """Tell whether the fingers moved less than even a wide object would let them."""
        way = before - self.plan.request.width / self._hand.mouth
        return before - closed < min(_MOVED_OPENING, way / 4)

    def _judge_grasp(self) -> str:
        """Judge by fingers and tool whether an object is held; return the reason code."""
        openings = {phase: touch.opening for phase, touch in self._touch.items()}
        self.held = judge_held(openings, self._rise_m)
        if self.held.answer == "unknown":
            return "not_judged"
        if self.held.is_yes:
            clear = self._judge_clear()
            if clear.answer == "no":
                self.held = Judgement("no", f"{self.held.evidence}, {clear.evidence}")
                return "slip_lift"
            return "ok"
        lost = openings["lift"] > CLOSED_ON_SOMETHING and self._rise_m > MIN_RISE_M
        return "slip_hold" if lost else "slip_lift"

    def _judge_clear(self) -> Judgement:
        """Look whether an end of the object stays on the table."""
        outline = self.plan.request.outline
        if outline is None:
            return Judgement()
        after = self._low_map(outline)
        return judge_off_table(after, after.within(*outline))

    def _look_in_hand(self) -> None:
        """Look whether what is held has turned about the closing axis, and how far."""
        request = self.plan.request
        if request.outline is None and request.points is None:
            return
        points = self._station.eyes.points(self._side)
        points = points[points[:, 2] > request.table_height + _OVER_TABLE_M]
        tool = self.robot.tool_pose(self.arm)
        gap = self.robot.finger_opening(self.arm) * self._hand.mouth
        load = held_load(self.plan, self._station.space_of(self.plan.stance).chains[self.arm])
        turn = load.seen_turn((points - tool[:3, 3]) @ tool[:3, :3], gap)
        self._turn = turn or 0.0
        seen = "not seen in the hand" if turn is None else f"turned by {np.degrees(turn):.0f} deg"
        self.held = Judgement(self.held.answer, f"{self.held.evidence}, {seen}")

    def place_in_box(self) -> str:
        """Place the held object into the box of its side and go home; return the reason code."""
        box = self.world.box_for(self._hand.side, self.plan.request.y)
        if box is None:
            self.put_back()
            self.place_reason = "place_plan"
            return self.place_reason
        used = self._station.next_spot(box.side)
        request = self.plan.request
        before = self._box_before or self._box_map(box)
        spot = PlaceSpot.in_box(box, used, max(request.height, request.length), before)
        self.place = f"{box.side} box"
        return self._place(spot, before, lambda: self._box_map(box), np.array(box.centre))

    def place_at(self, x: float, y: float) -> str:
        """Place the held object on the table at (x, y) m, base frame, and go home."""
        spot = PlaceSpot.on_table(x, y, self.plan.request.table_height)
        return self._place(
            spot, self._table_map(x, y), lambda: self._table_map(x, y), np.array([x, y])
        )

    def put_back(self) -> None:
        """Lower whatever is still in the hand, back off and go home."""
        if self._raised is not None:
            self._follow(reverse(self._raised, 1.0))
        self._follow(reverse(self.plan.lift, 1.0))
        self.back_off()

    def back_off(self) -> None:
        """Open the hand at the object and go home along the approach."""
        self._open(self.plan.opening)
        self._follow(reverse(self.plan.approach, 2.0))
        self._go_home()

    def _measure_error(self, wanted: Floats) -> None:
        tool = self.robot.tool_pose(self.arm)[:3, 3]
        self.error_m = float(np.linalg.norm(tool - wanted))

    def _place(
        self, spot: PlaceSpot, before: HeightMap, look: Callable[[], HeightMap], wanted: Floats
    ) -> str:
        start = (self._raised or self.plan.lift).positions[-1]
        space = self._station.space_of(self.plan.stance)
        way = plan_place(space, self.plan, start, spot, self._turn)
        if isinstance(way, str):
            self.put_back()
            self.place_reason = way
            return way
        kept = self._follow(way.transport, watch=True)
        self._end("transport")
        if kept:
            self._set_down(way)
        else:  # set down, the empty hand would push about what lies there
            self._open(self.plan.opening)
            self._end("place")
            self._withdraw(way.back)
        self._end("home")
        after = look()
        request = self.plan.request
        volume = request.width * max(request.length, request.width) * request.height
        self.placed = judge_placed(kept, before, after, volume)
        self._look_after()
        if self.placed.is_yes:
            self.place_reason = "ok" if kept else "slip_transport"
            arrived = after.centre_of(new_cells(before, after))
            self._place_offset = float(np.linalg.norm(arrived - wanted))
        elif self.placed.answer == "unknown":
            self.place_reason = "not_judged"
        else:
            self.place_reason = "drop_outside" if kept else "slip_transport"
        return self.place_reason

    def _set_down(self, way: PlacePlan) -> None:
        self._follow(way.lower)
        self._measure_error(way.tool)
        self._open(1.0)
        self._end("place")
        self._withdraw(way.retreat)

    def _withdraw(self, way: Trajectory) -> None:
        self._follow(way)
        self.robot.rest_hand(self.arm)
        self.robot.take_stance(UPRIGHT)
        self._steps(_REST_S - (self.world.time - self._phase_started))

    # -- ways back -------------------------------------------------------------------------

    def _go_home(self) -> None:
        self._follow(reverse(self.plan.free, 1.0))
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
        step = self.world.preset.step_s
        left, part = max(round(seconds / step), 1), max(round(_CONTACT_CHECK_S / step), 1)
        while left > 0:
            self.world.step(min(left, part) * step)
            self._log.sample()
            left -= part

    def _joints(self) -> Floats:
        """Return the arm's measured joints.

        Raises
        ------
        RobotError
            The physics diverged: a joint is not a number, and the world is no longer usable.
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
        """Move the arm along waypoints; return whether it arrived (``watch``: and kept hold)."""
        step = self._ticks * self.world.preset.step_s
        touching, since = True, 0.0
        time = 0.0
        while time < way.duration:
            time += step
            position, velocity = way.at(time)
            self.robot.command_arm(self.arm, position, velocity)
            self.world.step(step)
            self._log.sample()
            since += step
            if watch and since >= _CONTACT_CHECK_S:
                touching, since = touching and self._grips, 0.0
        self._steps(_SETTLE_S)
        error = np.abs(self._joints() - way.positions[-1])
        return touching if watch else bool(np.all(error < _TRACKING_RAD))

    def _open(self, opening: float) -> None:
        self._fingers(opening, self._hand.open_effort, _OPEN_S)

    def _fingers(self, opening: float, effort: float, seconds: float) -> None:
        self.robot.move_fingers(self.arm, opening, effort)
        self._steps(seconds)

    # -- what is sensed --------------------------------------------------------------------

    @property
    def _side(self) -> str:
        return "left" if self.plan.request.y > 0 else "right"

    @property
    def _grips(self) -> bool:
        """Whether something keeps the fingers open."""
        return self.robot.finger_opening(self.arm) > CLOSED_ON_SOMETHING

    @property
    def _rise_m(self) -> float:
        """Rise of the tool from closing to the latest phase of the lift, m."""
        heights = [self._tool_height[p] for p in ("close", "lift", "hold") if p in self._times]
        return heights[-1] - heights[0] if heights else 0.0

    def _look_before(self) -> None:
        """Take a view of the object and of the box while both are visible."""
        self._old_place = self._footprint_map()
        box = self.world.box_for(self._hand.side, self.plan.request.y)
        self._box_before = None if box is None else self._box_map(box)

    def _look_after(self) -> None:
        """Check in a view whether the object is still at its original place."""
        if self._old_place is not None:
            self.old_place = judge_old_place(self._old_place, self._footprint_map())

    def _footprint_map(self) -> HeightMap:
        request = self.plan.request
        half = max(request.width, request.length) / 2 + _MARGIN_M
        return self._table_map(request.x, request.y, half)

    def _low_map(self, outline: tuple[float, float, float, float, float]) -> HeightMap:
        """Return the map of what is low around an object."""
        x, y, _, length, _ = outline
        return self._table_map(x, y, length / 2 + _BESIDE_M / 2, _LOW_M)

    def _table_map(
        self, x: float, y: float, half: float = _BESIDE_M, height: float = _HIGHEST_M
    ) -> HeightMap:
        """Return the height map, up to a height, of the square of side ``2 half`` around (x, y)."""
        floor = self.plan.request.table_height
        points = self._station.eyes.points("left" if y > 0 else "right")
        return HeightMap.of(
            points, (x - half, x + half), (y - half, y + half), floor, floor + height
        )

    def _box_map(self, box: PlaceBox) -> HeightMap:
        """Return the height map of a box, without the arms that hide a part of it."""
        ceiling = box.floor + _HIGHEST_M
        points = self._station.eyes.box_points(box.side)
        low, high = np.array([box.x_range, box.y_range]).T
        over = ((points[:, :2] >= low) & (points[:, :2] < high)).all(axis=1)
        points = points[over & (points[:, 2] < ceiling)]
        space = self._station.space_of(self.robot.stance)
        for arm in space.chains:
            spheres = space.spheres(arm, REST_OPENING)
            points = points[~spheres.shows(self.robot.arm_joints(arm), points, _ARM_MARGIN_M)]
        return HeightMap.of(points, box.x_range, box.y_range, box.floor, ceiling)

    def _end(self, phase: str) -> FingerTouch:
        """End a phase: read the fingers, record the duration, call back."""
        self._times[phase] = self.world.time - self._phase_started
        self._phase_started = self.world.time
        touch = self.robot.finger_touch(self.arm)
        self._touch[phase] = touch
        self._tool_height[phase] = float(self.robot.tool_pose(self.arm)[2, 3])
        self._on_phase(phase)
        return touch

    @property
    def record(self) -> GraspRecord:
        """Record of the attempt so far."""
        plan, touch = self.plan, self._touch
        last = next((touch[p] for p in ("hold", "lift", "close") if p in touch), FingerTouch())
        held = self.held.is_yes
        closed = touch.get("close", last)
        return GraspRecord(
            grasp=plan,
            arm=plan.arm,
            end_effector=self._hand.end_effector,
            preset=self.world.preset.name,
            seed=plan.seed,
            reason=self.reason,
            judged_held=self.held,
            judged_placed=self.placed,
            old_place=self.old_place,
            place_reason=self.place_reason,
            place=self.place,
            links_touching=last.links,
            contact_force_n=last.force_n,
            jaw_gap_m=max(closed.opening, 0.0) * self._hand.mouth,
            lifted_m=self._rise_m if held else 0.0,
            slip_m=max(closed.opening - last.opening, 0.0) * self._hand.mouth,
            place_offset_m=self._place_offset,
            duration_s=self.world.time - self._started,
            planning_s=plan.planning_s,
            tilt=plan.tilt,
            ik_solutions=plan.ik_solutions,
            times=self._times,
            links={phase: one.links for phase, one in touch.items()},
            forces={phase: one.force_n for phase, one in touch.items()},
            motion=self._log.motion,
        )
