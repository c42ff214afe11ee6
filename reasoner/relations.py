"""Facts by property, both ways round, and a layer of staged changes on top of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .dictionary import Fact

Index = dict[int, set[int]]
EMPTY: frozenset[int] = frozenset()


class Facts:
    """A set of facts, indexed by property and subject and by property and object.

    Examples
    --------
    >>> facts = Facts()
    >>> facts.add(300, 301, 302), facts.add(300, 301, 302)
    (True, False)
    >>> facts.objects(301, 300), facts.subjects(301, 302), len(facts)
    ({302}, {300}, 1)
    """

    __slots__ = ("_forward", "_inverse", "_size")

    def __init__(self, facts: Iterable[Fact] = ()) -> None:
        self._forward: dict[int, Index] = {}
        self._inverse: dict[int, Index] = {}
        self._size = 0
        for fact in facts:
            self.add(*fact)

    def __len__(self) -> int:
        return self._size

    def __iter__(self) -> Iterator[Fact]:
        for p in tuple(self._forward):
            for s, o in self.pairs(p):
                yield s, p, o

    def __contains__(self, fact: Fact) -> bool:
        return self.has(*fact)

    def has(self, s: int, p: int, o: int) -> bool:
        """Tell whether a fact is in the set."""
        by_subject = self._forward.get(p)
        return by_subject is not None and o in by_subject.get(s, EMPTY)

    def objects(self, p: int, s: int) -> set[int] | frozenset[int]:
        """Return the objects of a subject; not to be changed by the caller."""
        by_subject = self._forward.get(p)
        return EMPTY if by_subject is None else by_subject.get(s, EMPTY)

    def subjects(self, p: int, o: int) -> set[int] | frozenset[int]:
        """Return the subjects of an object; not to be changed by the caller."""
        by_object = self._inverse.get(p)
        return EMPTY if by_object is None else by_object.get(o, EMPTY)

    def pairs(self, p: int) -> Iterator[tuple[int, int]]:
        """Iterate over a snapshot of the subjects and objects of a property."""
        for s, values in tuple(self._forward.get(p, {}).items()):
            for o in tuple(values):
                yield s, o

    def size(self, p: int) -> int:
        """Return the number of subjects of a property."""
        return len(self._forward.get(p, ()))

    def predicates(self) -> tuple[int, ...]:
        """Return the properties that have facts."""
        return tuple(p for p, by_subject in tuple(self._forward.items()) if by_subject)

    def add(self, s: int, p: int, o: int) -> bool:
        """Add a fact; False if it was there."""
        by_subject = self._forward.get(p)
        if by_subject is None:
            by_subject = self._forward[p] = {}
            self._inverse[p] = {}
        values = by_subject.get(s)
        if values is None:
            by_subject[s] = {o}
        elif o in values:
            return False
        else:
            values.add(o)
        by_object = self._inverse[p]
        if o in by_object:
            by_object[o].add(s)
        else:
            by_object[o] = {s}
        self._size += 1
        return True

    def discard(self, s: int, p: int, o: int) -> bool:
        """Remove a fact; False if it was not there."""
        if not self.has(s, p, o):
            return False
        for index, key, value in ((self._forward[p], s, o), (self._inverse[p], o, s)):
            values = index[key]
            values.discard(value)
            if not values:
                del index[key]
        self._size -= 1
        return True

    def adopt(self, other: Facts) -> None:
        """Take over the contents of another set, which is not used any more."""
        self._forward, self._inverse = other._forward, other._inverse
        self._size = other._size

    def about(self, number: int) -> list[Fact]:
        """Return the facts that mention an id as subject, predicate or object."""
        found: list[Fact] = [(s, number, o) for s, o in self.pairs(number)]
        for p in self.predicates():
            found += [(number, p, o) for o in self.objects(p, number)]
            found += [(s, p, number) for s in self.subjects(p, number) if s != number]
        return found


class Layer:
    """A set of facts seen through changes that have not been applied.

    Examples
    --------
    >>> base = Facts([(300, 301, 302)])
    >>> layer = Layer(base)
    >>> layer.add(300, 301, 303), layer.discard(300, 301, 302), layer.objects(301, 300)
    (True, True, {303})
    >>> base.objects(301, 300)
    {302}
    """

    __slots__ = ("added", "base", "removed")

    def __init__(self, base: Facts) -> None:
        self.base = base
        self.added = Facts()
        self.removed = Facts()

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

    def objects(self, p: int, s: int) -> set[int] | frozenset[int]:
        """Return the objects of a subject after the changes."""
        return _overlay(
            self.base.objects(p, s), self.added.objects(p, s), self.removed.objects(p, s)
        )

    def subjects(self, p: int, o: int) -> set[int] | frozenset[int]:
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
        """Return about how many subjects a property has."""
        return self.base.size(p) + self.added.size(p)

    def predicates(self) -> tuple[int, ...]:
        """Return the properties that may have facts."""
        return tuple({*self.base.predicates(), *self.added.predicates()})

    def add(self, s: int, p: int, o: int) -> bool:
        """Add a fact; False if it holds already."""
        if self.base.has(s, p, o):
            return len(self.removed) > 0 and self.removed.discard(s, p, o)
        return self.added.add(s, p, o)

    def discard(self, s: int, p: int, o: int) -> bool:
        """Remove a fact; False if it does not hold."""
        if self.added.discard(s, p, o):
            return True
        return self.base.has(s, p, o) and self.removed.add(s, p, o)

    def about(self, number: int) -> list[Fact]:
        """Return the facts that mention an id, after the changes."""
        found = [fact for fact in self.base.about(number) if fact not in self.removed]
        return found + self.added.about(number)

    def apply(self) -> None:
        """Write the changes into the base."""
        if not len(self.base):
            self.base.adopt(self.added)
            self.added = Facts()
        for fact in self.removed:
            self.base.discard(*fact)
        for fact in self.added:
            self.base.add(*fact)
        self.added, self.removed = Facts(), Facts()


def _overlay(
    base: set[int] | frozenset[int],
    added: set[int] | frozenset[int],
    removed: set[int] | frozenset[int],
) -> set[int] | frozenset[int]:
    if removed:
        base = base - removed
    if not added:
        return base
    return base | added if base else added
