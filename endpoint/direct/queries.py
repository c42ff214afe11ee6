"""Small queries from their bytes to the bytes of their answers.

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
from typing import NamedTuple, Protocol

from uvicorn.protocols.http.httptools_impl import STATUS_LINE

from endpoint.application import Application
from endpoint.asgi import call_soon
from endpoint.direct.exchange import Exchange
from endpoint.direct.heads import Fields, Head, Heads, Origin
from endpoint.http.conditional import is_unsteady
from endpoint.http.messages import Response, decoded, new_request_id
from endpoint.http.plan import RunningQuery
from endpoint.http.response_stream import UNHURRIED_BYTES
from endpoint.lanes import Job
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

__all__ = ["Channel", "QuickQueries"]

# What clients leave unescaped in a value, and escapes: no `&` (another field), no `#`.
_SAFE = rb"[A-Za-z0-9\-._~!$'()*,;:@/?+]*"
_FIELD = re.compile(rb"query=(" + _SAFE + rb"(?:%[0-9A-Fa-f]{2}" + _SAFE + rb")*)")
_MAX_BYTES = 8 << 10
_MAX_SHAPES = 2_048
_OK = STATUS_LINE[200]
_GZIP = b"content-encoding: gzip\r\n"


class Channel(Protocol):
    """The connection of a query."""

    loop: asyncio.AbstractEventLoop

    @property
    def shared(self) -> bytes:
        """The header fields that all responses of the server share."""

    def send(self, exchange: Exchange, data: bytes) -> bool:
        """Send a whole response and end the request; return whether the client is still there."""

    def resume(
        self, exchange: Exchange, job: Job, outcome: Answer | ReaderStream | Instead
    ) -> None:
        """Go on as with any other request, from what was found."""


class _Judgement(NamedTuple):
    """What the shape of a text says of a query.

    Attributes
    ----------
    form
        SELECT or ASK; empty if it is not for here.
    is_steady
        Whether the answer is the same until the next commit.
    """

    form: str
    is_steady: bool


class _Asked(NamedTuple):
    """A query that was admitted."""

    exchange: Exchange
    channel: Channel
    head: Head
    text: str
    query_string: str
    judgement: _Judgement
    id: str
    started: float


class QuickQueries:
    """Admits and answers small queries; its methods are for the event loop's thread.

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
        self._heads = Heads(application)
        self._judgements: OrderedDict[str, _Judgement] = OrderedDict()

    def take(self, exchange: Exchange, origin: Origin, fields: Fields, channel: Channel) -> bool:
        """Answer a query, or return false if it needs a closer look; then nothing has happened."""
        started = time.perf_counter()
        head = self._heads.find(origin, fields)
        if head is None or (text := _text(exchange, head)) is None:
            return False
        judgement = self._judge(text)
        # A limit that is reached is refused elsewhere, with its words; here nothing may have
        # happened.
        context = self._context
        if not judgement.form or text in self._asked.slow or not context.queries.has_room:
            return False
        if not context.limiter.try_admit(head.caller):
            return False
        query_string = exchange.query_string.decode("ascii")
        asked = _Asked(
            exchange, channel, head, text, query_string, judgement, new_request_id(), started
        )
        self._answer(asked)
        return True

    def _judge(self, text: str) -> _Judgement:
        masked = shape(text)
        judgement = self._judgements.get(masked)
        if judgement is None:
            limits, here = self._context.config.limits, self._asked.lookups.in_memory
            judgement = self._judgements[masked] = _judged(masked, limits, here)
            if len(self._judgements) > _MAX_SHAPES:
                self._judgements.popitem(last=False)
        return judgement

    def _answer(self, asked: _Asked) -> None:
        """Answer a query from the cache, or ask a reader."""
        exchange, channel, head, text, query_string, judgement, request_id, _ = asked
        cache, versions = self._asked.cache, self._asked.versions
        version = versions.current()
        key = (head.request.raw_path, query_string, exchange.body, head.part)
        cached = cache.lookup(key)
        if cached is not None:
            self._send(asked, cached.fields, cached.response.body, version)
            return
        # An answer that differs each time, by NOW() or RAND(), is neither tagged nor kept.
        etag, keep = "", None
        if judgement.is_steady:
            etag = versions.of_query(text, (), (), True, head.request.url, head.media_type)
            keep = cache.keeper_of(key, judgement.form, text, etag)
        caller = head.caller
        running = RunningQuery(request_id, caller.key, caller.name, text, head.timeout_s)
        query = PointQuery(
            head.payload + text.encode(),
            text,
            partial(self._arrive, asked, running, etag, version, keep),
        )
        exchange.running = running
        running.on_stop(partial(call_soon, channel.loop, query.give_up))
        # Raced by others since the first look: the application says that there is no room.
        if self._context.queries.try_begin(running):
            self._points.ask(query)
        else:
            query.give_up()

    def _arrive(
        self,
        asked: _Asked,
        running: RunningQuery,
        etag: str,
        version: str,
        keep: Callable[[Response], None] | None,
        outcome: Answer | ReaderStream | Instead,
    ) -> None:
        """Send an answer that has come, if it is small; leave all else to the application."""
        self._context.queries.end(running)
        # A large answer is sent in pieces, at the pace of its reader.
        if not isinstance(outcome, Answer) or len(outcome.body) > UNHURRIED_BYTES:
            self._leave(asked, running, outcome)
            return
        fields = asked.head.content_type
        if etag:
            fields += b"etag: %b\r\n" % etag.encode()
        if outcome.gzip:
            fields += _GZIP
        if keep is not None:
            keep(_response(asked.head, etag, outcome))
        self._send(asked, fields, outcome.body, version)

    def _leave(
        self, asked: _Asked, running: RunningQuery, outcome: Answer | ReaderStream | Instead
    ) -> None:
        exchange, caller = asked.exchange, asked.head.caller
        request = replace(asked.head.request, query_string=asked.query_string, body=exchange.body)
        request.__dict__["id"] = asked.id
        job = self._application.admit_identified(
            request, caller, partial(self._context.limiter.leave, caller)
        )
        job.started = asked.started
        exchange.running = job.plan.running
        # Stopped between the two: the new query would not have heard of it.
        if job.plan.running is not None and running.stopped:
            job.plan.running.stop()
        asked.channel.resume(exchange, job, outcome)

    def _send(self, asked: _Asked, fields: bytes, body: bytes, version: str) -> None:
        exchange, channel, head, text, _, judgement, request_id, started = asked
        end = b"\r\n" if exchange.keep_alive else b"connection: close\r\n\r\n"
        data = (
            b"%b%b%b%brtask-request-id: %b\r\nrtask-version: %b\r\ncontent-length: %d\r\n%b%b"
        ) % (
            _OK,
            channel.shared,
            head.fields,
            fields,
            request_id.encode(),
            version.encode(),
            len(body),
            end,
            body,
        )
        self._context.limiter.leave(head.caller)
        is_whole = channel.send(exchange, data)
        outcome = Outcome(request_id, 200, len(exchange.body), len(body), is_whole)
        self._context.request_log.answered(head.sender, outcome, judgement.form, text, started)


def _text(exchange: Exchange, head: Head) -> str | None:
    """Return the text of a query, or None if the request is not one plain query."""
    body = exchange.body
    try:
        if head.place == "body":
            text = None if exchange.query_string else body.decode()
        elif head.place == "form":
            text = None if exchange.query_string else _field(body)
        else:
            text = None if body else _field(exchange.query_string)
    except UnicodeDecodeError:
        return None
    return None if text is None or "\x00" in text else text


def _field(fields: bytes) -> str | None:
    """Return the value of the only field, ``query``."""
    if len(fields) > _MAX_BYTES or (found := _FIELD.fullmatch(fields)) is None:
        return None
    return decoded(found[1])


def _judged(masked: str, limits: Limits, has_lookups: bool) -> _Judgement:
    """Judge whether a query reads little and needs no rewriting.

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
        return _Judgement("", False)
    is_point = not has_lookups if is_lookup(masked) else is_quick(masked)
    if not is_plain or not is_point or form not in ("SELECT", "ASK"):
        return _Judgement("", False)
    return _Judgement(form, not is_unsteady(masked))


def _response(head: Head, etag: str, answer: Answer) -> Response:
    headers: tuple[tuple[str, str], ...] = (("ETag", etag),) if etag else ()
    if answer.gzip:
        headers = (*headers, ("Content-Encoding", "gzip"))
    return Response(200, answer.body, negotiation.content_type(head.media_type), headers)
