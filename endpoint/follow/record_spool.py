"""Records of what robots asked at a follower, on disk until the writer has them.

A robot at a follower gets its answer at once, from the copy. What is to be stored of it, a place, a
refusal, a decision, waits here: 10,000 records or 100 MB at most, of which the oldest go first.
"""

from __future__ import annotations

import json
import logging
import sqlite3
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import httpx

from rtask.errors import RtaskError
from rtask.kb.commit.access import Access
from rtask.kb.feed.outage import Outage
from rtask.rdf.namespaces import uuid7

__all__ = ["FILE", "MAX_BYTES", "MAX_RECORDS", "RecordSpool"]

_log = logging.getLogger(__name__)
FILE = "asked.db"
"""Name of the queue in a follower's folder."""

MAX_RECORDS = 10_000
MAX_BYTES = 100 << 20
_BATCH = 200
_RETRY_S = 1.0

Row = tuple[int, str]
Send = Callable[[Sequence[Mapping[str, Any]]], Sequence[Mapping[str, Any]]]
Count = Callable[[str, int], None]


class RecordSpool:
    """Durable queue of records, sent in their order by a thread of its own.

    Parameters
    ----------
    file
        Database of SQLite; made where it is missing.
    send
        Gives records to the writer; returns those that it refused, each with ``id`` and ``reason``.
        Raises an error of httpx or :mod:`rtask.errors` if it has none of them.
    lost
        Called with ``full`` or ``refused`` and how many records were dropped for it.

    Examples
    --------
    >>> import tempfile
    >>> arrived = []
    >>> def send(records):
    ...     arrived.extend(records)
    ...     return []
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     spool = RecordSpool(Path(folder) / "records.db", send)
    ...     spool.put({"kind": "decision", "task": "t-1"}, Access("nao-1", "robot"))
    ...     spool.start()
    ...     spool.wait_until_sent(10.0)
    ...     spool.close()
    True
    >>> arrived[0]["record"]["task"], arrived[0]["agent"]
    ('t-1', 'nao-1')
    """

    def __init__(
        self,
        file: Path,
        send: Send,
        lost: Count = lambda reason, count: None,
        *,
        max_records: int = MAX_RECORDS,
        max_bytes: int = MAX_BYTES,
    ) -> None:
        self._send = send
        self._lost = lost
        self._max_records, self._max_bytes = max_records, max_bytes
        self._outage = Outage(_log, "records of what robots asked wait for the writer")
        self._changed = threading.Condition()
        self._is_closed = False
        self._thread: threading.Thread | None = None
        self._db = sqlite3.connect(file, check_same_thread=False, isolation_level=None)
        self._db.execute("PRAGMA journal_mode=WAL")
        # A killed process loses nothing by it, a failing machine the last records at most.
        self._db.execute("PRAGMA synchronous=NORMAL")
        self._db.execute("CREATE TABLE IF NOT EXISTS records (number INTEGER PRIMARY KEY, text)")
        row = self._db.execute("SELECT COUNT(*), COALESCE(SUM(LENGTH(text)), 0) FROM records")
        self._count, self._bytes = row.fetchone()

    @property
    def waiting(self) -> int:
        """Number of records that the writer does not have yet."""
        return int(self._count)

    def put(self, record: Mapping[str, Any], author: Access) -> None:
        """Keep a record until the writer has it."""
        # The writer stores each id once, so that a batch may be sent again.
        entry = {
            "id": uuid7().hex, "agent": author.agent, "role": author.role, "record": record,
        }  # fmt: skip
        text = json.dumps(entry)
        with self._changed:
            if self._is_closed:
                return
            self._db.execute("INSERT INTO records (text) VALUES (?)", (text,))
            self._count += 1
            self._bytes += len(text)
            self._drop_oldest()
            self._changed.notify_all()

    def _drop_oldest(self) -> None:
        dropped = 0
        while self._count > self._max_records or self._bytes > self._max_bytes:
            [row] = self._rows(1)
            self._delete([row])
            dropped += 1
        if dropped:
            self._lost("full", dropped)

    def _rows(self, count: int) -> list[Row]:
        query = "SELECT number, text FROM records ORDER BY number LIMIT ?"
        return self._db.execute(query, (count,)).fetchall()

    def _delete(self, rows: Sequence[Row]) -> None:
        # Row by row, as the oldest may have been dropped while they were sent.
        for number, text in rows:
            done = self._db.execute("DELETE FROM records WHERE number = ?", (number,))
            if done.rowcount:  # else it was dropped while it was being sent
                self._count -= 1
                self._bytes -= len(text)

    def start(self) -> None:
        """Begin to send."""
        self._thread = threading.Thread(target=self._run, name="rtask-records", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._count and not self._is_closed:
                    self._changed.wait()
                if self._is_closed:
                    return
                rows = self._rows(_BATCH)
            try:
                refused = self._send([json.loads(text) for _, text in rows])
            except (httpx.HTTPError, RtaskError, ValueError) as error:
                self._outage.failed(error)
                with self._changed:
                    self._changed.wait_for(lambda: self._is_closed, _RETRY_S)
                continue
            self._outage.ended()
            self._report(refused)
            # Only now: killed before this line, they are sent again.
            with self._changed:
                self._delete(rows)
                self._changed.notify_all()

    def send_all(self) -> None:
        """Send everything in the calling thread, where no other thread was started.

        Raises
        ------
        RtaskError
            The records, from the first that was not taken on, stay for the next time.
        """
        while rows := self._rows(_BATCH):
            self._report(self._send([json.loads(text) for _, text in rows]))
            self._delete(rows)

    def _report(self, refused: Sequence[Mapping[str, Any]]) -> None:
        for record in refused:
            _log.warning("a record of a robot was refused: %s", record.get("reason"))
        if refused:
            self._lost("refused", len(refused))

    def wait_until_sent(self, timeout_s: float) -> bool:
        """Wait until the writer has what is kept now, and return whether it does.

        A write that follows, such as the outcome of what was decided, then finds it there. Nobody
        waits while the writer does not answer.
        """
        end = time.monotonic() + timeout_s
        with self._changed:
            row = self._db.execute("SELECT MAX(number) FROM records").fetchone()
            last = row[0] or 0

            def is_sent() -> bool:
                oldest = self._rows(1)
                return not oldest or oldest[0][0] > last

            while not is_sent():
                left_s = end - time.monotonic()
                if left_s <= 0 or self._is_closed or self._outage.is_on:
                    return False
                # Also without a sign from the sender, since an outage may begin.
                self._changed.wait(min(left_s, 0.1))
        return True

    def close(self) -> None:
        """Stop sending; what waits is sent after the next start."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(timeout=15.0)
        with self._changed:
            self._db.close()
