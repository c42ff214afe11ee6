"""What a closure holds, as its readers ask for it: matches, proofs, digests, equal terms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from pyoxigraph import BlankNode, Literal, NamedNode
from pyoxigraph import Triple as TripleTerm

from reasoner.decisions import DEFAULT_BUDGET, Refutation
from reasoner.exports import Triples, missing_and_surplus
from reasoner.facts.layer import Asserted
from reasoner.fixpoint.maintenance import Draft, State
from reasoner.glosses import Name, local_name
from reasoner.proofs import Decision, GraphsOf, Proof
from reasoner.reading import Reading
from reasoner.terms import vocabulary as v
from reasoner.terms.dictionary import Dictionary, Fact, Term, Triple
from reasoner.terms.digest import Digest, digest_of
from reasoner.terms.vocabulary import RDF, SAME

__all__ = ["ClosureView"]

_TYPE = NamedNode(RDF + "type")


class ClosureView:
    """Read access to the facts of a closure, asserted and derived."""

    def __init__(self) -> None:
        self._terms = Dictionary()
        self._state = State()
        self._changes = 0

    @property
    def size(self) -> int:
        """Number of asserted triples."""
        return len(self._state.asserted)

    @property
    def changes(self) -> int:
        """Number of facts that came or went since the closure was built or read."""
        return self._changes

    def contains(self, triple: Triple) -> bool:
        """Return whether a triple is asserted, derived, or a tautology."""
        fact = self._find(triple)
        if fact is None:
            # Everything is the same as itself (rule eq-ref), also what was never mentioned.
            return triple[0] == triple[2] and triple[1] == NamedNode(v.IRIS[SAME])
        reading = self._reading()
        return any(reading.holds(f) or reading.is_virtual(f) for f in reading.forms(fact))

    def match(
        self, s: Term | None = None, p: Term | None = None, o: Term | None = None
    ) -> list[Triple]:
        """Return the asserted and derived triples that match a pattern; None matches all."""
        pattern = tuple(None if term is None else self._terms.find(term) for term in (s, p, o))
        # A term without an id is in no fact; None in the pattern would match all.
        if any(n is None and t is not None for n, t in zip(pattern, (s, p, o), strict=True)):
            return []
        a, b, c = pattern
        return self._reading().match((a, b, c))

    def explain(
        self,
        triple: Triple,
        budget: int = DEFAULT_BUDGET,
        graphs_of: GraphsOf | None = None,
        name: Name = local_name,
    ) -> Decision:
        """Return a proof of least height, or what a triple that does not hold lacks.

        Parameters
        ----------
        triple : Triple
        budget : int
            Goals and rows that may be looked at. Where they do not suffice, the answer is
            :class:`~reasoner.decisions.Undecided`, never that the triple does not hold.
        graphs_of : callable, optional
            Returns the names of the graphs that assert a triple, for the leaves.
        name : callable
            Returns the short name of a term, for the glosses.

        Raises
        ------
        TypeError
            A part of the triple is no term, such as a text.
        """
        for term in triple:
            if not isinstance(term, NamedNode | BlankNode | Literal | TripleTerm):
                raise TypeError(f"expected a term, got {type(term).__name__}: {term!r}")
        fact = self._find(triple)
        if fact is None:
            s, p, o = triple
            if s == o and p == NamedNode(v.IRIS[SAME]):
                return Proof(triple, f"{name(s)} {name(p)} {name(o)}", "eq-ref")
            gloss = " ".join("a" if term == _TYPE else name(term) for term in triple)
            return Refutation(triple, gloss, (), self._unmentioned(triple, name))
        if not self.contains(triple):
            refutation = self._reading().refute(fact, budget, name)
            # What is missing says more than which names are new.
            if refutation.needs:
                return refutation
            return replace(refutation, unknown=self._unmentioned(triple, name))
        return self._reading().prove(fact, budget, graphs_of, name)

    def inferred(self) -> Iterator[Triple]:
        """Yield every derived triple that no graph asserts: the content of the inferred graph."""
        decode = self._terms.decode_fact
        for fact in self._reading().everything():
            yield decode(fact)

    def compare(self, exported: Iterable[Triple]) -> tuple[Triples, list[Triple]]:
        """Return what the inferred graph in a store lacks and what it has too much.

        Parameters
        ----------
        exported : iterable of Triple
            The content of the store's inferred graph; read once.
        """
        return missing_and_surplus(self._reading(), exported)

    def digest(self) -> Digest:
        """Return the digest of the inferred graph: its number of triples and their hash."""
        return digest_of(self._reading().everything(), self._terms)

    def same_as(self, term: Term) -> list[Term]:
        """Return all terms known to denote the same individual, including the term itself."""
        number = self._terms.find(term)
        if number is None:
            return [term]
        return [self._terms.decode(m) for m in self._state.equality.members(number)]

    @property
    def holds_equal(self) -> bool:
        """Whether any two terms are the same."""
        return bool(self._state.equality)

    def _find(self, triple: Triple) -> Fact | None:
        s, p, o = map(self._terms.find_equal, triple)
        return None if s is None or p is None or o is None else (s, p, o)

    def _unmentioned(self, triple: Triple, name: Name) -> tuple[str, ...]:
        """Return the names of the terms that no statement mentions now.

        The dictionary may hold more: terms of statements that are gone, or that were only looked
        for. A process started since then has forgotten them, and is to answer the same.
        """
        reading = self._reading()
        numbers = map(self._terms.find_equal, triple)
        return tuple(
            name(term)
            for term, number in zip(triple, numbers, strict=True)
            if number is None or not reading.mentions(number)
        )

    def _reading(self, draft: Draft | None = None) -> Reading:
        state, terms = self._state, self._terms
        if draft is not None:
            return Reading(draft.layer, draft.equality, draft.asserted, draft.program, terms)
        asserted = Asserted(state.asserted)
        return Reading(state.facts, state.equality, asserted, state.program, terms)
