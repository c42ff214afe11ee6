"""Present places of a thing, as robots estimated or recorded them, each with its time and frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import ontology
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, Term, prologue

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.sparql.results import Row

__all__ = ["MAX_PLACES", "Place", "places_of"]

MAX_PLACES = 1000

_QUERY = """SELECT ?thing ?graph ?relation ?place ?frame ?x ?y ?z ?time ?confidence ?estimate
WHERE {
  {
    %(things)s GRAPH ?graph { ?estimate rt:poseOf ?thing }
    ?estimate rt:estimatedPose ?pose . BIND("at" AS ?relation)
    ?pose rt:atTime ?time ; rt:inFrame ?place ; rt:x ?x ; rt:y ?y ; rt:z ?z
    OPTIONAL { ?place rt:frameId ?frame }
    OPTIONAL { ?estimate rt:poseConfidence ?confidence }
    FILTER NOT EXISTS { ?estimate prov:invalidatedAtTime ?end }
  }
  UNION
  {
    %(things)s GRAPH ?graph { ?thing rt:locatedOn ?place } BIND("on" AS ?relation)
    OPTIONAL {
      ?task rt:handles ?thing .
      { ?task rt:through ?attempt . ?attempt rt:activates ?place }
      UNION { ?task rt:targetSurface ?place ; rt:carriedOutBy ?attempt }
      ?attempt rt:hasOutcome/rt:success true ; prov:endedAtTime ?time
    }
  }
  UNION
  {
    %(things)s GRAPH ?graph { ?thing rt:currentPose ?pose } BIND("at" AS ?relation)
    ?pose rt:inFrame ?place ; rt:x ?x ; rt:y ?y ; rt:z ?z
    OPTIONAL { ?pose rt:atTime ?time } OPTIONAL { ?place rt:frameId ?frame }
    FILTER NOT EXISTS { ?estimate rt:poseOf ?thing ; rt:estimatedPose ?pose }
  }
  UNION { %(things)s GRAPH ?graph { ?thing sumo:located ?place } BIND("in" AS ?relation) }
}
ORDER BY DESC(?time) ?place ?thing DESC(?relation) ?graph ?x ?y ?z LIMIT %(most)d"""


@dataclass(frozen=True)
class Place:
    """One place of a thing.

    Parameters
    ----------
    thing
        What was asked for, or one of its things.
    relation
        ``at`` a pose in a frame, ``on`` a surface or in a hand, ``in`` a place at any depth.
    place
        The frame, surface or place.
    frame_id
        Name of the frame as a term; None without one.
    position
        x, y, z in the frame, m; None without a pose.
    time
        When it was there, ISO 8601; empty where nobody says.
    confidence
        Of the estimate, 0..1; None without one.
    graph
        Graph that states it.
    estimate
        What has the confidence; None without one.
    """

    thing: NamedNode
    relation: str
    place: Term
    frame_id: Term | None
    position: tuple[float, float, float] | None
    time: str
    confidence: float | None
    graph: NamedNode
    estimate: Term | None = None


def places_of(
    kb: GraphCore, subject: NamedNode, most: int = MAX_PLACES
) -> tuple[list[Place], bool]:
    """Return where a thing, or each thing of a product, is as far as the graph states it.

    The latest place comes first; there may be none.

    Returns
    -------
    At most so many places, and whether the graph states more.
    """
    names = {name: ontology.PREFIXES[name] for name in ("rt", "prov", "sumo")}
    things = " ".join(map(str, [subject, *_exemplars(kb, subject)]))
    query = _QUERY % {"things": f"VALUES ?thing {{ {things} }}", "most": most + 1}
    rows = list(kb.select(prologue(names) + query))
    places = {
        (row["thing"], row["relation"], row["place"], row["x"], row["time"], row["graph"]): _place(
            row
        )
        for row in rows[:most]
    }
    return list(places.values()), len(rows) > most


def _exemplars(kb: GraphCore, product: NamedNode) -> list[NamedNode]:
    things = (quad.subject for quad in kb.match(None, RT.exemplarOf, product))
    return [thing for thing in things if isinstance(thing, NamedNode)]


def _place(row: Row) -> Place:
    x, y, z = (_number(row, name) for name in "xyz")
    thing, place, graph = row["thing"], row["place"], row["graph"]
    assert place is not None
    assert isinstance(thing, NamedNode)
    assert isinstance(graph, NamedNode)
    return Place(
        thing=thing,
        relation=str(row.value("relation")),
        place=place,
        frame_id=row["frame"],
        position=None if x is None or y is None or z is None else (x, y, z),
        time=str(row.value("time") or ""),
        confidence=_number(row, "confidence"),
        graph=graph,
        estimate=row["estimate"],
    )


def _number(row: Row, name: str) -> float | None:
    value = row.value(name)
    return float(value) if isinstance(value, int | float) else None
