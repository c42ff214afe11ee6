"""Tracking of the things on a table from one look to the next.

A robot that has just pushed an object knows that the thing now lying 3 cm further is that object.
Tracking only ever joins looks of one robot at one table; identity across robots comes from
recognition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from scipy.optimize import linear_sum_assignment

from simulate.agent.perception import Seen

__all__ = ["Thing", "Tracker"]

_STILL_M = 0.025
_MOVED_M = 0.09


@dataclass
class Thing:
    """Something on the table that is tracked through several looks.

    Parameters
    ----------
    number
        Counts from 1 at each table.
    seen
        The latest look at it.
    object_iri
        Under which the graph knows it; empty = not yet.
    finished
        Nothing is left to do with it.
    visible
        In the latest look at its side of the table.
    waiting
        Out of reach while others stand in the way.
    """

    number: int
    seen: Seen
    object_iri: str = ""
    finished: bool = False
    visible: bool = True
    waiting: bool = False


class Tracker:
    """Tracks the things on one table.

    An object may have moved up to 2.5 cm unnoticed (a neighbour brushed it), the one just
    handled up to 9 cm (it was pushed). When the handled one is nowhere near and something
    unknown lies on the table, that is it: it was dropped or rolled away.
    """

    def __init__(self) -> None:
        self.things: list[Thing] = []
        self._numbers = count(1)

    def update(
        self, objects: Sequence[Seen], handled: Thing | None = None, side: int | None = None
    ) -> list[Thing]:
        """Match the objects of a new look to the known things; return those in view.

        Parameters
        ----------
        objects
            Of one frame.
        handled
            The thing that the robot has just touched, which may be anywhere near.
        side
            +1 = the look shows the left half of the table (y > 0), -1 the right half; things of
            the other half stay as they were.
        """
        known = [t for t in self.things if side is None or t.seen.position[1] * side >= 0]
        for thing in known:
            thing.visible = False
        matched: list[Thing | None] = [None] * len(objects)
        if known and objects:
            cost = np.array(
                [[self._distance(thing, seen, handled) for seen in objects] for thing in known]
            )
            for row, column in zip(*linear_sum_assignment(cost), strict=True):
                if cost[row, column] < 1.0:
                    matched[column] = known[row]
        strangers = [column for column, match in enumerate(matched) if match is None]
        astray = handled in known and handled not in matched and not handled.finished
        if astray and len(strangers) == 1:
            matched[strangers[0]] = handled
        for seen, match in zip(objects, matched, strict=True):
            if match is None:
                self.things.append(Thing(next(self._numbers), seen))
            else:
                match.seen, match.visible = seen, True
        return [thing for thing in self.things if thing.visible]

    def lost(self, object_iri: str) -> Thing | None:
        """Return the unfinished thing of that identity that went out of sight, if any."""
        for thing in self.things:
            if thing.object_iri == object_iri and not thing.visible and not thing.finished:
                return thing
        return None

    def join(self, lost: Thing, found: Thing) -> None:
        """Replace a lost thing by the one found elsewhere."""
        self.things.remove(lost)
        found.number, found.object_iri = lost.number, lost.object_iri

    @staticmethod
    def _distance(thing: Thing, seen: Seen, handled: Thing | None) -> float:
        """Return the distance that a thing would have moved, relative to its allowed distance."""
        allowed = _MOVED_M if thing is handled else _STILL_M
        way = float(np.linalg.norm(thing.seen.position - seen.position))
        return min(way / allowed, 1e3)
