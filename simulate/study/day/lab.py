"""The true lab of a day: tables, boxes and things, and the log of what truly happened.

Nothing here is told to the graph; questions are judged by it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

__all__ = ["BOXES", "MOVED_M", "TABLES", "Item", "Lab", "Place", "Spot2"]

Spot2 = tuple[float, float]
"""Position (x, y) in the map, m."""
TABLES: dict[str, Spot2] = {"table-a": (0.0, 0.0), "table-b": (3.0, 0.0)}
"""Centre of each table in the map, m."""
BOXES = {"left box": "table-a", "right box": "table-b"}
"""Table beside which each box stands."""
_HALF = (0.8, 0.4)
"""Half length and width of the tables, m."""
MOVED_M = 0.02
"""Shift from which something counts as moved, as in the graph."""
_APART_M = 0.11
_PAIRS_SHARE = 1 / 3
Kind = Literal["on", "in", "held", "away"]


@dataclass(frozen=True)
class Place:
    """A true place of a thing from a time on.

    Parameters
    ----------
    kind
        On a table, in a box, held by a robot, or away, where no robot can see it.
    where
        Name of the table, box or robot; empty if it is away.
    since_s
        Unix time at which it came there.
    mover
        Name of the robot that brought it; empty for a person, whom nobody saw.
    spot
        Position in the map, m, on a table.
    """

    kind: Kind
    where: str
    since_s: float
    mover: str = ""
    spot: Spot2 = (0.0, 0.0)


@dataclass(eq=False)
class Item:
    """A thing with its product and all of its true places, oldest first."""

    name: str
    product: int
    log: list[Place] = field(default_factory=list)
    covered_from_s: float = 0.0
    covered_until_s: float = 0.0

    @property
    def now(self) -> Place:
        """Where it is."""
        return self.log[-1]

    def at(self, time_s: float) -> Place | None:
        """Return where it was at a time."""
        begun = [place for place in self.log if place.since_s <= time_s]
        return begun[-1] if begun else None

    def until(self, place: Place) -> float | None:
        """Return when a place of the log ended, or None if it lasts."""
        after = self.log[self.log.index(place) + 1 :]
        return after[0].since_s if after else None


@dataclass
class Lab:
    """All things of the lab, in their true places.

    Parameters
    ----------
    rng
        Draws free spots and small pushes.
    """

    rng: np.random.Generator
    items: list[Item] = field(default_factory=list)
    _put: dict[tuple[Item, float], Spot2] = field(default_factory=dict)

    @classmethod
    def made(cls, rng: np.random.Generator, count: int, start_s: float) -> Lab:
        """Return a lab with so many things on its tables, of which a third are equal pairs."""
        lab = cls(rng)
        pairs = int(count * _PAIRS_SHARE / 2)
        products = [k for k in range(pairs) for _ in range(2)]
        products += range(pairs, pairs + count - 2 * pairs)
        for product in products:
            item = Item(f"cup {product}" if product < pairs else f"carton {product}", product)
            table = str(rng.choice(list(TABLES)))
            item.log.append(Place("on", table, start_s, spot=lab.free_spot(table)))
            lab.items.append(item)
        return lab

    @property
    def pairs(self) -> list[tuple[Item, Item]]:
        """Things of which there are two that look the same."""
        alike: dict[int, list[Item]] = {}
        for item in self.items:
            alike.setdefault(item.product, []).append(item)
        return [(same[0], same[1]) for same in alike.values() if len(same) == 2]

    @property
    def single(self) -> list[Item]:
        """Things of which there is one."""
        paired = {item.product for pair in self.pairs for item in pair}
        return [item for item in self.items if item.product not in paired]

    def on(self, table: str) -> list[Item]:
        """Return what is on a table."""
        return [t for t in self.items if (t.now.kind, t.now.where) == ("on", table)]

    def free_spot(self, table: str) -> Spot2:
        """Return a spot on a table at which nothing else would be touched."""
        taken = [item.now.spot for item in self.items if item.log and item.now.where == table]
        centre = TABLES[table]
        while True:
            x, y = (float(self.rng.uniform(-half + 0.05, half - 0.05)) for half in _HALF)
            spot = centre[0] + x, centre[1] + y
            if all(np.hypot(spot[0] - a, spot[1] - b) >= _APART_M for a, b in taken):
                return spot

    def move(self, item: Item, place: Place) -> None:
        """Log that a thing is at another place from now on."""
        item.log.append(place)

    def nudge(self, item: Item, time_s: float) -> None:
        """Let a hand brush against a thing: it shifts by some millimetres.

        Once it is :data:`MOVED_M` from where it was put, it counts as moved, unseen.
        """
        dx, dy = self.rng.normal(0.0, 0.004, 2)
        place = item.now
        spot = place.spot[0] + float(dx), place.spot[1] + float(dy)
        put = self._put.setdefault((item, place.since_s), place.spot)
        if distance(put, spot) < MOVED_M:
            item.log[-1] = replace(place, spot=spot)
        else:
            self.move(item, Place("on", place.where, time_s, "", spot))

    def neighbours(self, item: Item, radius_m: float) -> list[Item]:
        """Return what stands within a radius on the same table."""
        return [
            other for other in self.on(item.now.where)
            if other is not item and distance(other.now.spot, item.now.spot) <= radius_m
        ]  # fmt: skip


def distance(first: Spot2, other: Spot2) -> float:
    """Return the distance of two spots, m."""
    return float(np.hypot(first[0] - other[0], first[1] - other[1]))
