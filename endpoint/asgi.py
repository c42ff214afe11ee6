"""The asynchronous front: robots' websockets and programs' requests; pages go on to Flask.

What programs ask runs on the gateway's threads, so a stalled download or a slow page keeps nobody
from the graph, and `/health` is answered whatever else is busy.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import Any, cast

from a2wsgi import WSGIMiddleware
from flask import Flask

from endpoint.exchange import RefusedError, Request, Response
from endpoint.gateway import Gateway
from endpoint.problems import problem
from endpoint.protocol.negotiation import prefers_html
from endpoint.rosbridge.session import Bridge
from endpoint.websocket import Connections, Message, Receive, Transmit

_log = logging.getLogger(__name__)
SMALL_BODY = 16 << 10
BODY_IDLE_S = 30.0
SEND_IDLE_S = 30.0
UNHURRIED_BYTES = 64 << 10  # fits the socket's buffers: no client can hold it up
REVOCATION_CHECK_S = 0.5
PAGE_THREADS = 16


class Front:
    """The ASGI application.

    Parameters
    ----------
    gateway
        Answers programs.
    bridge
        Answers robots.
    pages
        The Flask application.
    """

    def __init__(self, gateway: Gateway, bridge: Bridge, pages: Flask) -> None:
        self._gateway = gateway
        self.connections = Connections(bridge, gateway.auth)
        # a2wsgi types the same interfaces in words of its own.
        self._pages: Any = WSGIMiddleware(cast(Any, pages.wsgi_app), workers=PAGE_THREADS)

    async def __call__(self, scope: Message, receive: Receive, transmit: Transmit) -> None:
        """Serve one connection of the server."""
        if scope["type"] == "lifespan":
            await self._lifespan(receive, transmit)
        elif scope["type"] == "websocket":
            await self.connections.serve(self._request(scope, b""), scope, receive, transmit)
        else:
            await self._http(scope, receive, transmit)

    async def _lifespan(self, receive: Receive, transmit: Transmit) -> None:
        await receive()
        watch = asyncio.create_task(self._watch_tokens())
        await transmit({"type": "lifespan.startup.complete"})
        await receive()
        watch.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await watch
        await transmit({"type": "lifespan.shutdown.complete"})

    async def _watch_tokens(self) -> None:
        while True:
            await asyncio.sleep(REVOCATION_CHECK_S)
            await self.connections.close_revoked()

    async def _http(self, scope: Message, receive: Receive, transmit: Transmit) -> None:
        try:
            body = await _read_body(scope, receive, self._gateway.config.max_upload_bytes)
        except RefusedError as error:
            await _send(transmit, problem(error), scope["method"])
            return
        if body is None:  # cut off half-way: nothing may be executed
            return
        request = self._request(scope, body)
        if self._gateway.serves(request.raw_path) and not _wants_page(request):
            response = await self._answer(request)
            await _send(transmit, response, request.method)
            return
        await self._pages(_with_length(scope, body), _replay(body), _impatient(transmit))

    async def _answer(self, request: Request) -> Response:
        loop = asyncio.get_running_loop()
        gateway = self._gateway
        if len(request.body) <= SMALL_BODY:
            plan = gateway.plan(request)
        else:
            plan = await loop.run_in_executor(gateway.pool, gateway.plan, request)
        work = gateway.pool.submit(plan.run)
        answer = asyncio.wrap_future(work)
        if plan.timeout_s is None:
            return await answer
        try:
            async with asyncio.timeout(plan.timeout_s):
                return await asyncio.shield(answer)
        except TimeoutError:
            return gateway.give_up(work, request, plan.timeout_s)

    def _request(self, scope: Message, body: bytes) -> Request:
        headers: dict[str, str] = {}
        for name, value in scope["headers"]:
            key, text = name.decode("latin-1"), value.decode("latin-1")
            headers[key] = f"{headers[key]}, {text}" if key in headers else text
        host = headers.get("host") or "{}:{}".format(*(scope.get("server") or ("localhost", 80)))
        client = scope.get("client")
        raw_path = scope.get("raw_path") or scope["path"].encode()
        return Request(
            scope.get("method", "GET"),
            raw_path.decode("latin-1"),
            scope["query_string"].decode("latin-1"),
            headers,
            body,
            self._gateway.config.site(scope["scheme"], host),
            client[0] if client else "",
        )


def _wants_page(request: Request) -> bool:
    """Tell whether a person opens the workbench at the protocol's own address."""
    return (
        request.method in ("GET", "HEAD")
        and request.raw_path.rstrip("/") == "/sparql"
        and prefers_html(request.header("accept"))
    )


def _send_time(response: Response) -> float:
    """Return how long a client may take to read: 30 s, and 100 kB/s for large answers."""
    return SEND_IDLE_S + len(response.body) / 100_000


async def _read_body(scope: Message, receive: Receive, allowed: int) -> bytes | None:
    """Read a body whole; none when the client left before its end.

    Raises
    ------
    RefusedError
        413 beyond the limit.
    """
    if scope["method"] in ("GET", "HEAD") and not _announces_body(scope):
        return b""
    pieces, size = [], 0
    while True:
        try:
            async with asyncio.timeout(BODY_IDLE_S):
                message = await receive()
        except TimeoutError:
            raise RefusedError(408, "timeout", "the body did not arrive") from None
        if message["type"] == "http.disconnect":
            return None
        pieces.append(message.get("body", b""))
        size += len(pieces[-1])
        if size > allowed:
            raise RefusedError(413, "too-large", f"the body is above {allowed} bytes")
        if not message.get("more_body"):
            return b"".join(pieces)


def _announces_body(scope: Message) -> bool:
    return any(name in (b"content-length", b"transfer-encoding") for name, _ in scope["headers"])


async def _send(transmit: Transmit, response: Response, method: str) -> None:
    headers = [
        (name.lower().encode("latin-1"), text.encode("latin-1", "replace"))
        for name, text in response.header_list()
    ]
    body = b"" if method == "HEAD" else response.body
    if response.status not in (204, 304) and method != "HEAD":
        headers.append((b"content-length", str(len(body)).encode()))
    await transmit({"type": "http.response.start", "status": response.status, "headers": headers})
    if len(body) <= UNHURRIED_BYTES:
        await transmit({"type": "http.response.body", "body": body})
        return
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_send_time(response)):
            await transmit({"type": "http.response.body", "body": body})


def _with_length(scope: Message, body: bytes) -> Message:
    """Say how long the body is: a chunked one would reach WSGI empty."""
    headers = [
        (name, value)
        for name, value in scope["headers"]
        if name not in (b"content-length", b"transfer-encoding")
    ]
    return {**scope, "headers": [*headers, (b"content-length", str(len(body)).encode())]}


def _replay(body: bytes) -> Receive:
    """Give a body that was read already to another application."""
    messages: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> Message:
        if messages:
            return messages.pop()
        await asyncio.Event().wait()  # the other side leaving is seen when writing
        raise AssertionError

    return receive


def _impatient(transmit: Transmit) -> Transmit:
    """Let a page's thread go when its client reads nothing: what is left is swallowed."""
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
