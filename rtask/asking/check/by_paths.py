"""Paths that lead nowhere: over a property that cannot repeat, or up where kinds are looked for."""

from __future__ import annotations

from collections.abc import Iterator

import ontology
from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import is_same_variable
from rtask.asking.check.look import Look
from rtask.asking.check.metamodel import PROPERTIES
from rtask.asking.check.syntax.outline import Edge
from rtask.asking.check.types import TYPE, Context
from rtask.asking.check.vocabulary import local

__all__ = ["ByPaths"]

_SUB_CLASS = ontology.PREFIXES["rdfs"] + "subClassOf"


class ByPaths(Look):
    """Looks at the paths of a group that may walk a property more than once."""

    def findings(self, context: Context) -> Iterator[Finding]:
        """Yield the paths of a context that cannot repeat, or lead up from a class."""
        for edge in context.own:
            if id(edge) in self._blamed or not edge.repeats or len(edge.steps) != 1:
                continue
            finding = self._once_only(edge, context) or self._upwards(edge, context)
            if finding is not None:
                self._blamed.add(id(edge))
                yield finding

    def _once_only(self, edge: Edge, context: Context) -> Finding | None:
        """Return the finding of a property whose values never have it themselves."""
        node = edge.steps[0].node
        axioms = self._vocabulary.properties.get(node.value)
        if axioms is None:
            return None
        if axioms.relates_things is not False and (
            axioms.domain is None or axioms.range is None or axioms.domain & axioms.range
        ):
            return None
        words = f"a value of {local(node.value)} has no {local(node.value)}, so it cannot repeat"
        repairs = self._repairs.repeating(edge, context)
        return Finding("wrong-type", "likely", node.start, node.end, words, tuple(repairs))

    def _upwards(self, edge: Edge, context: Context) -> Finding | None:
        """Return the finding of a path that leads from a class up to the kinds of things.

        Everything is of the most general kinds, so that nearly all things would match.
        """
        (step,) = edge.steps
        lower, upper = edge.ends[:: -1 if step.is_inverse else 1]
        if step.node.value != _SUB_CLASS or lower.kind != "iri" or upper.kind != "variable":
            return None
        if not any(
            other is not edge and is_same_variable(value, upper) and _is_of_individuals(other)
            for other in context.touching(edge)
            for value in other.ends[:: -1 if _is_inverse(other) else 1][1:]
        ):
            return None
        node = step.node
        words = f"this asks for the kinds above {local(lower.value)}, of which nearly everything is"
        return Finding(
            "reversed", "likely", node.start, node.end, words, (self._repairs.turned(edge),)
        )


def _is_inverse(edge: Edge) -> bool:
    return len(edge.steps) == 1 and edge.steps[0].is_inverse


def _is_of_individuals(edge: Edge) -> bool:
    """Return whether a pattern says of a thing, not of a class, which class it is of."""
    if len(edge.steps) != 1:
        return False
    iri = edge.steps[0].node.value
    return iri == TYPE or (iri.startswith(ontology.NS) and iri not in PROPERTIES)
