"""Sending of responses, whole or in pieces, as fast as the client reads and no faster."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable
from dataclasses import dataclass, field

from endpoint.http.cork import CORK, Cork
from endpoint.http.messages import Chunks, Response
from endpoint.http.websocket import Message, Receive, Transmit
from rtask.errors import RtaskError

SEND_IDLE_S = 30.0
PIECE = 256 << 10
UNHURRIED_BYTES = 64 << 10  # fits the socket's buffers, so no client can delay it
MAX_BUFFERED = 64 << 20
_AS_WRITTEN = contextlib.nullcontext()
_log = logging.getLogger(__name__)


@dataclass
class Wire:
    """The two directions of one ASGI request.

    Parameters
    ----------
    scope
        ASGI scope.
    receive, transmit
        ASGI callables.
    """

    scope: Message
    receive: Receive
    transmit: Transmit
    _watcher: asyncio.Task[None] | None = None
    _when_gone: list[Callable[[], object]] = field(default_factory=list)

    def watch(self, when_gone: Callable[[], object]) -> None:
        """Call back when the client disconnects; the body must have been read."""
        self._when_gone.append(when_gone)
        if self._watcher is None:
            self._watcher = asyncio.get_running_loop().create_task(self._watch())

    async def _watch(self) -> None:
        while (await self.receive())["type"] != "http.disconnect":
            pass
        for callback in self._when_gone:
            callback()

    def in_one_piece(self) -> contextlib.AbstractContextManager[object]:
        """Return a context at whose end all is sent that was transmitted in it."""
        cork: Cork | None = self.scope.get("extensions", {}).get(CORK)
        return _AS_WRITTEN if cork is None else cork

    def unwatch(self) -> None:
        """Stop watching, once the answer has been sent."""
        if self._watcher is not None:
            self._watcher.cancel()


async def send(response: Response, method: str, wire: Wire) -> tuple[int, bool]:
    """Send a response.

    Returns
    -------
    sent, whole
        Bytes of the body that were sent, and whether that was all of it.
    """
    try:
        if response.chunks is None:
            return await _send_whole(response, method, wire)
        if wire.scope.get("http_version") == "1.0" or method == "HEAD":
            return await _send_buffered(response, method, wire)
        return await _send_pieces(response, response.chunks, wire)
    finally:
        wire.unwatch()
        if response.chunks is not None:
            response.chunks.close()


def _start(response: Response, length: int | None) -> Message:
    headers = [
        (name.lower().encode("latin-1"), text.encode("latin-1", "replace"))
        for name, text in response.header_list()
    ]
    if length is not None:
        headers.append((b"content-length", b"%d" % length))
    return {"type": "http.response.start", "status": response.status, "headers": headers}


async def _send_whole(response: Response, method: str, wire: Wire) -> tuple[int, bool]:
    body = b"" if method == "HEAD" else response.body
    without_length = response.status in (204, 304) or method == "HEAD"
    start = _start(response, None if without_length else len(body))
    if len(body) <= UNHURRIED_BYTES:
        with wire.in_one_piece():
            await wire.transmit(start)
            await wire.transmit({"type": "http.response.body", "body": body})
        return len(body), True
    await wire.transmit(start)
    sent = 0
    try:
        for at in range(0, len(body), PIECE):
            piece = body[at : at + PIECE]
            more = at + PIECE < len(body)
            async with asyncio.timeout(SEND_IDLE_S):
                await wire.transmit(
                    {"type": "http.response.body", "body": piece, "more_body": more}
                )
            sent += len(piece)
    except TimeoutError:
        _log.info("a client reads nothing; closing")
        return sent, False
    return sent, True


async def _send_pieces(response: Response, chunks: Chunks, wire: Wire) -> tuple[int, bool]:
    """Send the pieces as they become available.

    An answer that cannot be completed is left without its last chunk, and the server closes the
    connection, so that no client takes half an answer for a whole one (RFC 9112, 8).
    """
    gone = asyncio.Event()
    wire.watch(gone.set)
    wire.watch(chunks.close)
    loop = asyncio.get_running_loop()
    await wire.transmit(_start(response, None))
    sent, piece = 0, response.body
    try:
        while True:
            if piece:
                async with asyncio.timeout(SEND_IDLE_S):
                    await wire.transmit(
                        {"type": "http.response.body", "body": piece, "more_body": True}
                    )
                sent += len(piece)
            if gone.is_set():
                return sent, False
            following = await loop.run_in_executor(None, next, chunks, None)
            if following is None:
                break
            piece = following
        if gone.is_set():
            return sent, False
        await wire.transmit({"type": "http.response.body", "body": b"", "more_body": False})
    except (TimeoutError, RtaskError) as error:
        _log.info("an answer is broken off: %s", error or "the client reads nothing")
        return sent, False
    return sent, True


async def _send_buffered(response: Response, method: str, wire: Wire) -> tuple[int, bool]:
    """Send all at once: before HTTP/1.1 a client cannot tell that an answer is truncated."""
    assert response.chunks is not None
    loop = asyncio.get_running_loop()
    pieces, size = [response.body], len(response.body)
    with contextlib.suppress(RtaskError):
        while method != "HEAD" and size <= MAX_BUFFERED:
            piece = await loop.run_in_executor(None, next, response.chunks, None)
            if piece is None:
                whole = Response(
                    response.status, b"".join(pieces), response.media_type, response.headers
                )
                return await _send_whole(whole, method, wire)
            pieces.append(piece)
            size += len(piece)
    if method == "HEAD":
        return await _send_whole(response, method, wire)
    refusal = Response(413, b"too large for HTTP/1.0, or broken off", "text/plain; charset=utf-8")
    return await _send_whole(refusal, method, wire)
