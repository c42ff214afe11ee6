"""The history of a thing: where it was, one place after the other, and who moved it there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rtask.world.placement import Placement

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = ["Stay", "stays_of"]


@dataclass(frozen=True, eq=False)
class Stay:
    """A place at which a thing was, and how it came there.

    Parameters
    ----------
    placement
        The interval.
    arrived_after_s
        Unix time after which it came: when it was last seen at the place before; None if nobody saw
        it before.
    moved_by
        IRI of the robot or person that brought it, if one said so; empty if nobody saw that.
    """

    placement: Placement
    arrived_after_s: float | None
    moved_by: str


def stays_of(world: WorldState, thing: str, until_s: float) -> list[Stay]:
    """Return the places of a thing that had begun by a time, oldest first."""
    placements = [place for place in world.history(thing) if place.begin <= until_s]
    return [_stay(placements, number) for number in range(len(placements))]


def _stay(placements: Sequence[Placement], number: int) -> Stay:
    placement = placements[number]
    before = placements[number - 1] if number else None
    if placement.relation != "at":
        return Stay(placement, placement.begin, placement.agent)
    if before is None:
        return Stay(placement, None, "")
    is_carried = before.relation == "held_by" and before.end is not None
    mover = before.agent if is_carried and before.end == placement.begin else ""
    return Stay(placement, before.confirmed, mover)
