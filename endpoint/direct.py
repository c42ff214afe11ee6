"""Answers to small queries by GET and small calls by POST, written by the server's protocol itself.

Most requests of robots are queries by GET whose answer is in the cache or comes from a reader in
well under a millisecond, or calls of operations and services that take as little. A task, and
messages between server and application, would cost more than the answer, so these requests are
admitted and answered where the parser calls back; the work of a call is still done by a thread.
All checks, limits, logs and metrics are the application's own. Whatever takes longer, or is larger,
is handed to the ASGI application, admitted but unanswered.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, RequestResponseCycle

from endpoint.application import Job
from endpoint.asgi import SMALL_BODY, WATCH_AFTER_S, AsgiApplication, call_soon
from endpoint.http.messages import Response
from endpoint.http.response_stream import UNHURRIED_BYTES, Wire
from endpoint.http.server_protocol import GuardedProtocol
from endpoint.http.websocket import Message, Receive, Transmit
from endpoint.sparql.answers import SlowerThanItLooksError
from rtask.kb.readers.streams import ReaderStream

__all__ = ["DirectProtocol"]

_QUERIES = frozenset((b"/query", b"/query/", b"/sparql", b"/sparql/"))
_CALL = re.compile(rb"/engine/[a-z_]+|/services/[A-Za-z0-9_]+/[A-Za-z0-9_@.*]+/[A-Za-z0-9_]+")
_UNSAFE = re.compile(r"[\x00-\x08\x0a-\x1f\x7f]")


class _Exchange:
    """One request that is being answered here, in the place of uvicorn's own cycle.

    The attributes are those that uvicorn reads or sets, and what is known of the request.
    """

    def __init__(self, scope: Any, keep_alive: bool) -> None:
        self.scope = scope
        self.keep_alive = keep_alive
        self.response_complete = False
        self.disconnected = False
        self.message_event = self
        self.body = bytearray()
        self.job: Job | None = None
        self.begun = False
        self.timer: asyncio.TimerHandle | None = None

    def set(self) -> None:
        """Stop the work if the client has gone; uvicorn calls this when it notices."""
        if not self.disconnected or self.job is None:
            return
        plan = self.job.plan
        if plan.running is not None:
            plan.running.stop()
        elif plan.elsewhere is not None:
            plan.elsewhere.stop()

    def wait(
        self, loop: asyncio.AbstractEventLoop, seconds: float, late: Callable[[], None]
    ) -> None:
        """Call back after some seconds unless :meth:`stop_waiting` was called before."""
        self.timer = loop.call_later(seconds, late)

    def stop_waiting(self) -> bool:
        """Tell whether this still waits, and end it."""
        timer, self.timer = self.timer, None
        if timer is not None:
            timer.cancel()
        return timer is not None


class DirectProtocol(GuardedProtocol):
    """The server's protocol, which answers small queries without the ASGI application.

    Parameters
    ----------
    asgi
        Answers everything else.
    """

    def __init__(self, *args: Any, asgi: AsgiApplication, **options: Any) -> None:
        super().__init__(*args, **options)
        self._asgi = asgi
        self._application = asgi.application
        # Middleware changes what the application sees: who asks, behind a proxy.
        self._is_plain = self.app is asgi

    def begin_request(self) -> None:
        """Take a query by GET or a call by POST; leave the rest to the ASGI application."""
        path, _, query = self.url.partition(b"?")
        method = self.parser.get_method()
        if method == b"GET":
            is_taken = path in _QUERIES and bool(query) and self._is_simple(0)
        else:
            is_call = method == b"POST" and _CALL.fullmatch(path) is not None
            is_taken = is_call and self._is_simple(SMALL_BODY)
        if not is_taken:
            super().begin_request()
            return
        scope: Any = self.scope
        scope["method"] = method.decode("ascii")
        scope["path"] = path.decode("ascii")
        scope["raw_path"] = path
        scope["query_string"] = query
        exchange: Any = _Exchange(scope, self.parser.should_keep_alive())
        self.cycle = exchange
        if method == b"POST":  # its body may be late
            exchange.wait(self.loop, WATCH_AFTER_S, partial(self._pass_on, exchange))

    def _is_simple(self, max_bytes: int) -> bool:
        """Whether nothing stands in the way of answering a request here.

        Parameters
        ----------
        max_bytes
            Length of its body at most; 0 = it has none.
        """
        if not self._is_plain:
            return False
        if self.parser.get_http_version() != "1.1" or self.parser.should_upgrade():
            return False
        if self.cycle is not None and not self.cycle.response_complete:
            return False
        if self.expect_100_continue or self.flow.write_paused or b"#" in self.url:
            return False
        limit = self.limit_concurrency
        if limit is not None and max(len(self.connections), len(self.tasks)) >= limit:
            return False
        has_length = False
        for name, value in self.headers:
            if name == b"content-length":
                has_length = value.isdigit() and int(value) <= max_bytes
                if not has_length:
                    return False
            elif name in (b"transfer-encoding", b"content-encoding") or (
                name == b"accept" and b"html" in value.lower()
            ):
                return False
        return has_length == bool(max_bytes)

    def on_message_complete(self) -> None:
        """Answer a request that was taken."""
        exchange: Any = self.cycle
        if isinstance(exchange, _Exchange):
            if not exchange.begun:
                exchange.begun = True
                self._answer(exchange)
        else:
            super().on_message_complete()

    def _answer(self, exchange: _Exchange) -> None:
        exchange.stop_waiting()
        request = self._asgi.request_of(exchange.scope, bytes(exchange.body))
        exchange.job = job = self._application.admit(request)
        if job.plan.lane == "loop":
            self._reply(exchange, job, self._application.run(job))
        elif job.plan.lane == "point":
            self._asgi.points.ask(job, partial(self._resume, exchange, job))
        elif request.method == "POST":
            self._await(exchange, job)
        else:
            self._hand_over(exchange, job)

    def _await(self, exchange: _Exchange, job: Job) -> None:
        """Answer once a thread has done the work; pass on what takes long."""
        work = self._application.submit(job)
        timeout_s = job.plan.timeout_s
        patience_s = WATCH_AFTER_S if timeout_s is None else min(WATCH_AFTER_S, timeout_s)
        exchange.wait(self.loop, patience_s, partial(self._tired, exchange, job, work))

        def done(_: object) -> None:
            call_soon(self.loop, partial(self._done, exchange, job, work))

        work.add_done_callback(done)

    def _done(self, exchange: _Exchange, job: Job, work: Future[Response]) -> None:
        if not exchange.stop_waiting():
            return  # it was passed on
        if work.cancelled():
            self._hand_over(exchange, job, work=work)
        else:
            self._reply(exchange, job, work.result())

    def _tired(self, exchange: _Exchange, job: Job, work: Future[Response]) -> None:
        exchange.stop_waiting()
        self._hand_over(exchange, job, work=work)

    def _resume(self, exchange: _Exchange, job: Job, stream: ReaderStream | None) -> None:
        """Send an answer that has come; pass on one that is long or late."""
        if stream is None:
            found = self._application.look_up(job)
            if found is None:
                self._hand_over(exchange, job)
            else:
                self._reply(exchange, job, found)
            return
        if not stream.is_whole:
            self._hand_over(exchange, job, stream)
            return
        try:
            response = self._application.resume(job, stream)
        except SlowerThanItLooksError:
            self._application.slower(job)
            self._hand_over(exchange, job)
        else:
            self._reply(exchange, job, response)

    def _reply(self, exchange: _Exchange, job: Job, response: Response) -> None:
        """Write a whole response at once."""
        is_whole = response.chunks is None and len(response.body) <= UNHURRIED_BYTES
        if not is_whole or self.flow.write_paused:
            self._hand_over(exchange, job, response=response)
            return
        try:
            if not exchange.disconnected and not self.transport.is_closing():
                self.transport.write(self._encoded(exchange, response))
        finally:
            exchange.response_complete = True
            self._application.end(job)
        self._application.report(job, response, len(response.body), whole=not exchange.disconnected)
        if not exchange.keep_alive:
            self.transport.close()
        self.on_response_complete()

    def _encoded(self, exchange: _Exchange, response: Response) -> bytes:
        fields = response.header_list()
        head = "".join([f"{name.lower()}: {value}\r\n" for name, value in fields])
        if _UNSAFE.search("".join([value for _, value in fields])):
            raise RuntimeError("a header field holds a control character")
        parts = [STATUS_LINE[response.status]]
        for name, value in self.server_state.default_headers:
            parts += (name, b": ", value, b"\r\n")
        parts.append(head.encode("latin-1", "replace"))
        if response.status not in (204, 304):
            parts.append(b"content-length: %d\r\n" % len(response.body))
        parts.append(b"\r\n" if exchange.keep_alive else b"connection: close\r\n\r\n")
        parts.append(response.body)
        return b"".join(parts)

    def _hand_over(
        self,
        exchange: _Exchange,
        job: Job,
        stream: ReaderStream | None = None,
        response: Response | None = None,
        work: Future[Response] | None = None,
    ) -> None:
        """Let the ASGI application complete a request that was admitted here."""

        async def complete(scope: Message, receive: Receive, transmit: Transmit) -> None:
            await receive()  # the body, which has been read
            wire = Wire(scope, receive, transmit)
            await self._asgi.complete(job, wire, stream, response, work)

        self._start(exchange, complete)

    def _pass_on(self, exchange: _Exchange) -> None:
        """Let the ASGI application answer a request whose body is late."""
        if exchange.stop_waiting():
            self._start(exchange, self._asgi, more_body=True)

    def _start(self, exchange: _Exchange, app: Any, *, more_body: bool = False) -> None:
        """Put a cycle of uvicorn in the place of an exchange, and start an application for it."""
        cycle = RequestResponseCycle(
            scope=exchange.scope,
            transport=self.transport,
            flow=self.flow,
            logger=self.logger,
            access_logger=self.access_logger,
            access_log=self.access_log,
            default_headers=self.server_state.default_headers,
            message_event=asyncio.Event(),
            expect_100_continue=False,
            keep_alive=exchange.keep_alive,
            on_response=self.on_response_complete,
        )
        cycle.more_body = more_body
        if more_body:
            cycle.body = exchange.body
        cycle.disconnected = exchange.disconnected
        if not more_body or exchange.body:
            cycle.message_event.set()
        current: Any = self.cycle
        if current is exchange:  # and not a later request's, which already waits its turn
            self.cycle = cycle
        self._start_asgi_task(cycle, app)
