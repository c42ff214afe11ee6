"""The graph store in this process, on disk or in memory.

pyoxigraph closes a store only when its last reference is dropped, and a traceback may keep a
reference for long. Other code therefore refers to :class:`EmbeddedStore`, which drops its reference
on ``close()``.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Collection, Iterable, Iterator, Sized
from dataclasses import replace
from pathlib import Path
from typing import Any

from pyoxigraph import BlankNode, DefaultGraph, NamedNode, Quad, QuerySolutions, RdfFormat, Store

from rtask.errors import ClosedError, StorageFullError, StoreFormatError, UnsupportedError
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.merged_graphs import MergedCopy, with_merged_graphs
from rtask.kb.store.quads import InGraph, QuadChain, ground_text, parts_of
from rtask.kb.store.writes import Writes, as_update
from rtask.rdf.terms import GraphName, Subject, Term, TripleKey, stored, triple_key
from rtask.sparql.lexer import names_dataset

__all__ = ["LARGE", "EmbeddedStore", "embedded_store"]

_ATTEMPTS = 100  # on a busy machine RocksDB took more than a second to let go
_PAUSE_S = 0.05
_BULK = 100_000
_MOST = 1_000_000
_BLANK_PART = 10_000
_READ_EACH, _READ_MORE = 4, 16
"""So many statements are read for each that is looked up, before they are looked up one by one."""
LARGE = 30_000
"""A change with more additions than this is journalled durably, then stored in two steps.

The bulk loader takes a third of the processor time, but forces some nine files to disk before it
returns, .3 to .4 s during which others wait for the lock; one atomic step takes .01 ms a statement.
"""


class EmbeddedStore(GraphStore):
    """Quad store of pyoxigraph.

    Parameters
    ----------
    store
        The store; the caller must keep no other reference to it.
    """

    __slots__ = ("_is_applying", "_left_over", "_merged", "_path", "_store", "is_past")

    def __init__(self, store: Store, path: str | None = None) -> None:
        super().__init__()
        self._store: Store | None = store
        self._path = path
        self._merged, self._is_applying = MergedCopy(), False
        self._left_over: Writes | None = None
        self.is_past = False  # a copy that was open to write and is only read from now on

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
    def path(self) -> str | None:
        """Folder of the files; ``None`` in memory."""
        return self._path

    def move(self, path: Path) -> None:
        """Go on with the store at another place."""
        self._store = None
        self.changed()
        self._store, self._path = Store(str(path)), str(path)

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
        self.changed()
        for attempt in range(_ATTEMPTS):
            try:
                self._store = Store(self._path)
                self._clear_left_over()
                self.is_stuck = False
                return
            except (OSError, RuntimeError) as error:
                if attempt + 1 == _ATTEMPTS or "lock" not in str(error).lower():
                    # Reads go on while writes wait for room.
                    self._store = Store.read_only(self._path)
                    raise StorageFullError(f"the store cannot be written: {error}") from error
                time.sleep(_PAUSE_S)  # nothing tells when the lock of the closed store is free

    def reopen_to_read(self) -> None:
        """Open a past copy again, since readers beside failed to open one that may be written."""
        if self.is_past and self._path is not None:
            self._store, self.is_past = None, False
            self.changed()
            self._store = Store.read_only(self._path)

    def close(self) -> None:
        """Release the files."""
        self._store = None
        self.changed()

    @contextlib.contextmanager
    def _changing(self) -> Iterator[None]:
        try:
            yield
        except RuntimeError as error:
            raise self._failed(error) from error
        finally:
            self.changed()

    def changed(self) -> None:
        """Forget what is copied of the store, after a change other than by :meth:`apply`."""
        if not self._is_applying:
            self._merged.drop()

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
        # RocksDB writes the word with and without a capital.
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
                quads = self.raw.quads_for_pattern(subject, predicate, value, graph)
            if _is_named(value) and _is_named(subject) and not isinstance(graph, BlankNode):
                yield from quads
            else:
                yield from _fitting(quads, subject, value, graph)
        except RuntimeError as error:
            raise self._failed(error) from error

    def lacking(self, quads: Iterable[Quad]) -> list[Quad]:
        """Return those of some quads that the store does not hold."""
        try:
            with self.complete():
                raw = self.raw
                return [quad for quad in quads if quad not in raw]
        except RuntimeError as error:
            raise self._failed(error) from error

    def holders(self, key: TripleKey) -> list[GraphName]:
        """Return the graphs that hold a triple."""
        subject, _, value = key
        try:
            with self.complete():
                quads: Iterable[Quad] = self.raw.quads_for_pattern(*key, None)
            if not (_is_named(value) and _is_named(subject)):
                quads = _fitting(quads, subject, value, None)
            return [quad.graph_name for quad in quads]
        except RuntimeError as error:
            raise self._failed(error) from error

    def holders_of_each(self, keys: Iterable[TripleKey]) -> dict[TripleKey, list[GraphName]]:
        """Return the graphs that hold each of some triples; those of one subject are read at once.

        To find one triple costs as much as to read ten that lie together.
        """
        by_subject: dict[Subject, list[TripleKey]] = {}
        for key in keys:
            by_subject.setdefault(key[0], []).append(key)
        holders: dict[TripleKey, list[GraphName]] = {}
        if not by_subject:  # to begin a read has notes that wait stored
            return holders
        try:
            with self.complete():
                find = self.raw.quads_for_pattern
                for subject, group in by_subject.items():
                    together = self._held_together(subject, group) if len(group) > 1 else None
                    if together is not None:
                        holders.update(together)
                        continue
                    for key in group:
                        value = key[2]
                        quads: Iterable[Quad] = find(subject, key[1], value, None)
                        if not (_is_named(value) and _is_named(subject)):
                            quads = _fitting(quads, subject, value, None)
                        holders[key] = [quad.graph_name for quad in quads]
        except RuntimeError as error:
            raise self._failed(error) from error
        return holders

    def _held_together(
        self, subject: Subject, keys: list[TripleKey]
    ) -> dict[TripleKey, list[GraphName]] | None:
        """Return the graphs that hold triples of one subject; ``None`` if it has far more."""
        # The store keeps some literals in another form than they were written in.
        exact = {(key[1], stored(key[2])): key for key in keys}
        holders: dict[TripleKey, list[GraphName]] = {key: [] for key in keys}
        # Two that became one by that cannot be told apart in what is stored.
        if len(exact) < len(holders):
            return None
        predicates = {key[1] for key in keys}
        predicate = predicates.pop() if len(predicates) == 1 else None
        left = _READ_EACH * len(keys) + _READ_MORE
        for quad in self.raw.quads_for_pattern(subject, predicate, None, None):
            left -= 1
            # Far more is stored of this subject than is asked for: what robots did grows.
            if left < 0:
                return None
            key = exact.get((quad.predicate, quad.object))
            if key is not None and quad.subject == subject:
                holders[key].append(quad.graph_name)
        return holders

    def _view(
        self, subject: Subject | None, predicate: NamedNode | None, value: Term | None
    ) -> Iterator[Quad]:
        seen: set[Quad] = set()
        for quad in self.quads_for_pattern(subject, predicate, value, None):
            joined = Quad(quad.subject, quad.predicate, quad.object)
            if joined not in seen and not Graphs.is_quarantine(quad.graph_name):
                seen.add(joined)
                yield joined

    def count(self, graph: GraphName) -> int:
        """Return the number of triples in a named graph."""
        if not isinstance(graph, NamedNode):
            return sum(1 for _ in self.quads_for_pattern(None, None, None, graph))
        # Counted in the store, no object of Python is made for each quad.
        text = f"SELECT (COUNT(*) AS ?n) {{ GRAPH {graph} {{ ?s ?p ?o }} }}"
        with self.complete(graph):
            rows = self.raw.query(text)
        assert isinstance(rows, QuerySolutions)
        [row] = rows
        return int(row["n"].value)

    def named_graphs(self) -> Iterator[GraphName]:
        """Yield the names of the named graphs, empty ones included."""
        with self.complete():
            return self.raw.named_graphs()

    def contains_named_graph(self, graph: GraphName) -> bool:
        """Whether a named graph exists."""
        with self.complete(graph):
            return self.raw.contains_named_graph(graph)

    def query(self, text: str, *, timeout_s: float | None = None, **options: Any) -> Any:
        """Evaluate a query; consume the answer in this thread."""
        if self.is_view and "default_graph" not in options and not names_dataset(text):
            options["use_default_graph_as_union"] = True
        try:
            with self.complete():
                source, options = with_merged_graphs(self.raw, text, options, self._merged)
                return source.query(text, **options)
        except RuntimeError as error:
            raise self._failed(error) from error

    def update(self, text: str, **options: Any) -> None:
        """Run an update atomically."""
        with self._changing():
            self.raw.update(text, **options)

    def extend(self, quads: Iterable[Quad]) -> None:
        """Add quads, all or none."""
        with self._changing():
            self.raw.extend(quads)

    def bulk_extend(self, quads: Iterable[Quad]) -> None:
        """Add many quads fast, but not atomically: a process killed meanwhile leaves some.

        The store keeps in memory all that it is given at once, and is slower for it. Text it reads
        itself, in less time, and others of this process go on meanwhile: ``Store.bulk_extend``
        holds the interpreter's lock until its files are on the disk, so that not even ``/health``
        is answered. Reading text would rename blank nodes, so these are added one by one, in parts.
        """
        written = quads.written if isinstance(quads, InGraph) else None
        if written is not None and written.is_ground:
            assert isinstance(quads, InGraph)
            self._bulk_load(written.text, RdfFormat.N_TRIPLES, quads.graph)
            return
        rest, each = iter(quads), _MOST
        # Parts of one size: a small last one would be files of its own all the same.
        if isinstance(quads, Sized):
            each = -(-len(quads) // max(1, round(len(quads) / _BULK)))
        while any(part := ground_text(itertools.islice(rest, each))):
            text, blank = part
            if text:
                self._bulk_load(text, RdfFormat.N_QUADS)
            for start in range(0, len(blank), _BLANK_PART):
                self.extend(blank[start : start + _BLANK_PART])

    def _bulk_load(self, text: bytes, form: RdfFormat, graph: GraphName | None = None) -> None:
        """Add statements whose terms the store has made or checked before."""
        with self._changing():
            self.raw.bulk_load(text, form, to_graph=graph, lenient=True)

    def apply(self, writes: Writes) -> None:
        """Change the store in one atomic step; a large change is added in bulk first."""
        self._clear_left_over()
        if len(writes.added) > LARGE:
            self._apply_large(writes)
            return
        self._is_applying = True
        try:
            self._apply_small(writes)
        except BaseException:
            # What was copied may have followed a part of the change that the store took back.
            self._merged.drop()
            raise
        finally:
            self._is_applying = False
        if self._merged.is_made:
            removed, added = list(writes.removed), list(writes.added)
            self._merged.follow(removed, added, writes.created, writes.dropped)
        else:
            self._merged.drop()

    def _apply_small(self, writes: Writes) -> None:
        if writes.only_adds():
            self.extend(writes.added)
        else:
            if writes.is_unseen:
                self.extend(writes.added)
                writes = replace(writes, added=())
            operations, functions = as_update(writes)
            if operations:
                self.update(" ;\n".join(operations), custom_functions=functions)

    def _apply_large(self, writes: Writes) -> None:
        """Add first; undo the additions if removing fails."""
        operations, functions = as_update(
            Writes(writes.removed, created=writes.created, dropped=writes.dropped)
        )
        added = writes.added
        try:
            for part in _joined(added):
                self.bulk_extend(part)
            if operations:
                self.update(" ;\n".join(operations), custom_functions=functions)
        except BaseException:
            self.changed()
            self._left_over = writes
            self._clear_or_reopen()
            raise

    def _clear_or_reopen(self) -> None:
        """Remove what a failed change left, now if the disk has any room for that.

        A store whose disk was full takes nothing more until it is opened again. Where that fails
        as well, the next write begins with it.
        """
        try:
            self._clear_left_over()
        except (RuntimeError, OSError):
            with contextlib.suppress(StorageFullError):
                self.reopen()

    def _clear_left_over(self) -> None:
        if self._left_over is not None:
            self._take_back(self._left_over)
            self._left_over = None

    def _take_back(self, writes: Writes) -> None:
        """Remove what was added, from the union only what no named graph holds."""
        shared = []
        for quad in writes.added:
            if writes.has_union and isinstance(quad.graph_name, DefaultGraph):
                shared.append(quad)
            else:
                self.raw.remove(quad)
        for quad in shared:
            # Only after the named graphs let go can it be told what none of them holds.
            holders = self.quads_for_pattern(*triple_key(quad), None)
            if not any(Graphs.is_joined(holder.graph_name) for holder in holders):
                self.raw.remove(quad)

    def flush(self) -> None:
        """Force everything to disk."""
        if self.gate is not None:
            self.gate.flush()
        try:
            self.raw.flush()
        except RuntimeError as error:
            raise self._failed(error) from error


def _joined(quads: Collection[Quad]) -> Iterator[Collection[Quad]]:
    """Yield the parts of quads as they are best added: those without their text together.

    On disk each call writes new files for each index, 12 ms of processor time however few the
    quads; text is read apart, in less time than its terms are made.
    """
    parts = parts_of(quads)
    texts = [part for part in parts if isinstance(part, InGraph) and part.written is not None]
    rest = [part for part in parts if not any(part is text for text in texts)]
    yield from texts
    if rest:
        yield QuadChain(*rest)


def _is_named(term: Subject | Term | None) -> bool:
    return term is None or isinstance(term, NamedNode)


def _fitting(
    quads: Iterable[Quad], subject: Subject | None, value: Term | None, graph: GraphName | None
) -> Iterator[Quad]:
    """Yield only the quads that really match.

    On disk, pyoxigraph reads past a term whose encoding ends in byte 255: a pattern with the number
    255 also yields 256 to 510. The same holds for dates, short strings and short blank node labels.
    Terms stored by their hash, and SPARQL, are not affected.
    """
    stored_value = None if value is None else stored(value)
    for quad in quads:
        if stored_value is not None and quad.object != stored_value:
            continue
        if subject is not None and quad.subject != subject:
            continue
        if graph is not None and quad.graph_name != graph:
            continue
        yield quad


def embedded_store(store: GraphStore, what: str) -> EmbeddedStore:
    """Return a store as the one in this process.

    Parameters
    ----------
    what
        Beginning of the error, before "needs the embedded store".

    Raises
    ------
    UnsupportedError
        The statements are on a SPARQL server.
    """
    if isinstance(store, EmbeddedStore):
        return store
    raise UnsupportedError(f"{what} needs the embedded store: open a folder instead of an address")
