"""Constants of a query that are not what the patterns around them demand."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import is_same_variable
from rtask.asking.check.look import Look
from rtask.asking.check.syntax.outline import Edge, Node
from rtask.asking.check.types import TYPE, Context, Demand
from rtask.asking.check.vocabulary import local
from rtask.asking.check.wording import demanded, label_of

__all__ = ["ByConstants"]


class ByConstants(Look):
    """Looks for things that are of another kind, and for things compared with literals."""

    def findings(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns of a context that its constants contradict."""
        for edge in self._patterns(context):
            words = self._words(edge, context)
            if words:
                self._blamed.add(id(edge))
                node = edge.steps[0].node
                repairs = tuple(self._repairs.of(edge, context))
                yield Finding("wrong-type", "likely", node.start, node.end, words, repairs)

    def _words(self, edge: Edge, context: Context) -> str:
        """Return what is wrong with a pattern; empty if nothing is."""
        if edge.steps[0].node.value == TYPE:
            return ""
        for demand in self._fitting.demands.of(edge, context) or ():
            words = self._compared(demand, context) or self._kind(demand, context)
            if words:
                return words
        return ""

    def _compared(self, demand: Demand, context: Context) -> str:
        """Return the words for a thing that is compared with a literal."""
        if demand.is_thing is not True:
            return ""
        for variable, kind in context.compared:
            if is_same_variable(variable, demand.node):
                what = demanded(self._vocabulary, demand)
                return f"?{demand.node.value} is compared with a {kind}, but {what}"
        return ""

    def _kind(self, demand: Demand, context: Context) -> str:
        """Return the words for things none of which is in the classes demanded."""
        if demand.bits is None or demand.is_observed:
            return ""
        node = demand.node
        things = [node] if node.kind == "iri" else context.columns.get(node.value, [])
        things = [term for term in things if term.kind == "iri"]
        if not things or any(self._suits(term, demand.bits) for term in things):
            return ""
        if node.kind == "iri" and self._evidence.matches(demand.edge):
            return ""
        what = self._what_is(things[0])
        return f"{local(things[0].value)} is {what}, but {demanded(self._vocabulary, demand)}"

    def _suits(self, thing: Node, bits: int) -> bool:
        """Return whether a thing is, or could become, a member of one of some classes."""
        kinds = self._evidence.kinds_of(thing.value, self._vocabulary)
        if not kinds:
            return thing.value not in self._vocabulary.bit
        specific = self._vocabulary.most_specific(kinds)
        return all(self._vocabulary.below[kind] & bits for kind in specific)

    def _what_is(self, thing: Node) -> str:
        kinds = self._evidence.kinds_of(thing.value, self._vocabulary)
        if not kinds:
            return "a class"
        specific = sorted(self._vocabulary.most_specific(kinds))
        return f"a {label_of(self._vocabulary, specific[0])}"
