"""How well a term would go with the other patterns, with names and with the data."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rtask.asking.check.evidence import Evidence
from rtask.asking.check.naming.names import affinity, likeness
from rtask.asking.check.naming.usual import usual_properties
from rtask.asking.check.syntax.outline import Edge, Node, Outline, Step
from rtask.asking.check.types import (
    TYPE,
    Conflict,
    Context,
    Demand,
    Demands,
    contexts,
    family,
    overlap,
    read_demands,
)
from rtask.asking.check.vocabulary import Property, Vocabulary, local

__all__ = ["Fitting", "is_same_variable", "replaced", "reversed_edge"]


_NONE: frozenset[str] = frozenset()
_FRACTIONS = {"double", "float", "decimal"}


@dataclass(slots=True)
class _Need:
    """What the patterns around one demand of an end of it, each demand once.

    Attributes
    ----------
    is_thing
        Whether it is a thing; both values where they contradict each other.
    literal
        Datatype of the literal that stands there; empty for any other term.
    """

    bits: set[int]
    is_thing: set[bool]
    datatypes: set[frozenset[str]]
    literal: str = ""

    @classmethod
    def of(cls, node: Node, beside: dict[str, list[Demand]]) -> _Need:
        if node.kind == "literal":
            return cls(set(), {False}, {frozenset({node.datatype})}, node.datatype)
        if node.kind != "variable":
            return cls(set(), {True} if node.kind == "iri" else set(), set())
        # A constant demands nothing; only what is said elsewhere of a variable does.
        given = beside.get(node.value, ())
        return cls(
            {demand.bits for demand in given if demand.bits is not None},
            {demand.is_thing for demand in given if demand.is_thing is not None},
            {demand.datatypes for demand in given if demand.datatypes},
        )

    def meets(self, given: int | None, kind: bool | None, types: frozenset[str]) -> bool:
        """Return whether an end of a property may be what is demanded."""
        if self.literal:
            return kind is False and (not types or _may_equal(self.literal, types))
        # Things and values have no member in common, whatever the classes say.
        if kind is not None and (not kind) in self.is_thing:
            return False
        if given is not None and not all(given & bits for bits in self.bits):
            return False
        return not types or all(overlap(types, others) for others in self.datatypes)

    def share_of(self, given: int | None, types: frozenset[str]) -> float:
        """Return which share of some classes is as demanded; 0 where either is not known."""
        # A datatype says less than a class: half of what a class may give.
        if types:
            families = {family(kind) for kind in types}
            needed = {family(kind) for kinds in self.datatypes for kind in kinds}
            return 0.5 if needed and families <= needed else 0.0
        if given is None or not self.bits:
            return 0.0
        met = given
        for bits in self.bits:
            met &= bits
        return met.bit_count() / given.bit_count()


def _may_equal(datatype: str, types: frozenset[str]) -> bool:
    """Return whether a literal of a datatype may be among values of some: 3 among counts."""
    if datatype in types or family(datatype) != "number":
        return datatype in types
    # Whole numbers count, others measure: 3 among lengths is rather a mistake.
    whole = local(datatype) not in _FRACTIONS
    return any(family(kind) == "number" and (local(kind) not in _FRACTIONS) == whole
               for kind in types)  # fmt: skip


class Fitting:
    """How well a term would fit in the place of another in a pattern."""

    def __init__(self, vocabulary: Vocabulary, evidence: Evidence, outline: Outline) -> None:
        self.vocabulary = vocabulary
        self.evidence = evidence
        self.demands = Demands(vocabulary, evidence)
        self.contexts = list(contexts(outline.body))
        self._at: dict[int, Context] = {}
        self._statements: set[tuple[str, ...]] | None = None
        for context in self.contexts:
            for edge in context.own:
                self._at.setdefault(id(edge), context)

    @property
    def usual(self) -> Mapping[str, float]:
        """How usual each property is in the questions that come with the ontology, from 0 to 1."""
        return usual_properties()

    def context(self, edge: Edge) -> Context | None:
        """Return the context that a pattern stands in."""
        return self._at.get(id(edge))

    def has(self, edge: Edge) -> bool:
        """Return whether the query has a pattern somewhere, whatever way it is written."""
        if self._statements is None:
            # Made when it is first asked for: most queries have no fault that needs it.
            self._statements = {_statement(own) for context in self.contexts for own in context.own}
        return _statement(edge) in self._statements

    def conflicts_of(self, edge: Edge, context: Context) -> list[Conflict]:
        """Return the conflicts of one pattern, perhaps a changed one, with the others."""
        own = self.demands.of(edge, context)
        conflicts: list[Conflict] = []
        if own is None:
            return conflicts
        # Changed together with it, it cannot be in conflict with it.
        for other in context.touching(edge):
            if is_written_once(other, edge):
                continue
            given = self.demands.of(other, context)
            for demand in given or ():
                for mine in own:
                    if is_same_variable(mine.node, demand.node):
                        made = self.demands.between(mine, demand)
                        if made is not None:
                            conflicts.append(made)
        for demand in read_demands(context, [end.value for end in edge.ends]):
            for mine in own:
                if is_same_variable(mine.node, demand.node):
                    made = self.demands.between(mine, demand)
                    if made is not None:
                        conflicts.append(made)
        return conflicts

    def beside(self, edge: Edge, context: Context) -> dict[str, list[Demand]]:
        """Return what the other patterns demand of the variables of one."""
        names = {end.value for end in edge.ends if end.kind == "variable"}
        demands: dict[str, list[Demand]] = defaultdict(list)
        for other in context.touching(edge):
            if other is not edge and not is_written_once(other, edge):
                for demand in self.demands.of(other, context) or ():
                    if demand.node.kind == "variable" and demand.node.value in names:
                        demands[demand.node.value].append(demand)
        for demand in read_demands(context, names):
            demands[demand.node.value].append(demand)
        return demands

    def fits(
        self, axioms: Property, about: Node, value: Node, beside: dict[str, list[Demand]]
    ) -> bool:
        """Return whether a property goes with what other patterns demand of its ends."""
        needs = _Need.of(about, beside), _Need.of(value, beside)
        return needs[0].meets(axioms.domain, True, _NONE) and needs[1].meets(
            axioms.range, axioms.relates_things, axioms.types
        )

    def fitting_properties(
        self, about: Node, value: Node, beside: dict[str, list[Demand]]
    ) -> list[str]:
        """Return the properties that go with what other patterns demand of their ends."""
        first, other = _Need.of(about, beside), _Need.of(value, beside)
        fitting: list[str] = []
        # By axioms that are alike, of which there are far fewer than properties.
        for (domain, values, kind, types), iris in self.vocabulary.alike.items():
            if other.meets(values, kind, types) and first.meets(domain, True, _NONE):
                fitting += iris
        return fitting

    def aptness(self, iri: str, about: Node, value: Node, beside: dict[str, list[Demand]]) -> float:
        """Return how much of what a property is for is what its ends must be, from 0 to 2.

        Of two that fit, the one made for hands is meant of a hand, not the one for all things.
        """
        axioms = self.vocabulary.properties[iri]
        needs = _Need.of(about, beside), _Need.of(value, beside)
        return needs[0].share_of(axioms.domain, _NONE) + needs[1].share_of(
            axioms.range, axioms.types
        )

    def is_attested(self, edge: Edge, context: Context) -> bool:
        """Return whether the graph has what a pattern says, together with others beside it."""
        meets = self.meets(edge, context)
        return bool(meets) and False not in meets and self.evidence.matches(edge)

    def is_contradicted(self, edge: Edge, context: Context) -> bool:
        """Return whether a pattern never matches together with some other that does match."""
        return False in self.meets(edge, context, only_matching=True)

    def meets(
        self, edge: Edge, context: Context, *, only_matching: bool = False
    ) -> list[bool | None]:
        """Return for each pattern beside one whether the graph has both; None for perhaps."""
        return [
            self.evidence.meet(edge, at, other, other_at)
            for other in context.touching(edge)
            if other.steps
            if not is_written_once(other, edge)
            # What never matches by itself is no witness against another.
            if not only_matching or self.evidence.matches(other)
            for at, mine in enumerate(edge.ends)
            for other_at, node in enumerate(other.ends)
            if is_same_variable(mine, node)
        ]

    def misfits(self, edge: Edge, context: Context) -> int:
        """Return how many patterns a changed pattern would not go together with."""
        count = len(self.conflicts_of(edge, context))
        for at, node in enumerate(edge.ends):
            count += not self.suits(edge, at, node, context)
        return count

    def suits(self, edge: Edge, at: int, node: Node, context: Context) -> bool:
        """Return whether a constant is of the kind that an end of a pattern demands."""
        demands = self.demands.of(edge, context)
        if demands is None or node.kind == "variable":
            return True
        demand = demands[at]
        if node.kind == "literal":
            return demand.is_thing is not True and at != 0
        # The value of rdf:type is a class, of which the demands say nothing.
        if any(step.node.value == TYPE for step in edge.steps) and at == 1:
            return True
        return demand.is_thing is not False

    def ranked(self, candidates: Iterable[str], node: Node, edge: Edge) -> list[str]:
        """Return the candidates for an unknown term, by nearness and by how well they fit."""
        context = self.context(edge)
        if context is None:
            return list(candidates)
        name = local(node.value).lower()
        rated = []
        for iri in candidates:
            changed = replaced(edge, node, iri)
            clash = 0.25 * min(self.misfits(changed, context), 2)
            rated.append((-(likeness(name, local(iri).lower()) - clash), iri))
        return [iri for _, iri in sorted(rated)]

    def merit(self, edge: Edge, context: Context, *, forgives: bool = False) -> float:
        """Return how well a changed pattern that fits goes with names and data.

        Parameters
        ----------
        forgives
            Whether not to count that it never meets one beside it, which may be the other's fault.
        """
        merit = 0.0
        (step,) = edge.steps
        merit += 0.5 * self.usual.get(step.node.value, 0.0)
        value = edge.subject if step.is_inverse else edge.object
        about = edge.object if step.is_inverse else edge.subject
        if value.kind == "variable":
            merit += 2.0 * affinity(value.name, step.node.value, self.vocabulary)
        if about.kind == "variable":
            merit += 0.4 * affinity(about.name, step.node.value, self.vocabulary)
        if not self.evidence.matches(edge):
            return merit
        merit += 0.6
        meets = self.meets(edge, context)
        if meets:
            merit += 0.8 * sum(met is True for met in meets) / len(meets)
            if not forgives:
                merit -= 0.8 * sum(met is False for met in meets) / len(meets)
        return merit


def reversed_edge(edge: Edge) -> Edge:
    """Return an edge with its predicates walked the other way."""
    steps = [Step(step.node, not step.is_inverse) for step in edge.steps]
    return _changed(edge, edge.subject, steps, edge.object)


def _statement(edge: Edge) -> tuple[str, ...]:
    """Return what a pattern with one property says, from subject to value."""
    if len(edge.steps) != 1:
        return (str(edge.start),)
    (step,) = edge.steps
    about, value = edge.ends[:: -1 if step.is_inverse else 1]
    return about.value, step.node.value, value.value


def replaced(edge: Edge, node: Node, iri: str) -> Edge:
    """Return an edge with another term in the place of one."""
    other = Node(node.kind, iri, node.start, node.end, node.datatype)
    steps = [Step(other, step.is_inverse) if step.node is node else step for step in edge.steps]
    subject, value = (other if end is node else end for end in edge.ends)
    return _changed(edge, subject, steps, value)


def _changed(edge: Edge, subject: Node, steps: list[Step], value: Node) -> Edge:
    return Edge(
        subject, steps, value, edge.start, edge.end, edge.is_loose, edge.is_path, edge.repeats
    )


def is_written_once(edge: Edge, other: Edge) -> bool:
    """Return whether two edges have one predicate in the text, so that one cannot change alone.

    They are the same, perhaps changed, or the predicate has several values.
    """
    return [step.node.start for step in edge.steps] == [step.node.start for step in other.steps]


def is_same_variable(node: Node, other: Node) -> bool:
    return node.kind == other.kind == "variable" and node.value == other.value
