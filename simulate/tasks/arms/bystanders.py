"""What stands around where an arm works: seen before it moves, and looked for afterwards.

An arm can push over, or off the table, what its task is not about. Nobody would look for that: a
step fails for its own thing alone, and one that is done looks at nothing else. So what was seen
before a motion and is not seen after it is no longer said to be there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.executor import Graph

__all__ = ["Bystanders", "Observer"]


class Observer(Protocol):
    """Eyes of a robot."""

    def is_seen(self, item: str, place: str) -> bool:
        """Look whether a thing is in an area, from any viewpoint."""

    def place_seen(self, item: str) -> str | None:
        """Look for a thing in all areas; return the one in which it is seen."""


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
        self.known: Mapping[str, str] = {}
        """Areas of things, as the graph had them before the last motion, by IRI."""

    def note(self, but: str) -> None:
        """Look what stands there before the robot moves something.

        What it does not recognise now is left out: not seen afterwards, it says nothing.

        Parameters
        ----------
        but
            IRI of the thing that is to be moved.
        """
        self.known = self._whereabouts()
        self._stood = {
            item: place
            for item, place in self.known.items()
            if item != but and self._observer.is_seen(item, place)
        }

    def displaced(self) -> Mapping[str, str | None]:
        """Look for what stood there; return where the rest is seen now, None where that is nowhere.

        What another robot has taken meanwhile, as the graph has it, is left out.
        """
        gone = [item for item, at in self._stood.items() if not self._observer.is_seen(item, at)]
        now = self._whereabouts() if gone else {}
        still = [item for item in gone if now.get(item) == self._stood[item]]
        self._stood = {}
        return {item: self._observer.place_seen(item) for item in still}

    def _whereabouts(self) -> dict[str, str]:
        """Return the areas of things as the graph has them, by IRI."""
        values = " ".join(f"<{place}>" for place in self._areas)
        return {str(row["thing"]): str(row["place"]) for row in self._graph.query(_AT % values)}


_AT = f"""{PREFIXES}
SELECT DISTINCT ?thing ?place WHERE {{
  VALUES ?place {{ %s }} ?thing a rt:Exemplar ; rt:locatedOn ?place }}"""
