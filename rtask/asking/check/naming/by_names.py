"""Patterns that make of a variable what its name does not say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import reversed_edge
from rtask.asking.check.look import Look
from rtask.asking.check.naming.meanings import head_of, is_process_named
from rtask.asking.check.naming.names import affinity, words_of
from rtask.asking.check.naming.usual import heads, kinds_by_name, nouns, usual_kinds, usual_literals
from rtask.asking.check.syntax.outline import Edge, Node
from rtask.asking.check.types import TYPE, Context, Demand, family
from rtask.asking.check.vocabulary import local
from rtask.asking.check.wording import demanded

__all__ = ["ByNames"]

_OF_ANY = {"label", "number", "text", "value", "title", "string", "count", "amount"}
"""Words for a literal of any property."""
_READ_AS_EITHER = ({"number", "dateTime"}, {"number", "boolean"})
"""Families of literals that one name is used for: ``?held`` says whether, and how often."""


class ByNames(Look):
    """Looks for variables named after something else than they stand for."""

    def turned(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns whose variables are named after what stands at the other end."""
        for edge in self._patterns(context):
            step = edge.steps[0]
            axioms = self._vocabulary.properties.get(step.node.value)
            if axioms is None or axioms.relates_things is None:
                continue
            about, value = edge.ends[:: -1 if step.is_inverse else 1]
            if about.kind != "variable" or value.kind != "variable":
                continue
            if axioms.relates_things is False:
                is_turned = self._is_called_like_the_value(about, value, step.node.value)
            elif _are_letters(about, value) and _counts_by_letters(context):
                is_turned = False
            else:
                is_turned = self._is_turned_by_name(about, value, axioms.classes)
            if is_turned:
                turned = reversed_edge(edge)
                if self._fitting.misfits(turned, context):
                    continue
                self._blamed.add(id(edge))
                words = (
                    f"?{about.value} and ?{value.value} are named after the value and the subject "
                    f"of {local(step.node.value)}, and stand the other way round"
                )
                yield Finding(
                    "reversed", "likely", step.node.start, step.node.end, words,
                    (self._repairs.turned(edge),),
                )  # fmt: skip

    def better(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns that match nothing here where a property named like its value does."""
        for edge in self._patterns(context):
            node = edge.steps[0].node
            value = edge.ends[0 if edge.steps[0].is_inverse else 1]
            if node.value == TYPE or value.kind != "variable":
                continue
            if node.value not in self._vocabulary.properties:
                continue  # an unknown term is reported as such
            word = head_of(value.name)
            if not word or word in _OF_ANY or value.name.lower() in nouns(self._vocabulary):
                continue
            if affinity(value.name, node.value, self._vocabulary) > 0:
                continue
            demands = self._fitting.demands.of(edge, context) or ()
            if any(
                demand.node is value and self._is_of_its_name(demand, edge, context)
                for demand in demands
            ):
                continue
            if self._evidence.matches(edge) and not self._fitting.is_contradicted(edge, context):
                continue
            repairs = self._repairs.better_named(edge, value, context)
            if repairs and not self._repairs.are_written(repairs):
                self._blamed.add(id(edge))
                words = (
                    f"nothing here has {local(node.value)}, and ?{value.value} "
                    "is named after another property that it has"
                )
                yield Finding("unusual-name", "likely", node.start, node.end, words, tuple(repairs))

    def unusual(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns that make of a variable what its name never stands for."""
        kinds, literals = usual_kinds(self._vocabulary), usual_literals(self._vocabulary)
        by_name = kinds_by_name(self._vocabulary)
        for edge in self._patterns(context):
            for demand in self._fitting.demands.of(edge, context) or ():
                if demand.node.kind != "variable" or demand.is_observed or demand.is_of_terms:
                    continue
                usual = kinds.get(demand.node.name, 0)
                is_odd = usual and demand.bits is not None and not demand.bits & usual
                if not usual and demand.bits is not None:
                    usual = by_name.get(demand.node.name.lower(), 0)
                    is_odd = usual and self._vocabulary.are_foreign(demand.bits, usual)
                if not is_odd and not self._is_odd_literal(demand, literals):
                    continue
                if self._fitting.is_attested(edge, context):
                    continue
                if self._is_of_its_name(demand, edge, context):
                    continue
                self._blamed.add(id(edge))
                node = edge.steps[0].node
                if node.value == TYPE and edge.object.kind == "iri":
                    node = edge.object
                words = (
                    f"{demanded(self._vocabulary, demand)}, "
                    f"which is hardly what ?{demand.node.value} stands for"
                )
                repairs = self._repairs.of_named(edge, demand, usual, context)
                yield Finding("unusual-name", "likely", node.start, node.end, words, tuple(repairs))
                break

    def _is_odd_literal(self, demand: Demand, literals: Mapping[str, frozenset[str]]) -> bool:
        """Return whether a name that stands for literals is that of a thing, or of other ones."""
        usual = literals.get(demand.node.name)
        if usual is None:
            return False
        if demand.is_thing:
            return True
        kinds = {family(kind) for kind in demand.datatypes}
        if not kinds or "" in kinds | usual or kinds & usual:
            return False
        return not any(kinds | usual <= both for both in _READ_AS_EITHER)

    def _is_of_its_name(self, demand: Demand, edge: Edge, context: Context) -> bool:
        """Return whether a variable is named after its property, or after its kind.

        What is called ``?plan`` may be a task plan, though the questions know other plans.
        """
        if self._is_of_kind_named(demand) or self._is_named_after_matches(demand):
            return True
        if is_process_named(demand.node.name, demand.bits, self._vocabulary):
            return True
        is_class = edge.steps[0].node.value == TYPE and edge.object.kind == "iri"
        if not is_class and self._is_named_after(demand, edge):
            return True
        return self._is_explained(demand, edge, context)

    def _kinds_of_head(self, variable: str) -> int:
        """Return the bits of the classes whose names end as a variable's does."""
        words = words_of(variable)
        return heads(self._vocabulary).get(words[-1], 0) if words else 0

    def _is_turned_by_name(
        self, about: Node, value: Node, classes: tuple[list[str], list[str]]
    ) -> bool:
        as_is = self._named(about, classes[0]) + self._named(value, classes[1])
        turned = self._named(about, classes[1]) + self._named(value, classes[0])
        if as_is:
            return False
        if all(classes):
            return turned == 2
        # Where nothing is known of one end, the other has to be called by its whole name.
        node, kinds = (value, classes[0]) if classes[0] else (about, classes[1])
        known = kinds_by_name(self._vocabulary).get(node.name.lower(), 0)
        return turned == 1 and any(
            known & self._vocabulary.below[iri] for iri in kinds if iri in self._vocabulary.below
        )

    def _is_called_like_the_value(self, about: Node, value: Node, iri: str) -> bool:
        """Return whether a pattern has for its subject what is called like the text or number."""
        word = head_of(local(iri))
        if not word or head_of(about.name) != word or head_of(value.name) == word:
            return False
        return not self._kinds_of_head(about.name)

    def _named(self, node: Node, classes: list[str]) -> bool:
        """Return whether a variable is named, or abbreviated, after one of some classes."""
        words = {word for iri in classes for word in words_of(local(iri))}
        if len(node.value) == 1:
            return any(word[0] == node.value for word in words)
        if set(words_of(node.name)) & words:
            return True
        by_name = kinds_by_name(self._vocabulary)
        own = by_name.get(node.name.lower(), 0) or by_name.get(head_of(node.name), 0)
        return any(
            self._vocabulary.below[iri] & own for iri in classes if iri in self._vocabulary.below
        )


def _are_letters(*nodes: Node) -> bool:
    return all(len(node.value) == 1 for node in nodes)


def _counts_by_letters(context: Context) -> bool:
    """Return whether the variables of a query are called ``?a``, ``?b`` and on, after nothing."""
    return bool(context.having("a")) and bool(context.having("b"))
