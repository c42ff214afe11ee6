"""Identity of things over time, by place, time and product.

A sighting of a product is a sighting of one of its things: the one that was there, one that was
put on or into the place that is looked at, the one that this robot had in its hand, or one whose
place nobody knows. Where none of these fits, either an
unseen hand carried one of the known things here, or this is another one. That chance is stored, and
can be settled later; nothing is decided that was not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rtask.world.uncertainty import Spread

__all__ = ["SURE", "Candidate", "Identity", "identify"]

SURE = 0.95
"""Chance from which a thing counts as the same."""

_NEW = 0.1
"""Weight of a thing that nobody has seen yet, beside the chances that a known one was moved."""
_TURNS_UP = 0.25
"""Weight of a thing that an unseen hand took, beside 1 for what slipped and must lie about."""

_MIN_CHANCE = 0.01
_SAME_LOOK_S = 2.0
_CHANCE = 0.9


@dataclass(frozen=True)
class Candidate:
    """A thing of the product that may be the one in sight.

    Parameters
    ----------
    exemplar
        IRI of the thing.
    distance_m
        From where it is, or was last, to where one is seen now; None if the graph cannot tell.
    spread
        Of its place at this time.
    is_current
        Whether it has a place now, as far as is known.
    in_own_hand
        Whether the robot that sees one holds it.
    is_reachable
        Whether it is, or was last, in the frames of the robot that sees one.
    age_s
        Time since it was last seen.
    has_slipped
        Whether a robot lost it from its hand, and nobody has seen it since.
    is_in_place
        Whether one is seen on or in the place where this one was put, at an unknown spot there.
    is_beyond_reach
        Whether it slipped, and from farther away than it can have fallen: an unseen hand would have
        to have brought it here since.
    """

    exemplar: str
    distance_m: float | None
    spread: Spread
    is_current: bool
    in_own_hand: bool = False
    is_reachable: bool = True
    age_s: float = 0.0
    has_slipped: bool = False
    is_in_place: bool = False
    is_beyond_reach: bool = False


@dataclass(frozen=True)
class Identity:
    """Which thing is seen.

    Parameters
    ----------
    exemplar
        A known one; empty for a new one.
    doubts
        Other known things that it may be, with the chances, most likely first.
    is_followed
        Whether it is where it was, or was in the robot's hand, so that it can be no other.
    """

    exemplar: str
    doubts: tuple[tuple[str, float], ...] = ()
    is_followed: bool = False


def identify(
    candidates: Sequence[Candidate], sigma_m: float, min_extent_m: float = 0.0
) -> Identity:
    """Return which of the known things of a product is seen.

    Parameters
    ----------
    sigma_m
        Standard deviation per axis of the position now seen, m.
    min_extent_m
        The product's smaller horizontal extent: two of them cannot be nearer to each other.

    Examples
    --------
    >>> there = Candidate("urn:a", 0.004, Spread(0.005, 1.0, 0.35), is_current=True)
    >>> identify([there], 0.005).exemplar
    'urn:a'
    >>> identify([Candidate("urn:a", 0.4, there.spread, is_current=True)], 0.005).exemplar
    ''
    """
    reach = Spread(sigma_m, 1.0, 0.0).radius(_CHANCE)
    here = [
        (candidate.distance_m, candidate.exemplar)
        for candidate in candidates
        if candidate.is_current
        and candidate.distance_m is not None
        and candidate.distance_m <= max(candidate.spread.radius(_CHANCE) + reach, min_extent_m)
    ]
    if here:
        return Identity(min(here)[1], is_followed=True)
    put = sorted(candidate.exemplar for candidate in candidates if candidate.is_in_place)
    if put:
        return Identity(put[0], _shares(put[1:], len(put)), is_followed=len(put) == 1)
    held = sorted(candidate.exemplar for candidate in candidates if candidate.in_own_hand)
    if held:
        return Identity(held[0], _shares(held[1:], len(held)), is_followed=len(held) == 1)
    lost = sorted(
        (c for c in candidates if not c.is_current and c.is_reachable and not c.is_beyond_reach),
        key=lambda c: (
            not c.has_slipped, c.distance_m is None, c.distance_m or 0.0, c.age_s, c.exemplar,
        ),
    )  # fmt: skip
    if lost:
        weights = [1.0 if c.has_slipped else _TURNS_UP for c in lost]
        shares = [
            (c.exemplar, weight / sum(weights)) for c, weight in zip(lost, weights, strict=True)
        ]
        return Identity(lost[0].exemplar, tuple(shares[1:]))
    moved = {
        candidate.exemplar: (
            # What slipped lies where it fell until it is found; more is not known of it.
            _TURNS_UP if candidate.is_beyond_reach else 1.0 - candidate.spread.still_there
        )
        for candidate in candidates
        if candidate.is_reachable and candidate.age_s > _SAME_LOOK_S
    }
    total = sum(moved.values()) + _NEW
    chances = sorted(
        ((weight / total, exemplar) for exemplar, weight in moved.items()), reverse=True
    )
    if chances and chances[0][0] >= SURE:
        return Identity(chances[0][1])
    doubts = tuple((exemplar, chance) for chance, exemplar in chances if chance >= _MIN_CHANCE)
    return Identity("", doubts)


def _shares(others: Sequence[str], count: int) -> tuple[tuple[str, float], ...]:
    """Return equal chances for things between which nothing decides."""
    return tuple((exemplar, 1.0 / count) for exemplar in others)
