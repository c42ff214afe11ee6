"""An answer that is preceded by events about its progress (HTML Standard, 9.2)."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import json
from collections.abc import Awaitable
from typing import Any

from endpoint.http.messages import Response
from endpoint.http.plan import Progress
from endpoint.http.response_stream import SEND_IDLE_S, Wire, send

__all__ = ["send_with_progress"]

COMMENT_S = 15.0


async def send_with_progress(
    answer: Awaitable[Response], progress: Progress, method: str, wire: Wire
) -> tuple[Response, int, bool]:
    """Send events while an answer is being made, and then the answer as the last event.

    An answer that is there before any event is sent as it is, without a stream.

    Returns
    -------
    response, sent, whole
        The answer, the bytes of the body that were sent, and whether that was all of it.
    """
    loop = asyncio.get_running_loop()
    ready = asyncio.Event()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(ready.set)

    progress.listen(wake)
    work = asyncio.ensure_future(answer)
    work.add_done_callback(lambda _: ready.set())
    sent, has_begun = 0, False
    try:
        while True:
            ready.clear()
            is_done = work.done()
            pieces = [_event(message) for message in progress.drain()]
            if is_done and not has_begun and not pieces:
                response = work.result()
                return response, *await send(response, method, wire)
            if not has_begun:
                await wire.transmit(_start())
                has_begun = True
            if is_done:
                response = work.result()
                pieces.append(_last(response, progress.request_id))
            for piece in pieces:
                await _transmit(wire, piece)
                sent += len(piece)
            if is_done:
                await wire.transmit({"type": "http.response.body", "body": b""})
                return response, sent, True
            try:
                async with asyncio.timeout(COMMENT_S):
                    await ready.wait()
            except TimeoutError:
                await _transmit(wire, b": still here\n\n")
    except (TimeoutError, OSError):  # the client reads nothing, or has left
        response = await work
        return response, sent, False
    finally:
        wire.unwatch()


def _start() -> dict[str, Any]:
    headers = [
        (b"content-type", b"text/event-stream"),
        (b"cache-control", b"no-store"),
        (b"x-accel-buffering", b"no"),
    ]
    return {"type": "http.response.start", "status": 200, "headers": headers}


def _event(message: dict[str, Any]) -> bytes:
    return f"event: message\ndata: {json.dumps(message, ensure_ascii=False)}\n\n".encode()


def _last(response: Response, request_id: object) -> bytes:
    """Return the answer as an event; a refusal of HTTP becomes an error of the protocol."""
    if response.status != 200:
        words = f"the call ended with status {response.status}"
        error = {"code": -32603, "message": words}
        return _event({"jsonrpc": "2.0", "id": request_id, "error": error})
    is_packed = ("Content-Encoding", "gzip") in response.headers
    body = gzip.decompress(response.body) if is_packed else response.body
    return b"event: message\ndata: " + body + b"\n\n"


async def _transmit(wire: Wire, piece: bytes) -> None:
    async with asyncio.timeout(SEND_IDLE_S):
        await wire.transmit({"type": "http.response.body", "body": piece, "more_body": True})
