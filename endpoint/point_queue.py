"""Point queries on the event loop: sent to a reader's socket, awaited at its pipe, without threads.

A thread for each query would spend more time waiting and waking than the query takes. Queries that
find no reader free wait here for one, in order and not for long; then a thread takes over, which
may wait, and which starts another reader where there are too few.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from endpoint.application import Application, Job
from endpoint.sparql.answers import QUICK_S
from rtask.kb.readers.streams import ReaderStream

__all__ = ["PointQueue"]

WAIT_S = 0.1
_MAX_WAITING = 256

Come = Callable[[ReaderStream | None], None]


@dataclass
class _Waiting:
    """A query that waits for a reader."""

    job: Job
    come: Come
    timer: asyncio.TimerHandle | None = None


class PointQueue:
    """Sends point queries to readers; its methods are for the event loop's thread.

    Parameters
    ----------
    application
        Plans and answers the queries.
    """

    def __init__(self, application: Application) -> None:
        self._application = application
        self._queue: deque[_Waiting] = deque()
        self._running = 0

    def ask(self, job: Job, come: Come) -> None:
        """Send a query as soon as a reader is free.

        Parameters
        ----------
        come
            Called once: with the stream when the answer or its first piece has come, or the query
            has been stopped; with none if a thread is to do the work.
        """
        may_begin = job.plan.begin is not None and self._application.may_begin
        if not may_begin or len(self._queue) >= _MAX_WAITING:
            come(None)
            return
        if not self._queue:
            stream = self._application.begin(job)
            if stream is not None:
                self._await(stream, come)
                return
        if not self._running:  # nobody will give a reader back soon
            self._application.start_reader()
            come(None)
            return
        waiting = _Waiting(job, come)
        waiting.timer = asyncio.get_running_loop().call_later(WAIT_S, self._give_up, waiting)
        self._queue.append(waiting)

    def _give_up(self, waiting: _Waiting) -> None:
        self._queue.remove(waiting)
        waiting.come(None)

    def _await(self, stream: ReaderStream, come: Come) -> None:
        loop = asyncio.get_running_loop()
        descriptor = stream.descriptor

        def receive() -> None:
            if stream.receive():
                timer.cancel()
                loop.remove_reader(descriptor)
                self._running -= 1
                try:
                    come(stream)
                finally:
                    self._advance()

        self._running += 1
        loop.add_reader(descriptor, receive)
        timer = loop.call_later(QUICK_S, stream.end, QUICK_S)

    def _advance(self) -> None:
        """Send the queries for which there is a reader now."""
        while self._queue:
            waiting = self._queue[0]
            stream = self._application.begin(waiting.job)
            if stream is None:
                return
            self._queue.popleft()
            assert waiting.timer is not None
            waiting.timer.cancel()
            self._await(stream, waiting.come)
