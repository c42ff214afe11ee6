"""Answers to small queries by GET, written by the server's protocol itself.

Most requests of robots are queries by GET whose answer is in the cache or comes from a reader in
well under a millisecond. A task, and messages between server and application, would cost more than
the answer, so these requests are admitted and answered where the parser calls back. All checks,
limits, logs and metrics are the application's own. Whatever takes longer, or is larger, is handed
to the ASGI application, admitted but unanswered.
"""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Any

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, RequestResponseCycle

from endpoint.application import Job
from endpoint.asgi import AsgiApplication, call_soon
from endpoint.direct.exchange import Exchange
from endpoint.direct.heads import KnownHead, learn
from endpoint.direct.known import KnownQueries, KnownQuery
from endpoint.http.encoding import SharedFields, encode_fields
from endpoint.http.messages import Request, Response
from endpoint.http.response_stream import UNHURRIED_BYTES, Wire
from endpoint.http.server_protocol import GuardedProtocol
from endpoint.http.websocket import Message, Receive, Transmit
from endpoint.point_lines import Instead, PointQuery
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream

__all__ = ["DirectProtocol"]

_ADDRESSES = frozenset((b"/query", b"/query/", b"/sparql", b"/sparql/"))
_END = b"\r\n\r\n"
_SHARED = SharedFields()


class DirectProtocol(GuardedProtocol):
    """The server's protocol, which answers small queries without the ASGI application.

    Parameters
    ----------
    asgi
        Answers everything else.
    known
        Answers queries under known headers.
    """

    def __init__(
        self, *args: Any, asgi: AsgiApplication, known: KnownQueries, **options: Any
    ) -> None:
        super().__init__(*args, **options)
        self._asgi = asgi
        self._application = asgi.application
        # Middleware changes what the application sees: who asks, behind a proxy.
        self._is_plain = self.app is asgi
        self._known = known
        self._may_learn = self._is_plain and self._application.context.following is None
        self._head: KnownHead | None = None
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
            query = self._known.admit(head, value) if value is not None else None
            if query is not None:
                cycle: Any = query
                self.cycle = cycle
                self._known.answer(query, self)
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
        """Take a query by GET; leave everything else to the ASGI application."""
        path, _, query = self.url.partition(b"?")
        if path not in _ADDRESSES or not query or not self._is_simple():
            super().begin_request()
            return
        scope: Any = self.scope
        scope["method"] = "GET"
        scope["path"] = path.decode("ascii")
        scope["raw_path"] = path
        scope["query_string"] = query
        exchange: Any = Exchange(self.parser.should_keep_alive())
        self.cycle = exchange

    def _is_simple(self) -> bool:
        """Whether nothing stands in the way of answering a request here."""
        if not self._is_plain or self.parser.get_method() != b"GET":
            return False
        if self.parser.get_http_version() != "1.1" or self.parser.should_upgrade():
            return False
        if self.expect_100_continue or b"#" in self.url or not self._is_free():
            return False
        for name, value in self.headers:
            if name in (b"content-length", b"transfer-encoding"):
                return False
            if name == b"accept" and b"html" in value.lower():
                return False
        return True

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
        scope: Any = self.scope
        request = self._asgi.request_of(scope)
        exchange.job = job = self._application.admit(request)
        self._learn(request)
        if job.plan.lane == "loop":
            self._reply(exchange, job, self._application.run(job))
            return
        payload = self._application.encoded(job)
        if payload is None:
            self._hand_over(exchange, job)
            return
        query = PointQuery(payload, job.plan.text, partial(self._arrive, exchange, job))
        assert job.plan.running is not None
        job.plan.running.on_stop(lambda: call_soon(self.loop, query.give_up))
        self._asgi.points.ask(query)

    def _arrive(self, exchange: Exchange, job: Job, found: Answer | ReaderStream | Instead) -> None:
        """Send an answer that has come; pass on one that is long or late."""
        response = self._application.arrived(job, found)
        if response is not None:
            self._reply(exchange, job, response)
        else:
            self._hand_over(exchange, job, found if isinstance(found, ReaderStream) else None)

    def _reply(self, exchange: Exchange, job: Job, response: Response) -> None:
        """Write a whole response at once."""
        if len(response.body) > UNHURRIED_BYTES or self.flow.write_paused:
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

    def resume(self, query: KnownQuery, job: Job, found: Answer | ReaderStream | Instead) -> None:
        """Go on with a query that needs more than what was done for it here."""
        self.scope = self._scope_of(query)
        if job.plan.lane == "point":
            self._arrive(query, job, found)
            return
        if isinstance(found, ReaderStream):
            found.close()
        if job.plan.lane == "loop":
            self._reply(query, job, self._application.run(job))
        else:
            self._hand_over(query, job)

    def _scope_of(self, query: KnownQuery) -> Any:
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
    ) -> None:
        """Let the ASGI application complete a request that was admitted here."""
        cycle = RequestResponseCycle(
            scope=self.scope,
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
        cycle.more_body = False
        cycle.disconnected = exchange.disconnected
        cycle.message_event.set()
        self.cycle = cycle

        async def complete(scope: Message, receive: Receive, transmit: Transmit) -> None:
            await receive()  # the empty body
            await self._asgi.complete(job, Wire(scope, receive, transmit), stream, response)

        app: Any = complete
        self._start_asgi_task(cycle, app)
