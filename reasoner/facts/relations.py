"""Facts by property, both ways round: sets for what changes, arrays for what is large."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Protocol

from reasoner.facts import arrays
from reasoner.facts.arrays import Column
from reasoner.terms.dictionary import Fact
from reasoner.terms.vocabulary import LITERAL

Ids = set[int] | frozenset[int]
EMPTY: frozenset[int] = frozenset()

LARGE = 20_000
"""Relations with more pairs stay in arrays when they are first probed; smaller become sets.

A probe of a set takes 0.1 microseconds, of an array 1; a pair takes 150 bytes in sets, 16 in
arrays.
"""


def _has_none(_s: int, _o: int) -> bool:
    return False


class Relation(Protocol):
    """The pairs of one property."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[tuple[int, int]]: ...

    def has(self, s: int, o: int) -> bool:
        """Tell whether a pair is in the relation."""

    def objects(self, s: int) -> Ids:
        """Return the objects of a subject; not to be changed by the caller."""

    def subjects(self, o: int) -> Ids:
        """Return the subjects of an object; not to be changed by the caller."""

    def add(self, s: int, o: int) -> bool:
        """Add a pair; False if it was there."""

    def update(self, pairs: Iterable[tuple[int, int]]) -> int:
        """Add pairs; return how many were not there."""

    def discard(self, s: int, o: int) -> bool:
        """Remove a pair; False if it was not there."""

    def column(self) -> Column:
        """Return all pairs as they are now."""


class SetRelation:
    """Pairs as sets by subject and by object."""

    __slots__ = ("_forward", "_inverse", "_size")

    def __init__(self, pairs: Iterable[tuple[int, int]] = ()) -> None:
        self._forward: dict[int, set[int]] = {}
        self._inverse: dict[int, set[int]] = {}
        self._size = 0
        self.update(pairs)

    def __len__(self) -> int:
        return self._size

    def __iter__(self) -> Iterator[tuple[int, int]]:
        for s, values in tuple(self._forward.items()):
            for o in tuple(values):
                yield s, o

    def has(self, s: int, o: int) -> bool:
        """Tell whether a pair is in the relation."""
        return o in self._forward.get(s, EMPTY)

    def objects(self, s: int) -> Ids:
        """Return the objects of a subject; not to be changed by the caller."""
        return self._forward.get(s, EMPTY)

    def subjects(self, o: int) -> Ids:
        """Return the subjects of an object; not to be changed by the caller."""
        return self._inverse.get(o, EMPTY)

    def add(self, s: int, o: int) -> bool:
        """Add a pair; False if it was there."""
        values = self._forward.get(s)
        if values is None:
            self._forward[s] = {o}
        elif o in values:
            return False
        else:
            values.add(o)
        others = self._inverse.get(o)
        if others is None:
            self._inverse[o] = {s}
        else:
            others.add(s)
        self._size += 1
        return True

    def update(self, pairs: Iterable[tuple[int, int]]) -> int:
        """Add pairs; return how many were not there."""
        forward, inverse, before = self._forward, self._inverse, self._size
        size = before
        # In line: ten thousand calls of `add` are a third of what a commit of as many costs here.
        for s, o in pairs:
            values = forward.get(s)
            if values is None:
                forward[s] = {o}
            elif o in values:
                continue
            else:
                values.add(o)
            others = inverse.get(o)
            if others is None:
                inverse[o] = {s}
            else:
                others.add(s)
            size += 1
        self._size = size
        return size - before

    def discard(self, s: int, o: int) -> bool:
        """Remove a pair; False if it was not there."""
        if not self.has(s, o):
            return False
        for index, key, value in ((self._forward, s, o), (self._inverse, o, s)):
            index[key].discard(value)
            if not index[key]:
                del index[key]
        self._size -= 1
        return True

    def column(self) -> Column:
        """Return all pairs as they are now."""
        subjects = [s for s, values in self._forward.items() for _ in values]
        objects = [o for values in self._forward.values() for o in values]
        return Column.of(subjects, objects)


class ArrayRelation:
    """A large immutable column with small sets of what came and went since."""

    __slots__ = ("_added", "_column", "_removed")

    def __init__(self, column: Column) -> None:
        self._column = column
        self._added = SetRelation()
        self._removed = SetRelation()

    def __len__(self) -> int:
        return len(self._column) + len(self._added) - len(self._removed)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        yield from self._added
        for s, o in self._column:
            if not self._removed.has(s, o):
                yield s, o

    def has(self, s: int, o: int) -> bool:
        """Tell whether a pair is in the relation."""
        if self._added.has(s, o):
            return True
        return self._column.has(s, o) and not self._removed.has(s, o)

    def column(self) -> Column:
        """Return all pairs as they are now."""
        keys = self._column.keys
        if len(self._removed):
            keys = keys[~arrays.is_in(keys, self._removed.column().keys)]
        if len(self._added):
            keys = arrays.merge(keys, self._added.column().keys)
        return self._column if keys is self._column.keys else Column(keys)

    def objects(self, s: int) -> Ids:
        """Return the objects of a subject."""
        objects = set(self._column.objects(s).tolist())
        return (objects - self._removed.objects(s)) | self._added.objects(s)

    def subjects(self, o: int) -> Ids:
        """Return the subjects of an object."""
        subjects = set(self._column.subjects(o).tolist())
        return (subjects - self._removed.subjects(o)) | self._added.subjects(o)

    def add(self, s: int, o: int) -> bool:
        """Add a pair; False if it was there."""
        # The two sets hold differences only: a pair of the column that comes back is one fewer.
        if self._column.has(s, o):
            return self._removed.discard(s, o)
        return self._added.add(s, o)

    def update(self, pairs: Iterable[tuple[int, int]]) -> int:
        """Add pairs; return how many were not there."""
        return sum(self.add(s, o) for s, o in pairs)

    def discard(self, s: int, o: int) -> bool:
        """Remove a pair; False if it was not there."""
        if self._added.discard(s, o):
            return True
        return self._column.has(s, o) and self._removed.add(s, o)


class Facts:
    """A set of facts, one relation per property.

    Examples
    --------
    >>> facts = Facts([(300, 301, 302)])
    >>> facts.add(300, 301, 303), facts.add(300, 301, 302)
    (True, False)
    >>> facts.objects(301, 300), facts.subjects(301, 302), len(facts)
    ({302, 303}, {300}, 2)
    """

    __slots__ = ("_columns", "_highest", "_relations", "_size")
    work: None = None
    """Joins on facts that are not about to change are not bounded."""

    def __init__(self, facts: Iterable[Fact] = ()) -> None:
        self._relations: dict[int, Relation] = {}
        self._columns: dict[int, Column] = {}
        self._highest: int | None = None
        self._size = 0
        for fact in facts:
            self.add(*fact)

    @classmethod
    def of(cls, columns: Mapping[int, Column]) -> Facts:
        """Take columns over; each becomes a relation when it is first probed."""
        facts = cls()
        facts._columns = {p: column for p, column in columns.items() if len(column)}
        facts._size = sum(map(len, columns.values()))
        return facts

    def replace(self, facts: Iterable[Fact]) -> None:
        """Hold these facts instead, as columns until they are probed."""
        columns = arrays.columns_of(facts)
        self._relations = {}
        self._columns = columns
        self._highest = None
        self._size = sum(map(len, self._columns.values()))

    def _relation(self, p: int) -> Relation | None:
        relation = self._relations.get(p)
        column = self._columns.get(p)
        if relation is not None or column is None:
            return self._relations.get(p)
        made: Relation = ArrayRelation(column) if len(column) > LARGE else SetRelation(column)
        # Two readers may arrive at once; whoever was first is right.
        relation = self._relations.setdefault(p, made)
        self._columns.pop(p, None)
        return relation

    def _contents(self, p: int) -> Relation | Column | None:
        relation = self._relations.get(p)
        return self._columns.get(p) if relation is None else relation

    def __len__(self) -> int:
        return self._size

    def __iter__(self) -> Iterator[Fact]:
        for p in self.predicates():
            for s, o in self.pairs(p):
                yield s, p, o

    def __contains__(self, fact: Fact) -> bool:
        return self.has(*fact)

    def has(self, s: int, p: int, o: int) -> bool:
        """Tell whether a fact is in the set."""
        relation = self._relations.get(p)
        if relation is None and self._columns:
            relation = self._relation(p)
        return relation is not None and relation.has(s, o)

    def _has(self, p: int) -> Callable[[int, int], bool]:
        relation = self._relation(p)
        return _has_none if relation is None else relation.has

    def among(self, facts: set[Fact]) -> set[Fact]:
        """Return the given facts that are in the set."""
        if len(facts) < LARGE:
            has = {p: self._has(p) for p in {p for _, p, _ in facts}}
            return {fact for fact in facts if has[fact[1]](fact[0], fact[2])}
        # Sorted arrays are compared at once; to probe the facts one by one would make sets of all.
        own, asked = self.columns(), Facts()
        present: set[Fact] = set()
        asked.replace(facts)
        for p, column in asked.columns().items():
            if p in own:
                common = Column(column.keys[arrays.is_in(column.keys, own[p].keys)])
                present.update((s, p, o) for s, o in common)
        return present

    def objects(self, p: int, s: int) -> Ids:
        """Return the objects of a subject; not to be changed by the caller."""
        relation = self._relations.get(p)
        if relation is None and self._columns:
            relation = self._relation(p)
        return EMPTY if relation is None else relation.objects(s)

    def subjects(self, p: int, o: int) -> Ids:
        """Return the subjects of an object; not to be changed by the caller."""
        relation = self._relations.get(p)
        if relation is None and self._columns:
            relation = self._relation(p)
        return EMPTY if relation is None else relation.subjects(o)

    def pairs(self, p: int) -> Iterator[tuple[int, int]]:
        """Iterate over the subjects and objects of a property."""
        return iter(self._contents(p) or ())

    def size(self, p: int) -> int:
        """Return the number of facts of a property."""
        return len(self._contents(p) or ())

    def columns(self) -> dict[int, Column]:
        """Return all facts as columns, by property."""
        columns = dict(self._columns)
        columns.update((p, relation.column()) for p, relation in self._relations.items())
        return {p: column for p, column in columns.items() if len(column)}

    def predicates(self) -> tuple[int, ...]:
        """Return the properties that have facts."""
        return tuple(p for p in {*tuple(self._columns), *tuple(self._relations)} if self.size(p))

    def add(self, s: int, p: int, o: int) -> bool:
        """Add a fact; False if it was there."""
        relation = self._relation(p)
        if relation is None:
            relation = self._relations.setdefault(p, SetRelation())
        if relation.add(s, o):
            self._size += 1
            return True
        return False

    def update(self, p: int, pairs: Iterable[tuple[int, int]]) -> None:
        """Add facts of one property."""
        relation = self._relation(p)
        if relation is None:
            relation = self._relations.setdefault(p, SetRelation())
        self._size += relation.update(pairs)

    def discard(self, s: int, p: int, o: int) -> bool:
        """Remove a fact; False if it was not there."""
        relation = self._relation(p)
        if relation is not None and relation.discard(s, o):
            self._size -= 1
            return True
        return False

    def about(self, number: int) -> list[Fact]:
        """Return the facts that mention an id as subject, predicate or object."""
        facts: list[Fact] = [(s, number, o) for s, o in self.pairs(number)]
        columns = () if self._is_later(number) else tuple(self._columns.items())
        for p, column in columns:  # not worth a relation
            facts += [(number, p, o) for o in column.objects(number).tolist()]
            facts += [(s, p, number) for s in column.subjects(number).tolist() if s != number]
        for p, relation in tuple(self._relations.items()):
            facts += [(number, p, o) for o in relation.objects(number)]
            facts += [(s, p, number) for s in relation.subjects(number) if s != number]
        return facts

    def _is_later(self, number: int) -> bool:
        """Tell whether a resource is newer than all that the columns mention.

        Merging new terms asks for each of them what is about it, over all properties.
        """
        if self._highest is None:
            columns = tuple(self._columns.values())
            self._highest = max((column.highest_resource() for column in columns), default=0)
        return self._highest < number < LITERAL
