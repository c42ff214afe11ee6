"""Causes of failures as hypotheses: how likely each lets an attempt hold, and what robots report.

The chances are judgements, made before anything was measured with them. Those of a centre of mass
and of weak zones are those of :mod:`grasp.learning.causes`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from grasp.learning.causes import HiddenHypothesis, hidden_hypotheses
from rtask.tasks.diagnosis.attempt import Failure, Try

__all__ = ["HOLDS", "UNKNOWN", "Hypothesis", "hypotheses_of", "report_chance"]

HOLDS = 0.85
"""Chance to hold where nothing speaks against it."""
UNKNOWN = "unknown"
"""Kind of the hypothesis that the cause is none of the others."""
_RARELY = 0.1
_SOMETIMES = 0.2
_CODES = 38.0
"""Number of codes among which the rest of the chance is spread."""

_REPORTS: Mapping[str, Mapping[str, float]] = {
    "centre_of_mass": {"slip_lift": 0.4, "slip_hold": 0.3, "slip_transport": 0.1, "touched": 0.03},
    # A hand that closes through an end that gives way reports that nothing is in it.
    "weak_zone": {"missed": 0.25, "crushed": 0.2, "came_apart": 0.15, "slip_lift": 0.2,
                  "slip_hold": 0.08},
    "slippery": {"slip_lift": 0.5, "slip_hold": 0.3, "slip_transport": 0.12},
    "fragile": {"crushed": 0.7, "came_apart": 0.15},
    "poor_grasp": {"missed": 0.2, "slip_lift": 0.25, "touched": 0.12, "pushed_away": 0.1,
                   "slip_hold": 0.12},
    "weak_hand": {"slip_lift": 0.25, "slip_hold": 0.2, "missed": 0.15, "tracking": 0.15,
                  "slip_transport": 0.05},
    "hardware": {"hardware": 0.8, "tracking": 0.1, "timed_out": 0.05},
    "wrong_identity": {"wrong_object": 0.4, "missed": 0.15, "slip_lift": 0.08, "too_wide": 0.05,
                       "low_recognition": 0.1, "no_match": 0.08},
    "stale_place": {"not_seen": 0.35, "missed": 0.35, "no_match": 0.1, "pushed_away": 0.03,
                    "pose_unknown": 0.05, "low_pose": 0.03},
    "collision": {"approach_collision": 0.25, "grasp_collision": 0.2, "pregrasp_collision": 0.15,
                  "rrt_start": 0.07, "rrt_goal": 0.1, "rrt_time": 0.08, "touched": 0.06},
    "late": {"timed_out": 0.45, "late": 0.4, "rrt_time": 0.06},
    "dropped": {"slip_transport": 0.5, "drop_outside": 0.35, "slip_hold": 0.05},
    "too_heavy": {"too_heavy": 0.5, "slip_lift": 0.25, "tracking": 0.1, "slip_hold": 0.05},
    "too_wide": {"too_wide": 0.6, "missed": 0.12, "grasp_collision": 0.1, "touched": 0.05},
    "out_of_reach": {"ik": 0.35, "approach_ik": 0.2, "lift_ik": 0.15, "tilt": 0.1,
                     "place_plan": 0.12},
    "declined": {"declined": 0.5, "stopped_by_human": 0.48},
    "chance": {"slip_lift": 0.15, "missed": 0.15, "slip_hold": 0.1, "slip_transport": 0.08,
               "touched": 0.05, "drop_outside": 0.05},
    # Flat over what robots report where they only notice that it went wrong: what nobody has
    # thought of may look like any of these, and is seldom reported as something that has a name.
    # An arm that cannot follow (tracking) is no such: with it, dead arms were called unknown.
    UNKNOWN: dict.fromkeys(("slip_lift", "slip_hold", "slip_transport", "missed", "touched",
                            "pushed_away", "no_match"), 0.1),
}  # fmt: skip
_PRIORS = {
    "slippery": 0.08, "fragile": 0.03, "poor_grasp": 0.1, "weak_hand": 0.06, "hardware": 0.03,
    "wrong_identity": 0.07, "stale_place": 0.1, "collision": 0.08, "late": 0.04, "dropped": 0.06,
    "too_heavy": 0.04, "too_wide": 0.04, "out_of_reach": 0.06, "declined": 0.03, "chance": 0.1,
    UNKNOWN: 0.15,
}  # fmt: skip
_HIDDEN = 0.24
"""Chance that the centre of mass is off, or a zone is weak, half each."""
_CURED_BY = {
    "wrong_identity": "recognised", "stale_place": "looked", "dropped": "looked",
    "collision": "cleared", "late": "in_time", "declined": "agreed",
}  # fmt: skip

Share = Callable[[Try], float]


@dataclass(frozen=True)
class Hypothesis:
    """A cause.

    Parameters
    ----------
    kind
        Its code; several may have the same.
    prior
        Its chance before anything is known.
    share
        What it leaves of an attempt's chance to hold, 0..1.
    start, end
        Where along the thing, m; None for causes without a place.
    """

    kind: str
    prior: float
    share: Share
    start: float | None = None
    end: float | None = None


def report_chance(kind: str, code: str) -> float:
    """Return how likely a robot reports a code if a cause of a kind made an attempt fail.

    >>> report_chance("hardware", "hardware")
    0.8
    """
    reports = _REPORTS[kind]
    return reports.get(code, (1.0 - sum(reports.values())) / _CODES)


def hypotheses_of(failure: Failure) -> list[Hypothesis]:
    """Return the causes that a failure may have."""
    own = failure.tried
    result = [
        Hypothesis(kind, prior, _of_unknown(failure) if kind == UNKNOWN else _share_of(kind, own))
        for kind, prior in _PRIORS.items()
    ]
    if failure.length and own.along is not None:
        result += _hidden_along(own, failure.length)
    else:
        # Where on the thing it was held is not known: one cause each, for all places.
        for kind in ("centre_of_mass", "weak_zone"):
            result.append(Hypothesis(kind, _HIDDEN / 4, _of_grasp(own)))
    return result


def _hidden_along(own: Try, length: float) -> list[Hypothesis]:
    result = []
    hypotheses = hidden_hypotheses()
    total = sum(hidden.probability for hidden in hypotheses)
    for hidden in hypotheses:
        kind = "centre_of_mass" if hidden.kind == "mass" else "weak_zone"

        def share(tried: Try, hidden: HiddenHypothesis = hidden) -> float:
            if tried.product != own.product or tried.along is None:
                return 1.0
            half = tried.hand.finger_width / 2 / length
            return hidden.share_at(tried.along / length, half)

        result.append(
            Hypothesis(
                kind, _HIDDEN * hidden.probability / total, share,
                hidden.start * length, hidden.end * length,
            )
        )  # fmt: skip
    return result


def _share_of(kind: str, own: Try) -> Share:
    """Return what a cause of a kind leaves of the chance of each attempt."""
    if kind in _CURED_BY:
        return _of_occasion(own, _CURED_BY[kind], 0.5 if kind == "collision" else _RARELY)
    shares: dict[str, Share] = {
        "slippery": lambda tried: _of_product(own, tried, _SOMETIMES, 0.5),
        "fragile": lambda tried: (
            1.0 if _below(tried.hand.force, own.hand.force)
            else _of_product(own, tried, _SOMETIMES, 0.4)
        ),
        "poor_grasp": _of_grasp(own),
        "weak_hand": lambda tried: _SOMETIMES if tried.hand.iri == own.hand.iri else 1.0,
        "hardware": lambda tried: (
            # What the hand did before it broke says nothing.
            _RARELY / 2 if tried.hand.iri == own.hand.iri and not tried.is_other else 1.0
        ),
        "too_heavy": lambda tried: (
            1.0 if _below(own.hand.payload, tried.hand.payload)
            else _of_product(own, tried, _RARELY, 0.4)
        ),
        "too_wide": lambda tried: (
            1.0 if _below(own.hand.opening, tried.hand.opening)
            else _of_product(own, tried, _RARELY, 0.4)
        ),
        "out_of_reach": lambda tried: (
            _RARELY if tried.hand.robot == own.hand.robot and tried.place == own.place
            and (own.place or tried.thing == own.thing) else 1.0
        ),
        "chance": lambda tried: 1.0,
    }  # fmt: skip
    return shares[kind]


def _of_unknown(failure: Failure) -> Share:
    """Return the share for a cause that nobody thought of.

    Other occasions say nothing about it, and nothing is known that would help against it but what
    has helped since.
    """
    helped = {
        (other.hand.kind, other.grasp)
        for other in failure.others
        if other.held and other.is_since and other.grasp and other.product == failure.tried.product
    }

    def share(tried: Try) -> float:
        return 1.0 if tried.is_other or (tried.hand.kind, tried.grasp) in helped else _SOMETIMES

    return share


def _of_occasion(own: Try, cure: str, otherwise: float) -> Share:
    """Return the share for a cause of that one occasion, which another grasp may get around."""

    def share(tried: Try) -> float:
        if tried.is_other or cure in tried.done_before:
            return 1.0
        return _RARELY if tried.grasp == own.grasp else otherwise

    return share


def _of_grasp(own: Try) -> Share:
    return lambda tried: _SOMETIMES if own.grasp and tried.grasp == own.grasp else 1.0


def _of_product(own: Try, tried: Try, alike: float, other_kind: float) -> float:
    if tried.product != own.product:
        return 1.0
    return alike if tried.hand.kind == own.hand.kind else other_kind


def _below(less: float | None, more: float | None) -> bool:
    return less is not None and more is not None and less < 0.8 * more
