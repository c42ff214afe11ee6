"""Storage on another machine: a store that passes everything on to a SPARQL 1.1 server.

Queries and updates pass through. What needs the embedded store (recognition, rights on graphs,
inference, the change feed, blobs, writing whole graphs) is refused as ``501 unsupported``.
"""

from __future__ import annotations

import itertools
import secrets
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from endpoint.rosbridge.messages import JsonObject
from endpoint.rosbridge.services import Operation
from rtask.engine.operations.table import OPERATIONS
from rtask.errors import ForbiddenError, QueryTimeout, RemoteUnavailableError, UnsupportedError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Change
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.readers.request import ReaderLimits
from rtask.kb.readers.streams import Stream, WholeStream
from rtask.rdf.terms import NamedNode
from rtask.remote.discovery import connect
from rtask.remote.knowledge_base import RemoteKnowledgeBase
from rtask.sparql.syntax import check_query
from rtask.wire.message import Answer

READERS = 32


@dataclass(frozen=True)
class _Readers:
    """No reader processes: the other server does the work."""

    limits: ReaderLimits = field(default_factory=lambda: ReaderLimits(count=READERS))
    possible: bool = False
    evaluate_updates: bool = False
    may_ask_now: bool = False

    def start(self, wait: bool = True, updates: bool = False) -> None:
        """Do nothing."""


class RemoteStore(RemoteKnowledgeBase):
    """A SPARQL server in the place of an embedded graph: an ``endpoint.served.ServedGraph``.

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

    def __init__(self, address: str, token: str | None = None, timeout_s: float = 30.0) -> None:
        endpoints = connect(address, token, timeout_s)
        endpoints.connection.close()
        super().__init__(endpoints.query_url, endpoints.update_url, token, timeout_s)
        self.epoch = secrets.token_hex(4)
        self.readers = _Readers()
        self._numbers = itertools.count(1)

    @property
    def base(self) -> str:
        """Base against which relative IRIs are resolved."""
        return self.query_url

    @property
    def seq(self) -> int:
        """A number that never repeats."""
        return next(self._numbers)

    def stream(
        self,
        text: str,
        media_type: str | None = None,
        *,
        timeout_s: float | None = None,
        inferred: bool = True,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        base_iri: str | None = None,
        gzip: bool = False,
        max_rows: int | None = None,
        max_bytes: int | None = None,
        on_start: Callable[[Stream], None] | None = None,
        quick: bool | None = None,
    ) -> WholeStream:
        """Evaluate a query; its answer comes in one piece, within the other server's limits.

        Raises
        ------
        QueryTimeout
            The other server did not answer in time; it may still be working.
        RemoteUnavailableError
            It does not answer at all.
        """
        check_query(text, base_iri or self.base)
        form = media_type or "application/sparql-results+json"
        until = None if timeout_s is None else time.monotonic() + timeout_s
        try:
            data = self.ask(text, form, default_graphs, named_graphs, timeout_s)
        except RemoteUnavailableError:
            if until is not None and time.monotonic() >= until:
                raise QueryTimeout(
                    f"no answer from the store within {timeout_s:g} s; it may go on working"
                ) from None
            raise
        return WholeStream(data, form)

    def update(
        self,
        text: str,
        agent: str | None = None,
        note: str | None = None,
        using: Iterable[NamedNode | str] = (),
        named: Iterable[NamedNode | str] = (),
        *,
        base: str | None = None,
        access: Access | None = None,
        if_version: int | None = None,
        limits: UpdateLimits | None = None,
    ) -> None:
        """Pass an update on, at most once; the other server sets its own limits, takes no note.

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
        super().update(text, agent, using=using, named=named, base=base)

    def on_commit(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Do nothing: commits of another server are not observed."""
        return lambda: None

    def publish(self, **facts: object) -> None:
        """Do nothing: there is no folder."""

    def warm_up(self) -> None:
        """Do nothing: there are no readers."""

    @property
    def store(self) -> _Count:
        """An object whose length is the number of statements."""
        return _Count(self)


class _Count:
    """Counts the statements of the other server."""

    def __init__(self, kb: RemoteKnowledgeBase) -> None:
        self._kb = kb

    def __len__(self) -> int:
        everywhere = "{ ?s ?p ?o } UNION { GRAPH ?g { ?s ?p ?o } }"
        rows = self._kb.select(f"SELECT (COUNT(*) AS ?n) {{ {everywhere} }}")
        return int(str(rows[0].value("n")))


class EngineElsewhere:
    """Stand-in for the engine over a remote store: lists its operations and refuses them all."""

    operations: Mapping[str, Operation] = OPERATIONS

    def call(self, name: str, args: JsonObject, access: Access) -> Answer:
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
