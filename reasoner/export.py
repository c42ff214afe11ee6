"""Selection of the derived facts that the inferred graph holds.

Left out are asserted facts, triples that are true of everything (`x a owl:Thing`), schema triples
about anonymous classes, and literals as subjects.
"""

from __future__ import annotations

from reasoner.terms import vocabulary as v
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import LITERAL, SAME, TYPE


def is_exported(fact: Fact, terms: Dictionary) -> bool:
    """Tell whether a derived fact belongs into the inferred graph."""
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
