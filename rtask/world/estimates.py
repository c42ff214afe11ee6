"""Placements of products in graphs older than things: estimated poses and ``rt:locatedOn``.

Robots used to state where they saw a product, and in which hand or box they left it. Such a graph
answers as far as that goes, until a robot sees the product again and makes a thing of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from rtask.rdf.namespaces import PREFIXES, PROV, RT
from rtask.rdf.terms import NamedNode, iri, python_value
from rtask.world.placement import Placement, pose_of, seconds

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["estimated_placement", "estimated_placements", "estimates_of"]

_LEFT = """
SELECT ?place ?time ?agent ?attempt ?hand WHERE {
  $product rt:locatedOn ?place .
  ?task rt:handles $product .
  { ?task rt:through ?attempt . ?attempt rt:activates ?place BIND(true AS ?hand) }
  UNION
  { ?task rt:targetSurface ?place ; rt:carriedOutBy ?attempt BIND(false AS ?hand) }
  ?attempt rt:performedBy ?agent ; rt:hasOutcome/rt:success true ; prov:endedAtTime ?time
} ORDER BY ?time"""


def estimated_placement(kb: GraphCore, product: str, time_s: float) -> Placement | None:
    """Return where a product was last seen or left by a time, or None."""
    begun = [p for p in estimated_placements(kb, product) if p.begin <= time_s]
    return begun[-1] if begun else None


def estimated_placements(kb: GraphCore, product: str) -> list[Placement]:
    """Return where robots saw and left a product, oldest first.

    Each sighting lasts until the next one in the same frame, or until its estimate has ended.
    """
    placements = [*estimates_of(kb, product), *_left(kb, product)]
    return sorted(placements, key=lambda placement: (placement.begin, placement.iri))


def estimates_of(kb: GraphCore, product: str) -> list[Placement]:
    """Return where robots saw a product, oldest first."""
    located = []
    for link in kb.match(None, RT.poseOf, iri(product)):
        if isinstance(link.subject, NamedNode):
            placement = _estimate(kb, link.subject, product)
            if placement is not None:
                located.append(placement)
    located.sort(key=lambda placement: placement.begin)
    seen = []
    for k, placement in enumerate(located):
        # A product seen in another frame may be another one of its kind.
        later = [p.begin for p in located[k + 1 :] if p.frame == placement.frame]
        ends = [end for end in (placement.end, *later[:1]) if end is not None]
        seen.append(replace(placement, end=min(ends, default=None)))
    return seen


def _estimate(kb: GraphCore, node: NamedNode, product: str) -> Placement | None:
    stored = {quad.predicate: quad.object for quad in kb.match(node)}
    pose = stored.get(RT.estimatedPose)
    if not isinstance(pose, NamedNode):
        return None
    frame, matrix = pose_of(kb, pose)
    times = [seconds(python_value(quad.object)) for quad in kb.match(pose, RT.atTime)]
    if matrix is None or not times:
        return None
    over = [seconds(python_value(q.object)) for q in kb.match(node, PROV.invalidatedAtTime)]
    # An end before the first sight is a clock's mistake.
    end = max(min(over), times[0]) if over else None
    confidence = python_value(stored.get(RT.poseConfidence))
    agent = stored.get(PROV.wasAttributedTo)
    return Placement(
        node.value, product, times[0], end, times[0], "at", "", frame, matrix,
        confidence=1.0 if confidence is None else float(str(confidence)),
        agent=agent.value if isinstance(agent, NamedNode) else "", source=node.value,
    )  # fmt: skip


def _left(kb: GraphCore, product: str) -> list[Placement]:
    rows = kb.select(PREFIXES + _LEFT.replace("$product", str(iri(product))))
    last: dict[str, Placement] = {}
    for row in rows:
        begin, place = seconds(row.value("time")), str(row.value("place"))
        last[place] = Placement(
            str(row.value("attempt")), product, begin, None, begin,
            "held_by" if row.value("hand") else "in", place, agent=str(row.value("agent")),
            source=str(row.value("attempt")),
        )  # fmt: skip
    return list(last.values())
