"""Websocket connections of robots: the handshake, then one rosbridge session for each."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time

from endpoint.access.auth import Authenticator, Caller
from endpoint.activity.presence import Link
from endpoint.http.following import Following
from endpoint.http.messages import RefusedError, Request
from endpoint.http.websocket import (
    INTERNAL_ERROR,
    POLICY_VIOLATION,
    SERVICE_RESTART,
    STALL_S,
    TRY_AGAIN_LATER,
    Message,
    Outbox,
    Receive,
    Transmit,
    refuse_handshake,
)
from endpoint.rosbridge.packing import Frame
from endpoint.rosbridge.session import Bridge, Session
from endpoint.rosbridge.upstream import Upstream
from rtask.errors import RtaskError

ADDRESSES = ("/", "/rosbridge")
LARGE_MESSAGE = 64 << 10
MAX_CONNECTIONS = 2_000
MAX_PER_TOKEN = 20
_log = logging.getLogger(__name__)


class Connections:
    """All open robot connections of a server.

    Parameters
    ----------
    bridge
        State that the sessions share.
    auth
        Identifies robots.
    following
        The server to which everything goes on that does not only read; none if this is nobody's
        follower, or passes nothing on.
    """

    def __init__(
        self, bridge: Bridge, auth: Authenticator, following: Following | None = None
    ) -> None:
        self._bridge = bridge
        self._auth = auth
        self._following = following
        self._open: set[Connection] = set()

    async def serve(
        self, request: Request, scope: Message, receive: Receive, transmit: Transmit
    ) -> None:
        """Accept a connection and serve it to its end, or refuse it before the upgrade."""
        await receive()  # websocket.connect
        try:
            if (request.path.rstrip("/") or "/") not in ADDRESSES:
                raise RefusedError(404, "not-found", f"robots connect to {' or '.join(ADDRESSES)}")
            caller = self._auth.identify(request, ticket_in_url=True)
            self._auth.check_origin(request, caller)
            self._admit(caller)
        except RtaskError as error:
            _log.warning("refused a robot from %s: %s", request.client, error)
            await refuse_handshake(scope, transmit, error)
            return
        await transmit({"type": "websocket.accept"})
        connection = Connection(self._bridge, caller, receive, transmit)
        if self._following is not None:
            connection.pass_on(self._following, request)
        self._open.add(connection)
        leave = self._bridge.activity.links.add(connection.link())
        _log.info("robot %s connected from %s", caller.name, request.client)
        try:
            await connection.run()
        finally:
            leave()
            self._open.discard(connection)
            _log.info("robot %s left", caller.name)

    def _admit(self, caller: Caller) -> None:
        """Refuse a connection too many.

        Raises
        ------
        RefusedError
            503, with the time to wait.
        """
        own = 0
        if caller.token is not None:
            own = sum(other.caller.key == caller.key for other in self._open)
        if own < MAX_PER_TOKEN and len(self._open) < MAX_CONNECTIONS:
            return
        held = f"{own} connections with this token" if own >= MAX_PER_TOKEN else "too many robots"
        raise RefusedError(503, "busy", f"{held}; try later", headers=(("Retry-After", "10"),))

    async def close_revoked(self) -> None:
        """Close the connections whose token has been revoked."""
        for connection in list(self._open):
            if not self._auth.still_valid(connection.caller):
                await connection.close(POLICY_VIOLATION, "token revoked")

    async def close_all(self) -> None:
        """Close all connections because the server stops."""
        await asyncio.gather(*(c.close(SERVICE_RESTART, "server stops") for c in list(self._open)))

    def __len__(self) -> int:
        return len(self._open)


class Connection:
    """The connection of one robot.

    Parameters
    ----------
    bridge
        State that the sessions share.
    caller
        The robot.
    receive, transmit
        The two halves of the ASGI connection.
    """

    def __init__(
        self, bridge: Bridge, caller: Caller, receive: Receive, transmit: Transmit
    ) -> None:
        self.caller = caller
        self._receive = receive
        self._transmit = transmit
        self._outbox = Outbox(asyncio.get_running_loop())
        self._session = Session(bridge, self._outbox.put, caller.access)
        self._bridge = bridge
        self._upstream: Upstream | None = None
        self._closing = False

    def pass_on(self, following: Following, request: Request) -> None:
        """From now on, pass what does not only read to the server that is followed."""
        self._upstream = Upstream(following, self._bridge, request, self._deliver, self.close)

    def link(self) -> Link:
        """Return what others see of the connection, and how they close it."""
        loop = asyncio.get_running_loop()

        def close(reason: str) -> None:
            if not loop.is_closed():
                asyncio.run_coroutine_threadsafe(self.close(POLICY_VIOLATION, reason), loop)

        session = self._session
        return Link(session.identity, time.time(), session.provides, close)

    async def _deliver(self, frame: Frame) -> None:
        self._outbox.put(frame)
        await self._outbox.wait_for_room()

    async def run(self) -> None:
        """Read until the robot leaves, while one task writes."""
        writer = asyncio.create_task(self._write())
        try:
            await self._read()
        except Exception:  # noqa: BLE001 - one robot's fault must not stop the others
            _log.exception("the connection of %s failed", self.caller.name)
            await self.close(INTERNAL_ERROR, "internal error")
        finally:
            self._closing = True
            self._session.close()
            self._outbox.close()
            if self._upstream is not None:
                await self._upstream.close()
            writer.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await writer

    async def _read(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            message = await self._receive()
            if message["type"] == "websocket.disconnect":
                return
            frame = message.get("text")
            if frame is None:
                frame = message.get("bytes") or b""
            if self._upstream is not None and await self._upstream.take(frame):
                pass
            elif isinstance(frame, str) and len(frame) > LARGE_MESSAGE:
                await loop.run_in_executor(None, self._session.feed, frame)
            else:
                self._session.feed(frame)
            await self._outbox.wait_for_room()

    async def _write(self) -> None:
        try:
            while True:
                text = await self._outbox.take()
                async with asyncio.timeout(STALL_S):
                    kind = "text" if isinstance(text, str) else "bytes"
                    await self._transmit({"type": "websocket.send", kind: text})
        except TimeoutError:
            await self.close(TRY_AGAIN_LATER, "nothing read for too long")
        except (RuntimeError, OSError):
            self._outbox.close()  # the robot left between two messages

    async def close(self, code: int, reason: str) -> None:
        """Close the connection from this side."""
        if self._closing:
            return
        self._closing = True
        with contextlib.suppress(RuntimeError, OSError):
            await self._transmit({"type": "websocket.close", "code": code, "reason": reason})
