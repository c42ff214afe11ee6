"""Small queries, read and answered where the parser of HTTP calls back.

A task for each request, and messages between server and application, cost more than the answer to a
small query. Queries are therefore admitted here, looked up in the answer cache or sent to a
reader's pipe, and the answer is written as soon as it comes. All checks, limits, logs and metrics
are the application's own. Whatever is large, or takes longer, goes on as a cycle of uvicorn's,
admitted but unanswered.
"""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Any

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, RequestResponseCycle

from endpoint.asgi import SMALL_BODY, AsgiApplication, call_soon
from endpoint.direct.exchange import Exchange
from endpoint.direct.queries import QuickQueries
from endpoint.http.encoding import SharedFields, encode_fields
from endpoint.http.messages import Response
from endpoint.http.response_stream import UNHURRIED_BYTES, Wire
from endpoint.http.server_protocol import GuardedProtocol
from endpoint.http.websocket import Message, Receive, Transmit
from endpoint.lanes import Job
from endpoint.point_lines import Instead, PointQuery
from endpoint.routes import ROUTES
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream

__all__ = ["DirectProtocol"]

_SHARED = SharedFields()
_PATHS = frozenset(
    route.pattern.encode()
    for route in ROUTES
    if route.handler == "protocol" and route.right != "write"
)
_METHODS = {b"GET": "GET", b"POST": "POST"}
_ELSEWHERE = (b"transfer-encoding", b"content-encoding")


class DirectProtocol(GuardedProtocol):
    """The server's protocol, which answers small queries without the ASGI application.

    Parameters
    ----------
    asgi
        Answers everything else.
    queries
        Answers queries whose headers are known.
    """

    def __init__(
        self, *args: Any, asgi: AsgiApplication, queries: QuickQueries, **options: Any
    ) -> None:
        super().__init__(*args, **options)
        self._asgi = asgi
        self._application = asgi.application
        self._queries = queries
        # Middleware changes what the application sees: who asks, behind a proxy.
        self._is_plain = self.app is asgi
        self._is_own = self._application.context.following is None
        self._taken: Exchange | None = None  # its body may not have come yet
        self._idle_timer: asyncio.TimerHandle | None = None
        self._active_at = 0.0

    def data_received(self, data: bytes) -> None:
        """Parse what has come; a request whose body is late goes the way of all others."""
        super().data_received(data)
        taken = self._taken
        if taken is not None:
            self._taken = None
            self._start(taken, self._asgi)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timer of idle connections."""
        if self._idle_timer is not None:
            self._idle_timer.cancel()
            self._idle_timer = None
        self._taken = None
        super().connection_lost(exc)

    def begin_request(self) -> None:
        """Take a small query; leave the rest to the ASGI application."""
        path, _, query = self.url.partition(b"?")
        method = _METHODS.get(self.parser.get_method())
        if path not in _PATHS or method is None or not self._is_simple(method):
            super().begin_request()
            return
        keep_alive = self.parser.should_keep_alive()
        exchange: Any = Exchange(self.scope, keep_alive, method, path, query)
        self._taken = self.cycle = exchange

    def _is_simple(self, method: str) -> bool:
        """Whether nothing stands in the way of answering a request here."""
        parser = self.parser
        if not self._is_plain or parser.get_http_version() != "1.1":
            return False
        if self.expect_100_continue or parser.should_upgrade() or b"#" in self.url:
            return False
        length = 0
        for name, value in self.headers:
            if name == b"content-length":
                length = int(value) if value.isdigit() and len(value) < 8 else SMALL_BODY + 1
            elif name in _ELSEWHERE or (name == b"accept" and b"html" in value.lower()):
                return False
        return length <= SMALL_BODY and (method == "POST") == (length > 0) and self._is_free()

    def _is_free(self) -> bool:
        """Whether another request may be begun, and answered at once."""
        if self.cycle is not None and not self.cycle.response_complete:
            return False
        limit = self.limit_concurrency
        if limit is not None and max(len(self.connections), len(self.tasks)) >= limit:
            return False
        return not self.flow.write_paused

    def on_body(self, body: bytes) -> None:
        """Collect the body of a request that was taken."""
        taken = self._taken
        if taken is None:
            super().on_body(body)
        else:
            taken.body += body

    def on_message_complete(self) -> None:
        """Answer a request that was taken."""
        taken = self._taken
        if taken is None:
            super().on_message_complete()
        else:
            self._taken = None
            taken.more_body = False
            self._answer(taken)

    def _answer(self, exchange: Exchange) -> None:
        application = self._application
        client = self.client[0] if self.client else ""
        origin = (exchange.method, exchange.raw_path, self.scheme or "http", client)
        if self._is_own and self._queries.take(exchange, origin, self.headers, self):
            return
        request = self._asgi.request_from(
            exchange.scope,
            exchange.method,
            exchange.raw_path,
            exchange.query_string,
            exchange.body,
        )
        job = application.admit(request)
        exchange.running = job.plan.running
        if job.plan.lane == "loop":
            self._reply(exchange, job, application.run(job))
            return
        payload = application.lanes.payload(job)
        if payload is None:
            self._hand_over(exchange, job)
            return
        query = PointQuery(payload, job.plan.text, lambda _: None)
        query.on_answer = partial(self._arrive, exchange, job, query)
        assert job.plan.running is not None
        job.plan.running.on_stop(partial(call_soon, self.loop, query.give_up))
        self._asgi.points.ask(query)

    def _arrive(
        self,
        exchange: Exchange,
        job: Job,
        query: PointQuery,
        outcome: Answer | ReaderStream | Instead,
    ) -> None:
        """Send an answer that has come; pass on a query that takes longer."""
        if query.line is not None:
            self._asgi.points.forget(query)
        self.resume(exchange, job, outcome)

    def _reply(self, exchange: Exchange, job: Job, response: Response) -> None:
        """Write a whole response at once."""
        is_small = response.chunks is None and len(response.body) <= UNHURRIED_BYTES
        if not is_small or self.flow.write_paused:
            self._hand_over(exchange, job, response)
            return
        whole = False
        try:
            whole = self.send(exchange, self._encoded(exchange, response))
        finally:
            self._application.end(job)
        self._application.report(job, response, len(response.body), whole=whole)

    def _encoded(self, exchange: Exchange, response: Response) -> bytes:
        """Return a response as it is sent."""
        length = b"content-length: %d\r\n" % len(response.body)
        return b"".join(
            (
                STATUS_LINE[response.status],
                self.shared,
                encode_fields(response.header_list()),
                b"" if response.status in (204, 304) else length,
                b"\r\n" if exchange.keep_alive else b"connection: close\r\n\r\n",
                response.body,
            )
        )

    @property
    def shared(self) -> bytes:
        """The header fields that all responses of the server share; they change each second."""
        return _SHARED.of(self.server_state.default_headers)

    def send(self, exchange: Exchange, data: bytes) -> bool:
        """Send a whole response and end the request; return whether the client is still there."""
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
        if self._idle_timer is None and not transport.is_closing():
            self._idle_timer = self.loop.call_later(self.timeout_keep_alive, self._check_idle)
        return is_there

    def on_response_complete(self) -> None:
        """Note when the connection became idle."""
        self._active_at = self.loop.time()
        super().on_response_complete()

    def _check_idle(self) -> None:
        """Close the connection if it has been idle for long enough, or look again when it might."""
        self._idle_timer, now = None, self.loop.time()
        if self.transport.is_closing():
            return
        is_busy = self._header_since is not None or not self.cycle.response_complete
        since = now if is_busy else self._active_at
        left = since + self.timeout_keep_alive - now
        if left > 0:
            self._idle_timer = self.loop.call_later(left, self._check_idle)
        else:
            self.transport.close()

    def _hand_over(
        self,
        exchange: Exchange,
        job: Job,
        outcome: Response | Answer | ReaderStream | Instead | None = None,
    ) -> None:
        """Let the ASGI application complete a request that was admitted here."""

        async def complete(scope: Message, receive: Receive, transmit: Transmit) -> None:
            await self._asgi.complete(job, Wire(scope, receive, transmit), outcome)

        self._start(exchange, complete)

    def resume(
        self, exchange: Exchange, job: Job, outcome: Answer | ReaderStream | Instead
    ) -> None:
        """Go on with a query that needs more than what was done for it."""
        if job.plan.lane == "point":
            response = self._application.lanes.after_pipe(job, outcome)
            if response is not None:
                self._reply(exchange, job, response)
            else:
                self._hand_over(exchange, job, outcome)
            return
        if isinstance(outcome, ReaderStream):
            outcome.close()
        if job.plan.lane == "loop":
            self._reply(exchange, job, self._application.run(job))
        else:
            self._hand_over(exchange, job)

    def _start(self, exchange: Exchange, app: Any) -> None:
        """Put a cycle of uvicorn in the place of an exchange, and start an application for it."""
        scope = exchange.scope
        scope["method"] = exchange.method
        scope["path"] = exchange.raw_path.decode("ascii")
        scope["raw_path"] = exchange.raw_path
        scope["query_string"] = exchange.query_string
        cycle = RequestResponseCycle(
            scope=scope,
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
        cycle.body += exchange.body
        cycle.more_body = exchange.more_body
        cycle.disconnected = exchange.disconnected
        if exchange.body or not exchange.more_body:
            cycle.message_event.set()
        self.cork(cycle)
        current: Any = self.cycle
        if current is exchange:  # and not a later request's, which waits its turn
            self.cycle = cycle
        self._start_asgi_task(cycle, app)
