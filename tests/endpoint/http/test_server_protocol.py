"""The protocol of the server: small answers in one piece, and headers that take too long."""

from __future__ import annotations

import asyncio

import pytest
import uvicorn
from uvicorn.server import ServerState

from endpoint.http.messages import Response
from endpoint.http.response_stream import UNHURRIED_BYTES, Wire, send
from endpoint.http.server_protocol import HEADER_S, GuardedProtocol

_ASK = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"


class FakeTransport(asyncio.Transport):
    """A connection that keeps what is written."""

    def __init__(self):
        super().__init__()
        self.written, self.closed = [], False

    def write(self, data):
        """Keep some bytes; none may follow the end."""
        assert not self.closed
        self.written.append(bytes(data))

    def close(self):
        """Close."""
        self.closed = True

    def is_closing(self):
        """Return whether it is closed."""
        return self.closed

    def pause_reading(self):
        """Do nothing."""

    def resume_reading(self):
        """Do nothing."""


class FakeLoop:
    """A loop whose time is set, with the timer of headers; the rest is the running one's."""

    def __init__(self):
        self.now, self.due = 0.0, None

    def __getattr__(self, name):
        return getattr(asyncio.get_running_loop(), name)

    def time(self):
        """Return the time that was set."""
        return self.now

    def call_at(self, when, callback):
        """Keep the timer of headers; those of idle connections are uvicorn's own."""
        if callback.__name__ == "_check_header":
            self.due = (when, callback)
        return asyncio.TimerHandle(when, callback, (), asyncio.get_running_loop())

    def call_later(self, delay, callback):
        """Keep a timer."""
        return self.call_at(self.now + delay, callback)

    def go_on_to(self, now):
        """Let time pass, and call back what is due."""
        while self.due is not None and self.due[0] <= now:
            (self.now, callback), self.due = self.due, None
            callback()
        self.now = now


def connected(response, loop=None):
    """Return a protocol that gives an answer, and its transport."""

    async def app(scope, receive, transmit):
        await send(response, "GET", Wire(scope, receive, transmit))

    config = uvicorn.Config(app, http=GuardedProtocol, lifespan="off", log_config=None)
    config.load()
    protocol = GuardedProtocol(
        config=config, server_state=ServerState(), app_state={}, _loop=loop or FakeLoop()
    )
    transport = FakeTransport()
    protocol.connection_made(transport)
    return protocol, transport


async def _settled():
    for _ in range(5):
        await asyncio.sleep(0)


def test_a_small_answer_is_written_once_and_a_large_one_in_pieces():
    async def run(size, ask=_ASK):
        protocol, transport = connected(Response(200, b"x" * size, "text/plain"))
        protocol.data_received(ask)
        await _settled()
        written, closed = list(transport.written), transport.closed
        protocol.connection_lost(None)
        return written, closed

    [whole], closed = asyncio.run(run(5))
    assert whole.startswith(b"HTTP/1.1 200")
    assert whole.endswith(b"\r\n\r\nxxxxx")
    assert not closed
    large, _ = asyncio.run(run(UNHURRIED_BYTES + 1))
    assert len(large) > 1
    assert b"".join(large).endswith(b"\r\n\r\n" + b"x" * (UNHURRIED_BYTES + 1))
    last, closed = asyncio.run(run(5, _ASK.replace(b"Host", b"Connection: close\r\nHost")))
    assert (b"".join(last)[-5:], closed) == (b"xxxxx", True)


def test_pipelined_requests_are_answered_in_order():
    async def run():
        protocol, transport = connected(Response(200, b"abc", "text/plain"))
        protocol.data_received(_ASK + _ASK)
        await _settled()
        await _settled()
        protocol.connection_lost(None)
        return transport.written

    written = asyncio.run(run())
    assert [piece[-3:] for piece in written] == [b"abc", b"abc"]


@pytest.mark.parametrize("begun", [0.0, 1.0, 29.0, 31.0, 100.0])
def test_a_header_is_given_its_time_whenever_it_begins_and_no_more(begun):
    async def run():
        loop = FakeLoop()
        protocol, transport = connected(Response(204), loop)
        if begun:
            protocol.data_received(_ASK)
            await _settled()
            loop.go_on_to(begun)
        protocol.data_received(b"GET / HTTP/1.1\r\nHost: loc")
        loop.go_on_to(begun + HEADER_S - 0.01)
        assert not transport.closed
        loop.go_on_to(begun + HEADER_S)
        assert transport.closed
        protocol.connection_lost(None)

    asyncio.run(run())


def test_the_time_of_a_header_ends_with_it():
    async def run():
        loop = FakeLoop()
        protocol, transport = connected(Response(204), loop)
        protocol.data_received(_ASK)
        loop.go_on_to(10 * HEADER_S)
        assert not transport.closed
        await _settled()
        protocol.connection_lost(None)

    asyncio.run(run())
