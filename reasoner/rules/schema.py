"""Schema facts: reading lists, and the rules that close a schema (OWL 2 Profiles 4.3, table 9)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from reasoner.rules.rule import Atom, Differ, Rule, View
from reasoner.terms.dictionary import Fact
from reasoner.terms.vocabulary import (
    ALL,
    DOMAIN,
    EQUIVALENT_CLASS,
    EQUIVALENT_PROPERTY,
    FIRST,
    HAS_VALUE,
    NIL,
    ON_PROPERTY,
    RANGE,
    REST,
    SOME,
    SUB_CLASS,
    SUB_PROPERTY,
)


@dataclass(frozen=True, slots=True)
class SchemaProblem:
    """An axiom that cannot be read and is ignored as a whole.

    Attributes
    ----------
    node : int
        The list or axiom.
    message : str
        Description of the problem.
    """

    node: int
    message: str


class BadListError(ValueError):
    """A list that is unterminated, forked or cyclic."""


def read_list(view: View, head: int) -> tuple[tuple[int, ...], tuple[Fact, ...]]:
    """Return the members of an RDF list and the facts it consists of.

    Raises
    ------
    BadListError
        If the list has no end, a node with two values, or a cycle.
    """
    members: list[int] = []
    facts: list[Fact] = []
    seen: set[int] = set()
    node = head
    while node != NIL:
        if node in seen:
            raise BadListError("the list runs in a circle")
        seen.add(node)
        firsts, rests = view.objects(FIRST, node), view.objects(REST, node)
        if len(firsts) != 1 or len(rests) != 1:
            raise BadListError(
                f"a node of the list has {len(firsts)} rdf:first and {len(rests)} rdf:rest, "
                "expected one of each"
            )
        (first,), (rest,) = firsts, rests
        members.append(first)
        facts += [(node, FIRST, first), (node, REST, rest)]
        node = rest
    return tuple(members), tuple(facts)


# Variables of the rules below.
_A, _B, _C, _P, _Q, _V = -1, -2, -3, -4, -5, -6


def _transitive(name: str, p: int) -> Rule:
    return Rule(
        name, (Atom(_A, p, _B), Atom(_B, p, _C)), Atom(_A, p, _C), conditions=(Differ(_A, _C),)
    )


def _equivalence(suffix: str, equal: int, below: int) -> Iterator[Rule]:
    differ = (Differ(_A, _B),)
    yield Rule(f"scm-eq{suffix}1", (Atom(_A, equal, _B),), Atom(_A, below, _B), conditions=differ)
    yield Rule(f"scm-eq{suffix}1", (Atom(_A, equal, _B),), Atom(_B, below, _A), conditions=differ)
    both = (Atom(_A, below, _B), Atom(_B, below, _A))
    yield Rule(f"scm-eq{suffix}2", both, Atom(_A, equal, _B), conditions=differ)


def _side(suffix: str, side: int) -> Iterator[Rule]:
    """Domain or range: upwards along classes, downwards along properties."""
    yield Rule(f"scm-{suffix}1", (Atom(_P, side, _A), Atom(_A, SUB_CLASS, _B)), Atom(_P, side, _B))
    yield Rule(
        f"scm-{suffix}2", (Atom(_Q, side, _A), Atom(_P, SUB_PROPERTY, _Q)), Atom(_P, side, _A)
    )


def _restrictions(kind: int, same: bool, p: int) -> tuple[Atom, ...]:
    """Body that two restrictions share: equal (or two) fillers, and two (or equal) properties."""
    fillers = (_V, _V) if same else (_C, _V)
    return (
        Atom(_A, kind, fillers[0]),
        Atom(_A, ON_PROPERTY, _P),
        Atom(_B, kind, fillers[1]),
        Atom(_B, ON_PROPERTY, p),
    )


def _restriction_rules() -> Iterator[Rule]:
    differ = (Differ(_A, _B),)
    up, down = Atom(_A, SUB_CLASS, _B), Atom(_B, SUB_CLASS, _A)
    below_class, below_property = Atom(_C, SUB_CLASS, _V), Atom(_P, SUB_PROPERTY, _Q)
    for name, kind, same, extra, head in (
        ("scm-hv", HAS_VALUE, True, below_property, up),
        ("scm-svf1", SOME, False, below_class, up),
        ("scm-svf2", SOME, True, below_property, up),
        ("scm-avf1", ALL, False, below_class, up),
        # More values to fill: the restriction on the wider property is the narrower class.
        ("scm-avf2", ALL, True, below_property, down),
    ):
        body = (*_restrictions(kind, same, _Q if extra is below_property else _P), extra)
        yield Rule(name, body, head, conditions=differ)
    # The same with one property and one filler, which are below themselves (scm-op, scm-cls).
    for name, kind in (("scm-hv", HAS_VALUE), ("scm-svf2", SOME), ("scm-avf2", ALL)):
        yield Rule(name, _restrictions(kind, True, _P), up, conditions=differ)


CLOSING_RULES: tuple[Rule, ...] = (
    _transitive("scm-sco", SUB_CLASS),
    _transitive("scm-spo", SUB_PROPERTY),
    *_equivalence("c", EQUIVALENT_CLASS, SUB_CLASS),
    *_equivalence("p", EQUIVALENT_PROPERTY, SUB_PROPERTY),
    *_side("dom", DOMAIN),
    *_side("rng", RANGE),
    *_restriction_rules(),
)
"""The scm-* rules that are not virtual; scm-int and scm-uni read lists and are compiled."""
