"""Answers to small queries by GET, written by the server's protocol itself.

Most requests of robots are queries by GET whose answer is in the cache or comes from a reader in
well under a millisecond. A task, and messages between server and application, would cost more than
the answer, so these requests are admitted and answered where the parser calls back. All checks,
limits, logs and metrics are the application's own. Whatever takes longer, or is larger, is handed
to the ASGI application, admitted but unanswered.
"""

from __future__ import annotations

import asyncio
import re
from functools import partial
from typing import Any

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, RequestResponseCycle

from endpoint.application import Job
from endpoint.asgi import AsgiApplication, call_soon
from endpoint.http.messages import Response
from endpoint.http.response_stream import UNHURRIED_BYTES, Wire
from endpoint.http.server_protocol import GuardedProtocol
from endpoint.http.websocket import Message, Receive, Transmit
from endpoint.point_lines import Instead, PointQuery
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream

__all__ = ["DirectProtocol"]

_ADDRESSES = frozenset((b"/query", b"/query/", b"/sparql", b"/sparql/"))
_UNSAFE = re.compile(r"[\x00-\x08\x0a-\x1f\x7f]")


class _Exchange:
    """One request that is being answered here, in the place of uvicorn's own cycle.

    The attributes are those that uvicorn reads or sets.
    """

    def __init__(self, keep_alive: bool) -> None:
        self.keep_alive = keep_alive
        self.response_complete = False
        self.disconnected = False
        self.message_event = self
        self.job: Job | None = None
        self.begun = False

    def set(self) -> None:
        """Stop the query if the client has gone; uvicorn calls this when it notices."""
        if self.disconnected and self.job is not None and self.job.plan.running is not None:
            self.job.plan.running.stop()


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
        exchange: Any = _Exchange(self.parser.should_keep_alive())
        self.cycle = exchange

    def _is_simple(self) -> bool:
        """Whether nothing stands in the way of answering a request here."""
        if not self._is_plain or self.parser.get_method() != b"GET":
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
        for name, value in self.headers:
            if name in (b"content-length", b"transfer-encoding"):
                return False
            if name == b"accept" and b"html" in value.lower():
                return False
        return True

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
        scope: Any = self.scope
        exchange.job = job = self._application.admit(self._asgi.request_of(scope))
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

    def _arrive(
        self, exchange: _Exchange, job: Job, found: Answer | ReaderStream | Instead
    ) -> None:
        """Send an answer that has come; pass on one that is long or late."""
        response = self._application.arrived(job, found)
        if response is not None:
            self._reply(exchange, job, response)
        else:
            self._hand_over(exchange, job, found if isinstance(found, ReaderStream) else None)

    def _reply(self, exchange: _Exchange, job: Job, response: Response) -> None:
        """Write a whole response at once."""
        if len(response.body) > UNHURRIED_BYTES or self.flow.write_paused:
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
