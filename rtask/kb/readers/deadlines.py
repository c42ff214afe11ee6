"""Ends queries whose time is over."""

from __future__ import annotations

import heapq
import itertools
import threading
import time
import weakref

from rtask.kb.readers.streams import ReaderStream

__all__ = ["Deadlines"]


class Deadlines:
    """Kills the readers of queries whose time is over; one thread for all."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._heap: list[tuple[float, int, weakref.ref[ReaderStream]]] = []
        self._numbers = itertools.count()
        self._thread: threading.Thread | None = None
        self._closed = False

    def add(self, at: float, stream: ReaderStream) -> None:
        """End the stream at this time of the monotonic clock."""
        with self._changed:
            while self._heap and _is_over(self._heap[0][2]):
                heapq.heappop(self._heap)
            number = next(self._numbers)
            heapq.heappush(self._heap, (at, number, weakref.ref(stream)))
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name="rtask-deadlines", daemon=True
                )
                self._thread.start()
            elif self._heap[0][1] == number:  # nobody else's time is over before
                self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._heap and _is_over(self._heap[0][2]):
                    heapq.heappop(self._heap)
                if self._closed:
                    return
                wait = self._heap[0][0] - time.monotonic() if self._heap else None
                if wait is None or wait > 0:
                    self._changed.wait(wait)
                    continue
                stream = heapq.heappop(self._heap)[2]()
            if stream is not None:
                stream.expire()
            del stream

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = True
            self._heap.clear()
            self._changed.notify()


def _is_over(reference: weakref.ref[ReaderStream]) -> bool:
    stream = reference()
    return stream is None or stream.is_over
