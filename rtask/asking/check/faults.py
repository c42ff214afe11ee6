"""Patterns that cannot match together: which one is at fault, and what would fit in its place."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping

import ontology
from rtask.asking.check.evidence import Evidence
from rtask.asking.check.findings import Edit, Finding, Repair, Severity
from rtask.asking.check.fitting import Fitting, is_same_variable, replaced, reversed_edge
from rtask.asking.check.names import affinity, likeness, words_of
from rtask.asking.check.outline import Edge, Node, Outline
from rtask.asking.check.types import (
    TYPE,
    Conflict,
    Context,
    Demand,
    family,
)
from rtask.asking.check.usual import usual_kinds, usual_literals
from rtask.asking.check.vocabulary import Vocabulary, local
from rtask.asking.check.writing import written

__all__ = ["Faults"]

_NS = ontology.NS
_OFFERED = 3
_TRIED = 16


class Faults:
    """Looks for patterns of one query that conflict with others, or that the data contradict."""

    def __init__(self, vocabulary: Vocabulary, evidence: Evidence, outline: Outline) -> None:
        self._vocabulary = vocabulary
        self._evidence = evidence
        self._outline = outline
        self._fitting = Fitting(vocabulary, evidence, outline)
        self._blamed: set[int] = set()

    def replacements(self, edge: Edge) -> list[Repair]:
        """Return the properties that would fit in a pattern instead of its own."""
        context = self._fitting.context(edge)
        return [] if context is None else self.other_properties(edge, context)

    def findings(self) -> Iterator[Finding]:
        """Yield the faults, one for each pattern."""
        for context in self._fitting.contexts:
            yield from self._conflicts(context)
        for context in self._fitting.contexts:
            yield from self._against_data(context)
        for context in self._fitting.contexts:
            yield from self._against_names(context)
        for context in self._fitting.contexts:
            yield from self._against_usage(context)

    # By classes.

    def _conflicts(self, context: Context) -> Iterator[Finding]:
        left = [
            one
            for one in self._fitting.demands.conflicts(context)
            if not self._has_member(one, context)
        ]
        while left:
            edge = self._culprit(left, context)
            mine = [one for one in left if edge in (one.one.edge, one.other.edge)]
            left = [one for one in left if one not in mine]
            if id(edge) not in self._blamed:
                self._blamed.add(id(edge))
                yield self._conflict(edge, mine, context)

    def _has_member(self, conflict: Conflict, context: Context) -> bool:
        """Return whether something in the graph is of both kinds all the same."""
        if conflict.is_certain and conflict.one.is_thing != conflict.other.is_thing:
            return False
        one, other = conflict.one, conflict.other
        return self._evidence.meet(one.edge, one.at, other.edge, other.at) is True

    def _culprit(self, conflicts: list[Conflict], context: Context) -> Edge:
        """Return the pattern that most conflicts have in common, or that fits its names least."""
        count: dict[int, int] = defaultdict(int)
        edges: dict[int, Edge] = {}
        for one in conflicts:
            for demand in (one.one, one.other):
                count[id(demand.edge)] += 1
                edges[id(demand.edge)] = demand.edge
        return max(edges.values(), key=lambda edge: self._suspicion(edge, count, context))

    def _suspicion(
        self, edge: Edge, count: dict[int, int], context: Context
    ) -> tuple[float, float]:
        changed = reversed_edge(edge) if len(edge.steps) == 1 else None
        mends = (
            changed is not None
            and edge.steps[0].node.value != TYPE
            and not self._fitting.misfits(changed, context)
        )
        doubt = count[id(edge)] + (1.5 if mends else 0.0)
        if len(edge.steps) == 1:
            doubt -= 0.8 * min(self._fitting.merit(edge, context), 2.0)
        return doubt, float(edge.start)

    def _conflict(self, edge: Edge, mine: list[Conflict], context: Context) -> Finding:
        first = mine[0]
        demand, other = (
            (first.one, first.other) if first.one.edge is edge else (first.other, first.one)
        )
        certain = any(one.is_certain for one in mine)
        words = self._words(demand, other)
        repairs = self._repairs(edge, context)
        rule = "wrong-type"
        if repairs and "direction" in repairs[0].words:
            rule = "reversed"
        node = edge.steps[0].node
        if node.value == TYPE and edge.object.kind == "iri":
            node = edge.object
        severity: Severity = "certain" if certain else "likely"
        return Finding(rule, severity, node.start, node.end, words, tuple(repairs))

    def _words(self, demand: Demand, other: Demand) -> str:
        name = demand.node.value
        who = "what the path reaches" if name.startswith(" ") else f"?{name.partition(' ')[0]}"
        return f"nothing can be {who}: {self._demanded(demand)}, but {self._demanded(other)}"

    def _demanded(self, demand: Demand) -> str:
        """Return in words what an end must be, and why."""
        step = demand.edge.steps[0]
        if step.node.value == TYPE and demand.edge.object.kind == "iri":
            return f"it is said to be a {self._label(demand.edge.object.value)}"
        place = "subject" if (demand.at == 0) != step.is_inverse else "value"
        known = self._vocabulary.properties.get(step.node.value)
        kinds: list[str] = []
        if known is not None:
            kinds = known.classes[0 if place == "subject" else 1]
        if kinds:
            what = " or ".join(self._label(kind) for kind in kinds[:3])
        elif demand.is_thing is False:
            what = "literal"
        else:
            what = "thing"
        return f"a {place} of {local(step.node.value)} is a {what}"

    def _label(self, iri: str) -> str:
        labels = sorted(self._vocabulary.labels.get(iri, ()), key=lambda one: (len(one), one))
        return labels[0] if labels else local(iri)

    # Repairs.

    def _repairs(self, edge: Edge, context: Context) -> list[Repair]:
        if len(edge.steps) != 1:
            return []
        step = edge.steps[0]
        found: list[Repair] = []
        if step.node.value == TYPE:
            return self._other_classes(edge, context)
        turned = reversed_edge(edge)
        if not self._fitting.misfits(turned, context):
            found.append(self._turned(edge))
        found += self.other_properties(edge, context)
        return found[:_OFFERED]

    def _turned(self, edge: Edge) -> Repair:
        (step,) = edge.steps
        start = step.node.start
        words = "turn the direction of the pattern"
        if step.is_inverse:
            return Repair(words, (Edit(start - 1, start, ""),))
        return Repair(words, (Edit(start, start, "^"),))

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
        for iri, known in self._vocabulary.properties.items():
            if iri == node.value or not self._fitting.fits(known, about, value, beside):
                continue
            rating = 0.3 * likeness(local(iri).lower(), name) + 0.2 * iri.startswith(_NS)
            rating += 0.9 * self._fitting.usual.get(iri, 0.0)
            for weight, end in ((0.4, about), (2.0, value)):
                if end.kind == "variable":
                    rating += weight * affinity(end.value, iri, self._vocabulary)
            fitting.append((-rating, iri))
        fitting.sort()
        rated = []
        for names, iri in fitting[:_TRIED]:
            changed = replaced(edge, node, iri)
            rated.append((names - self._fitting.merit(changed, context), iri))
        return [self._written(node, iri) for _, iri in sorted(rated)[:_OFFERED]]

    def _other_classes(self, edge: Edge, context: Context) -> list[Repair]:
        bits: int | None = None
        for other in context.edges:
            if other is edge:
                continue
            for demand in self._fitting.demands.of(other, context) or ():
                if is_same_variable(demand.node, edge.subject) and demand.bits is not None:
                    bits = demand.bits if bits is None else bits & demand.bits
        return self._classes_of(edge, bits) if bits else []

    def _classes_of(self, edge: Edge, bits: int) -> list[Repair]:
        """Return the classes among some that a variable may be said to be of."""
        node = edge.object
        kinds = self._vocabulary.most_general(bits)
        variable = edge.subject.value
        rated = []
        for iri in {*kinds, *(one for one in self._vocabulary.names(bits))}:
            rating = affinity(variable, iri, self._vocabulary)
            rating += 0.7 * (iri in kinds) + 0.2 * iri.startswith(_NS)
            rating += 0.2 * self._evidence.matches(replaced(edge, node, iri))
            rated.append((-rating, iri))
        return [self._written(node, iri) for _, iri in sorted(rated)[:_OFFERED]]

    def _written(self, node: Node, iri: str) -> Repair:
        text = written(iri, self._outline.prefixes)
        return Repair(f"write {text}", (Edit(node.start, node.end, text),))

    # By data.

    def _against_data(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns that match by themselves, and never with one beside them."""
        for edge in context.own:
            if id(edge) in self._blamed or len(edge.steps) != 1 or edge.is_loose:
                continue
            step = edge.steps[0]
            if step.node.value == TYPE:
                continue
            turned = reversed_edge(edge)
            constants = any(node.kind == "iri" for node in edge.ends)
            if constants and not self._evidence.matches(edge) and self._evidence.matches(turned):
                self._blamed.add(id(edge))
                words = (
                    f"no statement matches this pattern with {local(step.node.value)}, "
                    "but some match it the other way round"
                )
                repair = self._turned(edge)
                yield Finding(
                    "reversed", "likely", step.node.start, step.node.end, words, (repair,)
                )
                continue
            found = self._unmet(edge, context)
            if found is not None:
                self._blamed.add(id(edge))
                yield found

    def _unmet(self, edge: Edge, context: Context) -> Finding | None:
        """Return the finding of a pattern that the data contradict, though the classes allow it."""
        if not self._evidence.matches(edge):
            return None
        for other in context.edges:
            if other is edge or len(other.steps) != 1 or not self._evidence.matches(other):
                continue
            for at, mine in enumerate(edge.ends):
                for other_at, node in enumerate(other.ends):
                    if not is_same_variable(mine, node):
                        continue
                    if self._evidence.meet(edge, at, other, other_at) is not False:
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
        for one in context.edges:
            beside = one.steps and any(is_same_variable(end, node) for end in one.ends)
            if beside and not self._evidence.matches(one):
                return False
        return self._evidence.is_common(edge) and self._evidence.is_common(other)

    def _may_meet(self, edge: Edge, at: int, other: Edge, other_at: int, context: Context) -> bool:
        """Return whether the ontology says of both ends that one thing may be at them."""
        mine = self._fitting.demands.of(edge, context)
        given = self._fitting.demands.of(other, context)
        if mine is None or given is None:
            return False
        one, two = mine[at], given[other_at]
        if one.is_thing is False or two.is_thing is False:
            return True  # equal values of two properties are a matter of the data
        return one.bits is not None and two.bits is not None

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
        repairs = self._repairs(edge, context)
        return Finding("never-together", "likely", node.start, node.end, words, tuple(repairs))

    # By names.

    def _against_names(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns whose variables are named after what stands at the other end."""
        for edge in context.own:
            if id(edge) in self._blamed or len(edge.steps) != 1 or edge.is_loose:
                continue
            step = edge.steps[0]
            known = self._vocabulary.properties.get(step.node.value)
            if known is None or known.relates_things is not True:
                continue
            about, value = edge.ends[:: -1 if step.is_inverse else 1]
            if about.kind != "variable" or value.kind != "variable":
                continue
            if self._is_turned_by_name(about, value, known.classes):
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
                    (self._turned(edge),),
                )  # fmt: skip

    def _against_usage(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns that make of a variable what its name never stands for."""
        kinds, literals = usual_kinds(self._vocabulary), usual_literals(self._vocabulary)
        for edge in context.own:
            if id(edge) in self._blamed or len(edge.steps) != 1 or edge.is_loose:
                continue
            for demand in self._fitting.demands.of(edge, context) or ():
                if demand.node.kind != "variable":
                    continue
                usual = kinds.get(demand.node.value, 0)
                is_odd = usual and demand.bits is not None and not demand.bits & usual
                if not is_odd and not self._is_odd_literal(demand, literals):
                    continue
                self._blamed.add(id(edge))
                node = edge.steps[0].node
                if node.value == TYPE and edge.object.kind == "iri":
                    node = edge.object
                words = (
                    f"{self._demanded(demand)}, "
                    f"which is hardly what ?{demand.node.value} stands for"
                )
                repairs = self._named_repairs(edge, demand, usual, context)
                yield Finding("unusual-name", "likely", node.start, node.end, words, tuple(repairs))
                break

    def _is_odd_literal(self, demand: Demand, literals: Mapping[str, frozenset[str]]) -> bool:
        """Return whether a name that stands for literals is that of a thing, or of other ones."""
        usual = literals.get(demand.node.value)
        if usual is None:
            return False
        if demand.is_thing:
            return True
        kinds = {family(kind) for kind in demand.datatypes}
        if not kinds or "" in kinds | usual or kinds & usual:
            return False
        return not kinds <= {"number", "dateTime"} or not usual <= {"number", "dateTime"}

    def _named_repairs(
        self, edge: Edge, demand: Demand, usual: int, context: Context
    ) -> list[Repair]:
        """Return repairs after which a variable can be what its name stands for."""
        named = Edge(demand.node, [], demand.node, -1, -1)
        wish = Demand(named, 0, usual or None, bool(usual))
        if edge.steps[0].node.value == TYPE:
            return self._classes_of(edge, usual)
        turned = reversed_edge(edge)
        found: list[Repair] = []
        if not self._fitting.misfits(turned, context):
            changed = self._fitting.demands.of(turned, context) or ()
            if usual and all(
                one.bits is None or one.bits & usual
                for one in changed
                if is_same_variable(one.node, demand.node)
            ):
                found.append(self._turned(edge))
        return [*found, *self.other_properties(edge, context, [wish])][:_OFFERED]

    def _is_turned_by_name(
        self, about: Node, value: Node, classes: tuple[list[str], list[str]]
    ) -> bool:
        as_is = self._named(about, classes[0]) + self._named(value, classes[1])
        turned = self._named(about, classes[1]) + self._named(value, classes[0])
        return as_is == 0 and turned == 2

    def _named(self, node: Node, classes: list[str]) -> bool:
        """Return whether a variable is named, or abbreviated, after one of some classes."""
        words = {word for iri in classes for word in words_of(local(iri))}
        if len(node.value) == 1:
            return any(word[0] == node.value for word in words)
        return bool(set(words_of(node.value)) & words)
