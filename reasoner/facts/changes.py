"""Sets of facts that come and go, one change after another."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from reasoner.facts import arrays
from reasoner.facts.arrays import NO_KEYS, Column, Ids, Keys
from reasoner.facts.relations import Facts
from reasoner.terms.dictionary import Fact
from reasoner.terms.vocabulary import LITERAL

__all__ = ["FactChange", "Renumbering", "facts_in", "without"]

KeysByProperty = Mapping[int, Keys]


@dataclass(frozen=True)
class Renumbering:
    """What the ids of another dictionary are here.

    Two dictionaries agree on the terms that the first held when the second was copied from it.

    Attributes
    ----------
    resources, literals : (n,) uint64
        Ids here of the resources and literals that the copy has numbered since.
    first_resource, first_literal : int
        The lowest ids of these in the copy.
    """

    resources: Ids
    literals: Ids
    first_resource: int
    first_literal: int

    def __call__(self, number: int) -> int:
        """Return the id here; that of a variable, which is negative, stays."""
        # Literals first: their ids lie above those of all resources.
        if number >= self.first_literal:
            return int(self.literals[number - self.first_literal])
        if self.first_resource <= number < LITERAL:
            return int(self.resources[number - self.first_resource])
        return number

    def fact(self, fact: Fact) -> Fact:
        """Return a fact in the ids here."""
        s, p, o = fact
        return self(s), self(p), self(o)

    def ids(self, ids: Ids) -> Ids:
        """Return many ids at once."""
        result = ids.copy()
        is_new = (ids >= self.first_resource) & (ids < LITERAL)
        result[is_new] = self.resources[ids[is_new] - self.first_resource]
        is_new = ids >= self.first_literal
        result[is_new] = self.literals[ids[is_new] - self.first_literal]
        return result

    def keys(self, keys: Keys) -> Keys:
        """Return pairs of ids, again in ascending order."""
        # Two terms may be one here, and the order of ids is another: pairs are sorted and merged
        # anew.
        halves = self.ids(arrays.upper(keys)), self.ids(arrays.lower(keys))
        return arrays.distinct(arrays.pack(*halves))

    def columns(self, columns: KeysByProperty) -> dict[int, Keys]:
        """Return pairs by property."""
        return {self(p): self.keys(keys) for p, keys in columns.items()}


@dataclass(frozen=True)
class FactChange:
    """Facts that come and facts that go, as pairs by property.

    Examples
    --------
    >>> first = FactChange.of([(300, 301, 302), (300, 301, 303)], [])
    >>> both = first.then(FactChange.of([(300, 301, 304)], [(300, 301, 303)]))
    >>> sorted(facts_in(both.added)), len(both.removed)
    ([(300, 301, 302), (300, 301, 304)], 0)
    >>> both.then(both.undone()) == FactChange()
    True
    """

    added: KeysByProperty = field(default_factory=dict)
    removed: KeysByProperty = field(default_factory=dict)

    @classmethod
    def of(cls, added: Iterable[Fact], removed: Iterable[Fact]) -> FactChange:
        """Make a change of single facts."""
        return cls(_keys_of(added), _keys_of(removed))

    @classmethod
    def between(cls, before: KeysByProperty, after: KeysByProperty) -> FactChange:
        """Return the change from one set of facts to another."""
        return cls(without(after, before), without(before, after))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FactChange):
            return NotImplemented
        return _is_equal(self.added, other.added) and _is_equal(self.removed, other.removed)

    __hash__ = None  # type: ignore[assignment]

    @property
    def net(self) -> int:
        """How many facts more there are."""
        return sum(map(len, self.added.values())) - sum(map(len, self.removed.values()))

    def then(self, later: FactChange) -> FactChange:
        """Return the change that this one and a later one make together."""
        return FactChange(
            _joined(without(self.added, later.removed), without(later.added, self.removed)),
            _joined(without(self.removed, later.added), without(later.removed, self.added)),
        )

    def undone(self) -> FactChange:
        """Return the change that takes this one back."""
        return FactChange(self.removed, self.added)

    def renumbered(self, numbers: Renumbering) -> FactChange:
        """Return the change in the ids of another dictionary."""
        return FactChange(numbers.columns(self.added), numbers.columns(self.removed))


def facts_in(columns: KeysByProperty) -> Iterator[Fact]:
    """Yield the single facts of columns."""
    for p, keys in columns.items():
        yield from ((s, p, o) for s, o in Column(keys))


def without(columns: KeysByProperty, others: KeysByProperty) -> dict[int, Keys]:
    """Return columns without the facts of others; empty ones are left out."""
    # Columns without facts would make two equal changes differ.
    rest = {p: keys[~arrays.is_in(keys, others.get(p, NO_KEYS))] for p, keys in columns.items()}
    return {p: keys for p, keys in rest.items() if len(keys)}


def _joined(left: KeysByProperty, right: KeysByProperty) -> dict[int, Keys]:
    """Return the facts of two sets that have none in common."""
    joined = dict(left)
    for p, keys in right.items():
        joined[p] = arrays.merge(joined[p], keys) if p in joined else keys
    return joined


def _is_equal(left: KeysByProperty, right: KeysByProperty) -> bool:
    return left.keys() == right.keys() and all(
        len(keys) == len(right[p]) and bool((keys == right[p]).all()) for p, keys in left.items()
    )


def _keys_of(facts: Iterable[Fact]) -> dict[int, Keys]:
    held = Facts()
    held.replace(facts)
    return {p: column.keys for p, column in held.columns().items()}
