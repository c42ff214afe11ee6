"""Causes in words."""

from __future__ import annotations

from collections.abc import Sequence

from rtask.tasks.diagnosis.attempt import Failure
from rtask.tasks.diagnosis.hypotheses import UNKNOWN, Hypothesis

__all__ = ["cause_in_words"]

_WORDS = {
    "slippery": "the thing is slippery",
    "fragile": "the thing gives way under the fingers, wherever it is held",
    "poor_grasp": "this grasp does not hold",
    "weak_hand": "this hand fails at all things",
    "hardware": "the arm or hand is out of order",
    "wrong_identity": "it was another thing than it was taken for",
    "stale_place": "the thing was no longer where it had been seen",
    "collision": "something was in the way",
    "late": "it took too long",
    "dropped": "it fell on the way",
    "too_heavy": "it is too heavy for this hand",
    "too_wide": "it is too wide for this hand",
    "out_of_reach": "the arm cannot get there",
    "declined": "a person did not want it",
    "chance": "no particular cause; it usually holds",
    UNKNOWN: "another cause, which is none of those that are known here",
}


def cause_in_words(kind: str, failure: Failure, members: Sequence[tuple[Hypothesis, float]]) -> str:
    """Return a cause in words.

    Parameters
    ----------
    members
        Its hypotheses and their chances, which say where along the thing it lies.
    """
    if kind in _WORDS:
        return _WORDS[kind]
    likeliest, _ = max(members, key=lambda member: member[1])
    if likeliest.start is None or likeliest.end is None:
        where = ""
    elif kind == "centre_of_mass":
        where = f", about {1000 * likeliest.start:.0f} mm from the middle"
    else:
        where = f", from {1000 * likeliest.start:.0f} to {1000 * likeliest.end:.0f} mm"
    held_at = failure.tried.along
    held = "" if held_at is None else f"; it was held at {1000 * held_at:.0f} mm"
    if kind == "centre_of_mass":
        return f"its centre of mass is away from the middle{where}{held}"
    return f"a part of it gives way{where}{held}"
