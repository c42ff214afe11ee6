"""Side index in ``index.sqlite`` for words and places, which SPARQL cannot search quickly.

It is created on first use, follows the commits and records the last one indexed. The file can be
deleted at any time: everything in it is rebuilt from the graph.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from pyoxigraph import NamedNode, Quad

from rtask.errors import ClosedError, GoneError, StoreError
from rtask.kb.commit.commit import Change
from rtask.kb.feed.feed import Feed
from rtask.kb.store.graph_store import GraphStore

if TYPE_CHECKING:
    import sqlite3

__all__ = ["SideIndex", "Table"]

_log = logging.getLogger(__name__)
_FILE = "index.sqlite"
_FORMAT = "2"
_MAX_WAITING = 20_000


class Table(Protocol):
    """A table of the side index."""

    @property
    def predicates(self) -> frozenset[NamedNode]:
        """Predicates of the statements that the table indexes."""

    def create(self, db: sqlite3.Connection) -> None:
        """Create missing tables."""

    def fill(self, db: sqlite3.Connection, quads: Iterator[Quad]) -> None:
        """Rebuild the table."""

    def change(self, db: sqlite3.Connection, removed: list[Quad], added: list[Quad]) -> None:
        """Update the table after a commit."""


class SideIndex:
    """The index of one open knowledge base.

    Parameters
    ----------
    folder
        Folder of the file; ``None`` for an index in memory.
    counts
        Tells whether a graph's statements are indexed.
    """

    def __init__(
        self,
        store: GraphStore,
        feed: Feed,
        folder: Path | None,
        counts: Callable[[object], bool],
        tables: tuple[Table, ...],
    ) -> None:
        self._store = store
        self._feed = feed
        self._path = None if folder is None else folder / _FILE
        self._counts = counts
        self._tables = tables
        self._lock = threading.RLock()
        self._db: sqlite3.Connection | None = None
        self._waiting: deque[tuple[int, list[Quad], list[Quad]]] = deque()
        self._stale = False
        self._closed = False

    @property
    def _predicates(self) -> frozenset[NamedNode]:
        return frozenset().union(*(table.predicates for table in self._tables))

    def announce(self, change: Change) -> None:
        """Take note of a commit; it is indexed before the next search."""
        if self._db is None:
            return
        predicates = self._predicates
        parts = (change.removed, change.added)
        removed, added = ([q for q in part if q.predicate in predicates] for part in parts)
        self._waiting.append((change.commit.seq, removed, added))
        if len(self._waiting) > _MAX_WAITING:
            self._stale = True
            self._waiting.clear()

    def invalidate(self) -> None:
        """Mark the index as outdated; the next search rebuilds it."""
        with self._lock:
            self._stale = True
            if self._db is None and self._path is not None:
                with contextlib.suppress(OSError):
                    self._path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """Yield the database with every announced commit indexed.

        Raises
        ------
        StoreError
            The index cannot be created, e.g. because the disk is full.
        """
        import sqlite3

        with self._lock:
            if self._closed:
                raise ClosedError("the knowledge base is closed")
            try:
                db = self._db or self._open()
                self._catch_up(db)
                yield db
            except sqlite3.OperationalError as error:
                raise StoreError(f"the search index cannot be used: {error}") from error

    def rebuild(self) -> None:
        """Rebuild the index now."""
        self._stale = True
        with self.reading():
            pass

    def _open(self) -> sqlite3.Connection:
        db = self._connect()
        stored = dict(db.execute("SELECT name, value FROM facts"))
        seq = int(stored.get("seq", -1))
        fits = stored.get("epoch") == self._feed.epoch and seq <= self._feed.last_seq
        self._waiting.clear()
        self._db = db  # from here on, announced commits are queued
        upto = self._feed.last_seq
        if fits and seq >= 0 and not self._stale:
            self._stale = not self._replay(db, seq, upto)
        else:
            self._stale = True
        return db

    def _connect(self) -> sqlite3.Connection:
        import sqlite3

        if self._path is None:
            return self._prepare(":memory:")
        try:
            return self._prepare(str(self._path))
        except sqlite3.DatabaseError as error:
            _log.warning("%s is damaged and will be rebuilt: %s", self._path, error)
            self._path.unlink(missing_ok=True)
            return self._prepare(str(self._path))

    def _prepare(self, name: str) -> sqlite3.Connection:
        import sqlite3

        db = sqlite3.connect(name, check_same_thread=False, isolation_level=None)
        try:
            db.execute("PRAGMA synchronous = OFF")  # the file can be rebuilt
            db.execute("CREATE TABLE IF NOT EXISTS facts(name TEXT PRIMARY KEY, value TEXT)")
            row = db.execute("SELECT value FROM facts WHERE name = 'format'").fetchone()
            if row is not None and row[0] != _FORMAT:
                raise sqlite3.DatabaseError(f"format {row[0]}")
            for table in self._tables:
                table.create(db)
        except BaseException:
            db.close()
            raise
        return db

    def _replay(self, db: sqlite3.Connection, after: int, upto: int) -> bool:
        """Index the commits since the last search; return whether all were still available."""
        if after == upto:
            return True
        predicates = self._predicates
        try:
            self._feed.require_retained(after)
            with self._writing(db, upto):
                for change in self._feed.changes(after, upto):
                    removed = [q for q in change.removed if q.predicate in predicates]
                    self._apply(db, removed, [q for q in change.added if q.predicate in predicates])
        except GoneError:
            return False
        return True

    def _catch_up(self, db: sqlite3.Connection) -> None:
        if self._stale:
            self._fill(db)
        if not self._waiting:
            return
        indexed = int(db.execute("SELECT value FROM facts WHERE name = 'seq'").fetchone()[0])
        last = indexed
        with self._writing(db, None):
            while self._waiting:
                seq, removed, added = self._waiting.popleft()
                if seq > indexed:
                    self._apply(db, removed, added)
                    last = seq
            self._note(db, last)

    def _apply(self, db: sqlite3.Connection, removed: list[Quad], added: list[Quad]) -> None:
        for table in self._tables:
            lost, new = (
                [q for q in quads if q.predicate in table.predicates and self._is_ours(q)]
                for quads in (removed, added)
            )
            if lost or new:
                table.change(db, lost, new)

    def _fill(self, db: sqlite3.Connection) -> None:
        self._stale = False
        seq = self._feed.last_seq
        try:
            with self._writing(db, seq):
                for table in self._tables:
                    table.fill(db, self._quads(table.predicates))
        except BaseException:
            self._stale = True
            raise

    def _quads(self, predicates: Iterable[NamedNode]) -> Iterator[Quad]:
        for predicate in sorted(predicates, key=str):
            for quad in self._store.quads_for_pattern(None, predicate, None, None):
                if self._is_ours(quad):
                    yield quad

    def _is_ours(self, quad: Quad) -> bool:
        return isinstance(quad.subject, NamedNode) and self._counts(quad.graph_name)

    @contextlib.contextmanager
    def _writing(self, db: sqlite3.Connection, seq: int | None) -> Iterator[None]:
        db.execute("BEGIN IMMEDIATE")
        try:
            yield
            if seq is not None:
                self._note(db, seq)
            db.execute("COMMIT")
        except BaseException:
            db.execute("ROLLBACK")
            raise

    def _note(self, db: sqlite3.Connection, seq: int) -> None:
        facts = {"format": _FORMAT, "epoch": self._feed.epoch, "seq": str(seq)}
        db.executemany("INSERT OR REPLACE INTO facts VALUES (?, ?)", facts.items())

    def close(self) -> None:
        """Index the remaining commits and close the file."""
        import sqlite3

        with self._lock:
            self._closed = True
            db, self._db = self._db, None
            if db is None:
                return
            with contextlib.suppress(StoreError, sqlite3.Error, ClosedError):
                if self._path is not None:
                    self._catch_up(db)
            db.close()
            if self._stale and self._path is not None:
                self._path.unlink(missing_ok=True)
