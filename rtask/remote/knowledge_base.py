"""Remote knowledge base: :class:`rtask.graph.Graph` implemented by a SPARQL 1.1 server.

Queries, updates, transactions and loads use the SPARQL 1.1 Protocol. The server is responsible for
rights, reasoning and provenance. Methods that need the embedded store raise
:class:`UnsupportedError`. A server of RTASK offers more: :mod:`rtask.remote.served`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn

import httpx
from pyoxigraph import BlankNode, NamedNode, Quad, RdfFormat

from rtask.errors import UnsupportedError, UsageError
from rtask.graph import Changes, Graph
from rtask.rdf.terms import (
    Subject,
    Value,
    iri,
    is_ground,
    object_term,
    subject_term,
    written,
)
from rtask.remote.discovery import connect
from rtask.remote.transport import Connection, read_whole
from rtask.sparql.bindings import Bindings, bind
from rtask.sparql.lexer import query_form
from rtask.sparql.results import Solutions, Triples
from rtask.sparql.syntax import check_query, check_update
from rtask.sparql.update_outline import read_update

__all__ = ["RemoteKnowledgeBase", "open_remote"]

_ROWS = "application/sparql-results+json"
_TRIPLES = "application/n-triples"
_PIECE = 20_000
_WITHOUT = {
    "annotations": "query the reifiers",
    "as_of": "restore a backup on the server",
    "backup": "back up the server's folder",
    "blobs": "keep blobs on the server",
    "catalogue": "query the meta graph",
    "contradictions": "ask the server",
    "explain": "ask the server",
    "graphs": "name the graph by its IRI",
    "history": "query the provenance graph",
    "on_commit": "subscribe at the server",
    "near": "ask the server",
    "rebuild": "run `rtask rebuild` on the server",
    "retract": "send an update",
    "search": "run `rtask search` on the server",
    "session": "open a folder, or the address without plain=True",
    "stream": "use serialize()",
    "subscribe": "subscribe at the server",
    "subscribe_query": "subscribe at the server",
    "verify": "run `rtask verify` on the server",
}


class RemoteKnowledgeBase(Graph):
    """A SPARQL 1.1 server, used like an embedded knowledge base.

    Parameters
    ----------
    query_url, update_url
        Addresses of the server's query and update endpoints.
    token
        Sent as a bearer token.
    timeout_s
        Time limit for one answer.
    """

    folder = None
    keeps_authors = False
    """Whether the server records who changes what, as one of RTASK does."""

    def __init__(
        self,
        query_url: str,
        update_url: str | None = None,
        token: str | None = None,
        timeout_s: float = 30.0,
    ) -> None:
        self.query_url = query_url
        self.update_url = update_url or query_url
        self._connection = Connection(token, timeout_s)

    def query(
        self,
        text: str,
        *,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        bindings: Bindings | None = None,
        base: str | None = None,
        timeout_s: float | None = None,
        inferred: bool = True,
    ) -> Solutions | bool | Triples:
        """Evaluate a SPARQL query; see :meth:`KnowledgeBase.query`.

        Only a server of RTASK can leave derived statements out (``inferred=False``); others show
        what they have.

        Raises
        ------
        QuerySyntaxError
            The text does not parse; it is checked before anything is sent.
        RemoteUnavailableError
            No complete answer after three attempts.
        QueryTimeout
            No complete answer within ``timeout_s``.
        """
        text = bind(text, bindings or {})
        check_query(text, base or self.query_url)
        rows = query_form(text) in ("select", "ask")
        form = _ROWS if rows else _TRIPLES
        answer = self.ask(text, form, default_graphs, named_graphs, timeout_s, inferred)
        return read_whole("rows" if rows else "triples", answer)

    def ask(
        self,
        text: str,
        media_type: str,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        timeout_s: float | None = None,
        inferred: bool = True,
    ) -> bytes:
        """Send a query that has been checked; return its answer in a media type."""
        fields = [("query", text), *_dataset("default-graph-uri", default_graphs)]
        fields += _dataset("named-graph-uri", named_graphs)
        if not inferred:
            fields.append(("inferred", "0"))
        return self._send(self.query_url, fields, media_type, True, timeout_s).content

    def serialize(self, text: str, media_type: str, bindings: Bindings | None = None) -> bytes:
        """Evaluate a query and return its answer in a media type."""
        text = bind(text, bindings or {})
        check_query(text, self.query_url)
        return self.ask(text, media_type)

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: NamedNode | str | None = None,
    ) -> list[Quad]:
        """Return the statements of named graphs that match; ``None`` matches everything."""
        given: Mapping[str, Any] = {
            "s": None if subject is None else subject_term(subject),
            "p": None if predicate is None else iri(predicate),
            "o": None if value is None else object_term(value),
            "g": None if graph is None else iri(graph),
        }
        bound = {name: term for name, term in given.items() if term is not None}
        rows = self.select("SELECT ?s ?p ?o ?g { GRAPH ?g { ?s ?p ?o } }", bindings=bound)
        return [Quad(*row) for row in rows]

    def update(
        self,
        text: str,
        agent: str | None = None,
        note: str | None = None,
        using: Iterable[NamedNode | str] = (),
        named: Iterable[NamedNode | str] = (),
        *,
        base: str | None = None,
    ) -> None:
        """Run a SPARQL update as one request.

        It is sent again only if it is certain not to have run.

        Parameters
        ----------
        agent, note
            Author of the change and what he says about it, as a server of RTASK records them. Who
            shows a token is its agent, and can name no other.

        Raises
        ------
        UnsupportedError
            An agent or a note is given, and the server is not one of RTASK.
        ForbiddenError
            The token belongs to another agent.
        """
        author = self._author(agent, note)
        check_update(read_update(text), base or self.update_url)
        fields = [("update", text), *_dataset("using-graph-uri", using)]
        fields += _dataset("using-named-graph-uri", named)
        self._send(self.update_url, [*fields, *author], "*/*", False)

    def _send(
        self,
        url: str,
        fields: list[tuple[str, str]],
        accept: str,
        repeat: bool,
        timeout_s: float | None = None,
    ) -> httpx.Response:
        """Send a request; see :meth:`Connection.send`."""
        return self._connection.send(url, fields, accept, repeat=repeat, timeout_s=timeout_s)

    def _author(self, agent: str | None, note: str | None) -> list[tuple[str, str]]:
        """Return the fields that name the author of a change and what he says about it."""
        given = [(k, v) for k, v in (("agent", agent), ("note", note)) if v is not None]
        if given and not self.keeps_authors:
            raise UnsupportedError(
                f"{self.query_url} is no server of RTASK, or was opened as a plain dataset: it "
                "records neither agents nor notes; omit both"
            )
        return given

    def transaction(self, agent: str | None = None, note: str | None = None) -> RemoteTransaction:
        """Return a context manager whose changes become one update request.

        Raises
        ------
        UnsupportedError
            An agent or a note is given, and the server is not one of RTASK.
        """
        self._author(agent, note)
        return RemoteTransaction(self, agent, note)

    def load(
        self,
        source: bytes | str | Path,
        format: RdfFormat | str | None = None,
        graph: NamedNode | str | None = None,
        base: str | None = None,
    ) -> int:
        """Add a document's statements; return how many.

        The document is sent in pieces, each atomic. All statements with blank nodes are in the
        first, so that they keep sharing their nodes.
        """
        from rtask.rdf.formats import read_document

        quads = read_document(source, format, base)
        blank = [quad for quad in quads if not _is_ground(quad)]
        ground = [quad for quad in quads if _is_ground(quad)]
        first = max(0, _PIECE - len(blank))
        pieces = [[*blank, *ground[:first]]]
        pieces += [ground[at : at + _PIECE] for at in range(first, len(ground), _PIECE)]
        target = None if graph is None else iri(graph)
        for piece in filter(None, pieces):
            self.update(_insert_data(piece, target))
        return len(quads)

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    def __getattr__(self, name: str) -> Any:
        if name in _WITHOUT:
            raise UnsupportedError(f"{name} needs the embedded store; {_WITHOUT[name]}")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __reduce__(self) -> NoReturn:
        # Its token would go with it to wherever it is unpickled.
        raise UsageError(
            "an open knowledge base is neither pickled nor copied: it holds a connection and a "
            f"token; pass on where it is ({self.query_url}), and open that in the other process"
        )

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.query_url}>"


class RemoteTransaction(Changes):
    """Changes that are collected and sent as one update."""

    def __init__(
        self, kb: RemoteKnowledgeBase, agent: str | None = None, note: str | None = None
    ) -> None:
        self._kb, self._agent, self._note = kb, agent, note
        self._operations: list[str] = []

    def add(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Assert a statement; without a graph, the server chooses it."""
        self._data("INSERT", subject, predicate, value, graph)

    def remove(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Withdraw a statement."""
        self._data("DELETE", subject, predicate, value, graph)

    def _data(
        self,
        verb: str,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None,
    ) -> None:
        quad = Quad(subject_term(subject), iri(predicate), object_term(value))
        if not _is_ground(quad):
            raise UnsupportedError("blank nodes cannot be named to a server; use an IRI")
        text = _insert_data([quad], None if graph is None else iri(graph))
        self._operations.append(text.replace("INSERT", verb, 1))

    def update(self, text: str) -> None:
        """Add an update, which sees the changes made before it."""
        check_update(read_update(text))
        self._operations.append(text)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and self._operations:
            self._kb.update(" ;\n".join(self._operations), self._agent, self._note)


def open_remote(
    address: str, token: str | None = None, timeout_s: float = 30.0
) -> RemoteKnowledgeBase:
    """Return the bare dataset at an address; nothing is sent if it names both endpoints.

    >>> open_remote("sparql+http://host:81/?query=/q&update=/u").update_url
    'http://host:81/u'

    Raises
    ------
    AuthenticationError, ForbiddenError, RemoteUnavailableError, CallFailedError
        As :func:`rtask.remote.discovery.find_places` does.
    """
    endpoints = connect(address, token, timeout_s)
    endpoints.connection.close()
    return RemoteKnowledgeBase(endpoints.query_url, endpoints.update_url, token, timeout_s)


def _dataset(name: str, graphs: Iterable[NamedNode | str] | None) -> list[tuple[str, str]]:
    return [(name, iri(graph).value) for graph in graphs or ()]


def _is_ground(quad: Quad) -> bool:
    return is_ground(quad.subject) and is_ground(quad.object)


def _term(term: Any) -> str:
    return f"_:{term.value}" if isinstance(term, BlankNode) else written(term)


def _insert_data(quads: Iterable[Quad], graph: NamedNode | None) -> str:
    by_graph: dict[str, list[str]] = {}
    for quad in quads:
        named = quad.graph_name if isinstance(quad.graph_name, NamedNode) else graph
        line = f"{_term(quad.subject)} {quad.predicate} {_term(quad.object)} ."
        by_graph.setdefault("" if named is None else str(named), []).append(line)
    blocks = []
    for name, lines in by_graph.items():
        body = "\n".join(lines)
        blocks.append(f"GRAPH {name} {{ {body} }}" if name else body)
    return "INSERT DATA { " + "\n".join(blocks) + " }"
