"""The graph store on a SPARQL 1.1 server.

A commit is one request that takes effect only if nobody else has committed since (compare and set):
a head, kept in the graph ``<base>graph/store``, names the last commit and who made it, and the
request replaces it. Asking for the head afterwards tells whether the commit took effect, so a
request whose answer was lost can be sent again without any risk. A claim before it keeps two
processes apart where the server itself does not (:mod:`rtask.remote.claim`).

What a commit needs to know about the store before is asked for in one query, by subject. What is
known about a subject is kept until the next commit, of this process or of another, which is noticed
within a second; a change of this process makes sure first that it knows of every commit.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from pyoxigraph import DefaultGraph, NamedNode, Quad, Store

from rtask.errors import ClosedError, TooLargeError, UnsupportedError
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import DEFAULT, GraphName, Subject, Term, stored, stored_quad, triple_key
from rtask.remote.dataset import directed
from rtask.remote.dialect import Dialect
from rtask.remote.endpoints import ROWS, TRIPLES, Endpoints
from rtask.remote.head import Head, HeadGraph
from rtask.sparql.lexer import query_form
from rtask.sparql.syntax import check_query

__all__ = ["RemoteStore"]

_SUBJECTS = 500
_MAX_CACHED = 20_000
_MAX_COPIED = 200_000


class RemoteStore(GraphStore):
    """Quads on a SPARQL 1.1 server.

    Parameters
    ----------
    dialect
        How the server keeps terms and graphs.
    graphs
        Names of the graphs.
    head
        The last commit, as read at opening.

    Attributes
    ----------
    head
        The last commit that this process knows of.
    record
        Text of the commit that is about to be stored, kept on the server with it.
    on_moved
        Called inside a change when another process has committed; it renews what this one knows.
    on_close
        Called before the connection is closed.
    """

    __slots__ = (
        "_cache",
        "_changing",
        "_copy",
        "_dialect",
        "_endpoints",
        "_generation",
        "_graphs",
        "_head_graph",
        "_is_open",
        "_is_pinned",
        "_names",
        "head",
        "on_close",
        "on_moved",
        "record",
    )  # fmt: skip

    def __init__(self, endpoints: Endpoints, dialect: Dialect, graphs: Graphs, head: Head) -> None:
        super().__init__()
        self._endpoints = endpoints
        self._dialect = dialect
        self._names = graphs
        self._head_graph = HeadGraph(endpoints, dialect)
        self._is_open = True
        self._cache: dict[Subject, dict[Quad, None]] = {}
        self._graphs: dict[GraphName, None] | None = None
        self._changing: int | None = None
        self._is_pinned = False
        self._generation = 0
        self._copy: tuple[Head, EmbeddedStore] | None = None
        self.head = head
        self.record: str | None = None
        self.on_moved: Callable[[], None] = lambda: None
        self.on_close: Callable[[], None] = lambda: None

    @property
    def endpoints(self) -> Endpoints:
        """The server's endpoints."""
        return self._endpoints

    @property
    def dialect(self) -> Dialect:
        """Dialect of the server: how it keeps terms and graphs."""
        return self._dialect

    @property
    def folder(self) -> Path | None:
        """None: the quads are elsewhere."""
        return None

    @property
    def is_open(self) -> bool:
        """Whether the store is open."""
        return self._is_open

    def reopen(self) -> None:
        """Do nothing: the server looks after its own disk."""

    def close(self) -> None:
        """Close the connection."""
        self._is_open = False
        self.on_close()
        self._endpoints.connection.close()

    def flush(self) -> None:
        """Do nothing: what the server has acknowledged is its own concern."""

    @property
    def catalogued(self) -> tuple[NamedNode, ...]:
        """Graphs whose entries in the catalogue change with most commits."""
        return self._names.meta, self._names.provenance, self._names.inferred

    # What a change knows about the store

    def begin_change(self) -> None:
        """Begin a change, which must know of every commit so far; called with the writer's lock."""
        if not self._is_open:
            raise ClosedError("the knowledge base is closed")
        self._is_pinned = False
        self._changing = threading.get_ident()

    def end_change(self) -> None:
        """End the change."""
        self._changing = None

    @property
    def _is_changing(self) -> bool:
        return self._changing == threading.get_ident()

    def forget(self) -> None:
        """Forget what was read before another process committed."""
        self._forget_statements()
        self._graphs = None

    def _forget_statements(self) -> None:
        self._generation += 1
        self._cache = {}
        self._copy = None

    def read_head(self) -> Head:
        """Return the last commit as the server has it."""
        return self._head_graph.read()

    def _pin(self) -> None:
        """Make sure, once in a change, that this process knows of every commit so far."""
        if self._is_changing and not self._is_pinned:
            self._is_pinned = True
            if self.read_head() != self.head:
                self.on_moved()

    def prefetch(self, subjects: Iterable[Subject]) -> None:
        """Ask for all statements about some subjects, in one query for several hundred of them."""
        missing = [s for s in dict.fromkeys(subjects) if s not in self._cache]
        for at in range(0, len(missing), _SUBJECTS):
            self._fetch(missing[at : at + _SUBJECTS])

    def _fetch(self, subjects: Sequence[Subject]) -> dict[Subject, dict[Quad, None]]:
        generation = self._generation
        values = " ".join(map(self._dialect.term, subjects))
        head = self._head_graph.pattern
        about = f"VALUES ?s {{ {values} }} GRAPH ?g {{ ?s ?p ?o }} {self._dialect.exactly}"
        rows = self._rows(f"SELECT ?s ?p ?o ?g ?t {{ {{ {about} }} UNION {{ {head('?o')} }} }}")
        heads = [Head.of(row[2]) for row in rows if row[0] is None and row[2] is not None]
        if self._is_changing and not self._is_pinned:
            self._is_pinned = True
            if heads != [self.head]:
                self.on_moved()
                return self._fetch(subjects)
        quads_of: dict[Subject, dict[Quad, None]] = {subject: {} for subject in subjects}
        for s, p, o, g, text in rows:
            if s is not None and g in self._named():
                quads_of[s][Quad(s, p, self._dialect.exact_object(o, text), g)] = None
        if generation == self._generation and heads == [self.head]:  # no commit in between
            if len(self._cache) > _MAX_CACHED:
                self._cache = {}
            self._cache.update(quads_of)
        return quads_of

    def _about(self, subject: Subject) -> Iterable[Quad]:
        """Return the statements about a subject, asking for them if they are not known."""
        if self._is_changing:
            self._pin()
        cached = self._cache.get(subject)
        return self._fetch([subject])[subject] if cached is None else cached

    # Reading

    def _rows(self, text: str) -> list[tuple[Any, ...]]:
        """Return the rows of a query in which GRAPH ranges over everything on the server."""
        return self._dialect.rows(self._endpoints.query(text))

    def _named(self) -> dict[GraphName, None]:
        if self._graphs is None:
            meta = self._dialect.graph(self._names.meta)
            rows = self._rows(f"SELECT DISTINCT ?g {{ GRAPH {meta} {{ ?g a ?kind }} }}")
            self._graphs = {row[0]: None for row in rows if isinstance(row[0], NamedNode)}
        return self._graphs

    def __contains__(self, quad: Quad) -> bool:
        quads = self._about(quad.subject)
        quad = self._dialect.canonical_quad(stored_quad(quad))
        if isinstance(quad.graph_name, DefaultGraph):
            key = triple_key(quad)
            return any(Graphs.is_joined(k.graph_name) and triple_key(k) == key for k in quads)
        return quad in quads

    def __len__(self) -> int:
        """Return the number of statements of the named graphs, counted in each that holds them."""
        rows = self._rows("SELECT ?g (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } } GROUP BY ?g")
        return sum(int(row[1].value) for row in rows if row[0] in self._named())

    def quads_for_pattern(
        self,
        subject: Subject | None,
        predicate: NamedNode | None,
        value: Term | None,
        graph: GraphName | None = None,
    ) -> Iterator[Quad]:
        """Yield the quads that match; those of every named graph if none is given."""
        canonical_value = None if value is None else self._dialect.canonical(stored(value))
        if subject is not None and graph != DEFAULT:
            quads = self._about(subject)
        else:
            if self._is_changing:
                self._pin()
            quads = self._matching(subject, predicate, canonical_value, graph)
        for quad in list(quads):
            if (
                (predicate is None or quad.predicate == predicate)
                and (canonical_value is None or quad.object == canonical_value)
                and (graph is None or quad.graph_name == graph)
            ):
                yield quad

    def _matching(
        self,
        subject: Subject | None,
        predicate: NamedNode | None,
        value: Term | None,
        graph: GraphName | None,
    ) -> list[Quad]:
        given: dict[str, Any] = {"s": subject, "p": predicate, "o": value, "g": graph}
        s, p, o = (
            f"?{name}" if given[name] is None else self._dialect.term(given[name])
            for name in ("s", "p", "o")
        )
        where = "?g" if graph is None else self._dialect.graph(graph)
        body = f"GRAPH {where} {{ {s} {p} {o} }}" if where else f"{s} {p} {o}"
        names = [name for name, term in given.items() if term is None]
        if not names:
            return [Quad(*given.values())] if self._ask(body) else []
        if value is None:
            names.append("t")
            body += f" {self._dialect.exactly}"
        quads = []
        for row in self._rows(f"SELECT {' '.join('?' + n for n in names)} {{ {body} }}"):
            bound = {**given, **dict(zip(names, row, strict=True))}
            if value is None:
                bound["o"] = self._dialect.exact_object(bound["o"], bound["t"])
            if graph is not None or bound["g"] in self._named():
                quads.append(Quad(bound["s"], bound["p"], bound["o"], bound["g"]))
        return quads

    def with_values(
        self, pairs: Sequence[tuple[NamedNode, Term]], most: int
    ) -> list[tuple[int, Quad]]:
        """Return statements with these properties and values, each with the number of its pair."""
        if not pairs:
            return []
        if self._is_changing:
            self._pin()
        term = self._dialect.term
        values = [self._dialect.canonical(stored(value)) for _, value in pairs]
        rows = " ".join(
            f"({number} {term(predicate)} {term(value)})"
            for number, ((predicate, _), value) in enumerate(zip(pairs, values, strict=True))
        )
        body = f"VALUES (?n ?p ?o) {{ {rows} }} GRAPH ?g {{ ?s ?p ?o }}"
        found = []
        for s, n, g in self._rows(f"SELECT ?s ?n ?g {{ {body} }} LIMIT {most * len(pairs)}"):
            number = int(n.value)
            if g in self._named():
                found.append((number, Quad(s, pairs[number][0], values[number], g)))
        return found

    def _ask(self, body: str) -> bool:
        return self._endpoints.ask(f"ASK {{ {body} }}")

    def count(self, graph: GraphName) -> int:
        """Return the number of triples in a graph."""
        name = self._dialect.graph(graph)
        body = f"GRAPH {name} {{ ?s ?p ?o }}" if name else "?s ?p ?o"
        [row] = self._rows(f"SELECT (COUNT(*) AS ?n) {{ {body} }}")
        return int(row[0].value)

    def named_graphs(self) -> Iterator[GraphName]:
        """Yield the names of the named graphs of this knowledge base, empty ones included."""
        if self._is_changing:
            self._pin()
        return iter(list(self._named()))

    def contains_named_graph(self, graph: GraphName) -> bool:
        """Whether a named graph of this knowledge base exists."""
        return graph in self._named()

    def query(
        self,
        text: str,
        *,
        timeout_s: float | None = None,
        default_graph: Sequence[NamedNode] | None = None,
        named_graphs: Sequence[NamedNode] | None = None,
        base_iri: str | None = None,
        **_: Any,
    ) -> Any:
        """Evaluate a query on the server.

        Raises
        ------
        QuerySyntaxError
            The text does not parse; it is checked before anything is sent.
        QueryTimeout, RemoteUnavailableError
            The server did not answer, in time or at all.
        """
        check_query(text, base_iri)
        if self._is_changing:
            self._pin()
        sent, fields = directed(
            self._dialect,
            text,
            default_graph,
            named_graphs,
            lambda: [graph for graph in self._named() if isinstance(graph, NamedNode)],
        )
        rows = query_form(text) in ("select", "ask")
        whole = sent if base_iri is None else f"BASE <{base_iri}>\n{sent}"
        data = self._endpoints.query(whole, ROWS if rows else TRIPLES, fields, timeout_s)
        return self._dialect.answer(data, rows)

    # Writing

    def update(self, text: str, **options: Any) -> None:
        """Refuse: changes are made by commits.

        Raises
        ------
        UnsupportedError
            Always.
        """
        raise UnsupportedError("a store on a SPARQL server is changed by commits only")

    def scratch(self) -> GraphStore:
        """Return a copy in memory, on which an update with pending changes is tried.

        Raises
        ------
        TooLargeError
            The store is too large to be copied.
        """
        if self._is_changing:
            self._pin()
        if self._copy is None or self._copy[0] != self.head:
            size = len(self)
            if size > _MAX_COPIED:
                raise TooLargeError(
                    f"a WHERE that sees earlier changes of the same commit needs a copy of the "
                    f"store, which has {size} statements, and {_MAX_COPIED} are allowed; commit "
                    "the earlier changes first",
                    limit="statements",
                    value=size,
                    allowed=_MAX_COPIED,
                )
            copy = Store()
            quads = self._matching(None, None, None, None)
            copy.bulk_extend(quads)
            joined = (q for q in quads if Graphs.is_joined(q.graph_name))
            copy.bulk_extend(Quad(q.subject, q.predicate, q.object) for q in joined)
            for graph in self._named():
                if isinstance(graph, NamedNode):
                    copy.add_graph(graph)
            self._copy = (self.head, EmbeddedStore(copy))
        return self._copy[1]

    def apply(self, writes: Writes) -> None:
        """Store a commit, unless somebody else has committed since.

        Raises
        ------
        VersionConflictError
            Somebody else has; nothing was stored.
        RemoteUnavailableError
            The server does not answer. Whether the commit is stored shows at the next contact.
        """
        new = self.head.next(secrets.token_hex(6), is_commit=self.record is not None)
        self._head_graph.replace(self.head, new, writes, self.record)
        self.head, self.record = new, None
        self._forget_statements()
        if self._graphs is not None:
            touched = {*writes.created, *(quad.graph_name for quad in writes.added)}
            self._graphs.update(dict.fromkeys(touched - {DEFAULT}))
            for graph in writes.dropped:
                self._graphs.pop(graph, None)

    def bulk_extend(self, quads: Iterable[Quad]) -> None:
        """Add many quads in several requests; a process killed meanwhile leaves some."""
        size = self._dialect.abilities.statements
        piece: list[Quad] = []
        for quad in quads:
            piece.append(quad)
            if len(piece) >= size:
                self._insert(piece)
                piece = []
        if piece:
            self._insert(piece)

    def _insert(self, quads: Sequence[Quad]) -> None:
        self._endpoints.update(f"INSERT DATA {{ {self._dialect.block(quads)} }}")
        if self._graphs is not None:
            self._graphs.update((q.graph_name, None) for q in quads if q.graph_name != DEFAULT)
        self._forget_statements()
