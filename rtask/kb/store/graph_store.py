"""A quad store that can be closed explicitly.

pyoxigraph closes a store only when its last reference is dropped, and a traceback may keep a
reference for long. Other code therefore refers to :class:`GraphStore`, which drops its reference
on ``close()``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, Protocol

from pyoxigraph import BlankNode, DefaultGraph, NamedNode, Quad, Store

from rtask.errors import ClosedError, StorageFullError, StoreFormatError
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import GraphName, Subject, Term, stored
from rtask.sparql.lexer import names_dataset

__all__ = ["GraphStore"]

_ATTEMPTS = 20
_PAUSE_S = 0.05
_OPEN = nullcontext()
_COMPLETE = nullcontext(True)


class Gate(Protocol):
    """Something that completes the store before a read begins."""

    def concerns(self, graph: GraphName) -> bool:
        """Whether the content of a graph may not be complete."""

    def reading(self) -> AbstractContextManager[None]:
        """Return the context in which a read that may see these graphs begins."""

    @property
    def is_behind(self) -> bool:
        """Whether the next read must complete the store first."""

    def reading_now(self) -> AbstractContextManager[bool]:
        """Return the context in which a read may begin, if that needs no waiting."""

    def flush(self) -> None:
        """Complete the store."""

    def excluding(self) -> AbstractContextManager[None]:
        """Let no read begin in the block, where the store holds neither the old nor the new."""


class GraphStore:
    """Quad store of a knowledge base.

    Parameters
    ----------
    store
        The store; the caller must keep no other reference to it.

    Attributes
    ----------
    is_stuck
        Whether a write failed because the disk was full; see :meth:`reopen`.
    is_view
        Whether the default graph is a view of all named graphs, computed by each query instead of
        stored; see :mod:`rtask.kb.store.union`.
    followers
        Functions that :func:`rtask.kb.store.apply.apply` calls with the changes of each commit.
    gate
        Completes the store before a read begins; ``None`` if it is always complete. Methods of this
        class take care of it; what reads :attr:`raw` begins inside :meth:`complete`.
    """

    __slots__ = ("_path", "_store", "followers", "gate", "is_stuck", "is_view")

    def __init__(self, store: Store, path: str | None = None) -> None:
        self._store: Store | None = store
        self._path = path
        self.is_stuck = False
        self.followers: list[Callable[[Any], None]] = []
        self.is_view = False
        self.gate: Gate | None = None

    @property
    def is_complete(self) -> bool:
        """Whether a read can begin without completing the store first."""
        return self.gate is None or not self.gate.is_behind

    def complete_now(self) -> AbstractContextManager[bool]:
        """Return a context that tells whether a read may begin in it, as in :meth:`complete`.

        Unlike that it never waits for the store to be completed; for event loops.
        """
        return _COMPLETE if self.gate is None else self.gate.reading_now()

    def complete(self, graph: GraphName | None = None) -> AbstractContextManager[None]:
        """Return the context in which a read of a graph, or of any with ``None``, begins."""
        gate = self.gate
        if gate is None or (graph is not None and not gate.concerns(graph)):
            return _OPEN
        return gate.reading()

    @property
    def raw(self) -> Store:
        """The underlying store; do not keep a reference.

        Raises
        ------
        ClosedError
            After :meth:`close`.
        """
        if self._store is None:
            raise ClosedError("the knowledge base is closed")
        return self._store

    @property
    def folder(self) -> Path | None:
        """Folder of the knowledge base; ``None`` in memory."""
        return None if self._path is None else Path(self._path).parent

    @property
    def is_open(self) -> bool:
        """Whether the store is open."""
        return self._store is not None

    def reopen(self) -> None:
        """Reopen the store, which refuses every write after the disk was full.

        Raises
        ------
        StorageFullError
            The disk is still full, or the store is still being read.
        """
        if self._path is None:
            return
        self._store = None
        for attempt in range(_ATTEMPTS):
            try:
                self._store = Store(self._path)
                self.is_stuck = False
                return
            except OSError as error:
                if attempt + 1 == _ATTEMPTS or "lock" not in str(error).lower():
                    self._store = Store.read_only(self._path)
                    raise StorageFullError(f"the store cannot be written: {error}") from error
                time.sleep(_PAUSE_S)

    def close(self) -> None:
        """Release the files."""
        self._store = None

    def __contains__(self, quad: Quad) -> bool:
        try:
            with self.complete(quad.graph_name):
                return quad in self.raw
        except RuntimeError as error:
            raise self._failed(error) from error

    def __len__(self) -> int:
        try:
            with self.complete():
                return len(self.raw)
        except RuntimeError as error:
            raise self._failed(error) from error

    def _failed(self, error: RuntimeError) -> Exception:
        """Return the error for a failure of the store, distinguishing damaged files."""
        if "orruption" not in str(error):
            return error
        folder = Path(self._path).parent if self._path else Path()
        return StoreFormatError(
            f"the store in {folder} is damaged: {error}; restore a backup, or rebuild the store "
            f"from the journal: rtask rebuild store -d {folder}",
            damaged="store",
        )

    def quads_for_pattern(
        self,
        subject: Subject | None,
        predicate: NamedNode | None,
        value: Term | None,
        graph: GraphName | None = None,
    ) -> Iterator[Quad]:
        """Yield the quads that match; consume them in this thread.

        An exhausted iterator drops its reference to the store.
        """
        if self.is_view and isinstance(graph, DefaultGraph):
            yield from self._view(subject, predicate, value)
            return
        try:
            with self.complete(graph):
                found = self.raw.quads_for_pattern(subject, predicate, value, graph)
            if _is_named(value) and _is_named(subject) and not isinstance(graph, BlankNode):
                yield from found
            else:
                yield from _fitting(found, subject, value, graph)
        except RuntimeError as error:
            raise self._failed(error) from error

    def _view(
        self, subject: Subject | None, predicate: NamedNode | None, value: Term | None
    ) -> Iterator[Quad]:
        seen: set[Quad] = set()
        for quad in self.quads_for_pattern(subject, predicate, value, None):
            one = Quad(quad.subject, quad.predicate, quad.object)
            if one not in seen and not Graphs.is_quarantine(quad.graph_name):
                seen.add(one)
                yield one

    def count(self, graph: GraphName) -> int:
        """Return the number of triples in a named graph."""
        if not isinstance(graph, NamedNode):
            return sum(1 for _ in self.quads_for_pattern(None, None, None, graph))
        text = f"SELECT (COUNT(*) AS ?n) {{ GRAPH {graph} {{ ?s ?p ?o }} }}"
        with self.complete(graph):
            [row] = self.raw.query(text)  # type: ignore[misc]
        return int(row["n"].value)

    def named_graphs(self) -> Iterator[GraphName]:
        """Yield the names of the named graphs, empty ones included."""
        with self.complete():
            return self.raw.named_graphs()

    def contains_named_graph(self, graph: GraphName) -> bool:
        """Whether a named graph exists."""
        with self.complete(graph):
            return self.raw.contains_named_graph(graph)

    def query(self, text: str, **options: Any) -> Any:
        """Evaluate a query; consume the answer in this thread."""
        if self.is_view and "default_graph" not in options and not names_dataset(text):
            options["use_default_graph_as_union"] = True
        try:
            with self.complete():
                return self.raw.query(text, **options)
        except RuntimeError as error:
            raise self._failed(error) from error

    def update(self, text: str, **options: Any) -> None:
        """Run an update atomically."""
        try:
            self.raw.update(text, **options)
        except RuntimeError as error:
            raise self._failed(error) from error

    def extend(self, quads: Iterable[Quad]) -> None:
        """Add quads, all or none."""
        try:
            self.raw.extend(quads)
        except RuntimeError as error:
            raise self._failed(error) from error

    def bulk_extend(self, quads: Iterable[Quad]) -> None:
        """Add many quads fast, but not atomically: a process killed meanwhile leaves some."""
        try:
            self.raw.bulk_extend(quads)
        except RuntimeError as error:
            raise self._failed(error) from error

    def flush(self) -> None:
        """Force everything to disk."""
        if self.gate is not None:
            self.gate.flush()
        try:
            self.raw.flush()
        except RuntimeError as error:
            raise self._failed(error) from error


def _is_named(term: Subject | Term | None) -> bool:
    return term is None or isinstance(term, NamedNode)


def _fitting(
    found: Iterable[Quad], subject: Subject | None, value: Term | None, graph: GraphName | None
) -> Iterator[Quad]:
    """Yield only the quads that really match.

    On disk, pyoxigraph reads past a term whose encoding ends in byte 255: a pattern with the number
    255 also yields 256 to 510. The same holds for dates, short strings and short blank node labels.
    Terms stored by their hash, and SPARQL, are not affected.
    """
    wanted = None if value is None else stored(value)
    for quad in found:
        if wanted is not None and quad.object != wanted:
            continue
        if subject is not None and quad.subject != subject:
            continue
        if graph is not None and quad.graph_name != graph:
            continue
        yield quad
