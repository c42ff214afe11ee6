"""Reason codes by the phase that failed, and what a grasp is called that was never made."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["PHASES", "UNREACHABLE", "is_counted", "phase_of"]

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


def phase_of(reason: str) -> str:
    """Return the phase that a reason code belongs to.

    >>> phase_of("slip_lift"), phase_of("ok"), phase_of("new_reason")
    ('lift', '', 'other')
    """
    if reason == "ok":
        return ""
    return next((phase for phase, codes in PHASES.items() if reason in codes), "other")


def is_counted(reason: str) -> bool:
    """Tell whether an outcome says something about the grasp.

    Not when the arm could not get there or missed its path, its hand failed, or physics broke down.

    >>> is_counted("missed"), is_counted("not_judged")
    (True, False)
    """
    return reason not in (UNREACHABLE, "tracking", "hardware", "not_judged")
