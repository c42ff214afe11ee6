"""The history of a thing: where it was, one place after the other, and who moved it there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rtask.world.placement import Placement
from rtask.world.uncertainty import MOVED_M

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = ["Stay", "stays_of"]

_SURE_SIGMAS = 3.5
"""Noise of 1 look in 500 is beyond so many standard deviations per axis, in the plane."""


@dataclass(frozen=True, eq=False)
class Stay:
    """A place at which a thing was, and how it came there.

    Two poses that differ by little more than what counts as moved may be those of a thing that
    stood still and was measured twice, or that crept. Then it may have come there, or left, at any
    time of the places before and after as well.

    Parameters
    ----------
    placement
        The interval.
    arrived_after_s
        Unix time after which it came: when it was last seen where it surely had been before; None
        if nobody saw it elsewhere before.
    left_before_s
        Unix time by which it had surely left; None if it may be there still.
    moved_by
        IRI of the robot or person that brought it, if one said so; empty if nobody saw that.
    """

    placement: Placement
    arrived_after_s: float | None
    left_before_s: float | None
    moved_by: str


def stays_of(
    world: WorldState, thing: str, until_s: float, max_stays: int | None = None
) -> tuple[list[Stay], int]:
    """Return the latest places of a thing that had begun by a time, oldest first.

    Returns
    -------
    The places, at most ``max_stays``, and how many earlier ones there are.
    """
    history = world.history(thing)
    begun = sum(place.begin <= until_s for place in history)
    first = 0 if max_stays is None else max(begun - max_stays, 0)
    return [_stay(world, history, number) for number in range(first, begun)], first


def _stay(world: WorldState, history: Sequence[Placement], number: int) -> Stay:
    placement, last = history[number], number
    while last + 1 < len(history) and _may_be_one(world, history, number, last + 1):
        last += 1
    left_before_s = history[last].end
    first = number
    if placement.relation != "at":
        while first and history[first].follows(history[first - 1]):
            first -= 1
        while last + 1 < len(history) and history[last + 1].follows(history[last]):
            last += 1
        came = history[first]
        return Stay(placement, came.begin, history[last].end, came.agent)
    while first and _may_be_one(world, history, number, first - 1):
        first -= 1
    arrived_after_s = history[first - 1].confirmed if first else None
    if history[first].relation != "at":
        arrived_after_s = history[first].begin
    mover = _mover(history[number - 1], placement) if number else ""
    return Stay(placement, arrived_after_s, left_before_s, mover)


def _mover(before: Placement, placement: Placement) -> str:
    """Return who put a thing down where it is seen now."""
    is_carried = before.relation == "held_by" and before.end == placement.begin
    return before.agent if is_carried else ""


def _may_be_one(world: WorldState, history: Sequence[Placement], number: int, other: int) -> bool:
    """Whether a thing may have stood still from one place to another, as far as was measured.

    So too where it was missed in between: eyes miss things. False where the two poses cannot be
    compared; the places between are known to be like this one.
    """
    place, away = history[number], history[other]
    if place.frame_from_subject is None:
        return False
    there = world.pose_in(away, place.frame, max(place.begin, away.begin))
    if there is None:
        return False
    pose, variance_m2 = there
    sigma_m = math.sqrt(place.sigma_m**2 + away.sigma_m**2 + variance_m2)
    shift_m = float(np.linalg.norm(pose[:3, 3] - place.frame_from_subject[:3, 3]))
    return shift_m <= MOVED_M + _SURE_SIGMAS * sigma_m
