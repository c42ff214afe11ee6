"""Requests that have been read, passed to Flask, and what its answers show of themselves."""

from __future__ import annotations

import asyncio
import logging

from endpoint.http.response_stream import SEND_IDLE_S
from endpoint.http.websocket import Message, Receive, Transmit

__all__ = ["Seen", "impatient", "replay", "with_length"]

_log = logging.getLogger(__name__)


def with_length(scope: Message, body: bytes, request_id: str) -> Message:
    """Add the request id and the length of the body: a chunked one would reach WSGI empty."""
    headers = [
        (name, value)
        for name, value in scope["headers"]
        if name not in (b"content-length", b"transfer-encoding", b"rtask-request-id")
    ]
    own = [
        (b"content-length", str(len(body)).encode()),
        (b"rtask-request-id", request_id.encode()),
    ]
    return {**scope, "headers": [*headers, *own]}


class Seen:
    """Status and size of an answer by Flask, for the log."""

    def __init__(self, transmit: Transmit) -> None:
        self._transmit = transmit
        self.status, self.bytes = 500, 0

    async def transmit(self, message: Message) -> None:
        """Pass a message on."""
        if message["type"] == "http.response.start":
            self.status = message["status"]
        else:
            self.bytes += len(message.get("body", b""))
        await self._transmit(message)


def replay(body: bytes) -> Receive:
    """Pass a body that has been read to another application."""
    messages: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> Message:
        if messages:
            return messages.pop()
        await asyncio.Event().wait()  # the other side leaving is seen when writing
        raise AssertionError

    return receive


def impatient(transmit: Transmit) -> Transmit:
    """Discard the rest of a page whose client stopped reading, to free its thread."""
    gone = False

    async def send(message: Message) -> None:
        nonlocal gone
        if gone:
            return
        try:
            async with asyncio.timeout(SEND_IDLE_S):
                await transmit(message)
        except TimeoutError:
            gone = True
            _log.warning("a client stopped reading a page")

    return send
