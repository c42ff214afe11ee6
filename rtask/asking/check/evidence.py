"""What the statements of a graph say about patterns: whether they match, alone and together.

Each question looks at a bounded number of rows, so that a check costs the same in a large graph;
where the bound is reached, the answer is "perhaps".
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from pyoxigraph import Literal, NamedNode

import ontology
from rtask.asking.check.syntax.outline import Edge, Node
from rtask.asking.check.vocabulary import TOP, Vocabulary
from rtask.kb.core import GraphCore
from rtask.rdf.terms import RDF_TYPE, Term, stored

__all__ = ["Evidence"]

MAX_ROWS, MIN_ROWS = 24, 12
MIN_KINDS = 2
MAX_ENDS = 30
_KNOWN = 20_000


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
        self.sound: set[int] = set()

    def refresh(self) -> None:
        """Forget what an earlier state answered."""
        if self._seq != self._kb.seq or len(self._answers) + len(self.sound) > _KNOWN:
            self._seq = self._kb.seq
            self._answers = {}
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
        rows = self._quads(term, RDF_TYPE, None, None)
        named = (quad.object.value for quad in rows if isinstance(quad.object, NamedNode))
        return frozenset(iri for iri in named if iri in vocabulary.bit and iri not in TOP)

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
            for ends in islice(self._rows(edge), MAX_ROWS):
                kinds.update(vocabulary.most_specific(self._kinds(ends[at], vocabulary)))
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
        key = ("edge", edge.signature)
        if key not in self._answers:
            self._answers[key] = next(self._rows(edge), None) is not None
        return bool(self._answers[key])

    def is_common(self, edge: Edge) -> bool:
        """Return whether a pattern matches more than a few times."""
        key = ("common", edge.signature)
        if key not in self._answers:
            rows = zip(range(MIN_ROWS), self._rows(edge), strict=False)
            self._answers[key] = sum(1 for _ in rows) == MIN_ROWS
        return bool(self._answers[key])

    def meet(self, edge: Edge, at: int, other: Edge, other_at: int) -> bool | None:
        """Return whether two patterns match with the same term at an end; None for perhaps."""
        key = ("meet", edge.signature, at, other.signature, other_at)
        if key not in self._answers:
            answer: int | None = self._meet(edge, at, other, other_at)
            if answer is None:
                answer = self._meet(other, other_at, edge, at)
            self._answers[key] = answer
        met = self._answers[key]
        return None if met is None else bool(met)

    def _meet(self, edge: Edge, at: int, other: Edge, other_at: int) -> bool | None:
        seen: set[Term] = set()
        for row, terms in enumerate(self._rows(edge)):
            if row >= MAX_ROWS:
                return None
            term = terms[at]
            if term in seen or (isinstance(term, Literal) and other_at == 0):
                continue
            seen.add(term)
            if next(self._rows(other, other_at, term), None) is not None:
                return True
        return False

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
            if isinstance(s, Literal):
                continue
            for quad in self._quads(s, NamedNode(step.node.value), o, None):
                pair = (quad.subject, quad.object)
                yield pair[::-1] if step.is_inverse else pair


def _term(node: Node) -> Term | None:
    if node.kind == "iri":
        return NamedNode(node.value)
    if node.kind == "literal" and not node.datatype.endswith("langString"):
        return stored(Literal(node.value, datatype=NamedNode(node.datatype)))
    return None
