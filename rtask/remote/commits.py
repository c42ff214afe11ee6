"""Commits of a server of RTASK, as its answers show them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urljoin

import httpx

from rtask.errors import AccessError, RemoteError
from rtask.model.backing import Touched
from rtask.remote.endpoints import ROWS
from rtask.remote.transport import Connection

__all__ = ["Commits"]

_MOST = 20
"""After more commits than this, all objects count as changed: asking for each would take longer."""


class Commits:
    """Notices the commits that the answers of a server imply, and asks which subjects they touch.

    Every answer names the last commit before it was evaluated, so nothing that an answer lacks goes
    unnoticed at the next one.

    Parameters
    ----------
    connection
        To the server.
    query_url
        Address of queries; that of the change feed is next to it.
    """

    def __init__(self, connection: Connection, query_url: str) -> None:
        self._connection = connection
        self._query_url = query_url
        self._listeners: dict[object, Callable[[Touched], None]] = {}
        self._lock = threading.Lock()
        self._version = ""
        self._awaited = ""
        self._required: list[str] = []
        self._last: dict[str, Any] = {}

    @property
    def at_least(self) -> dict[str, str]:
        """Header that makes a follower wait until it has what its answer must not lack.

        Answers to such requests take longer, so it is sent after own changes and before a write.
        """
        required = self._required
        version = required[-1] if required else self._awaited
        return {"RTASK-Min-Version": version} if version else {}

    @contextmanager
    def no_older_than(self, version: str) -> Iterator[None]:
        """Take no answer from before a version while the block runs."""
        self._required.append(version)
        try:
            yield
        finally:
            self._required.remove(version)

    def current(self) -> str:
        """Ask for the last commit: ``EPOCH:NUMBER``."""
        answer = self._connection.send(
            self._query_url, [("query", "ASK {}")], ROWS, repeat=True, headers=self.at_least
        )
        self._notice(answer)
        return str(answer.headers["RTASK-Version"])

    def wrote(self, answer: httpx.Response) -> None:
        """Wait for an own change in the next answers, and tell listeners about it."""
        self._awaited = answer.headers.get("RTASK-Version", "")
        self._notice(answer)

    def give_up_waiting(self) -> None:
        """Take older answers again: a backup may have been restored, or a follower be cut off."""
        self._awaited = ""

    def listen(self, listener: Callable[[Touched], None]) -> Callable[[], None]:
        """Call ``listener`` with the subjects of the commits from now on."""
        key = object()
        with self._lock:
            if not self._listeners:
                self._version = ""  # what was committed before concerns nobody
            self._listeners[key] = listener

        def stop() -> None:
            self._listeners.pop(key, None)

        return stop

    def read(self, answer: httpx.Response) -> None:
        """Tell listeners about the commits that the answer to a query implies."""
        if self._awaited and _is_from(answer.headers.get("RTASK-Version", ""), self._awaited):
            self._awaited = ""
        self._notice(answer)

    def _notice(self, answer: httpx.Response) -> None:
        """Tell listeners about commits of which an answer is the first sign."""
        version = answer.headers.get("RTASK-Version", "")
        epoch, _, number = version.rpartition(":")
        if not number.isdecimal():
            return
        with self._lock:
            last_epoch, _, last_number = self._version.rpartition(":")
            if last_epoch == epoch and int(number) <= int(last_number):
                return
            self._version = version
            listeners = list(self._listeners.values()) if last_epoch else []
        if not listeners:
            return
        counted_anew = epoch != last_epoch
        touched = None if counted_anew else self._subjects(int(last_number) + 1, int(number))
        for listener in listeners:
            listener(touched)

    def record(self, seq: int) -> Mapping[str, Any] | None:
        """Return a commit as the change feed tells it; ``None`` if it is not to be had."""
        if self._last.get("seq") == seq:
            return self._last
        try:
            answer = self._connection.send(
                urljoin(self._query_url, f"changes/{seq}"), None, "application/json", repeat=True
            )
        except (RemoteError, AccessError):  # not kept, or not for this token
            return None
        self._last = answer.json()
        return self._last

    def _subjects(self, first: int, last: int) -> Touched:
        if last - first >= _MOST:
            return None
        subjects: set[str] = set()
        for seq in range(first, last + 1):
            record = self.record(seq)
            if record is None:
                return None
            derived = record["inferred"]
            for rows in (record["added"], record["removed"], derived["added"], derived["removed"]):
                subjects.update(row[0][1:-1] for row in rows if row[0].startswith("<"))
        return subjects


def _is_from(version: str, other: str) -> bool:
    """Whether a version is another one or a later one, or numbering has restarted."""
    epoch, _, number = version.rpartition(":")
    other_epoch, _, other_number = other.rpartition(":")
    return epoch != other_epoch or int(number) >= int(other_number)
