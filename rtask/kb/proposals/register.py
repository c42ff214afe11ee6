"""The proposals of one knowledge base, open and decided.

Everybody who has a change that must not take effect by itself proposes it: robots without the right
``schema``, agents that may not write, programs that suggest corrections. From Python::

    proposal = kb.propose([Quad(...)], [], author="nao-1", reason="mugs are vessels")
    kb.proposals.open()                                  # those that nobody has decided yet
    kb.adopt(proposal.number, access=operator)           # one commit, checked against the head
    kb.proposals.refuse(proposal.number, "ann", "too general")

A proposal changes nothing that queries see. It is kept in ``proposals.sqlite`` in the data folder,
or in memory for a graph that has none; backups hold a copy of the file, followers ask the server
that they follow. After 30 days without a decision a proposal expires.
"""

from __future__ import annotations

import datetime as dt
import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from pyoxigraph import DefaultGraph, Quad

from rtask.errors import (
    ConflictError,
    QueueFullError,
    StorageFullError,
    StoreError,
    TooLargeError,
    UnknownTermError,
    UsageError,
)
from rtask.kb.durability.disk_space import means_full
from rtask.kb.proposals.proposal import STATES, Proposal, State

__all__ = ["FILE_NAME", "LIFETIME", "MAX_OPEN", "Proposals"]

FILE_NAME = "proposals.sqlite"
MAX_OPEN = 100
"""Open proposals of one author."""
LIFETIME = dt.timedelta(days=30)
MAX_BYTES = 1 << 20
"""Size of the statements of one proposal."""
_MAX_PROPOSALS = 10_000
"""Proposals kept in all; of those that are decided the oldest are forgotten first."""
_DAY_S = 86_400
_SCHEMA = """
CREATE TABLE IF NOT EXISTS proposals (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    author TEXT NOT NULL,
    added TEXT NOT NULL,
    removed TEXT NOT NULL,
    rests_on INTEGER NOT NULL,
    reason TEXT NOT NULL,
    state TEXT NOT NULL,
    made TEXT NOT NULL,
    decided TEXT,
    decided_by TEXT NOT NULL DEFAULT '',
    remark TEXT NOT NULL DEFAULT '',
    seq INTEGER
) STRICT
"""


def _now() -> dt.datetime:
    return dt.datetime.now(dt.UTC)


class Proposals:
    """Register of proposals; may be used from any thread, and by several processes.

    Parameters
    ----------
    folder
        Data folder; ``None`` to keep the proposals in memory.
    clock
        Returns the present time in UTC.

    Attributes
    ----------
    deciding
        Held while a proposal is carried out, so that it is carried out once.

    Examples
    --------
    >>> from pyoxigraph import NamedNode as N
    >>> register = Proposals(None)
    >>> quad = Quad(N("urn:Mug"), N("urn:p"), N("urn:Vessel"), N("urn:g"))
    >>> register.add([quad], [], "nao-1", rests_on=7).number
    1
    >>> register.refuse(1, "ann", "too general").state
    'refused'
    """

    def __init__(self, folder: Path | None, clock: Callable[[], dt.datetime] = _now) -> None:
        self._path = None if folder is None else folder / FILE_NAME
        self._clock = clock
        self._lock = threading.Lock()
        self._memory: sqlite3.Connection | None = None
        self.deciding = threading.Lock()

    def add(
        self,
        added: Iterable[Quad],
        removed: Iterable[Quad],
        author: str,
        rests_on: int,
        reason: str = "",
    ) -> Proposal:
        """Keep a change without effect.

        Parameters
        ----------
        added, removed
            Statements to assert and to withdraw, each with its graph.
        author
            Name of the robot or person; empty for a caller without one.
        rests_on
            Number of the last commit that the author has seen.
        reason
            What it is for.

        Raises
        ------
        UsageError
            There is no statement, or one without a graph.
        TooLargeError
            The statements take more than :data:`MAX_BYTES`.
        QueueFullError
            The author has :data:`MAX_OPEN` open proposals already.
        """
        plus, minus = _write(added), _write(removed)
        if not (plus or minus):
            raise UsageError("the proposal changes nothing; name the statements to add or remove")
        if len(plus) + len(minus) > MAX_BYTES:
            raise TooLargeError(
                f"a proposal may hold {MAX_BYTES} bytes of statements; load a file as an operator",
                limit="proposal",
                allowed=MAX_BYTES,
            )
        with self._database() as database:
            self._expire(database)
            (count,) = database.execute(
                "SELECT COUNT(*) FROM proposals WHERE author = ? AND state = 'proposed'", (author,)
            ).fetchone()
            if count >= MAX_OPEN:
                raise QueueFullError(
                    f"{author or 'this caller'} has {count} open proposals, as many as may be; "
                    "wait until an operator has decided some",
                    retry_after_s=_DAY_S,
                )
            number = database.execute(
                "INSERT INTO proposals (author, added, removed, rests_on, reason, state, made) "
                "VALUES (?, ?, ?, ?, ?, 'proposed', ?)",
                (author, plus, minus, rests_on, reason[:2_000], self._clock().isoformat()),
            ).lastrowid
            database.execute(
                "DELETE FROM proposals WHERE state <> 'proposed' AND number <= ?",
                ((number or 0) - _MAX_PROPOSALS,),
            )
        assert number is not None
        return self.get(number)

    def get(self, number: int) -> Proposal:
        """Return a proposal.

        Raises
        ------
        UnknownTermError
            There is none with this number.
        """
        rows = self._select("WHERE number = ?", (number,))
        if not rows:
            raise UnknownTermError(f"there is no proposal {number}; see `rtask proposals list`")
        return rows[0]

    def open(self) -> list[Proposal]:
        """Return the proposals that nobody has decided yet, the oldest first."""
        return self.find("proposed")

    def find(self, state: State | None = None, author: str | None = None) -> list[Proposal]:
        """Return proposals, the oldest first.

        Raises
        ------
        UsageError
            There is no such state.
        """
        if state is not None and state not in STATES:
            raise UsageError(f"unknown state {state!r}; one of {', '.join(STATES)}")
        return self._select(
            "WHERE (? IS NULL OR state = ?) AND (? IS NULL OR author = ?) ORDER BY number",
            (state, state, author, author),
        )

    def refuse(self, number: int, by: str, remark: str = "") -> Proposal:
        """Decide against a proposal.

        Raises
        ------
        UnknownTermError
            There is none with this number.
        ConflictError
            It was decided before, or has expired.
        """
        return self._decide(number, "refused", by, remark, None)

    def adopted(self, number: int, by: str, commit: int) -> Proposal:
        """Record that a commit carried a proposal out; :meth:`GraphCore.adopt` calls this.

        Raises
        ------
        UnknownTermError, ConflictError
            As :meth:`refuse`; the commit stays.
        """
        return self._decide(number, "adopted", by, "", commit)

    def require_open(self, number: int) -> Proposal:
        """Return an open proposal.

        Raises
        ------
        UnknownTermError, ConflictError
            As :meth:`refuse`.
        """
        proposal = self.get(number)
        if not proposal.is_open:
            raise ConflictError(f"proposal {number} is {proposal.state} already")
        return proposal

    def _decide(
        self, number: int, state: State, by: str, remark: str, commit: int | None
    ) -> Proposal:
        self.require_open(number)
        # The look above is for the message only: another process may decide in between, so what
        # counts is the condition of the update itself.
        with self._database() as database:
            changed = database.execute(
                "UPDATE proposals SET state = ?, decided = ?, decided_by = ?, remark = ?, seq = ? "
                "WHERE number = ? AND state = 'proposed'",
                (state, self._clock().isoformat(), by, remark[:2_000], commit, number),
            ).rowcount
        proposal = self.get(number)
        if not changed:
            raise ConflictError(f"proposal {number} is {proposal.state} already")
        return proposal

    def _select(self, where: str, values: tuple[object, ...]) -> list[Proposal]:
        if self._path is not None and not self._path.exists():
            return []
        with self._database() as database:
            # Nobody watches the clock while nothing is asked; whoever reads ends what is too old.
            self._expire(database)
            rows = database.execute(
                "SELECT number, author, added, removed, rests_on, reason, state, made, decided, "
                f"decided_by, remark, seq FROM proposals {where}",
                values,
            ).fetchall()
        return [_proposal(row) for row in rows]

    def _expire(self, database: sqlite3.Connection) -> None:
        now = self._clock()
        database.execute(
            "UPDATE proposals SET state = 'expired', decided = ? "
            "WHERE state = 'proposed' AND made < ?",
            (now.isoformat(), (now - LIFETIME).isoformat()),
        )

    @contextmanager
    def _database(self) -> Iterator[sqlite3.Connection]:
        """Open the database for one transaction.

        Raises
        ------
        StorageFullError, StoreError
            The file cannot be read or written; names it.
        """
        try:
            with self._lock, self._transaction() as database:
                yield database
        except sqlite3.Error as error:
            where = str(self._path or "the proposals in memory")
            if means_full(error) or "disk is full" in str(error):
                raise StorageFullError(f"no room for {where}; nothing was kept") from error
            raise StoreError(f"{where} cannot be used: {error}") from error

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        if self._path is not None:
            # A new connection each time: commands of other processes, and threads that come and
            # go, use the file as well, and it is opened a few times a day.
            database = sqlite3.connect(self._path, timeout=10)
        else:
            database = self._memory or sqlite3.connect(":memory:", check_same_thread=False)
            self._memory = database
        try:
            with database:
                database.execute(_SCHEMA)
                yield database
        finally:
            if self._path is not None:
                database.close()

    def copy_to(self, folder: Path) -> None:
        """Copy the proposals to another folder, e.g. for a backup; nothing if there are none."""
        if self._path is None or not self._path.exists():
            return
        with self._database() as database, closing(sqlite3.connect(folder / FILE_NAME)) as copy:
            database.backup(copy)

    def close(self) -> None:
        """Release the database."""
        with self._lock:
            if self._memory is not None:
                self._memory.close()
                self._memory = None


def _write(quads: Iterable[Quad]) -> str:
    lines = []
    for quad in dict.fromkeys(quads):
        if isinstance(quad.graph_name, DefaultGraph):
            raise UsageError(f"{quad} has no graph; a proposal names the graph of each statement")
        lines.append(f"{quad} .\n")
    return "".join(lines)


def _proposal(row: tuple[Any, ...]) -> Proposal:
    number, author, added, removed, rests_on, reason, state, made, decided, by, remark, seq = row
    return Proposal(
        number,
        author,
        added,
        removed,
        rests_on,
        reason,
        state,
        dt.datetime.fromisoformat(made),
        None if decided is None else dt.datetime.fromisoformat(decided),
        by,
        remark,
        seq,
    )
