"""Carry out protocol operations on the knowledge base: SPARQL 1.1 Protocol, 2.1.4 to 2.2.4."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

from endpoint.config import Config
from endpoint.exchange import JSON_TYPE, Request, Response
from endpoint.protocol import negotiation
from endpoint.protocol.description import MAX_NAMED_GRAPHS, describe
from endpoint.protocol.limits import Limits, checked_form
from endpoint.protocol.request import QueryRequest, UpdateRequest
from rtask.errors import DataError, QuerySyntaxError
from rtask.kb.access import Access
from rtask.kb.knowledge_base import KnowledgeBase
from rtask.kb.services import without_services

_CACHED_TEXT = 16_384
# XML 1.0 has no way to write these; the store writes them raw.
_CONTROL = bytes(code for code in range(32) if code not in (9, 10, 13))
_XML_SAFE = bytes.maketrans(_CONTROL, b"?" * len(_CONTROL))
_XML_TYPES = (negotiation.RESULTS_XML, negotiation.RDF_XML)
_LIST_GRAPHS = f"SELECT ?g WHERE {{ GRAPH ?g {{}} }} ORDER BY ?g LIMIT {MAX_NAMED_GRAPHS}"


@dataclass(frozen=True)
class Plan:
    """A request that was understood: what is left is the work on the store.

    Parameters
    ----------
    run
        Does the work; may raise any error of :mod:`rtask.errors`.
    timeout_s
        How long it may take; none where it must not be given up half-way.
    """

    run: Callable[[], Response]
    timeout_s: float | None = None

    @staticmethod
    def ready(response: Response) -> Plan:
        """Return a plan without work."""
        return Plan(lambda: response)


@lru_cache(maxsize=512)
def _known_form(text: str, limits: Limits) -> str:
    return checked_form(text, limits)


def _form(text: str, limits: Limits) -> str:
    """Robots send the same text again and again; what is short is read once."""
    if len(text) > _CACHED_TEXT:
        return checked_form(text, limits)
    return _known_form(text, limits)


def plan_query(kb: KnowledgeBase, query: QueryRequest, request: Request, config: Config) -> Plan:
    """Prepare a query: limits, format, dataset.

    Raises
    ------
    RefusedError
        Too complex, or no format is acceptable.
    QuerySyntaxError
        The text is no query.
    """
    form = _form(query.text, config.limits)
    if not form:
        raise QuerySyntaxError(
            "this is no query: SELECT, ASK, CONSTRUCT or DESCRIBE is wanted; "
            "send updates as `update=` or application/sparql-update"
        )
    offers = negotiation.SOLUTION_TYPES if form in ("SELECT", "ASK") else negotiation.GRAPH_TYPES
    media_type = negotiation.choose(request.header("accept"), offers)
    content_type = negotiation.content_type(media_type)
    if request.method == "HEAD":
        return Plan.ready(Response(200, b"", content_type))
    timeout_s = config.effective_timeout(query.timeout_s)

    def run() -> Response:
        try:
            body = kb.serialize(
                query.text,
                media_type,
                inferred=query.inferred,
                default_graphs=query.default_graphs or None,
                named_graphs=query.named_graphs or None,
                base=query.base,
            )
        except RuntimeError as error:
            # What the store parses but cannot carry out, as an unknown function.
            raise DataError(f"the query cannot be evaluated: {error}") from error
        if media_type in _XML_TYPES:
            body = body.translate(_XML_SAFE)
        return Response(200, body, content_type)

    return Plan(run, timeout_s)


def plan_update(
    kb: KnowledgeBase, update: UpdateRequest, request: Request, access: Access, config: Config
) -> Plan:
    """Prepare an update. Rights are decided on by the knowledge base, on the exact change.

    Raises
    ------
    RefusedError
        Too complex.
    ForbiddenError
        It calls another server.
    """
    if checked_form(update.text, config.limits, update=True):
        raise QuerySyntaxError("this is a query; send it as `query=` or application/sparql-query")
    # The WHERE part of an update would call out just as a query would.
    text = without_services(update.text)
    wants_json = JSON_TYPE in request.header("accept").lower()

    def run() -> Response:
        commit = kb.update(
            text,
            using=update.using,
            named=update.using_named,
            access=access,
            base=update.base,
        )
        if not wants_json:
            return Response(204)
        counts = {
            "seq": commit.seq,
            "added": commit.added,
            "removed": commit.removed,
            "derived": commit.derived,
        }
        return Response(200, json.dumps(counts).encode(), JSON_TYPE)

    return Plan(run)


def plan_description(kb: KnowledgeBase, request: Request, config: Config, *, updates: bool) -> Plan:
    """Prepare the service description."""
    media_type = negotiation.choose(request.header("accept"), negotiation.GRAPH_TYPES)

    def run() -> Response:
        names = [str(row.value("g")) for row in kb.select(_LIST_GRAPHS)]
        return describe(request.url, media_type, plain=config.plain, updates=updates, graphs=names)

    return Plan(run, config.timeout_s)
