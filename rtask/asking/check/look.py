"""What all looks for faults in the patterns of a query share."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.asking.check.fitting import Fitting, is_same_variable, is_written_once
from rtask.asking.check.naming.names import affinity, words_of
from rtask.asking.check.naming.usual import heads
from rtask.asking.check.repairs import Repairs
from rtask.asking.check.syntax.outline import Edge
from rtask.asking.check.types import TYPE, Context, Demand
from rtask.asking.check.vocabulary import local

__all__ = ["Look"]


class Look:
    """A look for faults of one sort.

    Parameters
    ----------
    fitting
        Of the query.
    repairs
        Of the query.
    blamed
        Numbers (``id``) of the patterns that have a fault; all looks at one query share them.
    """

    def __init__(self, fitting: Fitting, repairs: Repairs, blamed: set[int]) -> None:
        self._fitting = fitting
        self._vocabulary = fitting.vocabulary
        self._evidence = fitting.evidence
        self._repairs = repairs
        self._blamed = blamed

    def _is_named_after_matches(self, demand: Demand) -> bool:
        """Return whether a variable has a word of the class of something that it stands for here.

        ``?ontology`` is fine for a named graph where the graph has that of ontologies.
        """
        words = words_of(demand.node.name)
        kinds = self._evidence.kinds_at(demand.edge, demand.at, self._vocabulary)
        return any(word in words for kind in kinds for word in words_of(local(kind)))

    def _is_named_after(self, demand: Demand, edge: Edge) -> bool:
        """Return whether a variable has a word of its property, or of what stands there."""
        (step,) = edge.steps
        name = demand.node.name
        if step.node.value == TYPE:
            return any(affinity(name, iri, self._vocabulary) > 0 for iri in self._kinds(demand))
        if affinity(name, step.node.value, self._vocabulary) > 0:
            return True
        axioms = self._vocabulary.properties.get(step.node.value)
        kinds = axioms.classes[1 - demand.at if step.is_inverse else demand.at] if axioms else ()
        named = {word for iri in kinds for word in words_of(local(iri))}
        return bool(named.intersection(words_of(name)))

    def _kinds(self, demand: Demand) -> list[str]:
        """Return the classes that a pattern with rdf:type names, perhaps through a path."""
        (step,) = demand.edge.steps
        value = demand.edge.ends[0 if step.is_inverse else 1]
        if value.kind == "iri":
            return [value.value]
        # Of a term itself, and not of a thing of that class.
        bits = None if demand.is_of_terms else demand.bits
        return self._vocabulary.most_general(bits) if bits is not None else []

    def _is_explained(self, demand: Demand, edge: Edge, context: Context) -> bool:
        """Return whether another pattern says why a variable is called as it is.

        ``?heldBy`` of ``rt:heldBy`` may be anything that may hold, in the other patterns too.
        """
        for other in context.touching(edge):
            if other is edge or len(other.steps) != 1 or is_written_once(other, edge):
                continue
            for given in self._fitting.demands.of(other, context) or ():
                if not is_same_variable(given.node, demand.node) or given.is_of_terms:
                    continue
                is_apart = None not in (demand.bits, given.bits) and not (
                    (demand.bits or 0) & (given.bits or 0)
                )
                # A pattern that contradicts the one that is suspected explains nothing.
                if is_apart or {given.is_thing, demand.is_thing} == {True, False}:
                    continue
                if self._is_named_after(given, other) and (
                    # A type alone explains a name only by its main word: a task plan is a plan.
                    other.steps[0].node.value != TYPE or self._is_of_kind_named(given)
                ):
                    return True
        return False

    def _is_of_kind_named(self, demand: Demand) -> bool:
        """Return whether a variable's last word is that of its classes: a plan of a task plan."""
        words = words_of(demand.node.name)
        named = heads(self._vocabulary).get(words[-1], 0) if words else 0
        return bool(named & (demand.bits or 0))

    def _patterns(self, context: Context) -> Iterator[Edge]:
        """Yield the patterns with one property and no fault so far."""
        for edge in context.own:
            if id(edge) not in self._blamed and len(edge.steps) == 1 and not edge.is_loose:
                yield edge
