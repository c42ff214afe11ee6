"""Transactions: several changes that become one commit, or none.

The writer's lock is held for the whole ``with`` block, so data read inside it cannot change before
the commit. Do slow work before entering the block.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from pyoxigraph import NamedNode, Quad, RdfFormat

from rtask.errors import ClosedError, UsageError
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.commit.delta import UpdateDataset, prepare, run_update
from rtask.kb.commit.statements import notes, reification, reifier_of
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.blobs import BlobStore
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import (
    DefaultGraph,
    GraphName,
    Subject,
    Term,
    Value,
    iri,
    object_term,
    stored_quad,
    subject_term,
)

__all__ = ["Transaction"]


class Transaction:
    """A pending commit; created by :meth:`KnowledgeBase.transaction`.

    Examples
    --------
    >>> import rtask
    >>> with rtask.open(":memory:", reason=False) as kb:
    ...     with kb.transaction(agent="nao-1", note="first sight") as tx:
    ...         tx.add("urn:mug", "urn:mass", 0.3)
    ...     tx.commit.added
    1
    """

    def __init__(self, writer: Writer, blobs: BlobStore, request: Request) -> None:
        self._writer = writer
        self._blobs = blobs
        self._request = request
        self._overlay: Overlay | None = None
        self._commit: Commit | None = None
        self._notes: dict[tuple[NamedNode, NamedNode], list[Quad]] = {}

    @classmethod
    def of(cls, change: Overlay, writer: Writer, blobs: BlobStore, request: Request) -> Self:
        """Return a transaction on a change that somebody else commits."""
        transaction = cls(writer, blobs, request)
        transaction._overlay = change
        return transaction

    @property
    def commit(self) -> Commit:
        """The stored commit, available after the ``with`` block."""
        if self._commit is None:
            raise UsageError("the transaction has not been committed")
        return self._commit

    @property
    def home(self) -> GraphName:
        """The graph of statements added without a graph."""
        return self._request.access.home()

    def __enter__(self) -> Self:
        self._overlay = self._writer.begin()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        overlay, self._overlay = self._pending(), None
        if kind is not None:
            # An error inside the block leaves nothing behind.
            self._writer.cancel()
            return
        self._commit = self._writer.finish(overlay, self._request)

    def _pending(self) -> Overlay:
        if self._overlay is None:
            raise ClosedError("use the transaction inside its with block")
        return self._overlay

    def add(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
        *,
        confidence: float | None = None,
        valid_until: dt.datetime | str | None = None,
        source: NamedNode | str | None = None,
    ) -> None:
        """Assert a statement.

        Parameters
        ----------
        subject, predicate
            Terms; text is taken as an IRI.
        value
            A term, or a Python value that becomes a literal.
        graph
            Target graph; the caller's own graph if not given.
        confidence
            In [0, 1]; an annotation on the statement's reifier, like ``valid_until`` and
            ``source``. It replaces an earlier value.
        valid_until
            When the statement is to be withdrawn.
        source
            IRI of what the statement was derived from.
        """
        quad = self._quad(subject, predicate, value, graph)
        self._pending().add(quad)
        annotations = notes(confidence, valid_until, source)
        if annotations:
            self._annotate(quad, annotations)

    def _annotate(self, quad: Quad, annotations: Mapping[NamedNode, Term]) -> None:
        pending, where = self._pending(), quad.graph_name
        base = self._request.access.graphs.base if self._request.access.graphs else ""
        reifier = reifier_of(base, quad)
        pending.add(reification(reifier, quad))
        for predicate, value in annotations.items():
            # The store does not hold the notes of this transaction yet; they are replaced as well.
            own = self._notes.setdefault((reifier, predicate), [])
            before = list(pending.store.quads_for_pattern(reifier, predicate, None, where))
            for old in (*before, *own):
                pending.remove(old)
            note = Quad(reifier, predicate, value, where)
            pending.add(note)
            own.append(note)

    def remove(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> None:
        """Withdraw a statement from one graph, if the graph contains it."""
        self._pending().remove(self._quad(subject, predicate, value, graph))

    def _quad(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None,
    ) -> Quad:
        where = self.home if graph is None else iri(graph)
        return stored_quad(Quad(subject_term(subject), iri(predicate), object_term(value), where))

    def add_quads(
        self,
        quads: Iterable[Quad],
        graph: NamedNode | str | None = None,
        *,
        as_read: bool = False,
    ) -> None:
        """Assert many statements; those of the default graph go to ``graph`` or :attr:`home`.

        Parameters
        ----------
        as_read
            Whether they have a graph, and terms in the form in which the store keeps them.
        """
        if as_read:
            self._pending().add_all(quads)
            return
        # Everything asserted has an owner, which is told from its graph.
        where = self.home if graph is None else iri(graph)

        def named() -> Iterator[Quad]:
            for quad in quads:
                if isinstance(quad.graph_name, DefaultGraph):
                    quad = Quad(quad.subject, quad.predicate, quad.object, where)
                yield stored_quad(quad)

        self._pending().add_all(named())

    def remove_quads(self, quads: Iterable[Quad], *, as_read: bool = False) -> None:
        """Withdraw many statements, each from its own graph, if the graph contains it.

        Parameters
        ----------
        as_read
            Whether they were read from the store, so that they have the form in which it keeps
            them; finding that out takes longer than removing them.
        """
        pending = self._pending()
        for quad in quads:
            pending.remove(quad if as_read else stored_quad(quad))

    def replace_permitted(self, removed: Iterable[Quad], added: Iterable[Quad]) -> None:
        """Withdraw and assert statements in graphs that the author may not write otherwise.

        Only for operations that decide by themselves on each of the statements, such as a robot's
        taking a step of a plan over; never for statements that a caller sends.
        """
        old, new = [stored_quad(q) for q in removed], [stored_quad(q) for q in added]
        permitted = self._request.permitted.union(old, new)
        self._request = replace(self._request, permitted=permitted)
        self.remove_quads(old, as_read=True)
        self.add_quads(new, as_read=True)

    def learn(self, subjects: Iterable[Sequence[Quad]], writes: int) -> None:
        """Take over what was read of subjects, so that the commit need not look it up again.

        Parameters
        ----------
        subjects
            For each of them, all that the store held about it, the default graph included.
        writes
            Writes of the store so far when that was read; after others it is not used.
        """
        self._pending().holders.learn(subjects, writes)

    def clear(self, graph: GraphName | str) -> None:
        """Withdraw all statements of a graph."""
        name = iri(graph) if isinstance(graph, str) else graph
        self._pending().clear(name, drop=False)

    def update(
        self,
        text: str,
        using: Iterable[NamedNode | str] = (),
        named: Iterable[NamedNode | str] = (),
        base: str | None = None,
    ) -> None:
        """Run a SPARQL update on the pending state.

        Statements that the reasoner will derive from pending changes are not visible yet.
        """
        dataset = UpdateDataset(tuple(map(iri, using)), tuple(map(iri, named)), base)
        run_update(self._pending(), prepare(text, dataset), self._request.access)

    def load(
        self,
        data: bytes | str | Path,
        format: RdfFormat | str | None = None,
        graph: NamedNode | str | None = None,
        base: str | None = None,
    ) -> int:
        """Assert the statements of a document; return how many it contains."""
        from rtask.rdf.formats import read_document

        quads = read_document(data, format, base)
        self.add_quads(quads, graph)
        return len(quads)

    def blob(
        self, data: bytes | Path | BinaryIO, media_type: str, graph: NamedNode | str | None = None
    ) -> NamedNode:
        """Store bytes and describe them; return the IRI that names them."""
        # Bytes first: a statement must never name what is not stored.
        blob = self._blobs.put(data, media_type)
        for subject, predicate, value in blob.statements():
            self.add(subject, predicate, value, graph)
        return blob.iri

    def counts(self) -> tuple[int, int]:
        """Return how many statements would be added and removed."""
        pending = self._pending()
        return len(pending.added), len(pending.removed)

    def holds(self, quad: Quad) -> bool:
        """Whether a statement, in the form in which the store keeps it, is in its graph."""
        return quad in self._pending()

    def contains(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        graph: NamedNode | str | None = None,
    ) -> bool:
        """Whether a statement holds in the pending state."""
        return self._quad(subject, predicate, value, graph) in self._pending()
