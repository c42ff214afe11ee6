"""View of one state of a closure in original terms, with equal terms substituted.

Also determines the content of the inferred graph, and its changes from one state to the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reasoner.decisions import Budget, Refutation, Undecided
from reasoner.facts import arrays
from reasoner.facts.arrays import Column
from reasoner.facts.equality import Equality
from reasoner.facts.layer import Asserted, Layer
from reasoner.facts.relations import Facts
from reasoner.glosses import Glossary, Name, local_name
from reasoner.proofs import GraphsOf, Proof, Prover
from reasoner.refutations import Refuter
from reasoner.rules.strata import Program
from reasoner.terms import vocabulary as v
from reasoner.terms.dictionary import Dictionary, Fact, Triple
from reasoner.terms.vocabulary import LITERAL, SAME, TYPE

_DATATYPES = frozenset(v.DATATYPES.values())
_FORM_WORK = 5
"""Candidates that one form of a derived fact counts as, for the store has to take it."""
Pattern = tuple[int | None, int | None, int | None]


@dataclass(frozen=True)
class Reading:
    """A state, in force or staged.

    Attributes
    ----------
    facts : Facts or Layer
        On representatives.
    equality : Equality
    asserted : Asserted
        In original terms.
    program : Program
    terms : Dictionary
    """

    facts: Facts | Layer
    equality: Equality
    asserted: Asserted
    program: Program
    terms: Dictionary

    # Single facts, in original terms.

    def forms(self, fact: Fact) -> Iterator[Fact]:
        """Yield a fact with each known literal of the same value as object."""
        s, p, o = fact
        return ((s, p, form) for form in (self.terms.variants(o) if o >= LITERAL else (o,)))

    def holds(self, fact: Fact) -> bool:
        """Tell whether a fact is asserted or derived."""
        if fact in self.asserted:
            return True
        s, p, o = self.equality.rewrite(fact)
        return s == o if p == SAME else self.facts.has(s, p, o)

    def mentions(self, number: int) -> bool:
        """Return whether a fact mentions a term, or it belongs to the vocabulary of OWL."""
        forms = self.terms.variants(number) if number >= LITERAL else (number,)
        return number < len(v.IRIS) or any(
            self.facts.about(self.equality.find(form)) for form in forms
        )

    def is_virtual(self, fact: Fact) -> bool:
        """Return whether a fact holds of every term, or of every class or property."""
        has = self.facts.has
        s, p, o = self.equality.rewrite(fact)
        if p == TYPE and (o in (v.THING, v.RESOURCE) or (o == v.DATATYPE and s in _DATATYPES)):
            return True
        if p in (v.SUB_CLASS, v.EQUIVALENT_CLASS):
            is_class = s in (v.THING, v.NOTHING) or has(s, TYPE, v.CLASS)
            return is_class and (s == o or (p == v.SUB_CLASS and (o == v.THING or s == v.NOTHING)))
        if p in (v.SUB_PROPERTY, v.EQUIVALENT_PROPERTY) and s == o:
            return has(s, TYPE, v.OBJECT_PROPERTY) or has(s, TYPE, v.DATATYPE_PROPERTY)
        return False

    def asserted_form(self, fact: Fact) -> Fact:
        """Return an asserted form of a fact, or the fact itself if no form was asserted."""
        forms = [form for form in self.equality.forms(fact) if form in self.asserted]
        return min(forms, key=lambda f: str(self.terms.decode_fact(f)), default=fact)

    def prove(
        self,
        fact: Fact,
        budget: int,
        graphs_of: GraphsOf | None = None,
        name: Name = local_name,
    ) -> Proof | Undecided:
        """Return a proof of minimal height of a fact that holds; for a virtual fact, its rule."""
        held = next(filter(self.holds, self.forms(fact)), None)
        if held is None:
            gloss = Glossary(self.facts, self.terms, name).fact(fact)
            return Proof(self.terms.decode_fact(fact), gloss, _virtual_rule(fact[1]))
        return Prover(
            self.facts,
            self.equality,
            self.program,
            self.asserted,
            self.terms,
            Budget(budget),
            graphs_of,
            name,
        ).prove(held)

    def refute(self, fact: Fact, budget: int, name: Name = local_name) -> Refutation:
        """Return what a fact that does not hold would need to hold."""
        return Refuter(
            self.facts, self.equality, self.program, self.terms, Budget(budget), name
        ).refute(fact)

    # Sets of facts.

    def match(self, pattern: Pattern) -> list[Triple]:
        """Return asserted and derived triples that match ids, in the order of their ids."""
        s, p, o = pattern
        forms = {
            form
            for fact in self._candidates(s, p, o)
            for form in self.equality.expand(fact)
            if form in self.asserted or is_exported(form, self.terms)
        }
        if p in (None, SAME):
            ends = [x for x in (s, o) if x is not None]
            classes = ends or [representative for representative, _ in self.equality.classes()]
            forms.update(self._pairs(classes))
        return [
            self.terms.decode_fact(form)
            for form in sorted(forms)
            if all(want in (None, have) for want, have in zip(pattern, form, strict=True))
        ]

    def _candidates(self, s: int | None, p: int | None, o: int | None) -> Iterator[Fact]:
        """Yield facts on representatives that may expand to a pattern."""
        facts, find = self.facts, self.equality.find
        for q in facts.predicates() if p is None else (find(p),):
            if s is not None:
                a = find(s)
                yield from ((a, q, x) for x in tuple(facts.objects(q, a)))
            elif o is not None:
                b = find(o)
                yield from ((x, q, b) for x in tuple(facts.subjects(q, b)))
            else:
                yield from ((x, q, y) for x, y in facts.pairs(q))

    def inferred(self, about: Iterable[Fact]) -> Iterator[Fact]:
        """Yield the exported forms of those facts, given on representatives, that are derived."""
        work = self.facts.work
        for fact in about:
            if self.facts.has(*fact):
                for form in self.equality.expand(fact):
                    if work is not None:
                        work.count(_FORM_WORK)
                    if form not in self.asserted and is_exported(form, self.terms):
                        yield form

    def equalities(self, members: Iterable[int]) -> Iterator[Fact]:
        """Yield the derived sameAs facts of the classes of terms."""
        return (form for form in self._pairs(members) if form not in self.asserted)

    def everything(self) -> Iterator[Fact]:
        """Yield the content of the inferred graph."""
        for p, keys in self.exported().items():
            for s, o in Column(keys):
                yield s, p, o

    def exported(self) -> dict[int, arrays.Keys]:
        """Return the content of the inferred graph: subjects and objects by property."""
        if self.equality:
            expanded = Facts()
            expanded.replace(self._expanded())
            return {p: column.keys for p, column in expanded.columns().items()}
        columns: dict[int, arrays.Keys] = {}
        asserted = self.asserted.columns()
        for p, column in self.facts.columns().items():
            keys = column.keys
            if p in asserted:
                keys = keys[~arrays.is_in(keys, asserted[p].keys)]
            if p == TYPE:
                keys = keys[self._is_shown_class(arrays.lower(keys))]
            elif p == SAME or p in v.SCHEMA_PREDICATES:
                shown = [is_exported((s, p, o), self.terms) for s, o in Column(keys)]
                keys = keys[np.array(shown, bool)]
            # Facts with any other predicate are exported unchanged.
            columns[p] = keys
        return columns

    def _is_shown_class(self, classes: arrays.Ids) -> NDArray[np.bool_]:
        """Tell for each class of a column whether its members' types are exported."""
        distinct, place = np.unique(classes, return_inverse=True)
        shown = [is_exported((v.RESERVED, TYPE, c), self.terms) for c in distinct.tolist()]
        return np.array(shown, bool)[place]

    def _expanded(self) -> Iterator[Fact]:
        asserted = self.asserted.facts if self.asserted.is_unchanged() else self.asserted
        work = self.facts.work
        for p in self.facts.predicates():
            is_special = p in (TYPE, SAME) or p in v.SCHEMA_PREDICATES
            for s, o in self.facts.pairs(p):
                if work is not None:
                    work.count(1)
                for form in self.equality.expand((s, p, o)):
                    if form not in asserted and not (
                        is_special and not is_exported(form, self.terms)
                    ):
                        yield form
        yield from self.equalities(representative for representative, _ in self.equality.classes())

    def _pairs(self, members: Iterable[int]) -> Iterator[Fact]:
        for representative in {self.equality.find(member) for member in members}:
            if self.facts.work is not None:
                self.facts.work.count(len(self.equality.members(representative)))
            yield from self.equality.pairs(representative)


def _virtual_rule(p: int) -> str:
    """Return the rule behind a tautology."""
    if p in (v.SUB_CLASS, v.EQUIVALENT_CLASS):
        return "scm-cls"
    return "scm-op" if p in (v.SUB_PROPERTY, v.EQUIVALENT_PROPERTY) else "cls-thing"


def is_exported(fact: Fact, terms: Dictionary) -> bool:
    """Return whether a derived fact belongs in the inferred graph.

    Excluded are tautologies (`x a owl:Thing`), schema triples about anonymous classes, and literals
    as subjects.
    """
    s, p, o = fact
    if s >= LITERAL:
        return False
    if p == TYPE:
        return o not in (v.THING, v.RESOURCE) and not terms.is_blank(o)
    if p not in v.SCHEMA_PREDICATES and p != SAME:
        return True
    if p in v.REFLEXIVE_PREDICATES and s == o:
        return False
    if p == v.SUB_CLASS and s == v.NOTHING:
        return False
    if p in (v.SUB_CLASS, v.DOMAIN, v.RANGE) and o in (v.THING, v.RESOURCE):
        return False
    return p == SAME or not (terms.is_blank(s) or terms.is_blank(o))
