"""Patterns that the statements of the graph contradict."""

from __future__ import annotations

from collections.abc import Iterator

import ontology
from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import is_same_variable, reversed_edge
from rtask.asking.check.look import Look
from rtask.asking.check.naming.meanings import leads_as_named
from rtask.asking.check.naming.usual import kinds_by_name
from rtask.asking.check.syntax.outline import Edge, Node
from rtask.asking.check.types import TYPE, Context
from rtask.asking.check.vocabulary import local

__all__ = ["ByData", "is_chained"]


class ByData(Look):
    """Looks for patterns that never match as they stand, though the classes allow it."""

    def findings(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns that match by themselves, and never with one beside them."""
        for edge in self._patterns(context):
            step = edge.steps[0]
            if step.node.value == TYPE:
                continue
            turned = reversed_edge(edge)
            alone = any(node.kind == "iri" for node in edge.ends) and (
                not self._evidence.matches(edge) and self._evidence.matches(turned)
            )
            if self._fitting.has(turned):
                continue  # asked both ways
            if alone or self._is_turned(edge, context):
                self._blamed.add(id(edge))
                place = "" if alone else " together with those beside it"
                words = (
                    f"no statement matches this pattern with {local(step.node.value)}{place}, "
                    "but some match it the other way round"
                )
                repair = self._repairs.turned(edge)
                yield Finding(
                    "reversed", "likely", step.node.start, step.node.end, words, (repair,)
                )
                continue
            finding = self._unmet(edge, context)
            if finding is not None:
                self._blamed.add(id(edge))
                yield finding

    def _is_turned(self, edge: Edge, context: Context) -> bool:
        """Return whether a pattern matches with those beside it only the other way round."""
        return (
            not self._is_named_so(edge, context)
            and not leads_as_named(edge)
            and not is_chained(edge, context)
            and self._evidence.ends_differ(edge.steps[0].node.value, self._vocabulary)
            and self._fitting.is_contradicted(edge, context)
            and self._fitting.is_attested(reversed_edge(edge), context)
        )

    def _is_named_so(self, edge: Edge, context: Context) -> bool:
        """Return whether a variable of a pattern is called like what stands at its end."""
        by_name = kinds_by_name(self._vocabulary)
        most = len(self._vocabulary.bit) // 2  # what is called an entity may be anything
        return any(
            demand.node.kind == "variable"
            and demand.bits is not None
            and demand.bits & named
            and named.bit_count() <= most
            for demand in self._fitting.demands.of(edge, context) or ()
            for named in (by_name.get(demand.node.value.lower(), 0),)
        )

    def _unmet(self, edge: Edge, context: Context) -> Finding | None:
        """Return the finding of a pattern that the data contradict, though the classes allow it."""
        if not self._evidence.matches(edge):
            return None
        for other in context.touching(edge):
            if other is edge or len(other.steps) != 1:
                continue
            if not self._evidence.matches(other):
                continue
            for at, mine in enumerate(edge.ends):
                for other_at, node in enumerate(other.ends):
                    if not is_same_variable(mine, node):
                        continue
                    if self._evidence.meet(edge, at, other, other_at) is not False:
                        continue
                    if self._evidence.is_general(edge, at, self._vocabulary) or (
                        self._evidence.is_general(other, other_at, self._vocabulary)
                    ):
                        continue
                    if self._may_meet(edge, at, other, other_at, context):
                        continue
                    if not self._is_attested(edge, other, mine, context):
                        continue
                    return self._never_together(edge, other, context)
        return None

    def _is_attested(self, edge: Edge, other: Edge, node: Node, context: Context) -> bool:
        """Return whether there are data of what the query is about, which only one pattern misses.

        A graph without refusals does not say that refusals have no time.
        """
        for neighbour in context.edges:
            beside = neighbour.steps and any(is_same_variable(end, node) for end in neighbour.ends)
            if beside and not self._evidence.matches(neighbour):
                return False
        if any(self._is_of_anything(pattern) for pattern in (edge, other)):
            return False
        return self._evidence.is_common(edge) and self._evidence.is_common(other)

    def _is_of_anything(self, edge: Edge) -> bool:
        """Return whether a pattern has a common property that may be said of anything.

        That no product has a comment yet, or a time at which it was made, is no fault.
        """
        iri = edge.steps[0].node.value
        axioms = self._vocabulary.properties.get(iri)
        is_ours = iri == TYPE or iri.startswith(ontology.NS)
        return not is_ours and (axioms is None or axioms.domain is None)

    def _may_meet(self, edge: Edge, at: int, other: Edge, other_at: int, context: Context) -> bool:
        """Return whether the ontology says of both ends that one thing may be at them."""
        mine = self._fitting.demands.of(edge, context)
        given = self._fitting.demands.of(other, context)
        if mine is None or given is None:
            return False
        first, second = mine[at], given[other_at]
        if first.is_thing is False or second.is_thing is False:
            return True  # equal values of two properties are a matter of the data
        return first.bits is not None and second.bits is not None

    def _never_together(self, edge: Edge, other: Edge, context: Context) -> Finding:
        edge, other = max(
            ((edge, other), (other, edge)),
            key=lambda pair: -self._fitting.merit(pair[0], context),
        )
        node = edge.steps[0].node
        words = (
            f"statements with {local(node.value)} and with {local(other.steps[0].node.value)} "
            "never meet like this in the graph"
        )
        repairs = self._repairs.of(edge, context)
        return Finding("never-together", "likely", node.start, node.end, words, tuple(repairs))


def is_chained(edge: Edge, context: Context) -> bool:
    """Return whether the same property leads to a pattern's subject, or away from its value.

    Turned, the pattern would only repeat the one beside it, so that it always matches.
    """
    (step,) = edge.steps
    walked = [(step.node.value, step.is_inverse)]
    return any(
        [(it.node.value, it.is_inverse) for it in other.steps] == walked
        and (
            is_same_variable(other.object, edge.subject)
            or is_same_variable(other.subject, edge.object)
        )
        for other in context.touching(edge)
        if other is not edge
    )
