"""Interface of every knowledge base, embedded or on a server, as ``rtask.open`` returns it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

from pyoxigraph import Quad, RdfFormat

from rtask.errors import UnsupportedError
from rtask.kb.commit.commit import Commit
from rtask.loader.load import LoadReport
from rtask.rdf.terms import NamedNode, Subject, Value
from rtask.sparql.bindings import Bindings
from rtask.sparql.results import Solutions, Triples

__all__ = ["Changes", "Graph"]


class Changes(Protocol):
    """Changes that become one commit when the ``with`` block ends, or nothing if it fails."""

    def add(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Assert a statement."""

    def remove(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Withdraw a statement from one graph."""

    def update(self, text: str) -> None:
        """Run a SPARQL update on the pending state."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


class Graph(Protocol):
    """A knowledge base, wherever its statements are stored.

    :class:`rtask.KnowledgeBase` is the embedded one and has more methods; on a server,
    :class:`rtask.remote.knowledge_base.RemoteKnowledgeBase` raises
    :class:`~rtask.errors.UnsupportedError` for what SPARQL 1.1 Protocol cannot express. On one of
    RTASK, :class:`rtask.remote.served.ServedKnowledgeBase` has Python objects as well.
    """

    @property
    def folder(self) -> Path | None:
        """Folder of the graph; ``None`` in memory and on a server."""

    def query(
        self,
        text: str,
        *,
        default_graphs: Iterable[NamedNode | str] | None = None,
        named_graphs: Iterable[NamedNode | str] | None = None,
        bindings: Bindings | None = None,
        base: str | None = None,
        timeout_s: float | None = None,
    ) -> Solutions | bool | Triples:
        """Evaluate a SPARQL query."""

    def select(self, text: str, **options: Any) -> Solutions:
        """Evaluate a SELECT; the same as :meth:`query`, typed for rows."""
        answer = self.query(text, **options)
        if not isinstance(answer, Solutions):
            raise UnsupportedError("select() is for SELECT queries")
        return answer

    def serialize(self, text: str, media_type: str, *, bindings: Bindings | None = None) -> bytes:
        """Evaluate a query and return its answer in a media type."""

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: NamedNode | str | None = None,
    ) -> list[Quad]:
        """Return the statements that fit a pattern; ``None`` fits everything."""

    def update(
        self,
        text: str,
        agent: str | None = None,
        note: str | None = None,
        using: Iterable[NamedNode | str] = (),
        named: Iterable[NamedNode | str] = (),
        *,
        base: str | None = None,
    ) -> Commit | None:
        """Run a SPARQL update as one commit; a server does not say what it stored.

        Raises
        ------
        UnsupportedError
            An agent or a note for a server, which takes the agent from the token.
        """

    def transaction(self, agent: str | None = None, note: str | None = None) -> Changes:
        """Return a context manager whose changes become one commit; arguments as in update."""

    def load(
        self,
        source: Path | str | bytes,
        format: RdfFormat | str | None = None,
        *,
        graph: NamedNode | str | None = None,
        base: str | None = None,
    ) -> LoadReport | int:
        """Load a document; return a report, or from a server the number of statements sent."""

    def close(self) -> None:
        """Make everything durable and release the folder or the connection."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
