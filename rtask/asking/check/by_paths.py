"""Paths that lead nowhere, or the wrong way: up where kinds are looked for, back from a literal."""

from __future__ import annotations

from collections.abc import Iterator

import ontology
from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import is_same_variable, reversed_edge
from rtask.asking.check.look import Look
from rtask.asking.check.metamodel import MUTUAL, PROPERTIES
from rtask.asking.check.naming.names import affinity, words_of
from rtask.asking.check.syntax.outline import Edge, Node, Step
from rtask.asking.check.types import TYPE, Context
from rtask.asking.check.vocabulary import local

__all__ = ["ByPaths"]

_SUB_CLASS = ontology.PREFIXES["rdfs"] + "subClassOf"


class ByPaths(Look):
    """Looks at the paths of a group: where they repeat, where they end, and which way they go."""

    def findings(self, context: Context) -> Iterator[Finding]:
        """Yield the paths of a context that cannot repeat, or go the wrong way."""
        for edge in context.own:
            if id(edge) in self._blamed or len(edge.steps) != 1:
                continue
            finding = (
                (edge.repeats and (self._once_only(edge, context) or self._between(edge)))
                or self._upwards(edge, context)
                or self._mirrored(edge)
            )
            if finding:
                self._blamed.add(id(edge))
                yield finding

    def backwards(self, context: Context) -> Iterator[Finding]:
        """Yield the walks of a context back from what should be a literal, and is bound as none."""
        for edge in self._patterns(context):
            finding = self._from_literal(edge, context)
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

    def _between(self, edge: Edge) -> Finding | None:
        """Return the finding of a path that leads from one named thing to another only turned."""
        (step,) = edge.steps
        start, end = edge.ends
        if start.kind != "iri" or end.kind != "iri" or start.value == end.value:
            return None
        turned = Step(step.node, not step.is_inverse)
        reach = self._evidence.reaches
        if reach(start, step, end) is not False or not reach(start, turned, end):
            return None
        words = (
            f"{local(step.node.value)} does not lead from {local(start.value)} to "
            f"{local(end.value)} like this, but the other way round"
        )
        return self._reversed(edge, words)

    def _mirrored(self, edge: Edge) -> Finding | None:
        """Return the finding of a turned property that holds both ways, and is stated one way.

        ``?a ^owl:disjointWith ?b`` says the same of the classes as without ``^``, but misses what
        was stated of ``?a``.
        """
        (step,) = edge.steps
        if not step.is_inverse or step.node.value not in MUTUAL:
            return None
        if self._fitting.has(reversed_edge(edge)):
            return None  # asked both ways
        name = local(step.node.value)
        words = f"{name} holds both ways, and is stated one way; {name}|^{name} asks for both"
        return self._reversed(edge, words)

    def _from_literal(self, edge: Edge, context: Context) -> Finding | None:
        """Return the finding of a walk back from a literal that nothing else makes one."""
        (step,) = edge.steps
        node = edge.subject
        if not step.is_inverse or edge.is_path or node.kind != "variable":
            return None
        axioms = self._vocabulary.properties.get(step.node.value)
        if axioms is None or axioms.relates_things is not False or is_unnamed(node):
            return None
        if self._is_of_value(node.name, step.node.value):
            return None  # ?name ^rt:name ?object is an unusual way to say it, and no other thing
        if any(is_same_variable(node, read) for read, _ in context.compared):
            return None
        if node.value in context.columns or any(
            is_same_variable(node, demand.node) and demand.is_thing is False
            for other in context.having(node.value)
            if other is not edge
            for demand in self._fitting.demands.of(other, context) or ()
        ):
            return None
        if self._fitting.misfits(reversed_edge(edge), context):
            return None
        words = (
            f"?{node.name.partition(' ')[0]} is the value of {local(step.node.value)} here, of "
            "which nothing can be said"
        )
        return self._reversed(edge, words)

    def _is_of_value(self, name: str, iri: str) -> bool:
        """Return whether a variable is named, or abbreviated, after the values of a property."""
        short = name.lower().strip("0123456789_")
        words = words_of(local(iri))
        return (
            affinity(name, iri, self._vocabulary) > 0
            or short in ("v", "val", "value", "literal", "text", "number")
            or any(word.startswith(short) for word in words)
        )

    def _reversed(self, edge: Edge, words: str) -> Finding:
        node = edge.steps[0].node
        repair = self._repairs.turned(edge)
        return Finding("reversed", "likely", node.start, node.end, words, (repair,))

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
        words = f"this asks for the kinds above {local(lower.value)}, of which nearly everything is"
        return self._reversed(edge, words)


def is_unnamed(node: Node) -> bool:
    """Return whether the text gives a variable no name: a blank node, or the middle of a path."""
    return node.value.startswith((" ", "_:"))


def _is_inverse(edge: Edge) -> bool:
    return len(edge.steps) == 1 and edge.steps[0].is_inverse


def _is_of_individuals(edge: Edge) -> bool:
    """Return whether a pattern says of a thing, not of a class, which class it is of."""
    if len(edge.steps) != 1:
        return False
    iri = edge.steps[0].node.value
    return iri == TYPE or (iri.startswith(ontology.NS) and iri not in PROPERTIES)
