"""Statements that a session reads from a server before it writes, and its update."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from itertools import islice
from typing import Any

from pyoxigraph import NamedNode, Quad

from rtask.errors import UnsupportedError
from rtask.rdf.terms import Subject, Value, iri, is_ground, object_term, subject_term, written
from rtask.remote.knowledge_base import RemoteKnowledgeBase

__all__ = ["Collected", "Excerpt"]

_AT_ONCE = 500


class Excerpt:
    """The statements about some subjects, read in few queries; about others, each time again.

    Parameters
    ----------
    kb
        The server.
    subjects
        IRIs.
    """

    def __init__(self, kb: RemoteKnowledgeBase, subjects: Collection[str]) -> None:
        self._kb = kb
        self._about: dict[str, list[Quad]] = {name: [] for name in subjects}
        names = iter(subjects)
        while some := list(islice(names, _AT_ONCE)):
            listed = " ".join(str(NamedNode(name)) for name in some)
            text = f"SELECT ?s ?p ?o ?g {{ VALUES ?s {{ {listed} }} GRAPH ?g {{ ?s ?p ?o }} }}"
            for row in kb.select(text):
                quad = Quad(*row)
                self._about[str(row.value("s"))].append(quad)

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: Any = None,
    ) -> list[Quad]:
        """Return the statements that match; ``None`` matches everything."""
        name = subject if isinstance(subject, str) else getattr(subject, "value", None)
        if name not in self._about:
            return self._kb.match(subject, predicate, value, graph)
        return list(_matching(self._about[name], predicate, value, graph))


def _matching(
    quads: Iterable[Quad],
    predicate: NamedNode | str | None,
    value: Value | None,
    graph: NamedNode | str | None,
) -> Iterator[Quad]:
    p = None if predicate is None else iri(predicate)
    o = None if value is None else object_term(value)
    g = None if graph is None else iri(graph)
    for quad in quads:
        same = (p is None or quad.predicate == p) and (o is None or quad.object == o)
        if same and (g is None or quad.graph_name == g):
            yield quad


class Collected:
    """Changes that become one update: all that is withdrawn, then all that is asserted."""

    def __init__(self) -> None:
        self._removed: dict[Quad, None] = {}
        self._added: dict[Quad, None] = {}

    def __bool__(self) -> bool:
        return bool(self._removed or self._added)

    def add(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Assert a statement."""
        self._added[_quad(subject, predicate, value, graph)] = None

    def remove(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Withdraw a statement from one graph."""
        self._removed[_quad(subject, predicate, value, graph)] = None

    def text(self) -> str:
        """Return the update."""
        parts = (("DELETE", self._removed), ("INSERT", self._added))
        return " ;\n".join(f"{verb} DATA {{\n{_data(quads)}\n}}" for verb, quads in parts if quads)


def _quad(
    subject: Subject | str,
    predicate: NamedNode | str,
    value: Value,
    graph: NamedNode | str | None,
) -> Quad:
    where = None if graph is None else iri(graph)
    made = Quad(subject_term(subject), iri(predicate), object_term(value), where)
    if not (is_ground(made.subject) and is_ground(made.object)):
        raise UnsupportedError("blank nodes cannot be named to a server; use an IRI")
    return made


def _data(quads: Iterable[Quad]) -> str:
    lines = []
    for quad in quads:
        triple = f"{written(quad.subject)} {quad.predicate} {written(quad.object)}"
        named = isinstance(quad.graph_name, NamedNode)
        lines.append(f"GRAPH {quad.graph_name} {{ {triple} }}" if named else f"{triple} .")
    return "\n".join(lines)
