"""Repairs of a pattern: its direction turned, another property, or another class."""

from __future__ import annotations

from collections.abc import Iterable

import ontology
from rtask.asking.check.evidence import Evidence
from rtask.asking.check.findings import Edit, Repair
from rtask.asking.check.fitting import Fitting, is_same_variable, replaced, reversed_edge
from rtask.asking.check.naming.meanings import head_of, kinds_of_word
from rtask.asking.check.naming.names import affinities, affinity, likeness, properties_named
from rtask.asking.check.syntax.outline import Edge, Node, Outline, Step
from rtask.asking.check.syntax.writing import written
from rtask.asking.check.types import TYPE, Context, Demand
from rtask.asking.check.vocabulary import Vocabulary, local

__all__ = ["Repairs", "turned_edits"]

_NS = ontology.NS
_OFFERED = 3
_TRIED = 12
_NAMED, _NAMED_SO = 0.6, 0.8
_APT = 0.7


def turned_edits(step: Step) -> tuple[Edit, ...]:
    """Return the edit that walks a predicate the other way."""
    start = step.node.start
    return (Edit(start - 1, start, "") if step.is_inverse else Edit(start, start, "^"),)


class Repairs:
    """Offers what would fit in the place of a pattern's term, the most plausible first."""

    def __init__(self, fitting: Fitting, outline: Outline) -> None:
        self._fitting = fitting
        self._vocabulary: Vocabulary = fitting.vocabulary
        self._evidence: Evidence = fitting.evidence
        self._outline = outline

    def of(self, edge: Edge, context: Context) -> list[Repair]:
        if len(edge.steps) != 1:
            return []
        step = edge.steps[0]
        repairs: list[Repair] = []
        if step.node.value == TYPE:
            return self._other_classes(edge, context)
        repairs += self.other_properties(edge, context)
        if not self._fitting.misfits(reversed_edge(edge), context):
            axioms = self._vocabulary.properties.get(step.node.value)
            is_first = step.is_inverse or axioms is None or axioms.relates_things is not False
            repairs.insert(0 if is_first else 1, self.turned(edge))  # few start from a literal
        return repairs[:_OFFERED]

    def turned(self, edge: Edge) -> Repair:
        return Repair("turn the direction of the pattern", turned_edits(edge.steps[0]))

    def other_properties(
        self, edge: Edge, context: Context, wishes: Iterable[Demand] = ()
    ) -> list[Repair]:
        """Return the properties that fit in a pattern, the most plausible first."""
        (step,) = edge.steps
        node, name = step.node, local(step.node.value).lower()
        beside = self._fitting.beside(edge, context)
        for wish in wishes:
            beside[wish.node.value].append(wish)
        about, value = edge.ends[:: -1 if step.is_inverse else 1]
        fitting: list[tuple[float, str]] = []
        usual = self._fitting.usual
        named = [
            (weight, affinities(end.name, self._vocabulary))
            for weight, end in ((0.4, about), (2.0, value))
            if end.kind == "variable"
        ]
        kinds = self._kinds_named(value)
        for iri in self._fitting.fitting_properties(about, value, beside):
            if iri == node.value:
                continue
            rating = 0.3 * likeness(self._vocabulary.lowered[iri], name) + 0.2 * iri.startswith(_NS)
            rating += 0.9 * usual.get(iri, 0.0)
            rating += _APT * self._fitting.aptness(iri, about, value, beside)
            for weight, fit in named:
                rating += weight * fit.get(iri, 0.0)
            if kinds and kinds & (self._vocabulary.properties[iri].range or 0):
                rating += _NAMED_SO
            fitting.append((-rating, iri))
        fitting.sort()
        rated = []
        for names, iri in fitting[:_TRIED]:
            changed = replaced(edge, node, iri)
            rated.append((names - self._fitting.merit(changed, context), iri))
        return [self.written_as(node, iri) for _, iri in sorted(rated)[:_OFFERED]]

    def repeating(self, edge: Edge, context: Context) -> list[Repair]:
        """Return the properties of a path that fit there and whose values may have them, too."""
        (step,) = edge.steps
        about, value = edge.ends[:: -1 if step.is_inverse else 1]
        beside = self._fitting.beside(edge, context)
        rated = []
        for iri in self._fitting.fitting_properties(about, value, beside):
            axioms = self._vocabulary.properties[iri]
            if iri == step.node.value or axioms.relates_things is not True:
                continue
            if axioms.domain and axioms.range and axioms.domain & axioms.range:
                changed = replaced(edge, step.node, iri)
                rated.append((-self._fitting.merit(changed, context), iri))
        return [self.written_as(step.node, iri) for _, iri in sorted(rated)[:_OFFERED]]

    def _kinds_named(self, node: Node) -> int:
        """Return the bits of the classes that a variable is called like."""
        if node.kind != "variable":
            return 0
        return kinds_of_word(head_of(node.name), self._vocabulary)

    def has_attested(self, edge: Edge, context: Context, wish: Demand) -> bool:
        """Return whether the graph has, with another property, what a pattern is wished to be."""
        (step,) = edge.steps
        beside = self._fitting.beside(edge, context)
        beside[wish.node.value].append(wish)
        about, value = edge.ends[:: -1 if step.is_inverse else 1]
        return any(
            iri != step.node.value
            and self._fitting.is_attested(replaced(edge, step.node, iri), context)
            for iri in self._fitting.fitting_properties(about, value, beside)
        )

    def _other_classes(self, edge: Edge, context: Context) -> list[Repair]:
        bits: int | None = None
        for other in context.edges:
            if other is edge:
                continue
            for demand in self._fitting.demands.of(other, context) or ():
                if is_same_variable(demand.node, edge.subject) and demand.bits is not None:
                    bits = demand.bits if bits is None else bits & demand.bits
        return self.classes_of(edge, bits) if bits else []

    def classes_of(self, edge: Edge, bits: int) -> list[Repair]:
        """Return the classes among some that a variable may be said to be of."""
        node = edge.object
        kinds = self._vocabulary.most_general(bits)
        variable = edge.subject.name
        rated = []
        for iri in {*kinds, *(name for name in self._vocabulary.names(bits))}:
            rating = affinity(variable, iri, self._vocabulary)
            rating += 0.7 * (iri in kinds) + 0.2 * iri.startswith(_NS)
            rating += 0.2 * self._evidence.matches(replaced(edge, node, iri))
            rated.append((-rating, iri))
        return [self.written_as(node, iri) for _, iri in sorted(rated)[:_OFFERED]]

    def are_written(self, repairs: Iterable[Repair]) -> bool:
        """Return whether the query has a proposed property already: its author knows them apart."""
        nodes = (step.node for group in self._outline.body.walk() for edge in group.edges
                 for step in edge.steps)  # fmt: skip
        used = {written(node.value, self._outline.prefixes) for node in nodes if node.kind == "iri"}
        return any(edit.text in used for repair in repairs for edit in repair.edits)

    def written_as(self, node: Node, iri: str) -> Repair:
        text = written(iri, self._outline.prefixes)
        return Repair(f"write {text}", (Edit(node.start, node.end, text),))

    def of_named(self, edge: Edge, demand: Demand, usual: int, context: Context) -> list[Repair]:
        """Return repairs after which a variable can be what its name stands for."""
        named = Edge(demand.node, [], demand.node, -1, -1)
        wish = Demand(named, 0, usual or None, bool(usual))
        if edge.steps[0].node.value == TYPE:
            return self.classes_of(edge, usual)
        turned = reversed_edge(edge)
        repairs: list[Repair] = []
        if not self._fitting.misfits(turned, context):
            changed = self._fitting.demands.of(turned, context) or ()
            if usual and all(
                change.bits is None or change.bits & usual
                for change in changed
                if is_same_variable(change.node, demand.node)
            ):
                repairs.append(self.turned(edge))
        return [*repairs, *self.other_properties(edge, context, [wish])][:_OFFERED]

    def better_named(self, edge: Edge, value: Node, context: Context) -> list[Repair]:
        """Return the properties named like a variable that the graph has where a pattern stands."""
        (step,) = edge.steps
        beside = self._fitting.beside(edge, context)
        about = edge.ends[1 if step.is_inverse else 0]
        rated = []
        named = self._kinds_named(about)
        for iri in properties_named(value.name, self._vocabulary):
            rating = affinity(value.name, iri, self._vocabulary)
            if rating < _NAMED or iri == step.node.value:
                continue
            known = self._vocabulary.properties[iri]
            if named and known.domain and not named & known.domain:
                continue  # ?outcome has no verdict; what people say of it has
            changed = replaced(edge, step.node, iri)
            if self._fitting.fits(known, about, value, beside) and (
                self._fitting.is_attested(changed, context)
            ):
                rated.append((-rating, iri))
        return [self.written_as(step.node, iri) for _, iri in sorted(rated)[:_OFFERED]]
