"""The ASGI application: websockets of robots, requests of programs, and pages, passed to Flask.

The requests of programs run on the application's threads, so that a stalled download or a slow page
blocks nobody, and `/health` is answered however busy the server is.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

from a2wsgi import WSGIMiddleware
from flask import Flask

from endpoint.application import Application
from endpoint.follow.changes import Changes
from endpoint.follow.event_stream import EventStream
from endpoint.http.body_buffer import BodyBuffer
from endpoint.http.messages import RefusedError, Request, Response
from endpoint.http.page_calls import Seen, impatient, replay, with_length
from endpoint.http.plan import Plan
from endpoint.http.progress_stream import send_with_progress
from endpoint.http.response_stream import Wire, send
from endpoint.http.websocket import Message, Receive, Transmit
from endpoint.lanes import Job
from endpoint.point_lines import Instead, PointLines, PointQuery
from endpoint.rosbridge.connections import Connections
from endpoint.rosbridge.session import Bridge
from endpoint.routes import find, serves
from endpoint.sparql.negotiation import prefers_html
from rtask.errors import RtaskError
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream
from rtask.knowledge_base import KnowledgeBase

SMALL_BODY = 16 << 10
BODY_IDLE_S = 30.0
WATCH_AFTER_S = 0.05
MAX_HELD_BYTES = 1 << 30
REVOCATION_CHECK_S = 0.5
PAGE_THREADS = 16


class AsgiApplication:
    """Everything that a server answers, as one ASGI application.

    Parameters
    ----------
    application
        Answers programs.
    bridge
        Answers robots.
    pages
        The Flask application, which answers people.
    """

    def __init__(self, application: Application, bridge: Bridge, pages: Flask) -> None:
        self._application = application
        self._context = application.context
        self._held = 0
        kb = self._context.kb
        readers = kb.readers if isinstance(kb, KnowledgeBase) and kb.readers.possible else None
        self.points = PointLines(readers, application.start_reader, application.router.asked.slow)
        following = self._context.following
        self.connections = Connections(
            bridge,
            self._context.auth,
            following if following is not None and following.forwards else None,
        )
        self.changes = Changes(self._context)
        self._context.gauges["rtask_subscribers"] = lambda: len(self.changes)
        self._context.gauges["rtask_robots_connected"] = lambda: len(self.connections)
        self._context.gauges["rtask_service_dropped_total"] = lambda: self._context.services.dropped
        self._context.gauges["rtask_upload_bytes_held"] = lambda: self._held
        # a2wsgi declares types of its own for the same interfaces.
        self._pages: Any = WSGIMiddleware(cast(Any, pages.wsgi_app), workers=PAGE_THREADS)

    @property
    def drain_delay_s(self) -> float:
        """Seconds between reporting "not ready" and closing the listening socket."""
        return self._context.config.drain_delay_s

    def drain(self) -> None:
        """Report from now on that the server is not ready."""
        self._application.drain()

    def stop_queries(self) -> None:
        """Stop every query that still runs; it is answered, or its answer ends."""
        self._application.context.queries.stop_all()

    async def __call__(self, scope: Message, receive: Receive, transmit: Transmit) -> None:
        """Serve one connection of the server."""
        if scope["type"] == "lifespan":
            await self._lifespan(receive, transmit)
        elif scope["type"] == "websocket":
            request = self.request_of(scope)
            if self.changes.serves(request.raw_path):
                await self.changes.serve_socket(request, scope, receive, transmit)
            else:
                await self.connections.serve(request, scope, receive, transmit)
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
            await self.changes.close_revoked()

    async def _http(self, scope: Message, receive: Receive, transmit: Transmit) -> None:
        request = self.request_of(scope)
        try:
            if _is_large(request):
                await self._check_sender(request)
            body = await self._read_body(scope, receive)
        except RtaskError as error:
            await self._refuse(error, request, transmit)
            return
        if body is None:  # cut off half-way: nothing may be executed
            return
        request = replace(request, body=body) if body else request
        if self.changes.follows(request):
            await self._follow(request, Wire(scope, receive, transmit))
        elif serves(request.raw_path) and not _wants_page(request):
            await self._program(request, Wire(scope, receive, transmit))
        else:
            await self._page(request, scope, transmit)

    async def _follow(self, request: Request, wire: Wire) -> None:
        """Let a program follow the graph until either side closes the stream."""
        application = self._application
        started = time.perf_counter()
        try:
            answer = self.changes.open(request)
        except Exception as error:  # noqa: BLE001 - every error is an answer
            job = application.refused(error, request)
            response = application.run(job)
        else:
            job = Job(request, Plan.ready(Response()), started=started)
            if isinstance(answer, EventStream):
                sent = await answer.send(wire)
                application.report(job, Response(200), sent)
                return
            job.plan = Plan.ready(answer)
            response = application.run(job)
        sent, whole = await send(response, request.method, wire)
        application.report(job, response, sent, whole=whole)

    async def _program(self, request: Request, wire: Wire) -> None:
        """Answer a program."""
        application = self._application
        if len(request.body) <= SMALL_BODY and "content-encoding" not in request.headers:
            job = application.admit(request)
        else:
            loop = asyncio.get_running_loop()
            job = await loop.run_in_executor(application.lanes.work, application.admit, request)
        await self.complete(job, wire)

    async def complete(
        self,
        job: Job,
        wire: Wire,
        outcome: Response | Answer | ReaderStream | Instead | None = None,
    ) -> None:
        """Do the work of a request that was admitted, and send the answer.

        Parameters
        ----------
        outcome
            What the protocol has already got: the response, or what a query met at a reader's pipe.
        """
        application = self._application
        try:
            if job.plan.progress is not None:
                answer, events = self._work(job, wire), job.plan.progress
                response, sent, whole = await send_with_progress(
                    answer, events, job.request.method, wire
                )
                application.report(job, response, sent, whole=whole)
                return
            if isinstance(outcome, Response):
                response = outcome
            elif outcome is not None:
                stream = outcome if isinstance(outcome, ReaderStream) else None
                response = await self._work(job, wire, stream)
            elif job.plan.lane == "loop":
                response = application.run(job)
            else:
                response = await self._answer(job, wire)
            sent, whole = await send(response, job.request.method, wire)
        finally:
            application.end(job)
        application.report(job, response, sent, whole=whole)

    async def _answer(self, job: Job, wire: Wire) -> Response:
        """Answer a point query from a reader's pipe; leave the rest to threads."""
        application = self._application
        payload = application.lanes.payload(job)
        if payload is None:
            return await self._work(job, wire)
        loop = asyncio.get_running_loop()
        outcome_future: asyncio.Future[Answer | ReaderStream | Instead] = loop.create_future()
        query = PointQuery(payload, job.plan.text, outcome_future.set_result)
        self.points.ask(query)
        assert job.plan.running is not None
        watch = loop.call_later(WATCH_AFTER_S, wire.watch, job.plan.running.stop)
        job.plan.running.on_stop(lambda: call_soon(loop, query.give_up))
        try:
            outcome = await outcome_future
        finally:
            watch.cancel()
            self.points.forget(query)
        response = application.lanes.after_pipe(job, outcome)
        if response is not None:
            return response
        return await self._work(job, wire, outcome if isinstance(outcome, ReaderStream) else None)

    async def _work(self, job: Job, wire: Wire, stream: ReaderStream | None = None) -> Response:
        """Wait for a thread to do the work, for its deadline, or for the client to leave."""
        application, plan = self._application, job.plan
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[Response] = loop.create_future()
        work = application.lanes.submit(job, stream)

        def deliver() -> None:
            if answer.done():
                return
            if work.cancelled():
                answer.cancel()
            else:
                answer.set_result(work.result())

        def on_patience_expired() -> None:
            refusal = None if answer.done() else application.give_up(work, job)
            if refusal is not None and not answer.done():
                answer.set_result(refusal)

        work.add_done_callback(lambda _: call_soon(loop, deliver))
        timers = []
        if plan.timeout_s is not None:
            timers.append(loop.call_later(plan.timeout_s, on_patience_expired))
        if plan.running is not None:
            timers.append(loop.call_later(WATCH_AFTER_S, wire.watch, plan.running.stop))
        if plan.elsewhere is not None:
            timers.append(loop.call_later(WATCH_AFTER_S, wire.watch, plan.elsewhere.stop))
        try:
            return await answer
        finally:
            for timer in timers:
                timer.cancel()

    async def _page(self, request: Request, scope: Message, transmit: Transmit) -> None:
        """Let Flask answer a person; count and log the request like any other."""
        started = time.perf_counter()
        seen = Seen(transmit)
        try:
            await self._pages(
                with_length(scope, request.body, request.id),
                replay(request.body),
                impatient(seen.transmit),
            )
        finally:
            job = Job(request, Plan.ready(Response()), started=started)
            self._application.report(job, Response(seen.status), seen.bytes)

    async def _check_sender(self, request: Request) -> None:
        """Identify the sender of a large body before reading it."""
        self._context.auth.identify(request, limited=True)

    async def _refuse(self, error: RtaskError, request: Request, transmit: Transmit) -> None:
        """Answer without reading the body; the connection cannot be reused."""
        job = self._application.refused(error, request)
        response = self._application.run(job).with_headers(("Connection", "close"))
        sent, _ = await send(response, request.method, Wire({}, _never, transmit))
        self._application.report(job, response, sent)

    async def _read_body(self, scope: Message, receive: Receive) -> bytes | None:
        """Read a whole body; return none if the client left before its end.

        Raises
        ------
        RefusedError
            413 beyond the limit, 408 if nothing arrives, 503 if too much is being uploaded.
        StorageFullError
            There is no disk space for a large body.
        """
        if scope["method"] in ("GET", "HEAD") and not _announces_body(scope):
            return b""
        allowed = self._context.config.max_upload_bytes
        size = 0
        # Told now, a client need not send what would be refused after all of it had come.
        if _announced(scope) > allowed:
            raise RefusedError(413, "too-large", f"the body exceeds {allowed} bytes")
        buffer = BodyBuffer()
        try:
            while True:
                message = await _next_message(receive)
                if message["type"] == "http.disconnect":
                    return None
                piece = message.get("body", b"")
                buffer.write(piece)
                size += len(piece)
                self._held += len(piece)
                if size > allowed:
                    raise RefusedError(413, "too-large", f"the body exceeds {allowed} bytes")
                # Whoever fills the room with uploads shall not keep others from small requests.
                if self._held > MAX_HELD_BYTES and size > SMALL_BODY:
                    raise RefusedError(
                        503,
                        "busy",
                        "too many uploads at once; try again",
                        headers=(("Retry-After", "5"),),
                    )
                if not message.get("more_body"):
                    return await buffer.read()
        finally:
            self._held -= size
            buffer.close()

    @property
    def application(self) -> Application:
        """The application that answers programs."""
        return self._application

    def request_of(self, scope: Message) -> Request:
        """Return the request that a connection's scope describes, without its body."""
        raw_path = scope.get("raw_path") or scope["path"].encode()
        method = scope.get("method", "GET")
        return self.request_from(scope, method, raw_path, scope["query_string"], b"")

    def request_from(
        self, scope: Message, method: str, raw_path: bytes, query_string: bytes, body: bytes
    ) -> Request:
        """Return a request from its parts; the scope has its headers and the connection."""
        headers: dict[str, str] = {}
        for name, value in scope["headers"]:
            key, text = name.decode("latin-1"), value.decode("latin-1")
            headers[key] = f"{headers[key]}, {text}" if key in headers else text
        host = headers.get("host") or "{}:{}".format(*(scope.get("server") or ("localhost", 80)))
        client = scope.get("client")
        return Request(
            method,
            raw_path.decode("latin-1"),
            query_string.decode("latin-1"),
            headers,
            body,
            self._context.config.site(scope["scheme"], host),
            client[0] if client else "",
        )


def _wants_page(request: Request) -> bool:
    """Tell whether a person opens a page that shares its address with programs.

    These are the workbench, at the protocol's address, and pages of services, datasets and jobs.
    """
    if not prefers_html(request.header("accept")):
        return False
    return any(request.method in route.pages for route in find(request.raw_path.rstrip("/")).routes)


async def _next_message(receive: Receive) -> Message:
    try:
        async with asyncio.timeout(BODY_IDLE_S):
            return await receive()
    except TimeoutError:
        raise RefusedError(408, "timeout", "the body did not arrive") from None


def _is_large(request: Request) -> bool:
    """Tell whether a request announces a body that is large or of unknown size."""
    length = request.headers.get("content-length", "")
    if "transfer-encoding" in request.headers:
        return True
    return length.isdigit() and int(length) > SMALL_BODY


def call_soon(loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> None:
    """Call back on the loop from a thread; the loop may be gone if work ends late."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(callback)


async def _never() -> Message:
    await asyncio.Event().wait()
    raise AssertionError


def _announced(scope: Message) -> int:
    """Return the length of the body that a request announces; 0 if it announces none."""
    length: bytes
    for name, length in scope["headers"]:
        if name == b"content-length" and length.isdigit():
            return int(length[:20])  # longer numbers are beyond any limit, whatever follows
    return 0


def _announces_body(scope: Message) -> bool:
    return any(name in (b"content-length", b"transfer-encoding") for name, _ in scope["headers"])
