"""Changes of the inferred graph; large ones stay columns of ids until somebody looks at them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from reasoner.facts.arrays import Column, Keys
from reasoner.facts.changes import FactChange, without
from reasoner.facts.equality import Equality
from reasoner.facts.layer import Asserted, Layer
from reasoner.facts.relations import Facts
from reasoner.reading import Reading
from reasoner.terms.dictionary import Dictionary, Fact, Term, Triple
from reasoner.terms.vocabulary import SAME

__all__ = ["Triples", "difference", "missing_and_surplus", "small_difference"]


class Triples(Collection[Triple]):
    """Triples kept as columns of ids; each pass over them recreates the terms.

    Parameters
    ----------
    columns : dict of int to (n,) uint64
        Subjects and objects by property, ascending.
    """

    def __init__(self, columns: Mapping[int, Keys], terms: Dictionary) -> None:
        self._columns = {p: Column(keys) for p, keys in columns.items() if len(keys)}
        self._terms = terms

    def __len__(self) -> int:
        return sum(map(len, self._columns.values()))

    def __iter__(self) -> Iterator[Triple]:
        for p, column in self._columns.items():
            yield from self._terms.decode_column(p, column)

    def ntriples(self) -> bytes:
        """Return the triples as N-Triples, in a fraction of the time of making the terms."""
        write = self._terms.write_column
        return "".join(line for p, c in self._columns.items() for line in write(p, c)).encode()

    def having(self, predicate: Term) -> Iterator[Triple]:
        """Yield the triples with a predicate; the others are not looked at."""
        p = self._terms.find(predicate)
        if p in self._columns:
            yield from self._terms.decode_column(p, self._columns[p])

    def parts(self, size: int) -> Iterator[Triples]:
        """Yield the triples in parts of at most so many."""
        part: dict[int, Keys] = {}
        count = 0
        for p, column in self._columns.items():
            for at in range(0, len(column), size):
                keys = column.keys[at : at + size]
                if count + len(keys) > size:
                    yield Triples(part, self._terms)
                    part, count = {}, 0
                part[p] = keys
                count += len(keys)
        if part:
            yield Triples(part, self._terms)

    def __contains__(self, triple: object) -> bool:
        if not isinstance(triple, tuple) or len(triple) != 3:
            return False
        s, p, o = map(self._terms.find, triple)
        if s is None or p is None or o is None or p not in self._columns:
            return False
        return self._columns[p].has(s, o)


def difference(before: Reading, after: Reading) -> tuple[FactChange, dict[int, Keys]]:
    """Return how the inferred graph changes from one state to another, and what stays in it."""
    was, now = before.exported(), after.exported()
    change = FactChange.between(was, now)
    return change, without(now, change.added)


def missing_and_surplus(
    reading: Reading, stored_triples: Iterable[Triple]
) -> tuple[Triples, list[Triple]]:
    """Compare the inferred graph with the one in a store.

    Parameters
    ----------
    stored_triples : iterable of Triple
        The content of the store's inferred graph; read once.

    Returns
    -------
    missing : Triples
        Inferred triples that the store lacks.
    surplus : list of Triple
        Triples in the store that are not inferred.
    """
    terms, exported = reading.terms, reading.exported()
    encodable: list[Fact] = []
    surplus: list[Triple] = []
    for triple in stored_triples:
        s, p, o = map(terms.find, triple)
        if s is None or p is None or o is None:
            surplus.append(triple)
        else:
            encodable.append((s, p, o))
    # Through the same columns as the closure's own, so that the comparison is one of sorted arrays.
    held = Facts()
    held.replace(encodable)
    stored = {p: column.keys for p, column in held.columns().items()}
    surplus += Triples(without(stored, exported), terms)
    return Triples(without(exported, stored), terms), surplus


def small_difference(
    before: Reading, after: Reading, changed: Asserted
) -> tuple[set[Fact], set[Fact]]:
    """Return the facts that enter and leave the inferred graph with a few others.

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
    # A class that was merged or split rewrites all facts about its members, not only the changed
    # ones.
    for term in merged:
        old.update(before.facts.about(before.equality.find(term)))
        new.update(after.facts.about(after.equality.find(term)))
    ends = {x for s, p, o in touched if p == SAME for x in (s, o)}
    was = {*before.inferred(old), *before.equalities(merged | ends)}
    now = {*after.inferred(new), *after.equalities(merged | ends)}
    return now - was, was - now


def _changed_classes(before: Equality, after: Equality) -> set[int]:
    # Most changes touch no equality.
    if before == after:
        return set()
    members = {m for e in (before, after) for _, ms in e.classes() for m in ms}
    return {m for m in members if before.members(m) != after.members(m)}
