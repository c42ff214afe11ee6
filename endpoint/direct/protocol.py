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
from concurrent.futures import Future
from functools import partial
from typing import Any

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, RequestResponseCycle

from endpoint.application import Job
from endpoint.asgi import SMALL_BODY, WATCH_AFTER_S, AsgiApplication, call_soon
from endpoint.direct.exchange import Exchange
from endpoint.direct.head_queries import HeadQueries, HeadQuery
from endpoint.direct.heads import RepeatedHead, learn
from endpoint.http.encoding import SharedFields, encode_fields
from endpoint.http.messages import Request, Response
from endpoint.http.response_stream import UNHURRIED_BYTES, Wire
from endpoint.http.server_protocol import GuardedProtocol
from endpoint.http.websocket import Message, Receive, Transmit
from endpoint.point_lines import Instead, PointQuery
from endpoint.routes import pattern_of
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream

__all__ = ["DirectProtocol"]

_QUERY, _CALL = pattern_of("query", "GET"), pattern_of("call", "POST")
_END = b"\r\n\r\n"
_SHARED = SharedFields()


class DirectProtocol(GuardedProtocol):
    """The server's protocol, which answers small requests without the ASGI application.

    Parameters
    ----------
    asgi
        Answers everything else.
    head_queries
        Answers queries under known headers.
    """

    def __init__(
        self, *args: Any, asgi: AsgiApplication, head_queries: HeadQueries, **options: Any
    ) -> None:
        super().__init__(*args, **options)
        self._asgi = asgi
        self._application = asgi.application
        # Middleware changes what the application sees: who asks, behind a proxy.
        self._is_plain = self.app is asgi
        self._head_queries = head_queries
        self._may_learn = self._is_plain and self._application.context.following is None
        self._head: RepeatedHead | None = None
        self._block = b""  # header of the last request that was answered here
        self._data = b""
        self._messages = 0
        self._in_message = False
        self._active_at = 0.0

    def data_received(self, data: bytes) -> None:
        """Answer a query under a known header; leave everything else to the parser."""
        head = self._head
        if head is not None and not self._in_message and self._is_free():
            value = head.value_in(data)
            query = self._head_queries.admit(head, value) if value is not None else None
            if query is not None:
                cycle: Any = query
                self.cycle = cycle
                self._head_queries.answer(query, self)
                return
        self._data = b"" if self._in_message else data
        self._messages = 0
        super().data_received(data)

    def on_message_begin(self) -> None:
        """Note that a request has begun."""
        self._in_message = True
        self._messages += 1
        super().on_message_begin()

    def _is_free(self) -> bool:
        """Whether another request may be begun, and answered at once."""
        if self.cycle is not None and not self.cycle.response_complete:
            return False
        limit = self.limit_concurrency
        if limit is not None and max(len(self.connections), len(self.tasks)) >= limit:
            return False
        return not self.flow.write_paused

    def _learn(self, request: Request) -> None:
        """Remember a header that comes for the second time."""
        data = self._data
        if not self._may_learn or self._messages != 1 or data.find(_END) != len(data) - len(_END):
            return
        block = data.partition(b"\r\n")[2]
        if block == self._block:
            self._head = learn(block, request, self._application)
        self._block = block

    def begin_request(self) -> None:
        """Take a query by GET or a call by POST; leave the rest to the ASGI application."""
        path, _, query = self.url.partition(b"?")
        method = self.parser.get_method()
        if method == b"GET":
            is_taken = bool(query) and _QUERY.fullmatch(path) is not None and self._is_simple(0)
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
        exchange: Any = Exchange(self.parser.should_keep_alive(), scope)
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
        if self.expect_100_continue or b"#" in self.url or not self._is_free():
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
        self._in_message = False
        exchange: Any = self.cycle
        if isinstance(exchange, Exchange):
            if not exchange.begun:
                exchange.begun = True
                self._answer(exchange)
        else:
            super().on_message_complete()

    def _answer(self, exchange: Exchange) -> None:
        exchange.stop_waiting()
        request = self._asgi.request_of(exchange.scope, bytes(exchange.body))
        exchange.job = job = self._application.admit(request)
        if request.method == "GET":
            self._learn(request)
        if job.plan.lane == "loop":
            self._reply(exchange, job, self._application.run(job))
            return
        if request.method == "POST":
            self._await(exchange, job)
            return
        payload = self._application.encoded(job)
        if payload is None:
            self._hand_over(exchange, job)
            return
        query = PointQuery(payload, job.plan.text, partial(self._arrive, exchange, job))
        assert job.plan.running is not None
        job.plan.running.on_stop(lambda: call_soon(self.loop, query.give_up))
        self._asgi.points.ask(query)

    def _await(self, exchange: Exchange, job: Job) -> None:
        """Answer once a thread has done the work; pass on what takes long."""
        work = self._application.submit(job)
        timeout_s = job.plan.timeout_s
        patience_s = WATCH_AFTER_S if timeout_s is None else min(WATCH_AFTER_S, timeout_s)
        expired = partial(self._on_patience_expired, exchange, job, work)
        exchange.wait(self.loop, patience_s, expired)

        def done(_: object) -> None:
            call_soon(self.loop, partial(self._done, exchange, job, work))

        work.add_done_callback(done)

    def _done(self, exchange: Exchange, job: Job, work: Future[Response]) -> None:
        if not exchange.stop_waiting():
            return  # it was passed on
        if work.cancelled():
            self._hand_over(exchange, job, work=work)
        else:
            self._reply(exchange, job, work.result())

    def _on_patience_expired(self, exchange: Exchange, job: Job, work: Future[Response]) -> None:
        exchange.stop_waiting()
        self._hand_over(exchange, job, work=work)

    def _arrive(
        self, exchange: Exchange, job: Job, outcome: Answer | ReaderStream | Instead
    ) -> None:
        """Send an answer that has come; pass on one that is long or late."""
        response = self._application.arrived(job, outcome)
        if response is not None:
            self._reply(exchange, job, response)
        else:
            self._hand_over(exchange, job, outcome if isinstance(outcome, ReaderStream) else None)

    def _reply(self, exchange: Exchange, job: Job, response: Response) -> None:
        """Write a whole response at once."""
        is_whole = response.chunks is None and len(response.body) <= UNHURRIED_BYTES
        if not is_whole or self.flow.write_paused:
            self._hand_over(exchange, job, response=response)
            return
        whole = False
        try:
            whole = self.send(exchange, self._encoded(exchange, response))
        finally:
            self._application.end(job)
        self._application.report(job, response, len(response.body), whole=whole)

    def _encoded(self, exchange: Exchange, response: Response) -> bytes:
        parts = [STATUS_LINE[response.status], self.date, encode_fields(response.header_list())]
        if response.status not in (204, 304):
            parts.append(b"content-length: %d\r\n" % len(response.body))
        parts.append(b"\r\n" if exchange.keep_alive else b"connection: close\r\n\r\n")
        parts.append(response.body)
        return b"".join(parts)

    @property
    def date(self) -> bytes:
        """The header fields that all responses of the server share; they change each second."""
        return _SHARED.of(self.server_state.default_headers)

    def send(self, exchange: Exchange, data: bytes) -> bool:
        """Send a whole response and end the request; tell whether the client is still there."""
        transport = self.transport
        is_there = not exchange.disconnected and not transport.is_closing()
        exchange.response_complete = True
        if is_there:
            transport.write(data)
        if not exchange.keep_alive:
            transport.close()
        if self.pipeline or self.flow.read_paused:
            self.on_response_complete()
            return is_there
        # As uvicorn does, but one timer serves many requests.
        self.server_state.total_requests += 1
        self._active_at = self.loop.time()
        if self.timeout_keep_alive_task is None and not transport.is_closing():
            self.timeout_keep_alive_task = self.loop.call_later(
                self.timeout_keep_alive, self.timeout_keep_alive_handler
            )
        return is_there

    def timeout_keep_alive_handler(self) -> None:
        """Close the connection if it has been idle for long enough."""
        left = self._active_at + self.timeout_keep_alive - self.loop.time()
        is_busy = self.cycle is not None and not self.cycle.response_complete
        if left > 0 or is_busy:
            self.timeout_keep_alive_task = self.loop.call_later(
                left if left > 0 else self.timeout_keep_alive, self.timeout_keep_alive_handler
            )
        else:
            super().timeout_keep_alive_handler()

    def resume(self, query: HeadQuery, job: Job, outcome: Answer | ReaderStream | Instead) -> None:
        """Go on with a query that needs more than what was done for it here."""
        query.scope = self._scope_of(query)
        if job.plan.lane == "point":
            self._arrive(query, job, outcome)
            return
        if isinstance(outcome, ReaderStream):
            outcome.close()
        if job.plan.lane == "loop":
            self._reply(query, job, self._application.run(job))
        else:
            self._hand_over(query, job)

    def _scope_of(self, query: HeadQuery) -> Any:
        """Return the scope that the parser would have made of a query."""
        request = query.head.request
        return {
            "type": "http",
            "asgi": {"version": self.asgi_version, "spec_version": "2.3"},
            "http_version": "1.1",
            "method": "GET",
            "path": request.raw_path,
            "raw_path": request.raw_path.encode(),
            "query_string": query.asked.encode(),
            "root_path": self.root_path,
            "server": self.server,
            "client": self.client,
            "scheme": self.scheme,
            "headers": [(k.encode(), v.encode("latin-1")) for k, v in request.headers.items()],
            "state": self.app_state.copy(),
        }

    def _hand_over(
        self,
        exchange: Exchange,
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

    def _pass_on(self, exchange: Exchange) -> None:
        """Let the ASGI application answer a request whose body is late."""
        if exchange.stop_waiting():
            self._start(exchange, self._asgi, more_body=True)

    def _start(self, exchange: Exchange, app: Any, *, more_body: bool = False) -> None:
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
