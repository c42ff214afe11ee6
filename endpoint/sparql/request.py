"""Parsing of protocol requests (SPARQL 1.1 Protocol, 2.1 and 2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from urllib.parse import unquote_to_bytes

from endpoint.http.messages import (
    FORM_TYPE,
    MAX_FIELDS,
    RefusedError,
    Request,
    parse_fields,
    refuse_unknown,
)
from rtask.errors import DataError
from rtask.rdf.terms import NamedNode, iri

QUERY_TYPE = "application/sparql-query"
UPDATE_TYPE = "application/sparql-update"

# What an address accepts: `/sparql` both, `/query` and `/update` one of them.
QUERY, UPDATE = "query", "update"
_QUERY_FIELDS = (
    QUERY, "default-graph-uri", "named-graph-uri", "inferred", "timeout", "as_of",
    "branch",
)  # fmt: skip
_UPDATE_FIELDS = (
    UPDATE, "using-graph-uri", "using-named-graph-uri", "agent", "note", "if-version",
    "branch",
)  # fmt: skip


@dataclass(frozen=True)
class QueryRequest:
    """A query operation.

    Parameters
    ----------
    text
        SPARQL 1.1 Query.
    default_graphs, named_graphs
        The protocol's dataset; if either is given, it overrides ``FROM`` in the text (2.1.4).
    base
        Base of relative IRIs in the text.
    timeout_s
        Time limit that the client requests; none for the server's default.
    inferred
        Whether to read derived triples, too.
    as_of
        Commit or time of the state to query, as text; empty for the current one.
    branch
        Name of the branch to query; empty for the trunk.
    """

    text: str
    default_graphs: tuple[str, ...] = ()
    named_graphs: tuple[str, ...] = ()
    base: str = ""
    timeout_s: float | None = None
    inferred: bool = True
    as_of: str = ""
    branch: str = ""


@dataclass(frozen=True)
class UpdateRequest:
    """An update operation.

    Parameters
    ----------
    using, using_named
        The protocol's dataset (2.2.3).
    agent, note
        In whose name the change is made, and what the author says about it: fields of our own,
        which other servers ignore.
    if_version
        ``EPOCH:NUMBER`` of the last commit on which the change depends; a field of our own, too.
    branch
        Name of the branch to change; empty for the trunk.
    """

    text: str
    using: tuple[str, ...] = ()
    using_named: tuple[str, ...] = ()
    base: str = ""
    agent: str = ""
    note: str = ""
    if_version: str = ""
    branch: str = ""


@dataclass(frozen=True)
class DescriptionRequest:
    """A GET without a query, which asks for the service description."""


Operation = QueryRequest | UpdateRequest | DescriptionRequest
Fields = list[tuple[str, str]]


def parse_operation(request: Request, kinds: tuple[str, ...] = (QUERY, UPDATE)) -> Operation:
    """Parse a protocol request.

    Parameters
    ----------
    request
        The request as received.
    kinds
        Kinds of operation that the address accepts.

    Raises
    ------
    RefusedError
        400, 405 or 415; the message says what to do instead.

    Examples
    --------
    >>> parse_operation(Request("GET", "/sparql", "query=ASK+%7B%7D")).text
    'ASK {}'
    """
    if request.method in ("GET", "HEAD"):
        return _from_get(request)
    return _from_post(request, kinds)


def is_update(request: Request) -> bool:
    """Return whether a request at ``/sparql`` is an update, without parsing it.

    >>> is_update(Request("POST", "/sparql", "", {"content-type": UPDATE_TYPE}))
    True
    >>> is_update(Request("POST", "/sparql", "", {"content-type": FORM_TYPE}, b"u%70date=x"))
    True
    """
    if request.method in ("GET", "HEAD"):
        return False
    media_type = request.content_type[0]
    # Looked at before parsing, to choose the lane: it has to be cheap, and right for every form
    # that parses.
    if media_type in (QUERY_TYPE, UPDATE_TYPE):
        return media_type == UPDATE_TYPE
    return _has_update(request.body) or _has_update(request.query_string.encode())


def _has_update(fields: bytes) -> bool:
    """Return whether a form has a field ``update``, its name escaped or not."""
    for field in fields.split(b"&", MAX_FIELDS):
        name = field.partition(b"=")[0]
        if name == b"update" or (b"%" in name and unquote_to_bytes(name) == b"update"):
            return True
    return False


def _from_get(request: Request) -> Operation:
    fields = request.parameters
    if any(name == "update" for name, _ in fields):
        raise RefusedError(400, "usage", "an update by GET is not allowed; send it by POST")
    if not any(name == "query" for name, _ in fields):
        refuse_unknown((name for name, _ in fields), _QUERY_FIELDS)
        return DescriptionRequest()
    return _query(_single(fields, "query"), fields, request)


def _from_post(request: Request, kinds: tuple[str, ...]) -> Operation:
    media_type, parameters = request.content_type
    types = [FORM_TYPE]
    types += [QUERY_TYPE] if QUERY in kinds else []
    types += [UPDATE_TYPE] if UPDATE in kinds else []
    if media_type not in types:
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"Content-Type {media_type or '(none)'} is not accepted; use {', '.join(types)}",
            headers=(("Accept-Post", ", ".join(types)),),
        )
    if parameters.get("charset", "utf-8").lower() not in ("utf-8", "utf8"):
        raise RefusedError(415, "unsupported-media-type", "send the text as UTF-8")
    try:
        body = request.body.decode("utf-8", errors="strict")
    except UnicodeDecodeError as error:
        raise RefusedError(400, "usage", f"the body is not UTF-8 at byte {error.start}") from None
    fields = request.parameters
    if media_type == QUERY_TYPE:
        _refuse_text_fields(fields)
        return _query(body, fields, request)
    if media_type == UPDATE_TYPE:
        _refuse_text_fields(fields)
        return _update(body, fields, request)
    return _from_form([*parse_fields(body, "form"), *fields], kinds, request)


def _from_form(fields: Fields, kinds: tuple[str, ...], request: Request) -> Operation:
    names = [name for name, _ in fields if name in kinds]
    if len(names) != 1:
        types = " or ".join(f"`{kind}`" for kind in kinds)
        listed = ", ".join(names) or "none"
        raise RefusedError(400, "usage", f"expected exactly one field {types}; found {listed}")
    if names == [QUERY]:
        return _query(_single(fields, "query"), fields, request)
    return _update(_single(fields, "update"), fields, request)


def _refuse_text_fields(fields: Fields) -> None:
    for name, _ in fields:
        if name in (QUERY, UPDATE):
            raise RefusedError(400, "usage", f"`{name}` in the URL and an operation in the body")


def _single(fields: Fields, name: str) -> str:
    values = [value for key, value in fields if key == name]
    if len(values) != 1:
        raise RefusedError(400, "usage", f"{len(values)} fields `{name}`; expected one")
    return values[0]


def _query(text: str, fields: Fields, request: Request) -> QueryRequest:
    # The commonest request, without a field to look for.
    if len(fields) == 1 and fields[0][0] == QUERY:
        return QueryRequest(_without_nul(text, "query"), base=request.url)
    refuse_unknown((name for name, _ in fields), _QUERY_FIELDS)
    return QueryRequest(
        _without_nul(text, "query"),
        _iris(fields, "default-graph-uri"),
        _iris(fields, "named-graph-uri"),
        base=request.url,
        timeout_s=_timeout(fields),
        inferred=_inferred(fields),
        as_of=_short(fields, "as_of", 64),
        branch=_short(fields, "branch", 64),
    )


def _update(text: str, fields: Fields, request: Request) -> UpdateRequest:
    refuse_unknown((name for name, _ in fields), _UPDATE_FIELDS)
    using = _iris(fields, "using-graph-uri")
    using_named = _iris(fields, "using-named-graph-uri")
    agent, note = (_short(fields, name, most) for name, most in (("agent", 64), ("note", 500)))
    version = _short(fields, "if-version", 64)
    text = _without_nul(text, "update")
    branch = _short(fields, "branch", 64)
    return UpdateRequest(text, using, using_named, request.url, agent, note, version, branch)


def _short(fields: Fields, name: str, most: int) -> str:
    """Return the text of an optional field, or refuse it."""
    values = [value for key, value in fields if key == name]
    if len(values) > 1 or any(len(v) > most or not v.isprintable() for v in values):
        raise RefusedError(
            400, "usage", f"`{name}` takes one text of at most {most} printable characters"
        )
    return values[0] if values else ""


def _without_nul(text: str, kind: str) -> str:
    if "\x00" in text:
        raise RefusedError(400, f"{kind}-syntax", f"a NUL character in the {kind}")
    if not text.strip():
        raise RefusedError(400, f"{kind}-syntax", f"the {kind} is empty")
    return text


def _iris(fields: Fields, name: str) -> tuple[str, ...]:
    values = tuple(value for key, value in fields if key == name)
    for value in values:
        absolute_iri(value, name)
    return values


def absolute_iri(value: str, name: str) -> NamedNode:
    """Return a value as a term, or refuse it unless it is an absolute IRI."""
    try:
        return iri(value)
    except DataError as error:
        raise RefusedError(400, "usage", f"{name}: {error}") from None


def _timeout(fields: Fields) -> float | None:
    values = [value for key, value in fields if key == "timeout"]
    if not values:
        return None
    try:
        seconds = float(values[-1])
    except ValueError:
        seconds = math.nan
    if not seconds > 0 or math.isinf(seconds):
        raise RefusedError(400, "usage", f"timeout={values[-1]!r} is not a number of seconds > 0")
    return seconds


def _inferred(fields: Fields) -> bool:
    values = [value for key, value in fields if key == "inferred"]
    if not values:
        return True
    if values[-1] not in ("0", "1", "false", "true"):
        raise RefusedError(400, "usage", f"inferred={values[-1]!r}; use 0 or 1")
    return values[-1] in ("1", "true")
