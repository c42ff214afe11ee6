"""The work that remains once a request has been understood, and how to stop it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from endpoint.http.messages import Response
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream

MAX_SHOWN_TEXT = 2_000

Lane = Literal["loop", "point", "query", "work"]


@dataclass(slots=True)
class RunningQuery:
    """One query in progress.

    Parameters
    ----------
    id
        Request id.
    owner
        Key under which the caller's requests are counted; the owner may stop the query.
    caller
        Name of the caller, for display.
    text
        SPARQL.
    timeout_s
        Its time limit.
    """

    id: str
    owner: str
    caller: str
    text: str
    timeout_s: float
    started: float = field(default_factory=time.monotonic)
    stopped: bool = False
    _stop: Callable[[], None] | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def on_stop(self, stop: Callable[[], None]) -> None:
        """Register how to stop the query; called at once if it has been stopped already."""
        with self._lock:
            self._stop = stop
            late = self.stopped
        # Outside of the lock: it may end the query, which asks for the lock.
        if late:
            stop()

    def stop(self) -> None:
        """Stop the query by the function registered with :meth:`on_stop`."""
        with self._lock:
            self.stopped = True
            stop = self._stop
        if stop is not None:
            stop()

    def facts(self) -> dict[str, Any]:
        """Return what lists of running queries show."""
        return {
            "id": self.id,
            "caller": self.caller,
            "seconds": round(time.monotonic() - self.started, 3),
            "timeout": self.timeout_s,
            "query": self.text[:MAX_SHOWN_TEXT],
        }


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Work that threads of its own do; the plan's ``run`` answers from it once it has ended.

    Parameters
    ----------
    start
        Starts the work without waiting; may raise any error of :mod:`rtask.errors`.
    late
        Called when the time is up: ends the work as late, unless it is being stored, in which case
        it ends by itself at once. None to leave the work alone and answer as it is then.
    stop
        Called when nobody waits for the answer any more.
    """

    start: Callable[[], Future[Any]]
    late: Callable[[], object] | None
    stop: Callable[[], object]


class PlannedQuery(Protocol):
    """The steps of a query on its way to an answer; :mod:`endpoint.lanes` draws the way."""

    def run(self) -> Response:
        """Answer among the long queries."""

    def encode(self) -> bytes | None:
        """Return the query as it is sent to a reader; None if a thread is to do the work."""

    def whole(self, answer: Answer) -> Response:
        """Return the response for a whole answer from a reader."""

    def resume(self, stream: ReaderStream) -> Response:
        """Answer from what a reader has begun to send; waits for the rest."""

    def look_up(self) -> Response | None:
        """Answer from the store in the calling thread at once; None if that is not possible."""

    def keep(self, response: Response) -> None:
        """Take the response, before it is sent, for the answer cache."""


class Progress:
    """Messages about work in progress, to be sent as events before its answer.

    Parameters
    ----------
    request_id
        Id of the request in its protocol.
    """

    def __init__(self, request_id: object = None) -> None:
        self.request_id = request_id
        self._lock = threading.Lock()
        self._waiting: list[dict[str, Any]] = []
        self._listener: Callable[[], None] | None = None

    def add(self, message: dict[str, Any]) -> None:
        """Append a message; may be called from any thread."""
        with self._lock:
            self._waiting.append(message)
            listener = self._listener
        if listener is not None:
            listener()

    def listen(self, listener: Callable[[], None]) -> None:
        """Call back after each message from now on."""
        with self._lock:
            self._listener = listener

    def drain(self) -> list[dict[str, Any]]:
        """Return the messages since the last call."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
        return waiting


@dataclass(slots=True)
class Plan:
    """A request that was understood; running it does the work.

    Parameters
    ----------
    run
        Does the work; may raise any error of :mod:`rtask.errors`.
    timeout_s
        Time limit; none for work that must not be abandoned half-way.
    lane
        Where it runs: ``loop`` for what takes no time, ``point`` for a query that looks quick,
        ``query`` for any other query, ``work`` for everything else.
    form, text
        Of SPARQL requests, for the log.
    running
        The query to list, and to stop on request, while it runs.
    query
        The query, if it is one: how it is answered in each of its lanes.
    elsewhere
        The work, if threads of its own do it.
    progress
        What is sent as events before the answer, where the client asked for that.
    """

    run: Callable[[], Response]
    timeout_s: float | None = None
    lane: Lane = "work"
    form: str = ""
    text: str = ""
    running: RunningQuery | None = None
    query: PlannedQuery | None = None
    elsewhere: Elsewhere | None = None
    progress: Progress | None = None

    @staticmethod
    def ready(response: Response) -> Plan:
        """Return a plan whose answer is known already."""
        return Plan(lambda: response, lane="loop")
