"""Patterns that make of a thing a term of the ontology, or the other way round.

``rt:unit`` is said of properties and ``rt:precondition`` of classes of tasks, so that nothing that
a robot did has either. No axiom says so of such annotations, but their statements do.
"""

from __future__ import annotations

from collections.abc import Iterator

import ontology
from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import is_same_variable
from rtask.asking.check.look import Look
from rtask.asking.check.metamodel import CLASS, PROPERTY
from rtask.asking.check.syntax.outline import Edge
from rtask.asking.check.types import TYPE, Context
from rtask.asking.check.vocabulary import local

__all__ = ["ByTerms"]

_RDFS = ontology.PREFIXES["rdfs"]
_OF_TERMS = {
    (_RDFS + "subClassOf", 0), (_RDFS + "subClassOf", 1), (_RDFS + "subPropertyOf", 0),
    (_RDFS + "subPropertyOf", 1), (_RDFS + "domain", 0), (_RDFS + "domain", 1),
    (_RDFS + "range", 0), (TYPE, 1),
}  # fmt: skip


class ByTerms(Look):
    """Looks for what is both a term and a thing."""

    def findings(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns of a context that demand a term where others demand a thing."""
        for edge in self._patterns(context):
            for at, node in enumerate(edge.ends):
                if not self._is_of_terms(edge, at) or edge.steps[0].node.value == TYPE:
                    continue
                if node.kind == "iri":
                    blamed = edge if self._is_individual(node.value) else None
                else:
                    blamed = self._individual_beside(edge, at, context)
                if blamed is not None and id(blamed) not in self._blamed:
                    self._blamed.add(id(blamed))
                    yield self._finding(blamed, edge, context)
                    break

    def _is_of_terms(self, edge: Edge, at: int) -> bool:
        """Return whether an end of a pattern is a class or property."""
        if len(edge.steps) != 1:
            return False
        (step,) = edge.steps
        place = 1 - at if step.is_inverse else at
        iri = step.node.value
        if (iri, place) in _OF_TERMS:
            return True
        return place == 0 and self._evidence.is_of_terms(iri, self._vocabulary)

    @property
    def _metamodel(self) -> int:
        return self._vocabulary.below[CLASS] | self._vocabulary.below[PROPERTY]

    def _is_individual(self, iri: str) -> bool:
        if iri in self._vocabulary.bit or iri in self._vocabulary.properties:
            return False
        return bool(self._evidence.kinds_of(iri, self._vocabulary))

    def _individual_beside(self, edge: Edge, at: int, context: Context) -> Edge | None:
        """Return the least likely of two patterns that never meet, the other about a thing."""
        for other in context.touching(edge):
            if other is edge or len(other.steps) != 1:
                continue
            for other_at, node in enumerate(other.ends):
                if not is_same_variable(node, edge.ends[at]) or self._is_of_terms(other, other_at):
                    continue
                given = self._fitting.demands.of(other, context)
                if given is None or given[other_at].bits is None:
                    continue
                if (given[other_at].bits or 0) & self._metamodel:
                    continue  # ?r a owl:Restriction
                if self._evidence.meet(edge, at, other, other_at) is True:
                    continue
                own = [pattern for pattern in (edge, other) if pattern in context.own]
                return min(own, key=lambda pattern: self._fitting.merit(pattern, context))
        return None

    def _finding(self, edge: Edge, of_terms: Edge, context: Context) -> Finding:
        node = edge.steps[0].node
        about = local(of_terms.steps[0].node.value)
        words = f"{about} is said of classes and properties, not of things such as these"
        repairs = self._repairs.of(edge, context)
        return Finding("wrong-type", "likely", node.start, node.end, words, tuple(repairs))
