"""Execution of a planned grasp in the physics world, phase by phase.

Phases: pre-grasp, approach, close, lift, hold, transport, place. A grasp that fails gives a reason
code, never an exception; only diverging physics raises one. The robot judges by its own senses
(:mod:`simulate.grasping.judgement`); true poses of objects are not used here.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simulate.grasping.attempt.driving import ArmDrive
from simulate.grasping.attempt.leaving import plan_leaving
from simulate.grasping.attempt.looking import Looks
from simulate.grasping.attempt.station import Station
from simulate.grasping.judgement import (
    CLOSED_ON_SOMETHING,
    MIN_RISE_M,
    HeightMap,
    Judgement,
    is_stuck,
    judge_held,
    judge_off_table,
    judge_old_place,
    judge_placed,
    narrowest_hold,
    new_cells,
    share_left,
)
from simulate.grasping.placing import (
    TABLE_DESCENTS,
    PlacePlan,
    PlaceSpot,
    held_load,
    plan_place,
    plan_rise,
)
from simulate.grasping.record import GraspRecord
from simulate.grasping.rules import PlannedGrasp
from simulate.motion.trajectory import Trajectory, reverse
from simulate.robots.description import Floats
from simulate.world.robot_body import FingerTouch
from simulate.world.world import PlaceBox

__all__ = ["AttemptRun"]

_HOLD_S = 2.0
_OFF_OPENING = 0.25
"""Share of the opening: a hand that is further than that from its command did not open."""
_DO_NOT_TURN = ("suction_cup", "three_fingers")
"""Hands in which nothing turns about a closing axis."""
_HIGHER_M = 0.060
"""By which a hand is lifted further, at least."""
_CLEAR_M = 0.010
"""Room wanted between the table and an end that hangs straight down."""


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
    :meth:`place_in_box`, :meth:`place_at`, :meth:`place_within` and :meth:`put_back` brings the arm
    home. :attr:`record` is the outcome so far.
    """

    def __init__(
        self, station: Station, plan: PlannedGrasp, on_phase: Callable[[str], None]
    ) -> None:
        self._station = station
        self.world, self.robot = station.world, station.robot
        self.plan, self.arm = plan, plan.arm
        self.drive = ArmDrive(self.world, self.robot, plan.arm, on_phase)
        self.looks = Looks(station, plan)
        self.reason = "not_judged"
        self.place_reason = ""
        self.place = ""
        self.error_m = float("nan")
        """Error of the tool position (m) at the grasp, and later at the place of release."""
        self._place_offset = float("nan")
        self._old_place: HeightMap | None = None
        self._box_before: HeightMap | None = None
        self._table_before: HeightMap | None = None
        self._turn = 0.0
        self._raised: Trajectory | None = None
        self.held, self.placed = Judgement("no"), Judgement("no")
        """The robot's own judgements of the grasp and of placing."""
        self.old_place = Judgement()
        """Whether the object still stands where it was."""

    def reach(self) -> str:
        """Go to the pre-grasp and on to the grasp with an open hand, and stay there.

        Returns
        -------
        str
            ``ok``; ``tracking`` if something kept the arm off its path, ``hardware`` if the hand
            did not open as planned: the arm is then at home.
        """
        self.drive.start_at_home()
        self.robot.take_stance(self.plan.stance)
        self.robot.move_fingers(self.arm, self.plan.opening, self.drive.hand.open_effort)
        arrived = self.drive.follow(self.plan.free)
        opens = abs(self.robot.finger_opening(self.arm) - self.plan.opening) < _OFF_OPENING
        if not arrived or not opens:
            self.drive.go_home(self.plan.free)
            return "hardware" if arrived else "tracking"
        self.drive.end("pregrasp")
        self.drive.follow(self.plan.approach)
        self.drive.end("approach")
        request = self.plan.request
        height = request.table_height + self.plan.tool_height
        self.error_m = self.drive.tool_error(np.array([request.x, request.y, height]))
        return "ok"

    def pretend(self) -> str:
        """Reach and lift with an open hand, as if something were held."""
        reason = self.reach()
        if reason == "ok":
            self.drive.follow(self.plan.lift)
            self.drive.end("lift")
        return reason

    def grasp(self) -> str:
        """Grasp, lift and hold; return the reason code, ``ok`` with the object in the hand."""
        self._look_before()
        self.reason = self.reach()
        if self.reason != "ok":
            return self.reason
        before = self.robot.finger_opening(self.arm)
        width, mouth = self.plan.request.width, self.drive.hand.mouth
        gave_way = self.drive.close(least=self._narrowest())
        closed = self.drive.end("close").opening
        stuck = is_stuck(before, closed, width, mouth)
        if closed <= CLOSED_ON_SOMETHING or gave_way or stuck:
            self.reason = "hardware" if stuck else "missed"
            evidence = f"opening {before:.2f} -> {closed:.2f} after closing"
            thin = ", too narrow for what was seen" if gave_way else ""
            self.held = Judgement("no", evidence + thin)
            self.back_off()
            self._look_after()
            return self.reason
        self.drive.follow(self.plan.lift)
        self._lift_further()
        self.drive.end("lift")
        self.drive.steps(_HOLD_S)
        self._lift_further()
        self.drive.end("hold")
        self.reason = self._judge_grasp()
        if self.reason == "ok":
            self._look_in_hand()
        else:
            self.put_back()
            self._look_after()
        return self.reason

    def _narrowest(self) -> float:
        """Return the opening, 0..1, below which the fingers stop: 0 where the width is a guess."""
        # A finger that goes on where the other meets nothing throws over what it pushes. How wide
        # a thing is at a pose in space, whose far side no view may show, is less certain.
        request, hand = self.plan.request, self.drive.hand
        if request.pose is not None or hand.grip in _DO_NOT_TURN:
            return 0.0
        return narrowest_hold(request.width, hand.mouth)

    def _lift_further(self) -> None:
        """Lift the hand higher, once, if an end of what it holds is, or might be, on the table.

        An end that hangs may be hidden by the hand or by the thing itself, and what is heavy goes
        on turning while it is held. So the hand rises until no end would reach the table, however
        the thing turned; whatever is low even so was seen.
        """
        if self._raised is not None or not self.drive.grips:
            return
        missing = self._missing_height()
        if missing > 0 or self._judge_clear().answer == "no":
            height = max(missing, _HIGHER_M)
            space = self._station.space_of(self.plan.stance)
            top = self.plan.lift.positions[-1]
            self._raised = plan_rise(space, self.plan, top, height)
            self.drive.follow(self._raised)

    def _missing_height(self) -> float:
        """Return by how much the hand is too low for an end that hangs, m; 0 if nothing turns."""
        if self.plan.request.outline is None or self.drive.hand.grip in _DO_NOT_TURN:
            return 0.0
        load = held_load(self.plan, self._station.space_of(self.plan.stance).chains[self.arm])
        over_table = self.robot.tool_pose(self.arm)[2, 3] - self.plan.request.table_height
        return max(load.reach + _CLEAR_M - float(over_table), 0.0)

    def _judge_grasp(self) -> str:
        """Judge by fingers and tool whether an object is held; return the reason code."""
        openings = {phase: touch.opening for phase, touch in self.drive.touch.items()}
        self.held = judge_held(openings, self.drive.rise_m)
        if self.held.answer == "unknown":
            return "not_judged"
        if self.held.is_yes:
            clear = self._judge_clear()
            if clear.answer == "no":
                self.held = Judgement("no", f"{self.held.evidence}, {clear.evidence}")
                return "slip_lift"
            return "ok"
        lost = openings["lift"] > CLOSED_ON_SOMETHING and self.drive.rise_m > MIN_RISE_M
        return "slip_hold" if lost else "slip_lift"

    def _judge_clear(self) -> Judgement:
        """Look whether an end of the object stays on the table."""
        outline = self.plan.request.outline
        if outline is None:
            return Judgement()
        after = self.looks.low(outline)
        return judge_off_table(after, after.within(*outline))

    def _look_in_hand(self) -> None:
        """Look whether what is held has turned about the closing axis, and how far."""
        request = self.plan.request
        has_shape = request.outline is not None or request.points is not None
        if not has_shape or self.drive.hand.grip in _DO_NOT_TURN:
            return
        turn = self.looks.turn_in_hand()
        self._turn = turn or 0.0
        seen = "not seen in the hand" if turn is None else f"turned by {np.degrees(turn):.0f} deg"
        self.held = Judgement(self.held.answer, f"{self.held.evidence}, {seen}")

    def place_in_box(self, into: PlaceBox | None = None) -> str:
        """Place the held object into a box and go home; return the reason code.

        Parameters
        ----------
        into
            The box, base frame; None = that of the side of the arm or of the object.
        """
        nearest = self._station.box_for(self.drive.hand.side, self.plan.request.y)
        box = into or nearest
        if box is None:
            self.put_back()
            self.place_reason = "place_plan"
            return self.place_reason
        used = self._station.next_spot(box.side)
        request = self.plan.request
        before = self._box_before if box == nearest else None
        before = before or self.looks.box(box)
        spot = PlaceSpot.in_box(box, used, max(request.height, request.length), before)
        self.place = f"{box.side} box"
        return self._place(spot, before, lambda: self.looks.box(box), np.array(box.centre))

    def place_at(self, x: float, y: float) -> str:
        """Place the held object on the table at (x, y) m, base frame, and go home."""
        spot = PlaceSpot.on_table(x, y, self.plan.request.table_height)
        return self._place(
            spot, self.looks.table(x, y), lambda: self.looks.table(x, y), np.array([x, y])
        )

    def place_within(
        self,
        x_range: tuple[float, float],
        y_range: tuple[float, float],
        spots: tuple[tuple[float, float], ...],
        closings: tuple[tuple[float, ...], ...] = (),
    ) -> str:
        """Place the held object on one of some spots of an area of the table, and go home.

        Parameters
        ----------
        x_range, y_range
            Of the area, m, base frame; whether the object arrived there is judged by its views.
        spots
            (x, y) m, base frame, best first.
        closings
            Closing directions to try first at each of them, rad, base frame; () = any will do.
        """
        spot = PlaceSpot(
            self.plan.request.table_height, spots, TABLE_DESCENTS, walled=False, closings=closings
        )

        def look() -> HeightMap:
            return self.looks.area(x_range, y_range)

        return self._place(spot, look(), look, np.array(spots[0]))

    def put_back(self) -> None:
        """Lower whatever is still in the hand, back off and go home; at once if it has slipped out.

        An empty hand that comes down again pushes about, or off the table, what fell below it.
        """
        has_slipped = "close" in self.drive.times and not self.drive.grips
        if has_slipped and self._leave_empty():
            return
        if self._raised is not None:
            self.drive.follow(reverse(self._raised, 1.0))
        self.drive.follow(reverse(self.plan.lift, 1.0))
        self.back_off()

    def _leave_empty(self) -> bool:
        """Go home from where the hand was lifted; tell whether there was a way."""
        top = (self._raised or self.plan.lift).positions[-1]
        way = plan_leaving(self._station.space_of(self.plan.stance), self.plan, top)
        if way is None:
            return False
        self.drive.open(self.plan.opening)
        self.drive.withdraw(way)
        self.drive.end("home")
        return True

    def back_off(self) -> None:
        """Open the hand at the object and go home along the approach."""
        self.drive.open(self.plan.opening)
        self.drive.follow(reverse(self.plan.approach, 2.0))
        self.drive.go_home(self.plan.free)

    def _place(
        self, spot: PlaceSpot, before: HeightMap, look: Callable[[], HeightMap], target: Floats
    ) -> str:
        start = (self._raised or self.plan.lift).positions[-1]
        space = self._station.space_of(self.plan.stance)
        way = plan_place(space, self.plan, start, spot, self._turn)
        if isinstance(way, str):
            self.put_back()
            self.place_reason = way
            return way
        was_held = self.drive.follow(way.transport, watch=True)
        self.drive.end("transport")
        if was_held:
            self._set_down(way)
        else:  # set down, the empty hand would push about what lies there
            self.drive.open(self.plan.opening)
            self.drive.end("place")
            self.drive.withdraw(way.back)
        self.drive.end("home")
        after = look()
        request = self.plan.request
        volume = request.width * max(request.length, request.width) * request.height
        is_lost_to_box = spot.walled and not was_held
        on_table = self._left_on_table(volume) if is_lost_to_box else 0.0
        self.placed = judge_placed(was_held, before, after, volume, on_table)
        self._look_after()
        if self.placed.is_yes:
            arrived = after.centre_of(new_cells(before, after))
            self._place_offset = float(np.linalg.norm(arrived - target))
        reasons = {"yes": "ok", "unknown": "not_judged", "no": "drop_outside"}
        self.place_reason = reasons[self.placed.answer] if was_held else "slip_transport"
        return self.place_reason

    def _left_on_table(self, volume: float) -> float:
        """Return the share of a lost object that the table beside the box still bears."""
        box = self._station.box_for(self.drive.hand.side, self.plan.request.y)
        if box is None or self._table_before is None or self._old_place is None:
            return 0.0
        seen = min(self._old_place.volume, volume)
        return share_left(self._table_before, self.looks.beside(box), seen)

    def _set_down(self, way: PlacePlan) -> None:
        self.drive.follow(way.lower)
        self.error_m = self.drive.tool_error(way.tool)
        self.drive.open(1.0)
        self.drive.end("place")
        self.drive.withdraw(way.retreat)

    def _look_before(self) -> None:
        """Take a view of the object and of the box while both are visible."""
        self._old_place = self.looks.old_place()
        box = self._station.box_for(self.drive.hand.side, self.plan.request.y)
        if box is not None:
            self._table_before, self._box_before = self.looks.beside(box), self.looks.box(box)

    def _look_after(self) -> None:
        """Check in a view whether the object is still at its original place."""
        if self._old_place is not None:
            self.old_place = judge_old_place(self._old_place, self.looks.old_place())

    @property
    def record(self) -> GraspRecord:
        """Record of the attempt so far."""
        plan, drive = self.plan, self.drive
        touch = drive.touch
        last = next((touch[p] for p in ("hold", "lift", "close") if p in touch), FingerTouch())
        held = self.held.is_yes
        closed = touch.get("close", last)
        return GraspRecord(
            grasp=plan,
            arm=plan.arm,
            end_effector=drive.hand.end_effector,
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
            jaw_gap_m=max(closed.opening, 0.0) * drive.hand.mouth,
            lifted_m=drive.rise_m if held else 0.0,
            slip_m=max(closed.opening - last.opening, 0.0) * drive.hand.mouth,
            place_offset_m=self._place_offset,
            duration_s=drive.elapsed_s,
            planning_s=plan.planning_s,
            tilt=plan.tilt,
            ik_solutions=plan.ik_solutions,
            times=drive.times,
            links={phase: reading.links for phase, reading in touch.items()},
            forces={phase: reading.force_n for phase, reading in touch.items()},
            motion=drive.log.motion,
        )
