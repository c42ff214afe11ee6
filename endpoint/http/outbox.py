"""What waits to go out to one robot: bounded, and filled from any thread."""

from __future__ import annotations

import asyncio
import threading
from collections import deque

MAX_MESSAGES = 256
MAX_BYTES = 64 << 20


class Outbox:
    """Frames for one websocket, texts or bytes; one task takes them out.

    Answers are never dropped; of topic messages the oldest of the same topic goes first when the
    robot reads too slowly. While the box is full the session's reads stop, so a robot that does
    not read cannot ask either.

    Parameters
    ----------
    loop
        The loop that the socket lives on; the box is made on its thread.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._thread = threading.get_ident()
        self._inbox: deque[tuple[str | bytes, str]] = deque()
        self._entries: deque[tuple[str | bytes, str]] = deque()
        self._bytes = 0
        self._filled = asyncio.Event()
        self._drained = asyncio.Event()
        self._drained.set()
        self._closed = False
        self.dropped = 0

    def put(self, text: str | bytes, topic: str = "") -> None:
        """Add a text; may be called from any thread, and never waits."""
        if self._closed or self._loop.is_closed():
            return
        # One queue for all threads keeps the order in which things were said; on the loop's own
        # thread there is no need to wake it.
        self._inbox.append((text, topic))
        if threading.get_ident() == self._thread:
            self._take_in()
        else:
            self._loop.call_soon_threadsafe(self._take_in)

    def _take_in(self) -> None:
        while self._inbox:
            self._put(*self._inbox.popleft())

    def _put(self, text: str | bytes, topic: str) -> None:
        if self._closed:
            return
        if topic and self._is_full():
            self._drop_oldest(topic)
            if self._is_full():
                self.dropped += 1
                return
        self._entries.append((text, topic))
        self._bytes += len(text)
        self._filled.set()
        if self._is_full():
            self._drained.clear()

    def _is_full(self) -> bool:
        return len(self._entries) >= MAX_MESSAGES or self._bytes >= MAX_BYTES

    def _drop_oldest(self, topic: str) -> None:
        for entry in self._entries:
            if entry[1] == topic:
                self._entries.remove(entry)
                self._bytes -= len(entry[0])
                self.dropped += 1
                return

    async def take(self) -> str | bytes:
        """Wait for the next text."""
        while not self._entries:
            self._filled.clear()
            await self._filled.wait()
        text, _ = self._entries.popleft()
        self._bytes -= len(text)
        if not self._is_full():
            self._drained.set()
        return text

    async def wait_for_room(self) -> None:
        """Wait until the robot has read enough to be listened to again."""
        await self._drained.wait()

    def close(self) -> None:
        """Take nothing more."""
        self._closed = True
        self._drained.set()
