"""The interface between a server and the graph that it serves, wherever that is stored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sized
from typing import Any, Protocol

from rtask.errors import UnsupportedError
from rtask.graph import Graph
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Change, Commit
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.readers.request import ReaderLimits
from rtask.kb.readers.streams import Stream
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import NamedNode

__all__ = ["ServedGraph", "ServedReaders", "embedded"]


class ServedReaders(Protocol):
    """The processes that answer queries."""

    @property
    def limits(self) -> ReaderLimits:
        """Number of queries that run at a time, and the limits of each."""

    @property
    def possible(self) -> bool:
        """Whether queries are answered by processes that can be stopped."""

    @property
    def evaluate_updates(self) -> bool:
        """Whether they evaluate updates, too."""

    @property
    def may_ask_now(self) -> bool:
        """Whether a query can be sent to one without completing the store first."""

    def start(self, wait: bool = True, updates: bool = False) -> None:
        """Start a process in advance."""


class ServedGraph(Graph, Protocol):
    """A graph that answers SPARQL requests.

    :class:`~rtask.knowledge_base.KnowledgeBase` is the embedded one; parts of the server that need
    more than this take it from :func:`embedded`.
    """

    @property
    def plain(self) -> bool:
        """Whether this is a bare SPARQL dataset: no union, inference or provenance."""

    @property
    def base(self) -> str:
        """IRI that starts every instance and graph."""

    @property
    def epoch(self) -> str:
        """Identifier of the current commit numbering."""

    @property
    def seq(self) -> int:
        """Number of the last commit."""

    @property
    def readers(self) -> ServedReaders:
        """The processes that answer queries."""

    @property
    def store(self) -> Sized:
        """The statements, to be counted."""

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
    ) -> Stream:
        """Evaluate a query and return its answer in pieces."""

    def update(
        self,
        text: str,
        agent: str | None = None,
        note: str | None = None,
        using: Iterable[NamedNode | str] = (),
        named: Iterable[NamedNode | str] = (),
        *,
        access: Access | None = None,
        base: str | None = None,
        if_version: int | None = None,
        limits: UpdateLimits | None = None,
    ) -> Commit | None:
        """Run a SPARQL update as one commit, with the rights and within the limits of a caller."""

    def on_commit(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Call a function after each commit; return a function that ends this."""

    def warm_up(self) -> None:
        """Start now what the first request would otherwise start."""

    def publish(self, **facts: Any) -> None:
        """Tell other processes on this machine about the server."""


def embedded(graph: ServedGraph, what: str = "this") -> KnowledgeBase:
    """Return the knowledge base embedded in this process.

    Parameters
    ----------
    what
        Beginning of the error, before "needs the embedded store".

    Raises
    ------
    UnsupportedError
        The graph is stored at another server.
    """
    if isinstance(graph, KnowledgeBase):
        return graph
    raise UnsupportedError(f"{what} needs the embedded store: rtask serve --data DIR")
