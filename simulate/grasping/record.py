"""Record of a grasp attempt, and its reason codes by the phase that failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rtask.interop.episodes.motion import Motion
from simulate.grasping.judgement import Judgement
from simulate.grasping.rules import PlannedGrasp

__all__ = ["PHASES", "UNREACHABLE", "GraspRecord", "is_counted", "phase_of"]

UNREACHABLE = "unreachable"
"""Outcomes of grasps that the arm cannot reach, which say nothing about the grasp."""

_PLANNING = (
    "ik", "tilt", "grasp_collision", "approach_ik", "approach_collision", "pregrasp_collision",
    "lift_ik", "rrt_start", "rrt_goal", "rrt_time", "too_wide", "too_heavy",
)  # fmt: skip

PHASES: Mapping[str, frozenset[str]] = {
    "see": frozenset({"not_seen", "no_grasp", "gone"}),
    "plan": frozenset(_PLANNING),
    "reach": frozenset({"tracking"}),
    "close": frozenset({"missed"}),
    "lift": frozenset({"slip_lift"}),
    "hold": frozenset({"slip_hold"}),
    "place": frozenset({"place_plan", "slip_transport", "drop_outside"}),
}
"""Phases of an attempt and the reason codes with which each fails."""


@dataclass(frozen=True, eq=False)
class GraspRecord:
    """Record of one attempt.

    Parameters
    ----------
    grasp
        The plan that was carried out.
    reason
        ``ok`` exactly if the object was judged to be held, otherwise the code of the phase that
        failed.
    judged_held, judged_placed
        The robot's own judgements: lifted and kept for 2 s; arrived where it was to go.
    old_place
        Whether the object is still at its original place; ``no`` without having been placed means
        that it fell over or rolled away.
    place_reason
        ``ok``, ``slip_transport``, ``place_plan``, ``drop_outside`` or ``not_judged``; empty when
        nothing was placed.
    place
        Where the object was to be put, such as ``left box``; empty if it is not a box.
    links_touching, contact_force_n, jaw_gap_m
        Finger links stopped by something and the force from their motors' effort, both at the last
        phase before transport in which the hand should hold the object; gap of the jaws after
        closing.
    links, forces
        The same by phase.
    lifted_m
        Rise of the tool with the object at the end of the hold, m; 0 when not held.
    slip_m
        Further closing of the jaws from the grasp to the end of the hold, m.
    place_offset_m
        From the middle of the place to what arrived there, m; nan when not placed.
    duration_s, times
        Simulated seconds, in total and by phase.
    motion
        The joints over time; None if they were not recorded.
    """

    grasp: PlannedGrasp
    arm: str
    end_effector: str
    preset: str
    seed: int
    reason: str
    judged_held: Judgement
    judged_placed: Judgement
    old_place: Judgement
    place_reason: str
    links_touching: int
    contact_force_n: float
    jaw_gap_m: float
    lifted_m: float
    slip_m: float
    place_offset_m: float
    duration_s: float
    planning_s: float
    tilt: float
    ik_solutions: int
    place: str = ""
    times: Mapping[str, float] = field(default_factory=dict)
    links: Mapping[str, int] = field(default_factory=dict)
    forces: Mapping[str, float] = field(default_factory=dict)
    motion: Motion | None = field(default=None, repr=False)

    @property
    def held(self) -> bool:
        """Whether the robot is sure that it held the object."""
        return self.judged_held.is_yes

    @property
    def kept(self) -> bool:
        """Whether it held the object and did not lose it on the way, even into the box.

        This is what the graph is told of the grasp: one that loses the object on the way is not
        to be repeated, wherever the object fell.
        """
        return self.held and self.place_reason != "slip_transport"

    @property
    def placed(self) -> bool:
        """Whether the robot is sure that it placed the object."""
        return self.judged_placed.is_yes

    @property
    def evidence(self) -> str:
        """Judgements with their measurements, in one line."""
        judged = {
            "held": self.judged_held,
            "placed": self.judged_placed,
            "still there": self.old_place,
        }
        return "; ".join(
            f"{name}: {judgement.answer} ({judgement.evidence})"
            for name, judgement in judged.items()
            if judgement.evidence
        )


def phase_of(reason: str) -> str:
    """Return the phase that a reason code belongs to.

    >>> phase_of("slip_lift"), phase_of("ok"), phase_of("new_reason")
    ('lift', '', 'other')
    """
    if reason == "ok":
        return ""
    return next((phase for phase, codes in PHASES.items() if reason in codes), "other")


def is_counted(reason: str) -> bool:
    """Return whether an outcome is evidence about the grasp.

    It is not if the arm could not get there or left its path, the hand failed, or physics diverged.

    >>> is_counted("missed"), is_counted("not_judged")
    (True, False)
    """
    return reason not in (UNREACHABLE, "tracking", "hardware", "not_judged")
