"""Constants of a query that are not what the patterns around them demand."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import is_same_variable
from rtask.asking.check.look import Look
from rtask.asking.check.syntax.outline import Edge, Node
from rtask.asking.check.types import TYPE, Context, Demand, family
from rtask.asking.check.vocabulary import local
from rtask.asking.check.wording import articled, demanded, label_of

__all__ = ["ByConstants"]

_READ_AS = {
    "number": {"number"}, "text": {"text"}, "moment": {"moment"},
    "quantity": {"number", "moment", "duration"},
    "ordered": {"number", "moment", "duration", "text"},
}  # fmt: skip


class ByConstants(Look):
    """Looks for things that are of another kind, and for things compared with literals."""

    def findings(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns of a context that its constants contradict."""
        own = {id(edge) for edge in context.own}
        for edge in context.edges:
            # By identity: the same pattern twice in one query is two places to point at; each is
            # blamed once.
            if id(edge) in self._blamed or len(edge.steps) != 1 or edge.is_loose:
                continue
            words = self._words(edge, context, is_own=id(edge) in own)
            if words:
                self._blamed.add(id(edge))
                node = edge.steps[0].node
                repairs = tuple(self._repairs.of(edge, context))
                yield Finding("wrong-type", "likely", node.start, node.end, words, repairs)

    def _words(self, edge: Edge, context: Context, *, is_own: bool) -> str:
        """Return what is wrong with a pattern; empty if nothing is.

        What a filter of an OPTIONAL reads may stem from a pattern around it.
        """
        if edge.steps[0].node.value == TYPE:
            return ""
        for demand in self._fitting.demands.of(edge, context) or ():
            words = self._compared(demand, context) or (is_own and self._kind(demand, context))
            if words:
                return words
        return ""

    def _compared(self, demand: Demand, context: Context) -> str:
        """Return the words for what an expression reads as another kind of value."""
        if demand.is_thing is None:
            return ""
        for variable, kind in context.compared:
            if is_same_variable(variable, demand.node) and not _may_be(demand, kind):
                what = demanded(self._vocabulary, demand)
                if demand.datatypes:
                    kinds = " or ".join(sorted(f"xsd:{local(one)}" for one in demand.datatypes))
                    what += f" of type {kinds}"
                read = "value with an order" if kind == "ordered" else kind
                return f"?{demand.node.value} is read as a {read}, but {what}"
        return ""

    def _kind(self, demand: Demand, context: Context) -> str:
        """Return the words for things none of which is in the classes demanded."""
        node = demand.node
        given = context.columns.get(node.value, ()) if node.kind == "variable" else ()
        if given and demand.is_thing is False and all(term.kind == "iri" for term in given):
            what = demanded(self._vocabulary, demand)
            return f"?{node.value} is {local(given[0].value)}, but {what}"
        # What was only observed of the data is no demand: a new kind of thing may come any time.
        if demand.bits is None or demand.is_observed:
            return ""
        things = [node] if node.kind == "iri" else [term for term in given if term.kind == "iri"]
        if not things or any(self._suits(term, demand.bits) for term in things):
            return ""
        # What the graph holds cannot be wrong in a query, whatever the ontology says.
        if any(self._evidence.matches(_with(demand, thing)) for thing in things):
            return ""
        what = self._what_is(things[0])
        return f"{local(things[0].value)} is {what}, but {demanded(self._vocabulary, demand)}"

    def _suits(self, thing: Node, bits: int) -> bool:
        """Return whether a thing is, or could become, a member of one of some classes."""
        kinds = self._evidence.kinds_of(thing.value, self._vocabulary)
        if not kinds:
            # Of an unknown thing nothing can be said; a class where a member is due is wrong.
            return thing.value not in self._vocabulary.bit
        specific = self._vocabulary.most_specific(kinds)
        return all(self._vocabulary.below[kind] & bits for kind in specific)

    def _what_is(self, thing: Node) -> str:
        kinds = self._evidence.kinds_of(thing.value, self._vocabulary)
        if not kinds:
            return "a class"
        specific = sorted(self._vocabulary.most_specific(kinds))
        return articled(label_of(self._vocabulary, specific[0]))


def _with(demand: Demand, thing: Node) -> Edge:
    """Return the pattern of a demand with a thing at its end."""
    edge = demand.edge
    subject, value = (edge.subject, thing) if demand.at else (thing, edge.object)
    return Edge(subject, edge.steps, value, edge.start, edge.end)


def _may_be(demand: Demand, kind: str) -> bool:
    """Return whether what stands at an end may be what an expression reads it as."""
    if demand.is_thing:
        return False
    needed = _READ_AS.get(kind)
    families = {family(datatype) for datatype in demand.datatypes}
    # A datatype that is not known may be anything: no blame without knowledge.
    if needed is None or not families or "" in families:
        return True
    named = {"moment" if name.startswith(("date", "time")) else name for name in families}
    named = {"duration" if name.endswith("Duration") else name for name in named}
    return bool(named & needed)
