"""Dictionary of terms and ids: the engine works on small integers instead of terms."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from typing import TypeGuard

from pyoxigraph import BlankNode, Literal, NamedNode
from pyoxigraph import Triple as TripleTerm

from reasoner.terms.datatypes import BITS, Value, value_of
from reasoner.terms.table import HashIndex, TermTable, TextTable, value_hash
from reasoner.terms.vocabulary import IRIS, LITERAL, RESERVED

Term = NamedNode | BlankNode | Literal
Triple = tuple[Term, Term, Term]
GivenTriple = tuple[Term | TripleTerm, Term, Term | TripleTerm]
"""A triple as RDF 1.2 allows it; only those without triple terms are encoded."""
Fact = tuple[int, int, int]
"""Subject, predicate, object as ids."""


def is_term(term: Term | TripleTerm) -> TypeGuard[Term]:
    """Whether a term of RDF 1.2 is no triple term."""
    return not isinstance(term, TripleTerm)


def is_plain(triple: GivenTriple) -> TypeGuard[Triple]:
    """Whether a triple has no triple term, and can be encoded."""
    return is_term(triple[0]) and is_term(triple[2])


class Dictionary:
    """Map terms to dense ids and back.

    IRIs and blank nodes count from 0, literals from `LITERAL`; the vocabulary has fixed ids. Ids
    are reused only after :meth:`forget_since`.

    Parameters
    ----------
    table : TermTable, optional
        Terms that have ids already; they are looked up there until they are first met.

    Attributes
    ----------
    has_read_label : bool
        Whether :meth:`text` returned the label of a blank node.

    Examples
    --------
    >>> terms = Dictionary()
    >>> one, also = (terms.encode(Literal(x)) for x in (1, 1.0))
    >>> terms.is_same(one, also), terms.decode(one)
    (False, <Literal value=1 datatype=<NamedNode value=http://www.w3.org/2001/XMLSchema#integer>>)
    """

    def __init__(self, table: TermTable | None = None) -> None:
        fixed = [NamedNode(iri) for iri in IRIS]
        # Ids on disk stay valid when later versions add terms of their own to the fixed ones.
        fixed += [NamedNode(f"urn:rtask:reserved:{i}") for i in range(len(IRIS), RESERVED)]
        self._table = self._saved = table
        self.has_read_label = False
        self._ids: dict[Term, int] = {term: i for i, term in enumerate(fixed)}
        self._resources: list[NamedNode | BlankNode | None] = [*fixed]
        self._literals: list[Literal | None] = []
        self._values: list[Value | None] = []
        self._by_value: dict[tuple[object, ...], int] = {}
        self._variants: dict[int, tuple[int, ...]] = {}
        if table is not None:
            # Decoded on demand: a graph of a million terms opens without making a single one.
            self._resources += [None] * (len(table.resources) - len(fixed))
            self._literals = [None] * len(table.literals)
            self._values = [None] * len(table.literals)
            for group in table.variants:
                ids = tuple(LITERAL + position for position in group)
                self._variants.update(dict.fromkeys(ids, ids))

    def __len__(self) -> int:
        return len(self._resources) + len(self._literals)

    def encode(self, term: Term) -> int:
        """Return the id of a term, a new one if it was never seen."""
        number = self._ids.get(term)
        return self._new(term) if number is None else number

    def find(self, term: Term) -> int | None:
        """Return the id of a term, None if it was never seen."""
        number = self._ids.get(term)
        return self._in_table(term) if number is None else number

    def _in_table(self, term: Term) -> int | None:
        """Look a term up among those that had ids from the start, and remember it."""
        table = self._table
        if table is None:
            return None
        if isinstance(term, Literal):
            position = table.literals.find(term)
            if position is None:
                return None
            self._literals[position] = term
            self._ids[term] = LITERAL + position
            return LITERAL + position
        position = table.resources.find(term)
        if position is not None and isinstance(term, NamedNode | BlankNode):
            self._resources[position] = term
            self._ids[term] = position
        return position

    def find_equal(self, term: Term) -> int | None:
        """Return the id of a term, or of a literal of the same value; None if there is neither."""
        number = self.find(term)
        if number is None and isinstance(term, Literal):
            return self._first(value_of(term.value, term.datatype.value, term.language))
        return number

    def _first(self, value: Value) -> int | None:
        """Return the first literal with a value, None if there is none."""
        number = self._by_value.get(value.key)
        if number is None and self._table is not None:
            for position in self._table.values.candidates(value_hash(value.key)):
                if self.value(LITERAL + position).key == value.key:
                    number = self._by_value[value.key] = LITERAL + position
                    break
        return number

    def encode_all(self, triples: Iterable[Triple]) -> list[Fact]:
        """Encode many triples at once."""
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
        # A triple may contain the same new term twice, hence the second look-up.
        existing = self.find(term)
        if existing is not None:
            return existing
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
        first = self._first(value)
        if first is None:
            self._by_value[value.key] = number
        else:
            # 01 and 1 are two terms and one value: each knows all spellings, the first seen in
            # front.
            variants = (*self._variants.get(first, (first,)), number)
            for each in variants:
                self._variants[each] = variants
        return number

    def decode(self, number: int) -> Term:
        """Return the term of an id."""
        if number >= LITERAL:
            return self._literal(number - LITERAL)
        return self._resource(number)

    def _resource(self, position: int) -> NamedNode | BlankNode:
        resource = self._resources[position]
        if resource is None:
            assert self._table is not None
            resource = self._resources[position] = self._table.resource(position)
        return resource

    def _literal(self, position: int) -> Literal:
        literal = self._literals[position]
        if literal is None:
            assert self._table is not None
            literal = self._literals[position] = self._table.literal(position)
        return literal

    def decode_fact(self, fact: Fact) -> Triple:
        """Return the terms of a fact."""
        s, p, o = fact
        return self.decode(s), self.decode(p), self.decode(o)

    def decode_column(self, p: int, pairs: Iterable[tuple[int, int]]) -> Iterator[Triple]:
        """Yield the terms of the facts of a property, given by subjects and objects."""
        predicate = self.decode(p)
        resources, literals = self._resources, self._literals
        for s, o in pairs:
            value = resources[o] if o < LITERAL else literals[o - LITERAL]
            yield (
                resources[s] or self._resource(s),
                predicate,
                self.decode(o) if value is None else value,
            )

    def write_column(self, p: int, pairs: Iterable[tuple[int, int]]) -> list[str]:
        """Return the facts of a property as lines of N-Triples."""
        predicate = f" {self.decode(p)} "

        @functools.cache
        def write(number: int) -> str:
            return str(self.decode(number))

        return [f"{write(s)}{predicate}{write(o)} .\n" for s, o in pairs]

    def iri(self, number: int) -> str:
        """Return the IRI of an id, or `_:label` of a blank node."""
        term = self._resource(number)
        return term.value if isinstance(term, NamedNode) else str(term)

    def text(self, number: int) -> str:
        """Return the text of a term: an IRI, a literal without its type, or a label."""
        term = self.decode(number)
        self.has_read_label |= isinstance(term, BlankNode)
        return term.value

    def is_blank(self, number: int) -> bool:
        """Tell whether an id is a blank node."""
        return number < LITERAL and isinstance(self._resource(number), BlankNode)

    def value(self, number: int) -> Value:
        """Return the value of a literal's id."""
        cached = self._values[number - LITERAL]
        if cached is None:
            literal = self._literal(number - LITERAL)
            cached = value_of(literal.value, literal.datatype.value, literal.language)
            self._values[number - LITERAL] = cached
        return cached

    def variants(self, number: int) -> tuple[int, ...]:
        """Return the ids of all known literals with the value of this one, itself included."""
        return self._variants.get(number, (number,))

    def listed(self) -> tuple[tuple[Term | None, ...], int] | None:
        """Return all terms by id and the number of resources; None if some are in a table.

        Resources come first. None stands for a blank node.
        """
        if self._table is not None:
            return None
        resources = (None if isinstance(r, BlankNode) else r for r in self._resources)
        return (*resources, *self._literals), len(self._resources)

    def counts(self) -> tuple[int, int]:
        """Return the lowest ids that a new resource and a new literal would have."""
        return len(self._resources), LITERAL + len(self._literals)

    def since(self, counts: tuple[int, int]) -> tuple[tuple[Term, ...], tuple[Term, ...]]:
        """Return the resources and the literals that were new after `counts`, in order."""
        resources, literals = counts
        return (
            tuple(map(self._resource, range(resources, len(self._resources)))),
            tuple(map(self._literal, range(literals - LITERAL, len(self._literals)))),
        )

    def forget_since(self, counts: tuple[int, int]) -> None:
        """Forget the terms that were new after `counts`; nobody may hold their ids any more."""
        resources, literals = counts[0], counts[1] - LITERAL
        for term in (*self._resources[resources:], *self._literals[literals:]):
            if term is not None:
                self._ids.pop(term, None)
        for value in self._values[literals:]:
            # An older literal of the same value keeps its place.
            if value is not None and self._by_value.get(value.key, 0) >= counts[1]:
                del self._by_value[value.key]
        for number in range(counts[1], LITERAL + len(self._literals)):
            group = self._variants.pop(number, ())
            earlier = tuple(other for other in group if other < counts[1])
            for other in earlier:
                # A group of one is none.
                if len(earlier) > 1:
                    self._variants[other] = earlier
                else:
                    self._variants.pop(other, None)
        del self._resources[resources:], self._literals[literals:], self._values[literals:]

    @property
    def has_variants(self) -> bool:
        """Whether any value has occurred in more than one literal."""
        return bool(self._variants)

    def is_same(self, left: int, right: int) -> bool:
        """Tell whether two ids are one term or two literals of one value."""
        return left == right or right in self._variants.get(left, ())

    def is_clash(self, left: int, right: int) -> bool:
        """Tell whether two ids cannot denote one thing.

        So it is for a literal and a resource, since data and individuals are apart (OWL 2 Direct
        Semantics 2.1), and for two literals whose values are known and differ.
        """
        if (left < LITERAL and right < LITERAL) or self.is_same(left, right):
            return False
        literals = [number for number in (left, right) if number >= LITERAL]
        return len(literals) == 1 or all(self.value(number).is_recognized for number in literals)

    def in_datatype(self, number: int, datatype: int) -> bool | None:
        """Tell whether a literal lies in a datatype; None where that is not known.

        It is not for a datatype that is not supported, and for a literal of one that is not.
        """
        bit = BITS.get(self.iri(datatype))
        value = self.value(number)
        return None if bit is None or not value.is_recognized else bool(value.mask & bit)

    def table(self) -> TermTable:
        """Return all terms as a table; what an earlier table holds is not encoded again."""
        before = self._saved
        resource_count, literal_count = (
            (0, 0) if before is None else (len(before.resources), len(before.literals))
        )
        resources = TextTable.of(self._resources[resource_count:], resource_count)
        literals = TextTable.of(self._literals[literal_count:], literal_count)
        fresh = [
            (key, number - LITERAL)
            for key, number in self._by_value.items()
            if number - LITERAL >= literal_count
        ]
        values = HashIndex.of([value_hash(key) for key, _ in fresh], [at for _, at in fresh])
        if before is not None:
            resources = before.resources.joined(resources)
            literals = before.literals.joined(literals)
            values = before.values.joined(values)
        groups = {tuple(n - LITERAL for n in ids) for ids in self._variants.values()}
        self._saved = TermTable(resources, literals, values, tuple(sorted(groups)))
        return self._saved
