"""Assembly of the objects of a query from the rows of its answer."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import pyoxigraph as ox

from rtask.model.codec import decode
from rtask.model.fields import Field
from rtask.model.instance import Model
from rtask.model.query.plan import Plan, eager
from rtask.model.reading import Facts, collect
from rtask.rdf.terms import NamedNode, Term
from rtask.sparql.results import Solutions

if TYPE_CHECKING:
    from rtask.model.session import Session

__all__ = ["Assembly", "plain_value", "term_name"]


class Assembly:
    """Assembles objects from rows of statements."""

    def __init__(self, session: Session, plan: Plan, rows: Solutions) -> None:
        self._session = session
        self._plan = plan
        self._order: dict[str, list[tuple[int, Any]]] = {}
        self._facts: dict[str, Facts] = {}
        found: dict[tuple[str, str], Facts] = {}
        last: tuple[Term | None, Term | None] = (None, None)
        known: Facts = {}
        for root, subject, predicate, value, *keys in rows.tuples():
            if subject != last[1] or root != last[0]:  # a subject's rows are mostly adjacent
                last, name = (root, subject), term_name(root)
                known = found.setdefault((name, term_name(subject)), {})
                if subject == root and name not in self._order:  # every root has a type
                    self._order[name] = [_sort_key(key) for key in keys]
            collect(known, term_name(predicate), value)
        for (
            _,
            name,
        ), facts in found.items():  # objects shared by several roots came with each of them
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
        self, names: Iterable[str], path: tuple[Field, ...], asked: type[Model], origin: str | None
    ) -> dict[str, Model]:
        fetched = eager(asked, self._plan.following(path))
        make, facts = self._session.reader.materialise, self._facts
        return {name: make(name, asked, facts.get(name, {}), fetched, origin) for name in names}

    def _follow(self, roots: list[Model], origin: str | None) -> None:
        """Create the prefetched objects, breadth first; each is kept alive by a reference to it."""
        level: dict[tuple[Field, ...], list[Model]] = {(): roots}
        while level:
            below: dict[tuple[Field, ...], list[Model]] = {}
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


def _linked(instance: Model, step: Field) -> list[str]:
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
    if isinstance(value, bool | int | float):
        return (3, value)
    if isinstance(value, str):
        return (4, value)
    if isinstance(value, dt.datetime):
        return (5, value if value.tzinfo else value.replace(tzinfo=dt.UTC))
    return (6, str(term))
