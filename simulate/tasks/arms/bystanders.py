"""What stands around where an arm works: seen before it moves, and looked for afterwards.

An arm can push over, or off the table, what its task is not about. Nobody would look for that: a
step fails for its own thing alone, and one that is done looks at nothing else. So what was seen
before a motion and is not seen after it is no longer said to be there.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.executor import Graph

if TYPE_CHECKING:
    from simulate.tasks.arms.body import ArmBody

__all__ = ["Bystanders"]


class Bystanders:
    """Things on the areas of the table that a robot gets to.

    Parameters
    ----------
    body
        The robot.
    graph
        A client in its name.
    """

    def __init__(self, body: ArmBody, graph: Graph) -> None:
        self._body, self._graph = body, graph
        layout = body.robot.station.bench.layout
        self._areas = [at for at, name in body.places.items() if not layout.area(name).is_box]
        self._stood: dict[str, str] = {}

    def note(self, but: str) -> None:
        """Look what stands there before the robot moves something.

        What it does not recognise now is left out: not seen afterwards, it says nothing.

        Parameters
        ----------
        but
            IRI of the thing that is to be moved.
        """
        self._stood = {
            item: place
            for item, place in self._known().items()
            if item != but and self._body.is_seen(item, place)
        }

    def displaced(self) -> Mapping[str, str | None]:
        """Look for what stood there; return where the rest is seen now, None where that is nowhere.

        What another robot has taken meanwhile, as the graph has it, is left out.
        """
        gone = [item for item, at in self._stood.items() if not self._body.is_seen(item, at)]
        known = self._known() if gone else {}
        still = [item for item in gone if known.get(item) == self._stood[item]]
        self._stood = {}
        return {item: self._body.place_seen(item) for item in still}

    def _known(self) -> dict[str, str]:
        """Return the areas of things as the graph has them, by IRI."""
        values = " ".join(f"<{place}>" for place in self._areas)
        return {str(row["thing"]): str(row["place"]) for row in self._graph.query(_AT % values)}


_AT = f"""{PREFIXES}
SELECT DISTINCT ?thing ?place WHERE {{
  VALUES ?place {{ %s }} ?thing a rt:Exemplar ; rt:locatedOn ?place }}"""
