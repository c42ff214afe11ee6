"""Small queries under a known header, from their bytes to the bytes of their answers.

Everything is checked, counted and logged as for other requests, by the same parts of the server.
A request that is anything else than small, quick and admitted is left to them as a whole.
"""

from __future__ import annotations

import asyncio
import re
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Protocol

from uvicorn.protocols.http.httptools_impl import STATUS_LINE

from endpoint.application import Application, Job
from endpoint.asgi import call_soon
from endpoint.direct.exchange import Exchange
from endpoint.direct.heads import RepeatedHead
from endpoint.http.conditional import is_unsteady
from endpoint.http.messages import Response, decoded, new_request_id
from endpoint.http.plan import RunningQuery
from endpoint.http.response_stream import UNHURRIED_BYTES
from endpoint.monitoring.request_log import Outcome
from endpoint.point_lines import Instead, PointLines, PointQuery
from endpoint.settings import Limits
from endpoint.sparql import negotiation
from endpoint.sparql.limits import checked_form
from rtask.errors import RtaskError
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream
from rtask.sparql.lexer import guard, names_dataset
from rtask.sparql.query_cost import is_lookup, is_quick
from rtask.sparql.tokens import shape

__all__ = ["HeadQueries", "HeadQuery"]

# What clients leave unescaped in a value, and escapes: no `&` (another field), no `#`.
_SAFE = rb"[A-Za-z0-9\-._~!$'()*,;:@/?+]*"
_VALUE = re.compile(_SAFE + rb"(?:%[0-9A-Fa-f]{2}" + _SAFE + rb")*")
_MAX_VALUE = 8 << 10
_MAX_FORMS = 2_048
_OK = STATUS_LINE[200]
_GZIP = b"content-encoding: gzip\r\n"


class Channel(Protocol):
    """The connection of a query."""

    loop: asyncio.AbstractEventLoop

    def send(self, query: HeadQuery, data: bytes) -> bool:
        """Send a whole response and end the request; tell whether the client is still there."""

    def resume(self, query: HeadQuery, job: Job, outcome: Answer | ReaderStream | Instead) -> None:
        """Go on as with any other request, from what was found."""

    @property
    def date(self) -> bytes:
        """The header fields that all responses of the server share."""


class HeadQuery(Exchange):
    """A query under a known header.

    Attributes
    ----------
    asked
        The query string.
    form, is_steady
        Of the text: SELECT or ASK, and whether its answer is the same until the next commit.
    """

    __slots__ = ("asked", "form", "head", "id", "is_steady", "running", "started", "text")

    def __init__(
        self, head: RepeatedHead, asked: str, text: str, form: str, is_steady: bool, started: float
    ) -> None:
        super().__init__(keep_alive=True)
        self.head = head
        self.asked = asked
        self.text = text
        self.form = form
        self.is_steady = is_steady
        self.started = started
        self.id = new_request_id()
        self.running: RunningQuery | None = None

    def set(self) -> None:
        """Stop the query if the client has gone."""
        super().set()
        if self.disconnected and self.running is not None:
            self.running.stop()


class HeadQueries:
    """Admits and answers queries under known headers; its methods are for the event loop's thread.

    Parameters
    ----------
    application
        The parts of the server.
    points
        Asks readers.
    """

    def __init__(self, application: Application, points: PointLines) -> None:
        self._application = application
        self._context = application.context
        self._asked = application.router.asked
        self._points = points
        self._forms: OrderedDict[str, tuple[str, bool]] = OrderedDict()

    def admit(self, head: RepeatedHead, value: bytes) -> HeadQuery | None:
        """Return a query that is to be answered here; none if it needs a closer look.

        In the latter case nothing has happened yet.

        Parameters
        ----------
        value
            The field ``query`` of the query string, as sent.
        """
        started = time.perf_counter()
        if len(value) > _MAX_VALUE or not _VALUE.fullmatch(value):
            return None
        try:
            text = decoded(value)
        except UnicodeDecodeError:
            return None
        if "\x00" in text:
            return None
        form, is_steady = self._form(text)
        context = self._context
        if not form or not head.is_current(context.tokens.revision()):
            return None
        if not context.queries.has_room or not context.limiter.try_admit(head.caller):
            return None
        return HeadQuery(head, "query=" + value.decode("ascii"), text, form, is_steady, started)

    def _form(self, text: str) -> tuple[str, bool]:
        """Return the form of a query that may be answered here; else an empty one."""
        masked = shape(text)
        form = self._forms.get(masked)
        if form is None:
            limits, here = self._context.config.limits, self._asked.lookups.in_memory
            form = self._forms[masked] = _judged(masked, limits, here)
            if len(self._forms) > _MAX_FORMS:
                self._forms.popitem(last=False)
        return form

    def answer(self, query: HeadQuery, channel: Channel) -> None:
        """Answer a query from the cache, or ask a reader."""
        head, cache = query.head, self._asked.cache
        key = (head.request.raw_path, query.asked, b"", head.part)
        cached = cache.lookup(key)
        if cached is not None:
            version = self._context.versions.current()
            self._send(query, channel, cached.fields, cached.response.body, version)
            return
        etag, keep = "", None
        if query.is_steady:
            etag = self._asked.versions.of_query(
                query.text, (), (), True, head.request.url, head.media_type
            )
            keep = cache.keeper_of(key, query.form, query.text, etag)
        caller = head.caller
        running = RunningQuery(query.id, caller.key, caller.name, query.text, head.timeout_s)
        version = self._context.versions.current()
        point = PointQuery(
            head.payload + query.text.encode(),
            query.text,
            partial(self._arrive, query, channel, etag, version, keep),
        )
        query.running = running
        running.on_stop(lambda: call_soon(channel.loop, point.give_up))
        if self._context.queries.try_begin(running):
            self._points.ask(point)
        else:
            point.give_up()

    def _arrive(
        self,
        query: HeadQuery,
        channel: Channel,
        etag: str,
        version: str,
        keep: Callable[[Response], None] | None,
        outcome: Answer | ReaderStream | Instead,
    ) -> None:
        """Send an answer that has come, if it is small; leave all else to the application."""
        running, head = query.running, query.head
        assert running is not None
        self._context.queries.end(running)
        if not isinstance(outcome, Answer) or len(outcome.body) > UNHURRIED_BYTES:
            self._leave(query, channel, outcome)
            return
        fields = head.content_type
        if etag:
            fields += b"etag: %b\r\n" % etag.encode()
        if outcome.gzip:
            fields += _GZIP
        if keep is not None:
            keep(_response(head, etag, outcome))
        self._send(query, channel, fields, outcome.body, version)

    def _leave(
        self, query: HeadQuery, channel: Channel, outcome: Answer | ReaderStream | Instead
    ) -> None:
        request = replace(query.head.request, query_string=query.asked)
        caller = query.head.caller
        job = self._application.admit_identified(
            request, caller, lambda: self._context.limiter.leave(caller)
        )
        job.started = query.started
        query.job = job
        if job.plan.running is not None and query.running is not None and query.running.stopped:
            job.plan.running.stop()
        channel.resume(query, job, outcome)

    def _send(
        self, query: HeadQuery, channel: Channel, fields: bytes, body: bytes, version: str
    ) -> None:
        head = query.head
        end = b"\r\n" if query.keep_alive else b"connection: close\r\n\r\n"
        data = (
            b"%b%b%b%brtask-request-id: %b\r\nrtask-version: %b\r\ncontent-length: %d\r\n%b%b"
        ) % (
            _OK,
            channel.date,
            head.fields,
            fields,
            query.id.encode(),
            version.encode(),
            len(body),
            end,
            body,
        )
        self._context.limiter.leave(head.caller)
        whole = channel.send(query, data)
        outcome = Outcome(query.id, 200, 0, len(body), whole)
        self._context.request_log.answered(
            head.sender, outcome, query.form, query.text, query.started
        )


def _judged(masked: str, limits: Limits, has_lookups: bool) -> tuple[str, bool]:
    """Return the form of a query that reads little and needs no rewriting; else an empty one.

    Parameters
    ----------
    masked
        The text without its IRIs.
    has_lookups
        Whether look-ups are answered in this process, which takes less time than asking another.
    """
    try:
        form = checked_form(masked, limits)
        guard(masked)
        is_plain = not names_dataset(masked) and "service" not in masked.lower()
    except RtaskError:
        return "", False
    is_point = not has_lookups if is_lookup(masked) else is_quick(masked)
    return (form, not is_unsteady(masked)) if is_plain and is_point else ("", False)


def _response(head: RepeatedHead, etag: str, answer: Answer) -> Response:
    headers: tuple[tuple[str, str], ...] = (("ETag", etag),) if etag else ()
    if answer.gzip:
        headers = (*headers, ("Content-Encoding", "gzip"))
    return Response(200, answer.body, negotiation.content_type(head.media_type), headers)
