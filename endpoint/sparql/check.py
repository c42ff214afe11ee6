"""Check of a query or an update, without carrying it out, at ``/sparql/check``."""

from __future__ import annotations

from endpoint.http.messages import RefusedError, Request, Response, json_response
from endpoint.http.plan import Plan
from endpoint.served import ServedGraph
from endpoint.sparql.request import QUERY_TYPE, UPDATE_TYPE
from rtask.asking.check.checker import checker_of
from rtask.errors import DataError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.sparql.syntax import check_query, check_update
from rtask.sparql.update_outline import read_update

__all__ = ["plan_check"]

MAX_TEXT = 200_000


def plan_check(kb: ServedGraph, request: Request) -> Plan:
    """Plan the check of the text in the body; its media type says what it is.

    The answer is 200 whether the text is right or not: ``ok``, and for one that does not parse
    ``detail``, ``line`` and ``column`` where they are known. For a query that parses, ``findings``
    where there are any, as :meth:`rtask.asking.check.findings.Finding.to_dict` gives them, or
    ``not_checked`` with the reason where the query parses and its meaning was not checked.

    Raises
    ------
    RefusedError
        415.
    UsageError
        The body is not UTF-8, or too long to be checked.
    """
    media_type, _ = request.content_type
    if media_type not in (QUERY_TYPE, UPDATE_TYPE):
        raise RefusedError(
            415,
            "unsupported-media-type",
            f"send the text as {QUERY_TYPE} or {UPDATE_TYPE}",
            headers=(("Accept-Post", f"{QUERY_TYPE}, {UPDATE_TYPE}"),),
        )
    try:
        text = request.body.decode()
    except UnicodeDecodeError:
        raise UsageError("the text is not UTF-8") from None
    if len(text) > MAX_TEXT:
        raise UsageError(f"{len(text)} characters; at most {MAX_TEXT} are checked")
    return Plan(lambda: _answer(kb, text, is_query=media_type == QUERY_TYPE))


def _answer(kb: ServedGraph, text: str, *, is_query: bool) -> Response:
    checks: dict[str, object] = {"ok": True}
    try:
        if is_query:
            check_query(text)
            if isinstance(kb, KnowledgeBase):
                findings = kb.check(text)
                if findings:
                    checks["findings"] = [finding.to_dict(text) for finding in findings]
                if unread := checker_of(kb).unread(text):
                    checks["not_checked"] = unread
            else:
                checks["not_checked"] = "not checked: the ontology of a remote store is not read"
        else:
            check_update(read_update(text))
    except DataError as error:
        checks = {"ok": False, "detail": str(error), **error.details}
    return json_response(checks)
