"""Decisions of which the outcome may still be reported, also after the server was restarted."""

from __future__ import annotations

import json
import logging
import sqlite3
import threading
from pathlib import Path

from rtask.engine.decisions import Decision
from rtask.engine.stored import Recent

__all__ = ["FILE", "DecisionLog"]

_log = logging.getLogger(__name__)
FILE = "decisions.db"
"""Name of the database in the folder of a knowledge base."""


class DecisionLog:
    """The newest decisions by task, in memory and in a file.

    A robot may name the grasp that it tried by the id alone that it was offered. Where that is,
    only the decision says, so that a report would be lost with the process that decided. A file
    that cannot be written costs no answer: a line in the log says so, and memory goes on.

    Parameters
    ----------
    file
        Database of SQLite, made where it is missing; None = in memory only.
    size
        How many are kept; the oldest go first.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = DecisionLog(Path(folder) / FILE)
    ...     log.put("t-1", Decision("kb:object/1", None, asked_by="nao-1"))
    ...     log.close()
    ...     again = DecisionLog(Path(folder) / FILE)
    ...     decision = again.get("t-1")
    ...     again.close()
    >>> decision.object, decision.asked_by, again.get("t-2")
    ('kb:object/1', 'nao-1', None)
    """

    def __init__(self, file: Path | None = None, size: int = 2048) -> None:
        self._recent: Recent[Decision] = Recent(size)
        self._size = size
        self._lock = threading.Lock()
        self._db = None if file is None else _opened(file)

    def get(self, task: str | None) -> Decision | None:
        """Return the decision for a task, or None if it is not remembered."""
        decision = self._recent.get(task)
        if decision is not None or task is None:
            return decision
        decision = self._read(task)
        if decision is not None:
            self._recent.put(task, decision)
        return decision

    def put(self, task: str, decision: Decision) -> None:
        """Remember a decision."""
        self._recent.put(task, decision)
        text = json.dumps(decision.to_json())
        with self._lock:
            if self._db is None:
                return
            try:
                done = self._db.execute(
                    "INSERT OR REPLACE INTO decisions (task, robot, text) VALUES (?, ?, ?)",
                    (task, decision.asked_by, text),
                )
                oldest = (done.lastrowid or 0) - self._size
                self._db.execute("DELETE FROM decisions WHERE number <= ?", (oldest,))
            except sqlite3.Error as error:
                _log.warning("a decision is in memory only, until the server ends: %s", error)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            if self._db is not None:
                self._db.close()
                self._db = None

    def _read(self, task: str) -> Decision | None:
        with self._lock:
            if self._db is None:
                return None
            try:
                query = "SELECT text, robot FROM decisions WHERE task = ?"
                row = self._db.execute(query, (task,)).fetchone()
                return None if row is None else Decision.from_json(json.loads(row[0]), row[1])
            except (sqlite3.Error, ValueError, TypeError, KeyError, AttributeError) as error:
                _log.warning("the decision for %s cannot be read: %s", task, error)
                return None


def _opened(file: Path) -> sqlite3.Connection | None:
    """Return the database, or None, with a line in the log, where there can be none."""
    try:
        db = sqlite3.connect(file, check_same_thread=False, isolation_level=None)
        db.execute("PRAGMA journal_mode=WAL")
        # The end of the process loses nothing; the end of the machine may lose the newest.
        db.execute("PRAGMA synchronous=OFF")
        db.execute(
            "CREATE TABLE IF NOT EXISTS decisions "
            "(number INTEGER PRIMARY KEY AUTOINCREMENT, task TEXT UNIQUE, robot TEXT, text TEXT)"
        )
    except sqlite3.Error as error:
        _log.warning("%s: %s; decisions are in memory only, until the server ends", file, error)
        return None
    return db
