"""Storage on another machine: a store that passes everything on to a SPARQL 1.1 server.

Queries and updates pass through. What needs the embedded store (recognition, rights on graphs,
inference, the change feed, blobs, writing whole graphs) is refused as ``501 unsupported``.
"""

from __future__ import annotations

import itertools
import secrets
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from endpoint.rosbridge.messages import JsonObject
from endpoint.rosbridge.services import Operation
from rtask.engine.operations.table import OPERATIONS
from rtask.errors import ForbiddenError, QueryTimeout, RemoteUnavailableError, UnsupportedError
from rtask.kb.commit.access import Access
from rtask.kb.readers.streams import WholeStream
from rtask.kb.remote.knowledge_base import open_remote
from rtask.kb.remote.transport import Connection
from rtask.sparql.bindings import bind
from rtask.sparql.results import Solutions
from rtask.sparql.syntax import check_query

READERS = 32


@dataclass(frozen=True)
class _Settings:
    """The settings of a knowledge base that a server shows."""

    epoch: str


@dataclass(frozen=True)
class _Limits:
    """Number of simultaneous queries."""

    count: int = READERS


@dataclass(frozen=True)
class _Readers:
    """No reader processes: the other server does the work."""

    limits: _Limits
    possible: bool = False
    evaluate_updates: bool = False


@dataclass(frozen=True)
class _Passed:
    """An update that was passed on; only the other server knows what it changed."""

    seq: int
    added: int | None = None
    removed: int | None = None
    derived: int | None = None


class RemoteStore:
    """A SPARQL server in the place of a knowledge base.

    Parameters
    ----------
    address
        As for :func:`rtask.open`: the address of queries and updates, or
        ``sparql+http://host:port/?query=/query&update=/update``.
    token
        Access token for the other server.
    timeout_s
        Time limit of one answer if the client names none.

    Notes
    -----
    Others may write to that server at any time, so :attr:`seq` never repeats and no client is told
    that it has an answer already.
    """

    plain = True
    folder = None

    def __init__(self, address: str, token: str | None = None, timeout_s: float = 30.0) -> None:
        self._remote = open_remote(address, token, timeout_s)
        self._connection = Connection(token, timeout_s)
        self.settings = _Settings(secrets.token_hex(4))
        self.readers = _Readers(_Limits())
        self._numbers = itertools.count(1)

    @property
    def base(self) -> str:
        """Base against which relative IRIs are resolved."""
        return self._remote.query_url

    @property
    def seq(self) -> int:
        """A number that never repeats."""
        return next(self._numbers)

    def query(self, text: str, **options: Any) -> Any:
        """Evaluate a query on the other server."""
        options.pop("inferred", None)
        return self._remote.query(text, **options)

    def select(self, text: str, **options: Any) -> Solutions:
        """Evaluate a SELECT on the other server."""
        return self._remote.select(text, **options)

    def serialize(
        self, text: str, media_type: str, bindings: Mapping[str, Any] | None = None
    ) -> bytes:
        """Evaluate a query and return its answer in a media type."""
        return self._remote.serialize(text, media_type, bindings)

    def stream(
        self,
        text: str,
        media_type: str,
        *,
        timeout_s: float,
        default_graphs: Iterable[Any] | None = None,
        named_graphs: Iterable[Any] | None = None,
        base_iri: str | None = None,
        **options: Any,
    ) -> WholeStream:
        """Evaluate a query; its answer comes in one piece.

        Raises
        ------
        QueryTimeout
            The other server did not answer in time; it may still be working.
        RemoteUnavailableError
            It does not answer at all.
        """
        text = bind(text, {})
        check_query(text, base_iri or self.base)
        parameters = [
            (name, str(getattr(graph, "value", graph)))
            for name, graphs in (
                ("default-graph-uri", default_graphs),
                ("named-graph-uri", named_graphs),
            )
            for graph in graphs or ()
        ]
        headers = {"Content-Type": "application/sparql-query", "Accept": media_type}
        until = time.monotonic() + timeout_s
        try:
            data = self._connection.send(
                self._remote.query_url, parameters, text, headers, True, timeout_s
            )
        except RemoteUnavailableError:
            if time.monotonic() >= until:
                raise QueryTimeout(
                    f"no answer from the store within {timeout_s:g} s; it may go on working"
                ) from None
            raise
        return WholeStream(data, media_type)

    def update(
        self,
        text: str,
        *,
        access: Access | None = None,
        using: Iterable[Any] = (),
        named: Iterable[Any] = (),
        base: str | None = None,
        if_version: int | None = None,
        note: str | None = None,
        limits: object = None,
    ) -> _Passed:
        """Pass an update on, at most once; the other server sets its own limits.

        Raises
        ------
        ForbiddenError
            The token is a robot's; only the embedded store knows which graph is whose.
        UnsupportedError
            The change depends on a version.
        """
        if access is not None and access.role not in ("admin", "anonymous"):
            raise ForbiddenError(
                "over a remote store only administrators write: rights on graphs need the "
                "embedded store", operation="update",
            )  # fmt: skip
        if if_version is not None:
            raise UnsupportedError("If-Match needs the embedded store")
        self._remote.update(text, using=using, named=named, base=base)
        return _Passed(self.seq)

    def on_commit(self, listener: Callable[[Any], None]) -> Callable[[], None]:
        """Do nothing: commits of another server are not observed."""
        return lambda: None

    def subscribe(self, *patterns: Any, **options: Any) -> Any:
        """Refuse.

        Raises
        ------
        UnsupportedError
            Always.
        """
        raise UnsupportedError("the change feed needs the embedded store")

    def publish(self, **facts: Any) -> None:
        """Do nothing: there is no folder."""

    def warm_up(self) -> None:
        """Do nothing: there are no readers."""

    @property
    def store(self) -> _Count:
        """An object whose length is the number of statements."""
        return _Count(self)

    def close(self) -> None:
        """Close the connections."""
        self._connection.close()
        self._remote.close()

    def __enter__(self) -> RemoteStore:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise UnsupportedError(f"{name} needs the embedded store: rtask serve --data DIR")


class _Count:
    """Counts the statements of the other server."""

    def __init__(self, kb: RemoteStore) -> None:
        self._kb = kb

    def __len__(self) -> int:
        everywhere = "{ ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } }"
        rows = self._kb.select(f"SELECT (COUNT(*) AS ?n) {{ {everywhere} }}")
        return int(str(rows[0].value("n")))


class EngineElsewhere:
    """Stand-in for the engine over a remote store: lists its operations and refuses them all."""

    operations: Mapping[str, Operation] = OPERATIONS

    def call(self, name: str, args: JsonObject, access: Access) -> JsonObject:
        """Refuse.

        Raises
        ------
        UnsupportedError
            Always.
        """
        raise UnsupportedError(
            f"{name} needs the embedded store, for its index of views and its conclusions: "
            "rtask serve --data DIR"
        )
