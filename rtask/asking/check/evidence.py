"""What the statements of a graph say about patterns: whether they match, alone and together.

Each question looks at a bounded number of rows, so that a check costs the same in a large graph;
where the bound is reached, the answer is "perhaps".
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import islice

from pyoxigraph import Literal, NamedNode

import ontology
from rtask.asking.check.syntax.outline import Edge, Node, Step
from rtask.asking.check.vocabulary import TOP, Vocabulary
from rtask.kb.core import GraphCore
from rtask.rdf.terms import RDF_TYPE, Term, stored

__all__ = ["Evidence"]

MAX_ROWS, MIN_ROWS = 24, 12
MIN_KINDS = 2
MAX_ENDS = 30
MIN_NATURE = 3
_MANY = 500
_MOST = 20_000


class _First:
    """The first matches of a pattern.

    Parameters
    ----------
    pairs
        Subject and object of each.
    is_all
        Whether there are no others.
    """

    def __init__(self, pairs: list[tuple[Term, Term]], is_all: bool) -> None:
        self.pairs, self.is_all = pairs, is_all

    @cached_property
    def _ends(self) -> tuple[frozenset[Term], frozenset[Term]]:
        return frozenset(pair[0] for pair in self.pairs), frozenset(pair[1] for pair in self.pairs)

    def ends(self, at: int) -> frozenset[Term]:
        """Return the terms at an end."""
        return self._ends[at]

    @cached_property
    def turned(self) -> _First:
        """The same, walked the other way."""
        return _First([pair[::-1] for pair in self.pairs], self.is_all)


class Evidence:
    """Looks patterns up in one state of a graph; answers are remembered until the next commit.

    Attributes
    ----------
    sound
        Hashes of the keys of groups of patterns in which no fault was found in this state.
    """

    def __init__(self, kb: GraphCore) -> None:
        self._quads = kb.store.quads_for_pattern
        self._seq = -1
        self._kb = kb
        self._answers: dict[object, int | None] = {}
        self._of_edges: dict[str, _First] = {}
        self._of_steps: dict[tuple[str, str, str], _First] = {}
        self._kinds_of: dict[Term, frozenset[str]] = {}
        self.sound: set[int] = set()

    def refresh(self) -> None:
        """Forget what an earlier state answered."""
        if (
            self._seq != self._kb.seq
            or len(self._answers) + len(self.sound) + len(self._kinds_of) > _MOST
        ):
            self._seq = self._kb.seq
            self._answers, self._of_edges, self._of_steps = {}, {}, {}
            self._kinds_of = {}
            self.sound = set()

    def is_used(self, iri: str) -> bool:
        """Return whether any statement, or the name of a graph, mentions an IRI."""
        key = ("used", iri)
        answer: int | None = self._answers.get(key)
        if answer is None:
            term = NamedNode(iri)
            answer = any(
                next(iter(rows), None) is not None
                for rows in (
                    self._quads(term, None, None, None),
                    self._quads(None, term, None, None),
                    self._quads(None, None, term, None),
                    self._quads(None, None, None, term),
                )
            )
            self._answers[key] = answer
        return bool(answer)

    def kinds_of(self, iri: str, vocabulary: Vocabulary) -> frozenset[str]:
        """Return the classes that a thing is stated, or follows, to be of."""
        return self._kinds(NamedNode(iri), vocabulary)

    def _kinds(self, term: Term, vocabulary: Vocabulary) -> frozenset[str]:
        if isinstance(term, Literal):
            return frozenset()
        kinds = self._kinds_of.get(term)
        if kinds is None:
            rows = self._quads(term, RDF_TYPE, None, None)
            named = (quad.object.value for quad in rows if isinstance(quad.object, NamedNode))
            kinds = frozenset(iri for iri in named if iri in vocabulary.bit and iri not in TOP)
            self._kinds_of[term] = kinds
        return kinds

    def languages(self, iri: str, text: str) -> list[str]:
        """Return the languages in which a text is a value of a property, among those that it has.

        Only languages that the first values of the property show are looked for.
        """
        first = islice(self._quads(None, NamedNode(iri), None, None), _MANY)
        tags = {
            quad.object.language
            for quad in first
            if isinstance(quad.object, Literal) and quad.object.language
        }
        return sorted(
            language
            for language in tags
            if next(self._quads(None, NamedNode(iri), Literal(text, language=language), None), None)
        )

    def has_kind(self, edge: Edge, at: int, bits: int, vocabulary: Vocabulary) -> bool:
        """Return whether a thing at an end of a pattern is, or may be, in one of some classes."""
        first = self._first(edge)
        kinds = (kind for term in first.ends(at) for kind in self._kinds(term, vocabulary))
        return not first.is_all or any(vocabulary.bit[kind] & bits for kind in kinds)

    def kinds_at(self, edge: Edge, at: int, vocabulary: Vocabulary) -> frozenset[str]:
        """Return the most specific classes of the terms that a pattern first has at an end."""
        return frozenset(
            kind
            for term in self._first(edge).ends(at)
            for kind in vocabulary.most_specific(self._kinds(term, vocabulary))
        )

    def ends_of(self, iri: str, at: int, vocabulary: Vocabulary) -> int | None:
        """Return the bits of the classes of all subjects, or values, of a property.

        None where there are none, too many to look at, some of no known class, or ones of several
        classes: these count only for our own properties, and with a superclass in common that is
        not of an upper ontology.
        """
        key = ("ends", iri, at)
        if key not in self._answers:
            self._answers[key] = self._ends_of(iri, at, vocabulary)
        return self._answers[key]

    def _ends_of(self, iri: str, at: int, vocabulary: Vocabulary) -> int | None:
        bits = 0
        seen: set[Term] = set()
        specific: set[str] = set()
        for row, quad in enumerate(self._quads(None, NamedNode(iri), None, None)):
            term = quad.object if at else quad.subject
            # Rows and not terms: one thing with a million values would be walked through.
            if row >= MAX_ENDS:
                return None
            if term in seen:
                continue
            seen.add(term)
            kinds = self._kinds(term, vocabulary)
            if not kinds:
                return None
            specific.update(vocabulary.most_specific(kinds))
            for kind in kinds:
                bits |= vocabulary.bit[kind]
        if len(specific) < 2:
            return bits or None
        return vocabulary.below_all(specific) if iri.startswith(ontology.NS) else None

    def has_things(self, iri: str) -> bool | None:
        """Return whether the first values of a property are all things, or False for all literals.

        None where they are of both sorts, or too few to tell.
        """
        key = ("things", iri)
        if key not in self._answers:
            rows = list(islice(self._quads(None, NamedNode(iri), None, None), MAX_ROWS))
            literals = sum(isinstance(quad.object, Literal) for quad in rows)
            is_mixed = len(rows) < MIN_NATURE or 0 < literals < len(rows)
            self._answers[key] = None if is_mixed else not literals
        answer = self._answers[key]
        return None if answer is None else bool(answer)

    def reaches(self, start: Node, step: Step, end: Node) -> bool | None:
        """Return whether a property, walked once or more, leads from one thing to another.

        None if that is not known: only so many things on the way are looked at.
        """
        todo, seen = [NamedNode(start.value)], {start.value}
        while todo and len(seen) < _MANY:
            node = Node("iri", todo.pop().value, -1, -1)
            for _, term in self._rows(Edge(node, [step], Node("variable", " ", -1, -1), -1, -1)):
                if isinstance(term, NamedNode):
                    if term.value == end.value:
                        return True
                    if term.value not in seen:
                        seen.add(term.value)
                        todo.append(term)
        return None if todo else False

    def is_of_terms(self, iri: str, vocabulary: Vocabulary) -> bool:
        """Return whether all that the graph says with a property is about classes or properties."""
        if not iri.startswith(ontology.NS):
            return False  # anything may have a label, or a source
        key = ("terms", iri)
        if key not in self._answers:
            rows = islice(self._quads(None, NamedNode(iri), None, None), MAX_ENDS)
            subjects = {quad.subject for quad in rows}
            self._answers[key] = bool(subjects) and all(
                isinstance(term, NamedNode)
                and (term.value in vocabulary.bit or term.value in vocabulary.properties)
                for term in subjects
            )
        return bool(self._answers[key])

    def is_general(self, edge: Edge, at: int, vocabulary: Vocabulary) -> bool:
        """Return whether a pattern has things of many kinds at an end, such as all with a name."""
        key = ("general", edge.signature, at)
        if key not in self._answers:
            kinds: set[str] = set()
            for term in self._first(edge).ends(at):
                kinds.update(vocabulary.most_specific(self._kinds(term, vocabulary)))
            self._answers[key] = len(kinds) > MIN_KINDS
        return bool(self._answers[key])

    def ends_differ(self, iri: str, vocabulary: Vocabulary) -> bool:
        """Return whether the subjects of a property are of other classes than its values."""
        key = ("differ", iri)
        if key not in self._answers:
            kinds: tuple[set[str], set[str]] = (set(), set())
            rows = self._quads(None, NamedNode(iri), None, None)
            for quad in islice(rows, MAX_ROWS):
                for at, term in enumerate((quad.subject, quad.object)):
                    kinds[at].update(vocabulary.most_specific(self._kinds(term, vocabulary)))
            self._answers[key] = bool(kinds[0] and kinds[1]) and not kinds[0] & kinds[1]
        return bool(self._answers[key])

    def matches(self, edge: Edge) -> bool:
        """Return whether a pattern matches anything by itself."""
        return bool(self._first(edge).pairs)

    def is_common(self, edge: Edge) -> bool:
        """Return whether a pattern matches more than a few times."""
        return len(self._first(edge).pairs) >= MIN_ROWS

    def meet(self, edge: Edge, at: int, other: Edge, other_at: int) -> bool | None:
        """Return whether two patterns match with the same term at an end; None for perhaps."""
        key = ("meet", edge.signature, at, other.signature, other_at)
        if key not in self._answers:
            self._answers[key] = self._meet(edge, at, other, other_at)
        met = self._answers[key]
        return None if met is None else bool(met)

    def _meet(self, edge: Edge, at: int, other: Edge, other_at: int) -> bool | None:
        mine, others = self._first(edge), self._first(other)
        if not mine.ends(at).isdisjoint(others.ends(other_at)):
            return True
        if mine.is_all and others.is_all:
            return False
        # The side whose matches are all known is looked up in the other: only that can say no.
        if mine.is_all or not others.is_all:
            has_any = self._has_any(mine.ends(at), other, other_at)
            if has_any or mine.is_all:
                return has_any
        has_any = self._has_any(others.ends(other_at), edge, at)
        return has_any if has_any or others.is_all else None

    def _has_any(self, terms: frozenset[Term], edge: Edge, at: int) -> bool:
        """Return whether a pattern matches with one of some terms at an end."""
        return any(
            next(self._rows(edge, at, term), None) is not None
            for term in terms
            # A literal is no subject.
            if at == 1 or not isinstance(term, Literal)
        )

    def _first(self, edge: Edge) -> _First:
        """Return the first matches of a pattern; those of each property are first."""
        first = self._of_edges.get(edge.signature)
        if first is None:
            parts = [self._of_step(edge, step) for step in edge.steps]
            if len(parts) == 1:
                first = parts[0]
            else:
                first = _First(
                    [pair for part in parts for pair in part.pairs],
                    all(part.is_all for part in parts),
                )
            self._of_edges[edge.signature] = first
        return first

    def _of_step(self, edge: Edge, step: Step) -> _First:
        s, o = edge.ends[::-1] if step.is_inverse else edge.ends
        key = (_sign(s), step.node.value, _sign(o))
        first = self._of_steps.get(key)
        if first is None:
            rows = self._rows(Edge(s, [Step(step.node)], o, 0, 0))
            # One more than is kept tells whether there are others.
            pairs = list(islice(rows, MAX_ROWS + 1))
            first = self._of_steps[key] = _First(pairs[:MAX_ROWS], len(pairs) <= MAX_ROWS)
        return first.turned if step.is_inverse else first

    def _rows(
        self, edge: Edge, at: int | None = None, term: Term | None = None
    ) -> Iterator[tuple[Term, Term]]:
        """Yield the subjects and objects of a pattern, as its path walks."""
        ends: list[Term | None] = [_term(node) for node in edge.ends]
        if at is not None:
            if ends[at] is not None and ends[at] != term:
                return
            ends[at] = term
        for step in edge.steps:
            s, o = ends[::-1] if step.is_inverse else ends
            # An inverse step from a literal would ask the store for one as subject, which it
            # refuses.
            if isinstance(s, Literal):
                continue
            for quad in self._quads(s, NamedNode(step.node.value), o, None):
                pair = (quad.subject, quad.object)
                yield pair[::-1] if step.is_inverse else pair


def _term(node: Node) -> Term | None:
    if node.kind == "iri":
        return NamedNode(node.value)
    if node.kind == "literal" and not node.datatype.endswith("langString"):
        # As the store writes it: 1.0 and 1.00 of a query are then the same term.
        return stored(Literal(node.value, datatype=NamedNode(node.datatype)))
    return None


def _sign(node: Node) -> str:
    """Return what of a node decides what a pattern matches."""
    return "" if node.kind == "variable" else f"{node.kind} {node.value} {node.datatype}"
