"""One stream of server-sent events (HTML Standard, 9.2), whatever it tells of."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from typing import Protocol

from endpoint.access.auth import Caller
from endpoint.follow.events import event
from endpoint.http.messages import Request
from endpoint.http.response_stream import SEND_IDLE_S, Wire
from endpoint.http.websocket import Message

__all__ = ["COMMENT_S", "EVENT_STREAM", "EventStream", "Streams"]

_log = logging.getLogger(__name__)
COMMENT_S = 15.0
EVENT_STREAM = "text/event-stream"
_LEFT = "the client left"


class Streams(Protocol):
    """The collection to which a stream belongs."""

    def add(self, stream: EventStream) -> None:
        """Count a stream in."""

    def remove(self, stream: EventStream) -> None:
        """Count a stream out."""

    def version(self) -> str:
        """Return the current version of the graph."""

    def cors(self, request: Request) -> tuple[tuple[str, str], ...]:
        """Return the header fields that let a page of another origin read the stream."""


class EventStream:
    """Sends the events of a subclass until either side ends the stream.

    Parameters
    ----------
    streams
        The collection to which it belongs.
    request
        The request that opened it.
    caller
        The follower.
    begin
        Version of the graph at which it begins; None = the current one, "" = none, where it does
        not tell of the graph.
    """

    def __init__(
        self, streams: Streams, request: Request, caller: Caller, begin: str | None = None
    ) -> None:
        self.caller = caller
        self.request = request
        self.ready = asyncio.Event()
        self.reason = ""
        self.begin = streams.version() if begin is None else begin
        self._streams = streams
        self._loop = asyncio.get_running_loop()

    def wake(self) -> None:
        """Look for new events; may be called from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self.ready.set)

    async def end(self, reason: str, code: int) -> None:
        """End the stream, naming the reason in a last event."""
        self.reason = reason
        self.ready.set()

    def close(self) -> None:
        """Stop following."""

    def pieces(self) -> AsyncIterator[bytes]:
        """Yield events until :attr:`reason` is set."""
        raise NotImplementedError

    async def send(self, wire: Wire) -> int:
        """Send events until either side ends the stream; return the number of bytes sent."""
        self._streams.add(self)
        wire.watch(self._leave)
        sent = 0
        try:
            await wire.transmit(self._start())
            if self.request.method != "HEAD":
                async for piece in self.pieces():
                    sent += await _transmit(wire, piece)
                if self.reason not in ("", _LEFT):
                    sent += await _transmit(wire, event("bye", {"reason": self.reason}))
            with contextlib.suppress(RuntimeError, OSError):
                await wire.transmit({"type": "http.response.body", "body": b""})
        except (TimeoutError, OSError):
            _log.info("a follower reads nothing; closing")
        finally:
            wire.unwatch()
            self._streams.remove(self)
            self.close()
        return sent

    async def wait(self, most_s: float = COMMENT_S) -> bool:
        """Wait for something new; tell whether it came before a comment is due."""
        try:
            async with asyncio.timeout(most_s):
                await self.ready.wait()
        except TimeoutError:
            return False
        return True

    def _leave(self) -> None:
        self.reason = _LEFT
        self.ready.set()

    def _start(self) -> Message:
        headers = [
            ("content-type", EVENT_STREAM),
            ("cache-control", "no-store"),
            ("x-accel-buffering", "no"),
            ("rtask-request-id", self.request.id),
            *self._streams.cors(self.request),
        ]
        if self.begin:
            headers.append(("rtask-version", self.begin))
        raw = [(name.lower().encode(), text.encode("latin-1")) for name, text in headers]
        return {"type": "http.response.start", "status": 200, "headers": raw}


async def _transmit(wire: Wire, piece: bytes) -> int:
    async with asyncio.timeout(SEND_IDLE_S):
        await wire.transmit({"type": "http.response.body", "body": piece, "more_body": True})
    return len(piece)
