"""Outcomes of attempts as robots report them, and what they mean."""

from __future__ import annotations

import datetime as dt
import logging
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

from annotated_types import Ge, Le, MaxLen
from pydantic import Field

from rtask.engine.records.clock import clocked
from rtask.errors import UsageError
from rtask.rdf.namespaces import RT
from rtask.wire.message import Message
from rtask.wire.types import Array, Flag, Image, Number, Text, Texts, Unit, Whole

__all__ = ["TIMES", "Outcome", "OutcomeReport"]

log = logging.getLogger(__name__)

_LATEST_S = 253_402_300_799
"""End of the year 9999, s since the epoch."""
# Physics that goes wrong throws things far, and what it reports has to be stored; what lies beyond
# was measured in another unit.
_REACH_M = 100
_HALF_TURN = 3.1416

TIMES = {
    "segmentation_s": RT.segmentationTime,
    "transfer_s": RT.transferTime,
    "decode_s": RT.decodingTime,
    "extraction_s": RT.extractionTime,
    "matching_s": RT.matchingTime,
    "query_s": RT.queryTime,
    "pose_s": RT.poseTime,
    "generation_s": RT.generationTime,
    "choice_s": RT.choiceTime,
    "planning_s": RT.planningTime,
    "execution_s": RT.executionTime,
    "total_s": RT.totalTime,
}
"""Property of the graph for each duration of a message, s."""


class StepTimes(Message):
    """Durations of the steps of an attempt."""

    segmentation_s: Annotated[Number, Unit("s")] | None = None
    """time for segmentation; default: not measured"""
    transfer_s: Annotated[Number, Unit("s")] | None = None
    """time for the transfer; default: not measured"""
    decode_s: Annotated[Number, Unit("s")] | None = None
    """time for decoding; default: not measured"""
    extraction_s: Annotated[Number, Unit("s")] | None = None
    """time for feature extraction; default: not measured"""
    matching_s: Annotated[Number, Unit("s")] | None = None
    """time for matching; default: not measured"""
    query_s: Annotated[Number, Unit("s")] | None = None
    """time for the query; default: not measured"""
    pose_s: Annotated[Number, Unit("s")] | None = None
    """time for the pose; default: not measured"""
    generation_s: Annotated[Number, Unit("s")] | None = None
    """time for generating grasps; default: not measured"""
    choice_s: Annotated[Number, Unit("s")] | None = None
    """time for the choice; default: not measured"""
    planning_s: Annotated[Number, Unit("s")] | None = None
    """time for motion planning; default: not measured"""
    execution_s: Annotated[Number, Unit("s")] | None = None
    """time for the execution; default: not measured"""
    total_s: Annotated[Number, Unit("s")] | None = None
    """total time; default: not measured"""


class Picture(Message):
    """A picture of an attempt."""

    phase: Text
    """pre_grasp, closed, lifted, placed, ..."""
    data: Image
    """base64 PNG or JPEG"""


class MotionReport(Message):
    """Joints of a robot during an attempt, sample by sample."""

    joints: Annotated[Texts, MaxLen(64)]
    """names; the opening of a hand, 0 (closed) to 1, counts as a joint by the hand's name"""
    times: Array
    """s since the start of the attempt, rising; one a sample"""
    positions: Array
    """as measured, rad or m; all joints of the first sample, then of the second, ..."""
    commands: Array
    """as commanded at the same moments, in the same order"""


class OutcomeReport(Message):
    """Outcome of an attempt as reported."""

    success: Flag
    """whether the object was held"""
    placed: Flag | None = None
    """whether it reached its destination; default: not known"""
    place: Text | None = None
    """name of the place where it was put, such as "left box"; default: not known"""
    reason: Text | None = None
    """code of the reason: ok, missed, slip_lift, ...; default: ok if it held, else not judged"""
    lifted_m: Annotated[Number, Unit("m"), Ge(-_REACH_M), Le(_REACH_M)] | None = None
    """height reached; default: not known"""
    slip: Annotated[Number, Unit("m"), Ge(-_REACH_M), Le(_REACH_M)] | None = None
    """distance that the object slipped in the hand; default: not known"""
    started: Annotated[Number, Unit("s"), Ge(0), Le(_LATEST_S)] | None = None
    """start of the attempt since the epoch; default: duration_s before its end, unless simulated"""
    ended: Annotated[Number, Unit("s"), Ge(0), Le(_LATEST_S)] | None = None
    """end of the attempt since the epoch, by the same clock; default: now"""
    duration_s: Annotated[Number, Unit("s"), Ge(0)] | None = None
    """of the attempt; by the clock of the simulation if there is one; default: not known"""
    links_touching: Annotated[Whole, Ge(0)] | None = None
    """number of hand links in contact at the end; default: not known"""
    contact_force: Annotated[Number, Unit("N"), Ge(0), Le(1e6)] | None = None
    """contact force at the jaws; default: not known"""
    jaw_gap: Annotated[Number, Unit("m"), Ge(0), Le(1)] | None = None
    """opening of the closed jaws; default: not known"""
    hold_s: Annotated[Number, Unit("s"), Ge(0)] | None = None
    """duration of the hold; default: not known"""
    place_offset: Annotated[Number, Unit("m"), Ge(0), Le(_REACH_M)] | None = None
    """distance from the destination; default: not known"""
    approach_tilt: Annotated[Number, Unit("rad"), Ge(-_HALF_TURN), Le(_HALF_TURN)] | None = None
    """angle between approach and vertical; default: not known"""
    preset: Literal["faithful", "fast", "real"] | None = None
    """kind of physics: faithful, fast or real; default: not known"""
    seed: Annotated[Whole, Ge(0)] | None = None
    """seed of the simulation; default: none"""
    attempt_number: Annotated[Whole, Ge(1)] | None = None
    """counted from 1 for each object and episode; default: not known"""
    candidate_count: Annotated[Whole, Ge(1)] | None = None
    """number of grasps to choose from; default: not known"""
    candidate_rank: Annotated[Whole, Ge(1)] | None = None
    """rank of the chosen grasp; default: not known"""
    confirmed_by: Literal["physics", "human"] | None = None
    """who confirmed it; default: nobody"""
    operator: Text | None = None
    """name of the person who confirmed it; default: nobody"""
    comment: Text | None = None
    """remark of the person or the robot; default: none"""
    times: StepTimes | None = None
    """durations of the steps; default: not known"""
    images: Annotated[list[Picture], MaxLen(32)] = Field(default_factory=list)
    """pictures of the attempt"""
    motion: MotionReport | None = None
    """the joints during the attempt; default: not recorded"""


_NEVER_HELD = ("missed", "no_grasp", "low_grasp", "no_match")
"""Reasons why nothing was ever in the hand."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of an attempt, checked against the reason codes of the ontology.

    Parameters
    ----------
    place_reason
        Code of the reason why an object that was held did not arrive; empty if it did, or if no
        known code was given.
    clock
        What is wrong with the robot's clock; empty if nothing is.
    """

    held: bool
    reason: str
    placed: bool | None = None
    place_reason: str = ""
    comments: tuple[str, ...] = ()
    report: OutcomeReport = field(default_factory=lambda: OutcomeReport(success=False))
    clock: str = ""

    @property
    def is_fast(self) -> bool:
        """Whether it was simulated with the coarse physics preset."""
        return bool(self.report.preset == "fast")

    def span(self, now: dt.datetime) -> tuple[dt.datetime | None, dt.datetime]:
        """Return when the attempt started, if that is known, and when it ended.

        The seconds of a simulation pass faster or slower than those of the clock by which the
        attempt ended, so that they do not tell when it started.

        Parameters
        ----------
        now
            The end of an attempt whose report does not tell it.

        Raises
        ------
        UsageError
            It started after it ended, or before the calendar did.
        """
        report, is_simulated = self.report, self.report.preset in ("faithful", "fast")
        ended = now if report.ended is None else dt.datetime.fromtimestamp(report.ended, dt.UTC)
        if report.started is None:
            if report.duration_s is None or is_simulated:
                return None, ended
            try:
                return ended - dt.timedelta(seconds=float(report.duration_s)), ended
            except OverflowError as error:
                raise UsageError(
                    f"outcome.duration_s: {report.duration_s:g} s are longer than the calendar",
                    field="outcome.duration_s",
                ) from error
        started = dt.datetime.fromtimestamp(report.started, dt.UTC)
        if started > ended:
            raise UsageError(
                f"outcome.started: {started.isoformat()} is after the end of the attempt, "
                f"{ended.isoformat()}; give both by one clock",
                field="outcome.started",
            )
        return started, ended

    def by_our_clock(self, ahead_s: float) -> Outcome:
        """Return the outcome with the time of receipt, if its own is too far ahead.

        Parameters
        ----------
        ahead_s
            How far the robot's clock may be ahead, s.
        """
        report = self.report
        ended, words = clocked(report.ended, ahead_s)
        if report.ended is None or not words:
            return self
        ended_s = ended.timestamp()
        times = {"ended": ended_s}
        if report.started is not None:
            times["started"] = report.started - report.ended + ended_s
        return replace(
            self,
            report=report.model_copy(update=times),
            comments=(*self.comments, words),
            clock=words,
        )

    @classmethod
    def of(cls, report: OutcomeReport, codes: frozenset[str], path: str) -> Outcome:
        """Interpret a reported outcome.

        The only reason of a success is ``ok``; a later failure becomes a comment. An unknown code
        becomes ``not_judged`` and is kept as a comment.

        Raises
        ------
        UsageError
            A failure has the reason ``ok``, or a success the reason that nothing was held.
        """
        held, code, after = report.success, report.reason, ""
        comments = [report.comment] if report.comment else []
        if held:
            if code in _NEVER_HELD:
                raise UsageError(
                    f"{path}.reason: {code} does not fit a grasp that held", field=f"{path}.reason"
                )
            if code not in (None, "ok"):
                comments.append(f"after holding: {code}")
                after = code if code in codes and report.placed is False else ""
            code = "ok"
        elif code == "ok":
            raise UsageError(f"{path}.reason: a failure cannot have the reason ok", field=path)
        elif code is None or code not in codes:
            if code is not None:
                log.warning("unknown reason code %r is kept as a comment", code)
                comments.append(code)
            code = "not_judged"
        return cls(held, code, report.placed, after, tuple(comments), report)
