"""Sets of facts seen through changes that have not been applied."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from reasoner.facts import arrays
from reasoner.facts.arrays import Column
from reasoner.facts.relations import Facts, Ids
from reasoner.terms.dictionary import Fact

if TYPE_CHECKING:
    from reasoner.rules.work import Work


class Layer:
    """Staged additions and removals on top of facts that stay as they are.

    Examples
    --------
    >>> base = Facts([(300, 301, 302)])
    >>> layer = Layer(base)
    >>> layer.add(300, 301, 303), layer.discard(300, 301, 302), layer.objects(301, 300)
    (True, True, {303})
    >>> base.objects(301, 300)
    {302}
    """

    __slots__ = ("absences", "added", "base", "removed", "work")

    def __init__(self, base: Facts) -> None:
        self.base = base
        self.added = Facts()
        self.removed = Facts()
        self.absences: dict[tuple[int | None, ...], bool] | None = None
        """Results of NOT EXISTS groups, valid while nothing that they read changes."""
        self.work: Work | None = None
        """Bound on the work of joins on this layer, if there is one."""

    def __len__(self) -> int:
        return len(self.base) + len(self.added) - len(self.removed)

    def __iter__(self) -> Iterator[Fact]:
        yield from self.added
        for fact in self.base:
            if fact not in self.removed:
                yield fact

    def __contains__(self, fact: Fact) -> bool:
        return self.has(*fact)

    def has(self, s: int, p: int, o: int) -> bool:
        """Tell whether a fact holds after the changes."""
        if self.added.has(s, p, o):
            return True
        return self.base.has(s, p, o) and not self.removed.has(s, p, o)

    def objects(self, p: int, s: int) -> Ids:
        """Return the objects of a subject after the changes."""
        return _overlay(
            self.base.objects(p, s), self.added.objects(p, s), self.removed.objects(p, s)
        )

    def subjects(self, p: int, o: int) -> Ids:
        """Return the subjects of an object after the changes."""
        return _overlay(
            self.base.subjects(p, o), self.added.subjects(p, o), self.removed.subjects(p, o)
        )

    def pairs(self, p: int) -> Iterator[tuple[int, int]]:
        """Iterate over the subjects and objects of a property after the changes."""
        yield from self.added.pairs(p)
        if self.removed.size(p):
            has_gone = self.removed.has
            for s, o in self.base.pairs(p):
                if not has_gone(s, p, o):
                    yield s, o
        else:
            yield from self.base.pairs(p)

    def size(self, p: int) -> int:
        """Return about how many facts a property has."""
        return self.base.size(p) + self.added.size(p)

    def predicates(self) -> tuple[int, ...]:
        """Return the properties that may have facts."""
        return tuple({*self.base.predicates(), *self.added.predicates()})

    def add(self, s: int, p: int, o: int) -> bool:
        """Add a fact; False if it holds already."""
        if self.base.has(s, p, o):
            # One that was to go stays as it was: nothing of it is staged any more.
            return len(self.removed) > 0 and self.removed.discard(s, p, o)
        return self.added.add(s, p, o)

    def discard(self, s: int, p: int, o: int) -> bool:
        """Remove a fact; False if it does not hold."""
        if self.added.discard(s, p, o):
            return True
        return self.base.has(s, p, o) and self.removed.add(s, p, o)

    def columns(self) -> dict[int, Column]:
        """Return all facts after the changes as columns, by property."""
        return changed_columns(self.base, self.added.columns(), self.removed.columns())

    def about(self, number: int) -> list[Fact]:
        """Return the facts that mention an id, after the changes."""
        facts = [fact for fact in self.base.about(number) if fact not in self.removed]
        return facts + self.added.about(number)

    def apply(self) -> None:
        """Write the changes into the base; over an empty one, the additions become the base."""
        # A first load would otherwise copy every fact that it has just derived.
        if not len(self.base):
            self.base, self.added = self.added, Facts()
        for fact in self.removed:
            self.base.discard(*fact)
        for p in self.added.predicates():
            self.base.update(p, self.added.pairs(p))
        self.added, self.removed = Facts(), Facts()


class Asserted:
    """Asserted facts in original terms, with staged changes.

    Examples
    --------
    >>> asserted = Asserted(Facts([(300, 301, 302)]), added=frozenset({(300, 301, 303)}))
    >>> (300, 301, 303) in asserted, (300, 301, 303) in asserted.facts
    (True, False)
    >>> asserted.apply()
    >>> (300, 301, 303) in asserted.facts
    True
    """

    __slots__ = ("added", "facts", "removed")

    def __init__(
        self,
        facts: Facts,
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
        yield from (fact for fact in self.facts if fact not in self.removed)

    def columns(self) -> dict[int, Column]:
        """Return all facts after the changes as columns, by property."""
        added, removed = Facts(), Facts()
        added.replace(self.added)
        removed.replace(self.removed)
        return changed_columns(self.facts, added.columns(), removed.columns())

    def is_unchanged(self) -> bool:
        """Tell whether nothing is staged."""
        return not self.added and not self.removed

    def apply(self) -> None:
        """Write the changes into the facts."""
        # So many that a new table is made sooner than the old one is changed fact by fact.
        if len(self.removed) + len(self.added) >= len(self.facts):
            self.facts.replace(self)
            return
        for fact in self.removed:
            self.facts.discard(*fact)
        by_property: dict[int, list[tuple[int, int]]] = {}
        for s, p, o in self.added:
            by_property.setdefault(p, []).append((s, o))
        for p, pairs in by_property.items():
            self.facts.update(p, pairs)


def changed_columns(
    base: Facts, added: Mapping[int, Column], removed: Mapping[int, Column]
) -> dict[int, Column]:
    """Return columns of facts without those that go and with those that come."""
    columns = base.columns()
    for p, column in removed.items():
        if p in columns:
            keys = columns[p].keys
            columns[p] = Column(keys[~arrays.is_in(keys, column.keys)])
    for p, column in added.items():
        old = columns[p].keys if p in columns else arrays.NO_KEYS
        columns[p] = Column(arrays.merge(old, column.keys[~arrays.is_in(column.keys, old)]))
    return {p: column for p, column in columns.items() if len(column)}


def _overlay(base: Ids, added: Ids, removed: Ids) -> Ids:
    if removed:
        base = base - removed
    if not added:
        return base
    return base | added if base else added
