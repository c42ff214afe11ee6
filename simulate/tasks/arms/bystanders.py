"""What stands around where an arm works: seen before it moves, and looked for afterwards.

An arm can push over, or off the table, what its task is not about. Nobody would look for that: a
step fails for its own thing alone, and one that is done looks at nothing else. So what was seen
before a motion, and whose place is seen empty after it, is no longer said to be there. What the arm
hides, such as behind a thing that it holds up, is looked for after the next motion once more.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Protocol

from features.geometry import FloatArray
from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.executor import Graph

__all__ = ["Bystanders", "Observer"]


class Observer(Protocol):
    """Eyes of a robot."""

    def is_seen(self, item: str, place: str) -> bool:
        """Look whether a thing is in an area, from any viewpoint."""

    def place_seen(self, item: str) -> str | None:
        """Look for a thing in all areas; return the one in which it is seen."""

    def count_seen(self, item: str, place: str) -> int:
        """Return how many of the product of a thing are seen in an area, at most from one view."""

    def product(self, item: str) -> str:
        """Return the IRI of the product of a thing."""

    def holds(self, item: str) -> bool:
        """Return whether a hand has a thing."""

    def spots(self, item: str, place: str) -> list[FloatArray]:
        """Return the surfaces (n, 3), m, base frame, of what is seen of a product in an area."""

    def is_empty(self, spot: FloatArray, place: str) -> bool:
        """Look whether there is nothing any more where a surface of an area was seen."""


class Bystanders:
    """Things on the areas of the table that a robot gets to.

    Parameters
    ----------
    observer
        The robot.
    graph
        A client in its name.
    areas
        IRIs of these parts of the table.
    """

    def __init__(self, observer: Observer, graph: Graph, areas: Sequence[str]) -> None:
        self._observer, self._graph, self._areas = observer, graph, areas
        self._stood: dict[str, str] = {}
        self._spots: dict[str, list[FloatArray]] = {}
        self._hidden: dict[str, str] = {}
        self._counted: set[tuple[str, str]] = set()
        self._but, self._but_at = "", frozenset[str]()
        self.areas_before: Mapping[str, str] = {}
        """Areas of things, as the graph had them before the last motion, by IRI."""

    def note(self, but: str, target: str = "") -> None:
        """Look what stands there before the robot moves something.

        What it does not recognise now is left out: not seen afterwards, it says nothing.

        Parameters
        ----------
        but, target
            IRIs of the thing that is to be moved, and of the area it is to be put onto, if any.
        """
        self.areas_before = self._whereabouts()
        self._but, self._but_at = but, frozenset((self.areas_before.get(but, ""), target))
        self._stood = {
            item: place
            for item, place in self.areas_before.items()
            if item != but
            and (self._observer.is_seen(item, place) or self._hidden.get(item) == place)
        }
        hidden = {item: self._spots[item] for item in self._hidden if item in self._stood}
        self._spots = {
            item: self._observer.spots(item, place) or hidden.get(item, [])
            for item, place in self._stood.items()
        }
        self._hidden = {}
        equal = Counter(
            (place, self._observer.product(item)) for item, place in self.areas_before.items()
        )
        # Seen less than all of them before, a count says nothing about them afterwards.
        self._counted = {
            (place, self._observer.product(item))
            for item, place in self.areas_before.items()
            if self._is_of_several(equal, place, item)
            and self._observer.count_seen(item, place) >= equal[place, self._observer.product(item)]
        }

    def _is_of_several(self, equal: Mapping[tuple[str, str], int], place: str, item: str) -> bool:
        """Tell whether an area has, or is to have, several things of one product."""
        product = self._observer.product(item)
        comes = self.areas_before.get(self._but) != place and place in self._but_at
        return equal[place, product] + (comes and self._observer.product(self._but) == product) > 1

    def displaced(self) -> Mapping[str, str | None]:
        """Look for what stood there; return where the rest is seen now, None where that is nowhere.

        What another robot has taken meanwhile, as the graph has it, is left out.
        """
        if not self._stood:  # nothing was moved since: what is hidden is still to be looked for
            return {}
        unseen = [item for item, at in self._stood.items() if not self._observer.is_seen(item, at)]
        gone = [item for item in unseen if self._empty_spots(item) == len(self._spots[item])]
        self._hidden = {item: self._stood[item] for item in unseen if item not in gone}
        gone += self._missing_equals(unseen)
        now = self._whereabouts() if gone else {}
        still = [item for item in gone if now.get(item) == self._stood[item]]
        moved = {item: self._place_of(item) for item in still}
        self._stood = {}
        return moved

    def _empty_spots(self, item: str) -> int:
        place = self._stood[item]
        return sum(self._observer.is_empty(spot, place) for spot in self._spots[item])

    def _missing_equals(self, gone: Sequence[str]) -> list[str]:
        """Return so many of equal things as are no longer seen: which of them, nobody can tell.

        At most so many as have left an empty spot.
        """
        groups: dict[tuple[str, str], list[str]] = {}
        for item, place in self._stood.items():
            if item not in gone:
                groups.setdefault((place, self._observer.product(item)), []).append(item)
        missing: list[str] = []
        for (place, product), items in groups.items():
            if (place, product) in self._counted:
                seen = self._observer.count_seen(items[0], place)
                there_too = self._is_there_too(place, product)
                was_there = self.areas_before.get(self._but) == place
                is_taken = was_there and self._observer.product(self._but) == product
                empty = self._empty_spots(items[0]) - (is_taken and not there_too)
                free = max(seen - there_too, len(items) - max(empty, 0), 0)
                missing += sorted(items)[free:]
        return missing

    def _is_there_too(self, place: str, product: str) -> bool:
        """Whether the thing that was to be moved is one of the equal things of an area now."""
        is_equal = self._observer.product(self._but) == product
        return is_equal and place in self._but_at and not self._observer.holds(self._but)

    def _place_of(self, item: str) -> str | None:
        """Return where a displaced thing is seen now: not where others of its product stood."""
        product = self._observer.product(item)
        equal = Counter(at for other, at in self.areas_before.items()
                        if other != item and self._observer.product(other) == product)  # fmt: skip
        if not equal:
            return self._observer.place_seen(item)
        more = (at for at in self._areas if at != self._stood[item]
                and self._observer.count_seen(item, at)
                > equal[at] + self._is_there_too(at, product))  # fmt: skip
        return next(more, None)

    def _whereabouts(self) -> dict[str, str]:
        """Return the areas of things as the graph has them, by IRI."""
        values = " ".join(f"<{place}>" for place in self._areas)
        return {str(row["thing"]): str(row["place"]) for row in self._graph.query(_AT % values)}


_AT = f"""{PREFIXES}
SELECT DISTINCT ?thing ?place WHERE {{
  VALUES ?place {{ %s }} ?thing a rt:Exemplar ; rt:locatedOn ?place }}"""
