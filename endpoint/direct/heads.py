"""Headers of queries: what one means is worked out once for all requests with the same fields.

A program sends the same few fields that matter with each request: who asks, and in which format the
answer is to come. Identifying the sender and negotiating the format takes longer than finding the
answer to a small query, so what follows from these fields is kept until a token changes. Fields
that the server does not read, such as ``User-Agent`` or a program's own, may differ each time.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from endpoint.access.auth import Caller
from endpoint.application import Application
from endpoint.http.compression import wants_gzip
from endpoint.http.encoding import encode_fields
from endpoint.http.messages import FORM_TYPE, Request, split_media_type
from endpoint.monitoring.request_log import Sender
from endpoint.sparql import negotiation
from endpoint.sparql.answer_cache import Part, key_part
from endpoint.sparql.request import QUERY_TYPE
from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase

__all__ = ["Head", "Heads", "Place"]

Place = Literal["url", "form", "body"]
"""Where the text of a query is: a field of the address or of a form, or all of the body."""

RELEVANT = frozenset((b"host", b"authorization", b"accept", b"accept-encoding", b"content-type"))
DECIDING = frozenset(
    (
        *(b"content-encoding", b"cookie", b"expect", b"forwarded", b"idempotency-key"),
        *(b"if-match", b"if-modified-since", b"if-none-match", b"if-range"),
        *(b"if-unmodified-since", b"last-event-id", b"mcp-protocol-version", b"origin"),
        *(b"prefer", b"range", b"transfer-encoding", b"upgrade"),
    )
)
"""Fields that the server reads elsewhere: a request that has one needs a closer look.

Fields that it does not read at all change nothing, and may differ each time.
"""
_DECIDING_STARTS = (b"rtask-", b"x-forwarded-", b"access-control-")
_MAX_BYTES = 4 << 10
_MAX_HEADS = 1_024
_PLACES: dict[str, Place] = {QUERY_TYPE: "body", FORM_TYPE: "form"}
_PLAIN_TYPES = (negotiation.RESULTS_JSON, negotiation.CSV, negotiation.TSV)


@dataclass(frozen=True, slots=True)
class Head:
    """Meaning of the fields of a header that matter, for a small query.

    Parameters
    ----------
    request
        The request without its query.
    caller, revision
        Who sends it, and the state of the tokens when that was worked out.
    expires_at
        When the caller's token does, in seconds of :func:`time.time`.
    sender
        Its part of the log line.
    fields
        The header fields of all answers.
    media_type, content_type
        Of answers to SELECT and ASK, and the header field for it.
    payload
        The beginning of such a query as it is sent to a reader; the text follows.
    timeout_s
        Time limit of a query.
    part
        Its part of the keys of the answer cache.
    place
        Where the query is.
    """

    request: Request
    caller: Caller
    revision: object
    expires_at: float
    sender: Sender
    fields: bytes
    media_type: str
    content_type: bytes
    payload: bytes
    timeout_s: float
    part: Part
    place: Place


Fields = list[tuple[bytes, bytes]]
Origin = tuple[str, bytes, str, str]
"""Method, path, scheme and the client's address."""


class Heads:
    """The headers that are known.

    Parameters
    ----------
    application
        Identifies callers, and says what all answers have in common.
    """

    def __init__(self, application: Application) -> None:
        self._application = application
        self._tokens = application.context.tokens
        self._known: dict[tuple[object, ...], Head | None] = {}
        self._revision: object = None

    def find(self, origin: Origin, fields: Fields) -> Head | None:
        """Return what a header means, or None if its request needs a closer look."""
        relevant = []
        for field in fields:
            name = field[0]
            if name in RELEVANT:
                relevant.append(field)
            elif name in DECIDING or name.startswith(_DECIDING_STARTS):
                return None
        revision = self._tokens.revision()
        if revision != self._revision:
            # A token that was revoked must not be let in by what its header meant before.
            self._known.clear()
            self._revision = revision
        key = (origin, *relevant)
        head = self._known.get(key)
        if head is None:
            # Remembered as one that needs a closer look; or too long to be remembered.
            if key in self._known or sum(len(value) for _, value in relevant) > _MAX_BYTES:
                return None
            head = self._meaning(origin, relevant)
            if len(self._known) >= _MAX_HEADS:
                # Emptied as a whole, since a robot's few headers are back after one request each.
                self._known.clear()
            self._known[key] = head
        elif head.expires_at <= time.time():
            return None
        return head

    def _meaning(self, origin: Origin, fields: Fields) -> Head | None:
        method, path, scheme, client = origin
        context = self._application.context
        kb, config = context.kb, context.config
        headers = {name.decode(): value.decode("latin-1") for name, value in fields}
        # A field that comes twice has no single meaning.
        if not isinstance(kb, KnowledgeBase) or len(headers) < len(fields):
            return None
        place = _place(method, headers.get("content-type", ""))
        if place is None:
            return None
        site = config.site(scheme, headers.get("host", ""))
        request = Request(method, path.decode(), "", headers, b"", site, client)
        revision = self._tokens.revision()
        try:
            caller = context.auth.identify(request)
            media_type = negotiation.choose(request.header("accept"), negotiation.SOLUTION_TYPES)
            payload = kb.encode_query(
                "",
                media_type,
                base_iri=request.url,
                gzip=wants_gzip(request),
                max_rows=config.max_rows,
                max_bytes=config.max_result_bytes,
            )
        except RtaskError:
            return None
        if media_type not in _PLAIN_TYPES or payload is None:
            return None
        token = caller.token
        return Head(
            request,
            caller,
            revision,
            float("inf") if token is None else token.expires_at,
            Sender.of(request, caller),
            encode_fields(self._application.steady_fields(request)),
            media_type,
            encode_fields([("Content-Type", negotiation.content_type(media_type))]),
            payload,
            config.effective_timeout(None, caller.access.role),
            key_part(request, caller.access),
            place,
        )


def _place(method: str, content_type: str) -> Place | None:
    """Return where the query of a request is, or None if its type needs a closer look."""
    if method == "GET":
        return "url"
    media_type, parameters = split_media_type(content_type)
    if parameters.get("charset", "utf-8").lower() != "utf-8":
        return None
    return _PLACES.get(media_type)
