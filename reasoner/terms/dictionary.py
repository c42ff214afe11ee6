"""Dictionary of terms and ids: the engine works on small integers instead of terms."""

from __future__ import annotations

from collections.abc import Iterable

from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner.terms.datatypes import BITS, Value, value_of
from reasoner.terms.vocabulary import IRIS, LITERAL, RESERVED

Term = NamedNode | BlankNode | Literal
Triple = tuple[Term, Term, Term]
Fact = tuple[int, int, int]
"""Subject, predicate, object as ids."""


class Dictionary:
    """Map terms to dense ids and back.

    IRIs and blank nodes count from 0, literals from `LITERAL`; the vocabulary has fixed ids. Ids
    are never reused.

    Examples
    --------
    >>> terms = Dictionary()
    >>> one, also = (terms.encode(Literal(x)) for x in (1, 1.0))
    >>> terms.is_same(one, also), terms.decode(one)
    (False, <Literal value=1 datatype=<NamedNode value=http://www.w3.org/2001/XMLSchema#integer>>)
    """

    def __init__(self) -> None:
        self._resources: list[NamedNode | BlankNode] = [NamedNode(iri) for iri in IRIS]
        self._resources += [
            NamedNode(f"urn:rtask:reserved:{i}") for i in range(len(IRIS), RESERVED)
        ]
        self._literals: list[Literal] = []
        self._values: list[Value] = []
        self._ids: dict[Term, int] = {term: i for i, term in enumerate(self._resources)}
        self._by_value: dict[tuple[object, ...], int] = {}
        self._variants: dict[int, tuple[int, ...]] = {}

    def __len__(self) -> int:
        return len(self._resources) + len(self._literals)

    def encode(self, term: Term) -> int:
        """Return the id of a term, a new one if it was never seen."""
        found = self._ids.get(term)
        return self._new(term) if found is None else found

    def find(self, term: Term) -> int | None:
        """Return the id of a term, None if it was never seen."""
        return self._ids.get(term)

    def find_equal(self, term: Term) -> int | None:
        """Return the id of a term, or of a literal of the same value; None if there is neither."""
        found = self._ids.get(term)
        if found is None and isinstance(term, Literal):
            value = value_of(term.value, term.datatype.value, term.language)
            return self._by_value.get(value.key)
        return found

    def encode_all(self, triples: Iterable[Triple]) -> list[Fact]:
        """Encode triples in one go."""
        ids, new = self._ids, self._new
        facts = []
        for s, p, o in triples:
            a, b, c = ids.get(s), ids.get(p), ids.get(o)
            facts.append(
                (
                    new(s) if a is None else a,
                    new(p) if b is None else b,
                    new(o) if c is None else c,
                )
            )
        return facts

    def _new(self, term: Term) -> int:
        # A triple may bring one new term twice, hence the second look.
        found = self._ids.get(term)
        if found is not None:
            return found
        if isinstance(term, Literal):
            number = self._new_literal(term)
        elif isinstance(term, NamedNode | BlankNode):
            number = len(self._resources)
            self._resources.append(term)
        else:
            raise TypeError(f"expected an IRI, a blank node or a literal, got {term!r}")
        self._ids[term] = number
        return number

    def _new_literal(self, literal: Literal) -> int:
        number = LITERAL + len(self._literals)
        self._literals.append(literal)
        value = value_of(literal.value, literal.datatype.value, literal.language)
        self._values.append(value)
        first = self._by_value.setdefault(value.key, number)
        if first != number:
            variants = (*self._variants.get(first, (first,)), number)
            for each in variants:
                self._variants[each] = variants
        return number

    def decode(self, number: int) -> Term:
        """Return the term of an id."""
        if number >= LITERAL:
            return self._literals[number - LITERAL]
        return self._resources[number]

    def decode_fact(self, fact: Fact) -> Triple:
        """Return the terms of a fact."""
        s, p, o = fact
        return self.decode(s), self.decode(p), self.decode(o)

    def iri(self, number: int) -> str:
        """Return the IRI of an id, or `_:label` of a blank node."""
        term = self._resources[number]
        return term.value if isinstance(term, NamedNode) else str(term)

    def is_blank(self, number: int) -> bool:
        """Tell whether an id is a blank node."""
        return number < LITERAL and isinstance(self._resources[number], BlankNode)

    def value(self, number: int) -> Value:
        """Return the value of a literal's id."""
        return self._values[number - LITERAL]

    def variants(self, number: int) -> tuple[int, ...]:
        """Return the ids of all known literals with the value of this one, itself included."""
        return self._variants.get(number, (number,))

    @property
    def has_variants(self) -> bool:
        """Whether some value was seen in more than one literal."""
        return bool(self._variants)

    def is_same(self, left: int, right: int) -> bool:
        """Tell whether two ids are one term or two literals of one value."""
        return left == right or right in self._variants.get(left, ())

    def in_datatype(self, number: int, datatype: int) -> bool | None:
        """Tell whether a literal lies in a datatype; None where the datatype is not supported."""
        bit = BITS.get(self.iri(datatype))
        return None if bit is None else bool(self.value(number).mask & bit)
