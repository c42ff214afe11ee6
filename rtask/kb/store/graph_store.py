"""Interface of the store of a knowledge base.

:class:`rtask.kb.store.embedded.EmbeddedStore` keeps the quads in this process, on disk or in
memory; :class:`rtask.remote.store.RemoteStore` on a SPARQL 1.1 server. Commits, the catalogue,
inference, rights, validation and the feed work on this interface and know neither.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

from pyoxigraph import NamedNode, Quad

from rtask.kb.store.writes import Writes
from rtask.rdf.terms import GraphName, Subject, Term, TripleKey

__all__ = ["Gate", "GraphStore"]

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


class GraphStore(ABC):
    """Quads of a knowledge base, wherever they are stored.

    Attributes
    ----------
    is_stuck
        Whether a write failed because the disk was full; see :meth:`reopen`.
    is_view
        Whether the default graph is a view of all named graphs, computed by each query instead of
        stored; see :mod:`rtask.kb.store.union`.
    followers
        Functions that :meth:`tell` calls with the changes of each commit.
    gate
        Completes the store before a read begins; ``None`` if it is always complete. Methods of this
        class take care of it; what reads the files begins inside :meth:`complete`.
    writes
        Number of changes of which :meth:`tell` told.
    """

    __slots__ = ("followers", "gate", "is_stuck", "is_view", "writes")

    def __init__(self) -> None:
        self.is_stuck = False
        self.followers: list[Callable[[Writes], None]] = []
        self.is_view = False
        self.gate: Gate | None = None
        self.writes = 0

    def changed(self) -> None:  # noqa: B027 - most stores copy nothing
        """Forget what is copied of the store, after a change other than by :meth:`apply`."""

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
    @abstractmethod
    def folder(self) -> Path | None:
        """Folder with the quads; ``None`` if they are in memory or elsewhere."""

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """Whether the store is open."""

    @abstractmethod
    def reopen(self) -> None:
        """Recover from a full disk."""

    @abstractmethod
    def close(self) -> None:
        """Release the files or the connection."""

    @abstractmethod
    def __contains__(self, quad: Quad) -> bool: ...

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def quads_for_pattern(
        self,
        subject: Subject | None,
        predicate: NamedNode | None,
        value: Term | None,
        graph: GraphName | None = None,
    ) -> Iterator[Quad]:
        """Yield the quads that match; consume them in this thread."""

    def tell(self, writes: Writes) -> None:
        """Tell those that follow the store of a change, after it was made."""
        self.writes += 1
        for follower in list(self.followers):
            follower(writes)

    def lacking(self, quads: Iterable[Quad]) -> list[Quad]:
        """Return those of some quads that the store does not hold."""
        return [quad for quad in quads if quad not in self]

    def holders(self, key: TripleKey) -> list[GraphName]:
        """Return the graphs that hold a triple."""
        return [quad.graph_name for quad in self.quads_for_pattern(*key, None)]

    def holders_of_each(self, keys: Iterable[TripleKey]) -> dict[TripleKey, list[GraphName]]:
        """Return the graphs that hold each of some triples."""
        return {key: self.holders(key) for key in keys}

    @abstractmethod
    def count(self, graph: GraphName) -> int:
        """Return the number of triples in a graph."""

    @abstractmethod
    def named_graphs(self) -> Iterator[GraphName]:
        """Yield the names of the named graphs, empty ones included."""

    @abstractmethod
    def contains_named_graph(self, graph: GraphName) -> bool:
        """Whether a named graph exists."""

    @abstractmethod
    def query(self, text: str, *, timeout_s: float | None = None, **options: Any) -> Any:
        """Evaluate a query; options and answer are those of ``pyoxigraph.Store.query``.

        Consume the answer in this thread.

        Parameters
        ----------
        timeout_s
            Time limit where another process answers; a store in this one has none.
        """

    @abstractmethod
    def update(self, text: str, **options: Any) -> None:
        """Run an update atomically; options are those of ``pyoxigraph.Store.update``."""

    def begin_change(self) -> None:  # noqa: B027 - nothing to do in this process
        """Prepare for a change by this thread; called with the writer's lock."""

    def end_change(self) -> None:  # noqa: B027 - nothing to do in this process
        """End the change, whether it was stored or not."""

    def prefetch(self, subjects: Iterable[Subject]) -> None:  # noqa: B027 - nothing to do in this process
        """Expect look-ups of these subjects in this change; a store elsewhere asks for all now."""

    def with_values(
        self, pairs: Sequence[tuple[NamedNode, Term]], most: int
    ) -> list[tuple[int, Quad]]:
        """Return statements with these properties and values, each with the number of its pair.

        A store elsewhere is asked once for all pairs.

        Parameters
        ----------
        most
            About how many are returned of each pair.
        """
        return [
            (number, quad)
            for number, (predicate, value) in enumerate(pairs)
            for quad in islice(self.quads_for_pattern(None, predicate, value, None), most)
        ]

    def scratch(self) -> GraphStore:
        """Return a store in this process with the same content, on which an update may be tried.

        The update is made to fail, so that this may be the store itself.
        """
        return self

    @abstractmethod
    def apply(self, writes: Writes) -> None:
        """Store the changes of one commit, all or none."""

    @abstractmethod
    def bulk_extend(self, quads: Iterable[Quad]) -> None:
        """Add many quads fast, but not atomically: a process killed meanwhile leaves some."""

    @abstractmethod
    def flush(self) -> None:
        """Force everything to disk."""
