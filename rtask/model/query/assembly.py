"""Answers of a query from its rows: objects with what they refer to, or plain values."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Iterator
from dataclasses import replace
from decimal import Decimal
from typing import Any, Protocol, TypeVar, overload

import pyoxigraph as ox

from rtask.errors import UsageError
from rtask.model.codec import decode
from rtask.model.instance import Model, Property, eager
from rtask.model.query import compile as compiled
from rtask.model.query.expressions import After, Path
from rtask.model.query.plan import Plan, check_root
from rtask.model.reading import Facts, Reader, collect
from rtask.model.view import View
from rtask.rdf.terms import NamedNode, Term
from rtask.sparql.results import Solutions

__all__ = ["Asking", "Assembly", "PlainAnswers", "plain_value"]

A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")
D = TypeVar("D")
E = TypeVar("E")
F = TypeVar("F")
G = TypeVar("G")
H = TypeVar("H")


class Asking(Protocol):
    """A session as its queries see it."""

    @property
    def view(self) -> View:
        """What answers them."""

    @property
    def reader(self) -> Reader:
        """What makes objects of the answers."""

    def flush_before_query(self) -> None:
        """Write the changes so far if the session does so before queries."""

    def delete(self, instance: Model) -> None:
        """Withdraw the agent's own statements about an object, and those that point to it."""


class Assembly:
    """Assembles objects from rows of statements."""

    def __init__(self, reader: Reader, plan: Plan, rows: Solutions) -> None:
        self._reader = reader
        self._plan = plan
        self._order: dict[str, list[tuple[int, Any]]] = {}
        self._facts: dict[str, Facts] = {}
        facts_of: dict[tuple[str, str], Facts] = {}
        last: tuple[Term | None, Term | None] = (None, None)
        subject_facts: Facts = {}
        for root, subject, predicate, value, *keys in rows.tuples():
            if subject != last[1] or root != last[0]:  # a subject's rows are mostly adjacent
                last, name = (root, subject), term_name(root)
                subject_facts = facts_of.setdefault((name, term_name(subject)), {})
                if subject == root and name not in self._order:  # every root has a type
                    self._order[name] = [_sort_key(key) for key in keys]
            collect(subject_facts, term_name(predicate), value)
        for (
            _,
            name,
        ), facts in facts_of.items():  # objects shared by several roots came with each of them
            self._facts[name] = facts | self._facts.get(name, {})

    def objects(self) -> list[Any]:
        """Return the roots in order; everything prefetched is in the identity map."""
        names = self._sorted()
        origin = self._plan.model.__name__ if len(names) > 1 else None
        made = self._make(names, (), self._plan.model, origin)
        self._follow(list(made.values()), origin)
        return list(made.values())

    def _sorted(self) -> list[str]:
        names = sorted(self._order)
        for at in reversed(range(len(self._plan.orders))):
            descending = self._plan.orders[at].descending
            keys = {name: self._order[name][at] for name in names}
            names.sort(key=keys.__getitem__, reverse=descending)
        return names

    def _make(
        self,
        names: Iterable[str],
        path: tuple[Property, ...],
        asked: type[Model],
        origin: str | None,
    ) -> dict[str, Model]:
        fetched = eager(asked, self._plan.following(path))
        make, facts = self._reader.materialise, self._facts
        return {name: make(name, asked, facts.get(name, {}), fetched, origin) for name in names}

    def _follow(self, roots: list[Model], origin: str | None) -> None:
        """Create the prefetched objects, breadth first; each is kept alive by a reference to it."""
        level: dict[tuple[Property, ...], list[Model]] = {(): roots}
        while level:
            below: dict[tuple[Property, ...], list[Model]] = {}
            for path, objects in level.items():
                for step in self._plan.following(path):
                    longer = (*path, step)
                    linked = [_linked(item, step) for item in objects]
                    names = dict.fromkeys(name for listed in linked for name in listed)
                    made = self._make(names, longer, step.target() or Model, origin)
                    for item, listed in zip(objects, linked, strict=True):
                        item.__state__.companions += [made[name] for name in listed]
                    below[longer] = list(made.values())
            level = below


def _linked(instance: Model, step: Property) -> list[str]:
    values = instance.__state__.loaded.get(step.iri, ())
    return [value.value for value in values if isinstance(value, NamedNode)]


def term_name(term: Term | None) -> str:
    """Return an IRI without angle brackets, or the text of another term."""
    return term.value if isinstance(term, NamedNode) else str(term)


def plain_value(term: Term | None) -> Any:
    """Return a term as a Python value; an IRI as text."""
    if term is None:
        return None
    return term.value if isinstance(term, NamedNode) else decode(term)


def _sort_key(term: Term | None) -> tuple[int, Any]:
    """Return a key that sorts as SPARQL does: unbound, blank nodes, IRIs, literals."""
    if term is None:
        return (0, "")
    if isinstance(term, ox.BlankNode):
        return (1, term.value)
    if isinstance(term, NamedNode):
        return (2, term.value)
    value = decode(term)
    if isinstance(value, bool | int | float | Decimal):
        return (3, value)
    if isinstance(value, str):
        return (4, value)
    if isinstance(value, dt.datetime):
        return (5, value if value.tzinfo else value.replace(tzinfo=dt.UTC))
    return (6, str(term))


class PlainAnswers:
    """The part of a query that needs no objects."""

    def __init__(self, session: Asking, plan: Plan) -> None:
        self._session = session
        self._plan = plan

    def _select(self, text: str) -> Solutions:
        self._session.flush_before_query()
        return self._session.view.rows(text)

    def count(self) -> int:
        """Return the number of objects."""
        return int(str(self._select(compiled.count_text(self._plan))[0].value("n")))

    def exists(self) -> bool:
        """Return whether there is such an object."""
        self._session.flush_before_query()
        return self._session.view.holds(compiled.ask_text(self._plan))

    def ids(self) -> list[str]:
        """Return the IRIs of the objects, in order."""
        rows = self._select(compiled.id_text(self._plan))
        names = [term_name(row["root"]) for row in rows]
        return names if self._plan.orders else sorted(names)

    @overload
    def values(self, a: Path[A], /, *, batch: int | None = None) -> Iterator[tuple[A | None]]: ...
    @overload
    def values(
        self, a: Path[A], b: Path[B], /, *, batch: int | None = None
    ) -> Iterator[tuple[A | None, B | None]]: ...
    @overload
    def values(
        self, a: Path[A], b: Path[B], c: Path[C], /, *, batch: int | None = None
    ) -> Iterator[tuple[A | None, B | None, C | None]]: ...
    @overload
    def values(
        self, a: Path[A], b: Path[B], c: Path[C], d: Path[D], /, *, batch: int | None = None
    ) -> Iterator[tuple[A | None, B | None, C | None, D | None]]: ...
    @overload
    def values(
        self,
        a: Path[A],
        b: Path[B],
        c: Path[C],
        d: Path[D],
        e: Path[E],
        /,
        *,
        batch: int | None = None,
    ) -> Iterator[tuple[A | None, B | None, C | None, D | None, E | None]]: ...
    @overload
    def values(
        self,
        a: Path[A],
        b: Path[B],
        c: Path[C],
        d: Path[D],
        e: Path[E],
        f: Path[F],
        /,
        *,
        batch: int | None = None,
    ) -> Iterator[tuple[A | None, B | None, C | None, D | None, E | None, F | None]]: ...
    @overload
    def values(
        self,
        a: Path[A],
        b: Path[B],
        c: Path[C],
        d: Path[D],
        e: Path[E],
        f: Path[F],
        g: Path[G],
        /,
        *,
        batch: int | None = None,
    ) -> Iterator[tuple[A | None, B | None, C | None, D | None, E | None, F | None, G | None]]: ...
    @overload
    def values(
        self,
        a: Path[A],
        b: Path[B],
        c: Path[C],
        d: Path[D],
        e: Path[E],
        f: Path[F],
        g: Path[G],
        h: Path[H],
        /,
        *,
        batch: int | None = None,
    ) -> Iterator[
        tuple[A | None, B | None, C | None, D | None, E | None, F | None, G | None, H | None]
    ]: ...
    @overload
    def values(self, *paths: Path[Any], batch: int | None = None) -> Iterator[tuple[Any, ...]]: ...
    def values(self, *paths: Path[Any], batch: int | None = None) -> Iterator[tuple[Any, ...]]:
        """Yield the values along paths; one tuple for each combination, ``None`` if missing.

        Values are Python values of the types that the fields declare, objects are their IRIs.
        Type checkers know the types of up to eight columns.

        Parameters
        ----------
        *paths
            One or more, which begin at the class of the query.
        batch
            Read so many objects at a time, in the order of their IRIs and in constant memory; each
            batch is one query, which begins after the last IRI. By default one query, which is
            run at once, reads all, and its rows are converted as they are consumed.

        Raises
        ------
        UsageError
            Without paths, for a path of another class, and for a batch together with ``order_by``,
            ``limit`` or ``offset``.
        """
        if not paths:
            raise UsageError("values() needs the paths to read, e.g. values(G.grasp_quality)")
        for path in paths:
            check_root(self._plan, path)
        if batch is None:
            return _plain(self._select(compiled.row_text(self._plan, paths)), len(paths))
        self._check_batch(batch, "values(batch=)")
        return self._batches(paths, batch)

    def _check_batch(self, batch: int, what: str) -> None:
        """Raise unless the objects can be read in batches of this size, by IRI."""
        if isinstance(batch, bool) or not isinstance(batch, int) or batch < 1:
            raise UsageError(f"expected a batch of 1 or more objects, not {batch!r}")
        if self._plan.orders or self._plan.limit is not None or self._plan.offset:
            raise UsageError(f"{what} sorts by IRI: remove order_by, limit and offset")

    def _page(self, last: str, batch: int) -> Plan:
        """Return the plan of the batch that begins after an IRI."""
        conditions = (*self._plan.conditions, (After(last),))
        return replace(self._plan, conditions=conditions, limit=batch)

    def _batches(self, paths: tuple[Path[Any], ...], batch: int) -> Iterator[tuple[Any, ...]]:
        last = ""
        while True:
            rows = self._select(compiled.page_text(self._page(last, batch), paths))
            yield from _plain(rows, len(paths))
            roots = {term_name(row[0]) for row in rows.tuples()}
            if len(roots) < batch:
                return
            last = max(roots)


def _plain(rows: Solutions, width: int) -> Iterator[tuple[Any, ...]]:
    """Convert the columns after the root; sort keys may follow them."""
    return (tuple(map(plain_value, row[1 : width + 1])) for row in rows.tuples())
