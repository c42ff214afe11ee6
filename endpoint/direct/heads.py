"""Headers that are known: what one means is found out once for all requests that repeat it.

A program sends the same header with each request of a connection, byte by byte. Parsing it,
identifying its sender and negotiating the format of an answer takes longer than finding the answer
to a small query. So what was found is kept with the connection, as long as no token changes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from endpoint.access.auth import Caller
from endpoint.application import Application
from endpoint.http.compression import wants_gzip
from endpoint.http.encoding import encode_fields
from endpoint.http.messages import Request
from endpoint.monitoring.request_log import Sender
from endpoint.sparql import negotiation
from endpoint.sparql.answer_cache import Part, key_part
from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase

__all__ = ["RepeatedHead", "learn"]

# With these alone, a request has no body, no condition, no session and no id of its own.
_HARMLESS = frozenset(
    (
        *("host", "accept", "accept-encoding", "accept-language", "user-agent", "connection"),
        "authorization",
    )
)
_MAX_BYTES = 4 << 10
_PLAIN_TYPES = (negotiation.RESULTS_JSON, negotiation.CSV, negotiation.TSV)


@dataclass(frozen=True, slots=True)
class RepeatedHead:
    """Meaning of a header for a small query by GET.

    Parameters
    ----------
    start, end
        What surrounds the field ``query`` in such a request: method and address, and the rest of
        the first line with all the lines that follow.
    request
        The request from which it was learnt.
    caller, revision
        Who sends it, and the state of the tokens when that was found out.
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
    """

    start: bytes
    end: bytes
    request: Request
    caller: Caller
    revision: object
    sender: Sender
    fields: bytes
    media_type: str
    content_type: bytes
    payload: bytes
    timeout_s: float
    part: Part

    def value_in(self, data: bytes) -> bytes | None:
        """Return the field ``query`` of a request by GET under this header, as sent.

        None if these bytes are not exactly one such request.
        """
        start, end = self.start, self.end
        if data.startswith(start) and data.endswith(end):
            return data[len(start) : -len(end)]
        return None

    def is_current(self, revision: object) -> bool:
        """Whether its sender is still the same, given the present state of the tokens."""
        token = self.caller.token
        return revision == self.revision and (token is None or token.expires_at > time.time())


def learn(block: bytes, request: Request, application: Application) -> RepeatedHead | None:
    """Return what a header means; none if it is one of those whose requests need a closer look.

    Parameters
    ----------
    block
        The header as sent: all lines but the first, and the empty one.
    request
        A query by GET with this header, in HTTP/1.1.
    """
    context = application.context
    kb, config = context.kb, context.config
    if not isinstance(kb, KnowledgeBase) or not kb.readers.possible or len(block) > _MAX_BYTES:
        return None
    is_harmless = _HARMLESS.issuperset(request.headers)
    if not is_harmless or request.header("connection", "keep-alive").lower() != "keep-alive":
        return None
    revision = context.tokens.revision()
    try:
        caller = context.auth.identify(request)
        media_type = negotiation.choose(request.header("accept"), negotiation.SOLUTION_TYPES)
        payload = kb.encode_query(
            "",
            media_type,
            base_iri=request.url or None,
            gzip=wants_gzip(request),
            max_rows=config.max_rows,
            max_bytes=config.max_result_bytes,
        )
    except RtaskError:
        return None
    if media_type not in _PLAIN_TYPES or payload is None:
        return None
    return RepeatedHead(
        b"GET %b?query=" % request.raw_path.encode("ascii"),
        b" HTTP/1.1\r\n" + block,
        request,
        caller,
        revision,
        Sender.of(request, caller),
        encode_fields(application.steady_fields(request)),
        media_type,
        encode_fields([("Content-Type", negotiation.content_type(media_type))]),
        payload,
        config.effective_timeout(None, caller.access.role),
        key_part(request, caller.access),
    )
