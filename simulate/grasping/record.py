"""Record of a grasp attempt, and its reason codes by the phase that failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from simulate.grasping.rules import PlannedGrasp

__all__ = ["PHASES", "UNREACHABLE", "GraspRecord", "is_counted", "phase_of"]

_PUSHED_M = 0.015

UNREACHABLE = "unreachable"
"""Outcome of a grasp that the arm cannot get to; says nothing about the grasp."""

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
        ``ok`` exactly when the object was held, else the code of the phase that failed.
    held, placed
        Lifted and kept for 2 s; arrived in the box.
    place_reason
        ``ok``, ``slip_transport``, ``place_plan`` or ``drop_outside``; empty when not held.
    pushed_m
        How far the hand moved the object before it closed; more than 15 mm is a touch.
    links_touching, contact_force_n
        At the last moment at which the hand should have had the object before transport.
    links, forces
        The same by phase.
    lifted_m
        Rise of the object at the end of the hold, m.
    slip_m
        Movement of the object in the hand from the closing to the end of the hold, m.
    place_offset_m
        From the middle of the box, m; nan when not placed.
    duration_s, times
        Simulated seconds, in all and by phase.
    """

    grasp: PlannedGrasp
    arm: str
    end_effector: str
    preset: str
    seed: int
    reason: str
    held: bool
    placed: bool
    place_reason: str
    pushed_m: float
    links_touching: int
    contact_force_n: float
    lifted_m: float
    slip_m: float
    place_offset_m: float
    duration_s: float
    planning_s: float
    tilt: float
    ik_solutions: int
    times: Mapping[str, float] = field(default_factory=dict)
    links: Mapping[str, int] = field(default_factory=dict)
    forces: Mapping[str, float] = field(default_factory=dict)

    @property
    def touched(self) -> bool:
        """Whether the hand pushed the object away while it approached."""
        return self.pushed_m > _PUSHED_M


def phase_of(reason: str) -> str:
    """Return the phase that a reason code belongs to.

    >>> phase_of("slip_lift"), phase_of("ok"), phase_of("new_reason")
    ('lift', '', 'other')
    """
    if reason == "ok":
        return ""
    return next((phase for phase, codes in PHASES.items() if reason in codes), "other")


def is_counted(reason: str) -> bool:
    """Tell whether an outcome is evidence about the grasp.

    Not when the arm could not get there or missed its path, its hand failed, or physics broke down.

    >>> is_counted("missed"), is_counted("not_judged")
    (True, False)
    """
    return reason not in (UNREACHABLE, "tracking", "hardware", "not_judged")
