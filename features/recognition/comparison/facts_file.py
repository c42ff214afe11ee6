"""File of what is known of stored views, so that a start need not compare them again.

One SQLite file lies beside the index. It is derived data: it says of which views it speaks (IRI,
object, digest of the content) and in which sequence they came and went, so that what changed
without it is noticed; every row carries a CRC-32. A file that is damaged or was made by other
rules is deleted with a word in the log, and its content is computed again.
"""

from __future__ import annotations

import hashlib
import logging
import sqlite3
import threading
import zlib
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

__all__ = ["FactsFile", "FiledView", "Record", "content_digest"]

log = logging.getLogger(__name__)

_TABLES = """
create table rules (name text not null);
create table view (id integer primary key, iri text not null, object text not null,
                   digest blob not null, crc32 integer not null);
create table change (place integer primary key, id integer not null, crc32 integer not null);
create table record (id integer primary key, place integer not null, content blob not null,
                     crc32 integer not null);
"""


class FiledView(NamedTuple):
    """A view of which the file speaks; the digest is of its content."""

    id: int
    iri: str
    object_iri: str
    digest: bytes


class Record(NamedTuple):
    """Facts about a view since a place in the sequence of changes, as bytes.

    Under a view's number with a minus stands what is known in part, until there is a whole record.
    """

    id: int
    place: int
    content: bytes


def content_digest(*parts: bytes) -> bytes:
    """Return the digest that identifies a view's content."""
    return hashlib.blake2b(b"".join(parts), digest_size=8).digest()


class FactsFile:
    """Facts about views, by their numbers; one process at a time uses a file.

    Where the file cannot be used or written (another process has it, the disk is full), nothing
    is read or kept, and the log says so once: the facts are then computed when they are needed.

    Parameters
    ----------
    path
        Made when missing.
    rules
        Name of the rules that the content follows from; a file of other rules is made again.

    Attributes
    ----------
    views
        Those that the file spoke of when it was opened.
    changes
        Numbers of the views that had come and, with a minus, gone by then, in order.
    """

    def __init__(self, path: Path, rules: str) -> None:
        self._path, self._rules = path, rules
        self._lock = threading.Lock()
        self._connection: sqlite3.Connection | None = None
        self.views: list[FiledView] = []
        self.changes: list[int] = []
        try:
            self._connection = self._opened() or self._made_again()
        except (sqlite3.Error, OSError) as error:
            log.info("%s is not used: %s; stored views are compared when needed", path, error)

    def record(self, view: int) -> Record | None:
        """Return what is known of a view; None where nothing is, or the record is damaged."""
        with self._lock:
            if self._connection is None:
                return None
            try:
                row = self._connection.execute(
                    "select id, place, content, crc32 from record where id = ?", (view,)
                ).fetchone()
            except sqlite3.Error as error:
                self._give_up(error)
                return None
        if row is not None and row[-1] != _crc(row[:-1]):
            log.warning("%s: the record of view %d is damaged and made again", self._path, view)
            return None
        return None if row is None else Record(*row[:-1])

    def places(self) -> dict[int, int]:
        """Return by view the place since which its record holds."""
        with self._lock:
            if self._connection is None:
                return {}
            try:
                return dict(self._connection.execute("select id, place from record").fetchall())
            except sqlite3.Error as error:
                self._give_up(error)
                return {}

    def write(
        self,
        came: Iterable[FiledView],
        went: Iterable[int],
        first_place: int,
        changes: Sequence[int],
        records: Iterable[Record],
    ) -> None:
        """Write wholly or not at all what changed since the last time.

        Parameters
        ----------
        went
            Numbers of views that are no longer stored.
        first_place, changes
            Numbers of the views that came and, with a minus, went, from that place on.
        """
        with self._lock:
            if self._connection is None:
                return
            try:
                with self._connection as now:
                    gone = [(view,) for view in went]
                    now.executemany("delete from view where id = ?", gone)
                    records = list(records)
                    parts = [(-record.id,) for record in records if record.id > 0]
                    gone += [(-view,) for (view,) in gone] + parts
                    now.executemany("delete from record where id = ?", gone)
                    for table, rows in (
                        ("view values (?, ?, ?, ?, ?)", came),
                        ("change values (?, ?, ?)", enumerate(changes, first_place)),
                        ("record values (?, ?, ?, ?)", records),
                    ):
                        checked = ((*row, _crc(row)) for row in rows)
                        now.executemany(f"insert or replace into {table}", checked)
            except sqlite3.Error as error:
                self._give_up(error)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()
                self._connection = None

    def delete(self) -> None:
        """Close the file and delete it; nothing is kept until it is opened again."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()
                self._connection = None
                _delete(self._path)

    def _give_up(self, error: sqlite3.Error) -> None:
        """Use the file no more; what is in it may be incomplete, so the next start makes it."""
        log.warning("%s: %s; it is deleted and made again at the next start", self._path, error)
        assert self._connection is not None
        self._connection.close()
        self._connection = None
        _delete(self._path)

    def _opened(self) -> sqlite3.Connection | None:
        """Open a file of these rules, if there is one."""
        if not self._path.exists():
            return None
        connection = _connect(self._path)
        try:
            rules = connection.execute("select name from rules").fetchall()
            problem: object = "made by other rules"
            if rules == [(self._rules,)]:
                problem = self._read(connection)
            if not problem:
                return connection
        except sqlite3.OperationalError as error:
            connection.close()
            if "no such table" not in str(error):
                raise
            problem = error
        except sqlite3.DatabaseError as error:
            problem = error
        connection.close()
        log.warning("%s: %s; it is made again", self._path, problem)
        return None

    def _read(self, connection: sqlite3.Connection) -> str:
        """Take over what the file speaks of; return what is wrong with it, empty if nothing is."""
        views = connection.execute("select * from view order by id").fetchall()
        changes = connection.execute("select * from change order by place").fetchall()
        if any(row[-1] != _crc(row[:-1]) for row in (*views, *changes)):
            return "damaged"
        if [place for place, *_ in changes] != list(range(len(changes))):
            return "incomplete"
        self.views = [FiledView(*row[:-1]) for row in views]
        self.changes = [view for _, view, _ in changes]
        return ""

    def _made_again(self) -> sqlite3.Connection:
        _delete(self._path)
        connection = _connect(self._path)
        try:
            with connection:
                connection.executescript(_TABLES)
                connection.execute("insert into rules values (?)", (self._rules,))
        except sqlite3.Error:
            connection.close()
            raise
        return connection


def _connect(path: Path) -> sqlite3.Connection:
    """Open a file for this process alone."""
    connection = sqlite3.connect(path, timeout=0, check_same_thread=False)
    try:
        with closing(connection.cursor()) as cursor:
            cursor.execute("pragma locking_mode = exclusive")
            cursor.execute("pragma journal_mode = wal")
            cursor.execute("pragma synchronous = normal")
    except sqlite3.OperationalError:
        connection.close()
        raise
    except sqlite3.DatabaseError:
        pass  # no database: the first query says so
    return connection


def _crc(row: Sequence[object]) -> int:
    """Return the checksum of a row: texts, numbers and bytes as Python writes them."""
    return zlib.crc32(repr(tuple(row)).encode())


def _delete(path: Path) -> None:
    for suffix in ("", "-wal", "-shm", "-journal"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
