"""Reports that come late: by a clock that is behind, or by a robot that was out of reach.

What they say of then belongs between what was said of before and of after. It must not become the
last word, and a thing that has been carried off since must not be made again where it stood.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rtask.world.placement import Placement, Relation
from rtask.world.statements import Statement, ended, placed

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = ["CLOCKS_DIFFER_S", "Then", "inserted", "is_same_place", "then", "was_seen_since"]

CLOCKS_DIFFER_S = 60.0
"""Difference of two robots' clocks up to which a deed counts though somebody looked after it."""


@dataclass(frozen=True, eq=False)
class Then:
    """What is known of a thing at a time before its last place began.

    Parameters
    ----------
    placement
        Its last place that had begun, ended or not; None if nobody had seen it.
    until_s
        When the next thing that is known of it begins, Unix time.
    """

    placement: Placement | None
    until_s: float

    def gap_at(self, time_s: float) -> bool:
        """Whether there is room for another place: nobody saw it at its own place since."""
        placement = self.placement
        return placement is None or not placement.holds_at(time_s) or placement.confirmed <= time_s


def then(world: WorldState, exemplar: str, time_s: float) -> Then | None:
    """Return what is known of a thing at a time; None if nothing begins after that."""
    after = [entry.begin for entry in world.entries(exemplar) if entry.begin > time_s]
    if not after:
        return None
    return Then(world.last_placement(exemplar, time_s), min(after))


def inserted(known: Then, told: Placement | None, time_s: float) -> Iterator[Statement]:
    """Yield the statements of a place between two others; None for a thing that was gone by then.

    Nothing where somebody saw it at its own place later: which of the two is right is not known.
    """
    if not known.gap_at(time_s):
        return
    before = known.placement
    if before is not None and before.holds_at(time_s):
        # It has an end already, if another follows: of two, the earlier one counts.
        yield from ended(before.iri, time_s)
    if told is not None and time_s < known.until_s:
        yield from placed(replace(told, end=None))
        yield from ended(told.iri, known.until_s)


def was_seen_since(last: Placement | None, time_s: float) -> bool:
    """Whether somebody saw a thing at its place well after the time that a report is about."""
    is_current = last is not None and last.is_current
    return last is not None and is_current and time_s < last.confirmed - CLOCKS_DIFFER_S


def is_same_place(known: Placement | None, relation: Relation, place: str, time_s: float) -> bool:
    """Whether a thing is known to have been on, in or held by something at a time."""
    if known is None or not known.holds_at(max(time_s, known.begin)):
        return False
    return (known.relation, known.place) == (relation, place)
