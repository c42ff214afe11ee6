"""What the inferred graph holds: facts in terms that stores and people can use.

Left out are asserted facts, triples that are true of everything (`x a owl:Thing`), schema triples
about anonymous classes, and literals as subjects.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from . import vocabulary as v
from .dictionary import Dictionary, Fact
from .equality import Equality
from .layer import Layer
from .vocabulary import LITERAL, SAME, TYPE

if TYPE_CHECKING:
    from .reading import Reading


class Asserted:
    """Asserted facts in original terms, with staged changes."""

    __slots__ = ("added", "facts", "removed")

    def __init__(
        self,
        facts: set[Fact],
        added: frozenset[Fact] = frozenset(),
        removed: frozenset[Fact] = frozenset(),
    ) -> None:
        self.facts = facts
        self.added = added
        self.removed = removed

    def __contains__(self, fact: Fact) -> bool:
        return fact in self.added or (fact in self.facts and fact not in self.removed)

    def __iter__(self) -> Iterator[Fact]:
        yield from self.added
        yield from (fact for fact in tuple(self.facts) if fact not in self.removed)

    def is_unchanged(self) -> bool:
        """Tell whether nothing is staged."""
        return not self.added and not self.removed

    def apply(self) -> None:
        """Write the changes into the set."""
        self.facts -= self.removed
        self.facts |= self.added


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


def differences(before: Reading, after: Reading, changed: Asserted) -> tuple[set[Fact], set[Fact]]:
    """Return what enters and what leaves the inferred graph.

    Parameters
    ----------
    before, after : Reading
        The second is a layer over the facts of the first.
    changed : Asserted
        The staged changes of what is asserted.

    Returns
    -------
    added, removed : set of Fact
    """
    layer = after.facts
    assert isinstance(layer, Layer)
    touched = (*changed.added, *changed.removed)
    old = {*layer.removed, *map(before.equality.rewrite, touched)}
    new = {*layer.added, *map(after.equality.rewrite, touched)}
    merged = _changed_classes(before.equality, after.equality)
    for term in merged:
        old.update(before.facts.about(before.equality.find(term)))
        new.update(after.facts.about(after.equality.find(term)))
    ends = {x for s, p, o in touched if p == SAME for x in (s, o)}
    was = {*before.inferred(old), *before.equalities(merged | ends)}
    now = {*after.inferred(new), *after.equalities(merged | ends)}
    return now - was, was - now


def _changed_classes(before: Equality, after: Equality) -> set[int]:
    if before == after:
        return set()
    members = {m for e in (before, after) for _, ms in e.classes() for m in ms}
    return {m for m in members if before.members(m) != after.members(m)}
