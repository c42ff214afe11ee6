"""Parts that all websockets share: message types, close codes, refused handshakes, the outbox."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from endpoint.http.problems import problem
from rtask.errors import RtaskError

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Transmit = Callable[[Message], Awaitable[None]]

# RFC 6455, 7.4.1, and the IANA registry of close codes.
POLICY_VIOLATION = 1008
INTERNAL_ERROR = 1011
SERVICE_RESTART = 1012
TRY_AGAIN_LATER = 1013

STALL_S = 120.0
MAX_MESSAGES = 256
MAX_BYTES = 64 << 20


async def refuse_handshake(scope: Message, transmit: Transmit, error: RtaskError) -> None:
    """Answer a handshake with the status of an error; with 403 if the server supports no other."""
    response = problem(error)
    if "websocket.http.response" not in scope.get("extensions", {}):
        await transmit({"type": "websocket.close", "code": POLICY_VIOLATION})
        return
    headers = [(name.lower().encode(), text.encode()) for name, text in response.header_list()]
    await transmit(
        {
            "type": "websocket.http.response.start",
            "status": response.status,
            "headers": [*headers, (b"content-length", str(len(response.body)).encode())],
        }
    )
    await transmit({"type": "websocket.http.response.body", "body": response.body})


class Outbox:
    """Bounded queue of the frames for one client, filled from any thread and emptied by one task.

    Answers are never dropped. If the client reads too slowly, the oldest message of the same topic
    makes room for a new one. While the queue is full, nothing is read from the client either, so
    that one that does not read cannot ask.

    Parameters
    ----------
    loop
        The loop of the websocket; the outbox is made on its thread.
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
        """Add a frame without waiting; may be called from any thread."""
        if self._closed or self._loop.is_closed():
            return
        # One queue for all threads preserves the order; the loop's own thread need not be woken.
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
        """Wait for the next frame and return it."""
        while not self._entries:
            self._filled.clear()
            await self._filled.wait()
        text, _ = self._entries.popleft()
        self._bytes -= len(text)
        if not self._is_full():
            self._drained.set()
        return text

    async def wait_for_room(self) -> None:
        """Wait until the client has read enough for us to read from it again."""
        await self._drained.wait()

    def close(self) -> None:
        """Accept no more frames."""
        self._closed = True
        self._drained.set()
