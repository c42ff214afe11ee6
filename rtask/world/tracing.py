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
    from rtask.world.index.tail import Entry
    from rtask.world.state import WorldState

__all__ = ["Stay", "stays_of"]

_MAX_COMPARISONS = 5_000
"""Pairs of poses that one answer compares. A thing that crept on for years would be compared with
each place of those years; beyond this it is not known when it came, or left."""
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
    history = _History(world, thing)
    begun = sum(entry.begin <= until_s for entry in history.entries)
    first = 0 if max_stays is None else max(begun - max_stays, 0)
    return [history.stay(number) for number in range(first, begun)], first


class _History:
    """The places of a thing, oldest first, each of which is read when it is looked at.

    What was where, from when to when, is in the index; a thing that is seen for years has more
    places than are to be read for the last hundred.
    """

    def __init__(self, world: WorldState, thing: str) -> None:
        self._world = world
        self.entries = world.entries(thing)
        self._read: dict[int, Placement] = {}
        self._comparisons = _MAX_COMPARISONS
        self._came, self._went = _runs(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, number: int) -> Placement:
        placement = self._read.get(number)
        if placement is None:
            entry = self.entries[number]
            read = self._world.index.read(entry.node)
            # Withdrawn since the index was asked: what it said of the place holds for this answer.
            end = None if math.isinf(entry.end) else entry.end
            placement = read or Placement(entry.node, "", entry.begin, end, entry.begin)
            self._read[number] = placement
        return placement

    def stay(self, number: int) -> Stay:
        """Return one place, with when the thing came there, and by when it had left."""
        placement = self[number]
        if placement.relation != "at":
            came = self[self._came[number]]
            last, is_cut = self._run(number, self._went[number], 1)
            left_before_s = None if is_cut else self[self._went[last]].end
            return Stay(placement, came.begin, left_before_s, came.agent)
        last, is_cut = self._run(number, number, 1)
        left_before_s = None if is_cut else self[last].end
        first, is_cut = self._run(number, number, -1)
        arrived_after_s = self[first - 1].confirmed if first else None
        if self[first].relation != "at":
            arrived_after_s = self[first].begin
        mover = _mover(self[number - 1], placement) if number else ""
        return Stay(placement, None if is_cut else arrived_after_s, left_before_s, mover)

    def _run(self, number: int, start: int, step: int) -> tuple[int, bool]:
        """Return up to which place a thing may have stood still, and whether that was cut short."""
        at = start
        while 0 <= at + step < len(self.entries):
            if self._comparisons <= 0:
                return at, True
            self._comparisons -= 1
            if not _may_be_one(self._world, self[number], self[at + step]):
                break
            at += step
        return at, False


def _runs(entries: Sequence[Entry]) -> tuple[list[int], list[int]]:
    """Return for each place the first and the last of the stay on or in something it belongs to."""
    came: list[int] = []
    for number, entry in enumerate(entries):
        follows = number > 0 and entry.follows(entries[number - 1])
        came.append(came[-1] if follows else number)
    went = list(range(len(entries)))
    for number in range(len(entries) - 2, -1, -1):
        if came[number + 1] == came[number]:
            went[number] = went[number + 1]
    return came, went


def _mover(before: Placement, placement: Placement) -> str:
    """Return who put a thing down where it is seen now."""
    is_carried = before.relation == "held_by" and before.end == placement.begin
    return before.agent if is_carried else ""


def _may_be_one(world: WorldState, place: Placement, away: Placement) -> bool:
    """Whether a thing may have stood still from one place to another, as far as was measured.

    So too where it was missed in between: eyes miss things. False where the two poses cannot be
    compared; the places between are known to be like this one.
    """
    if place.frame_from_subject is None:
        return False
    there = world.pose_in(away, place.frame, max(place.begin, away.begin))
    if there is None:
        return False
    pose, variance_m2 = there
    sigma_m = math.sqrt(place.sigma_m**2 + away.sigma_m**2 + variance_m2)
    shift_m = float(np.linalg.norm(pose[:3, 3] - place.frame_from_subject[:3, 3]))
    # Moved is what is so far from where it was put: it may have been on one side of that, then on
    # the other.
    return shift_m <= 2.0 * MOVED_M + _SURE_SIGMAS * sigma_m
