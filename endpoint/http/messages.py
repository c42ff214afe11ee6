"""HTTP requests and responses, independent of any server.

Handlers know only these two classes, so the same ones answer under Flask, under ASGI and in tests.
"""

from __future__ import annotations

import binascii
import difflib
import itertools
import json
import re
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol
from urllib.parse import quote, unquote

from rtask.errors import TRANSIENT_STATUSES, RtaskError

_BROKEN_ESCAPE = re.compile(r"%(?![0-9A-Fa-f]{2})")
# SPARQLWrapper and others send these beside the Accept header, which says the same and counts.
_OF_CLIENTS = ("format", "output", "results")
MAX_FIELDS = 2_000
_REQUEST_ID = re.compile(r"[A-Za-z0-9_-]{8,64}")
_RUN = secrets.token_hex(4)
_NUMBERS = itertools.count(1)
_PRINTABLE = "".join(map(chr, range(0x20, 0x7F)))

JSON_TYPE = "application/json"
CBOR_TYPE = "application/cbor"
FORM_TYPE = "application/x-www-form-urlencoded"


def new_request_id() -> str:
    """Return an id for a request whose client sent none."""
    return f"{_RUN}-{next(_NUMBERS)}"


class RefusedError(RtaskError):
    """A request refused for a reason of HTTP.

    Parameters
    ----------
    status
        HTTP status.
    slug
        Last part of the problem type.
    message
        What was wrong, where, and what to do.
    headers
        Header fields of the refusal, such as ``Allow``.
    **details
        Further members of the problem details.
    """

    def __init__(
        self,
        status: int,
        slug: str,
        message: str,
        headers: tuple[tuple[str, str], ...] = (),
        **details: Any,
    ) -> None:
        super().__init__(message, **{"transient": status in TRANSIENT_STATUSES, **details})
        self.http_status = status
        self.http_slug = slug
        self.headers = headers


def parse_fields(text: str, where: str) -> list[tuple[str, str]]:
    """Decode ``application/x-www-form-urlencoded`` text strictly.

    Parameters
    ----------
    text
        As sent, percent-encoded.
    where
        Named in the error: "query string" or "form".

    Raises
    ------
    RefusedError
        400 for a broken percent escape, text that is not UTF-8 or too many fields.

    Examples
    --------
    >>> parse_fields("query=ASK%20%7B%7D&x=", "form")
    [('query', 'ASK {}'), ('x', '')]
    """
    broken = _BROKEN_ESCAPE.search(text)
    if broken:
        near = text[broken.start() : broken.start() + 12]
        raise RefusedError(400, "usage", f"broken percent escape in the {where}: {near!r}")
    if text.count("&") >= MAX_FIELDS:
        raise RefusedError(400, "usage", f"more than {MAX_FIELDS} fields in the {where}")
    try:
        pairs = (field.partition("=") for field in text.split("&") if field)
        return [(_decoded(name), _decoded(value)) for name, _, value in pairs]
    except UnicodeDecodeError:
        raise RefusedError(400, "usage", f"the {where} is not UTF-8") from None


def _decoded(text: str) -> str:
    if "%" not in text:
        return text.replace("+", " ")
    if "=" in text or not text.isascii():
        return unquote(text.replace("+", " "), errors="strict")
    return decoded(text.encode("ascii"))


def decoded(value: bytes) -> str:
    """Return a value of a field in which all escapes are complete, and no ``=`` is without one.

    Quoted-printable has the same escapes by another sign, and the standard library decodes it at
    once; most of a request's text is escaped.

    Raises
    ------
    UnicodeDecodeError
        It is not UTF-8.

    Examples
    --------
    >>> decoded(b"ASK+%7B%7D")
    'ASK {}'
    """
    return binascii.a2b_qp(value.replace(b"+", b" ").replace(b"%", b"=")).decode()


def split_media_type(value: str) -> tuple[str, dict[str, str]]:
    """Split a Content-Type into the lower-case media type and its parameters.

    Examples
    --------
    >>> split_media_type('Text/Turtle; charset="UTF-8"')
    ('text/turtle', {'charset': 'UTF-8'})
    """
    media_type, *rest = value.split(";")
    parameters = {}
    for item in rest:
        name, _, text = item.partition("=")
        if name.strip():
            parameters[name.strip().lower()] = text.strip().strip('"')
    return media_type.strip().lower(), parameters


@dataclass(frozen=True)
class Request:
    """A request as a client sent it.

    Parameters
    ----------
    method
        Method in upper case.
    raw_path
        The path exactly as sent: percent-encoding is not normalised (``%31`` and ``1`` differ).
    query_string
        As sent, without the question mark.
    headers
        Names in lower case; repeated fields joined by a comma.
    body
        The whole body.
    site
        Scheme and authority as the client wrote them, ``http://127.0.0.1:8765``.
    client
        Address of the client, for the log.
    """

    method: str
    raw_path: str
    query_string: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""
    site: str = "http://localhost"
    client: str = ""

    @cached_property
    def id(self) -> str:
        """Request id for logs, problems and provenance; the client's own if it sent a valid one."""
        sent = self.headers.get("rtask-request-id", "")
        return sent if _REQUEST_ID.fullmatch(sent) else new_request_id()

    @cached_property
    def path(self) -> str:
        """The decoded path."""
        return unquote(self.raw_path)

    @property
    def url(self) -> str:
        """The request URL without its query."""
        return self.site + self.raw_path

    @cached_property
    def parameters(self) -> list[tuple[str, str]]:
        """The decoded fields of the query string, in order."""
        return parse_fields(self.query_string, "query string")

    def values(self, name: str) -> list[str]:
        """Return all values of a query-string field."""
        if not self.query_string:
            return []
        return [value for key, value in self.parameters if key == name]

    def header(self, name: str, default: str = "") -> str:
        """Return a header by its lower-case name."""
        return self.headers.get(name, default)

    @cached_property
    def content_type(self) -> tuple[str, dict[str, str]]:
        """Media type and parameters of the body; ``("", {})`` if the header is missing."""
        return split_media_type(self.header("content-type"))


def require_method(request: Request, allowed: Sequence[str], hint: str = "") -> None:
    """Refuse a request by another method than an address takes.

    Parameters
    ----------
    hint
        What to do instead; by default, which methods to use.

    Raises
    ------
    RefusedError
        405, with ``Allow`` (RFC 9110, 15.5.6).
    """
    if request.method not in allowed:
        listed = ", ".join(allowed)
        words = hint or f"{request.method} is not allowed here; use {listed}"
        raise RefusedError(405, "method-not-allowed", words, headers=(("Allow", listed),))


class Chunks(Protocol):
    """An answer that comes in pieces."""

    def __iter__(self) -> Iterator[bytes]:
        """Return the pieces."""
        ...

    def __next__(self) -> bytes:
        """Return the next piece; may wait for it."""
        ...

    def close(self) -> None:
        """End what makes the pieces; may be called from any thread."""
        ...


@dataclass(frozen=True)
class Response:
    """A response to a client.

    Parameters
    ----------
    status
        Status code.
    body
        The whole body, or its first part; left out by the server for HEAD.
    media_type
        Content-Type; none for an empty body.
    headers
        Further header fields.
    chunks
        The rest of the body, as it becomes available; an error breaks the connection, so that no
        client takes half an answer for a whole one. The server closes it in any case.
    """

    status: int = 200
    body: bytes = b""
    media_type: str = ""
    headers: tuple[tuple[str, str], ...] = ()
    chunks: Chunks | None = None

    def with_headers(self, *headers: tuple[str, str]) -> Response:
        """Return a copy with further header fields."""
        every = (*self.headers, *headers)
        return Response(self.status, self.body, self.media_type, every, self.chunks)

    def header_list(self) -> list[tuple[str, str]]:
        """Return all header fields, Content-Type included."""
        own = list(self.headers)
        if self.media_type:
            own.insert(0, ("Content-Type", self.media_type))
        return own


def remark_header(remark: str | None) -> tuple[tuple[str, str], ...]:
    """Return the header field of what the author of a change is told; none without a remark.

    >>> remark_header("two\N{EM DASH}one")
    (('RTASK-Remark', 'two%E2%80%94one'),)
    """
    return (("RTASK-Remark", quote(remark, safe=_PRINTABLE)),) if remark else ()


def refuse_unknown(names: Iterable[str], allowed: Sequence[str]) -> None:
    """Refuse a parameter without a meaning here: ignored, it would seem to have had its effect.

    Parameters
    ----------
    names
        Those of the request.
    allowed
        Those that the address understands.

    Raises
    ------
    RefusedError
        400 with the name, and the one that was probably meant.
    """
    for name in names:
        if name not in allowed and name not in _OF_CLIENTS:
            near = difflib.get_close_matches(name, allowed, 1)
            hint = f"did you mean `{near[0]}`? " if near else ""
            raise RefusedError(
                400,
                "usage",
                f"unknown parameter `{name[:80]}`; {hint}known: {', '.join(allowed)}",
                parameter=name[:80],
            )


def json_response(
    value: Any, status: int = 200, headers: tuple[tuple[str, str], ...] = ()
) -> Response:
    """Return a response whose body is a value as JSON."""
    return Response(status, json.dumps(value).encode(), JSON_TYPE, headers)
