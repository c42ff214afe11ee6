"""Errors as RFC 9457 problem details.

Every error of :mod:`rtask.errors` knows its status and slug;
:class:`~endpoint.http.messages.RefusedError` adds what only HTTP has: 405, 406, 415 and their
headers.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Mapping
from http import HTTPStatus
from types import MappingProxyType
from typing import Any

from endpoint.http.messages import RefusedError, Response
from rtask.errors import AuthenticationError, ForbiddenError, RtaskError

PROBLEM_TYPE = "application/problem+json"
_MAX_DETAIL = 4_000
_log = logging.getLogger(__name__)


def status_of(error: Exception) -> int:
    """Return the HTTP status that an error stands for."""
    if isinstance(error, RefusedError):
        return error.http_status
    return error.status if isinstance(error, RtaskError) else 500


def details_of(error: Exception, instance: str = "") -> dict[str, Any]:
    """Return the members of the problem details (RFC 9457, 3.1).

    Unexpected errors reveal nothing internal: no message, no traceback.

    Examples
    --------
    >>> from rtask.errors import QuerySyntaxError
    >>> details = details_of(QuerySyntaxError("expected }", line=1, column=9))
    >>> details["type"], details["status"], details["line"]
    ('/errors/query-syntax', 400, 1)
    """
    status = status_of(error)
    if isinstance(error, RtaskError):
        slug, detail, extra = slug_of(error), str(error), error.details
    else:
        slug, detail, extra = "internal", "an unexpected error; see the server's log", {}
    members: dict[str, Any] = {
        "type": f"/errors/{slug}",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "detail": detail[:_MAX_DETAIL],
    }
    if instance:
        members["instance"] = instance
    members["transient"] = is_transient(error)
    for name, value in extra.items():
        if name not in members and value is not None:
            members[name] = value
    return members


def is_transient(error: Exception) -> bool:
    """Return whether trying again may help; unexpected errors are nobody's to repeat."""
    return isinstance(error, RtaskError) and error.is_transient


def slug_of(error: Exception) -> str:
    """Return the last part of the problem type; lack of rights is divided by what was denied."""
    if not isinstance(error, RtaskError):
        return "internal"
    if isinstance(error, RefusedError):
        return error.http_slug
    if isinstance(error, ForbiddenError):
        if error.details.get("operation") in ("SERVICE", "LOAD"):
            return "service-not-allowed"
        if error.details.get("protected"):
            return "graph-protected"
        return error.slug if error.details.get("graph") else "forbidden"
    return error.slug


def problem(
    error: Exception, instance: str = "", more: Mapping[str, object] = MappingProxyType({})
) -> Response:
    """Turn an error into a response, and log it if it was unexpected.

    Parameters
    ----------
    more
        Further members of the problem details.
    """
    if not isinstance(error, RtaskError):
        _log.error("request %s failed", instance or "-", exc_info=error)
    details = {**details_of(error, instance), **more}
    text = json.dumps(details, default=str, ensure_ascii=False)
    body = text.encode(errors="backslashreplace")  # half of a surrogate pair, as JSON escapes it
    headers: tuple[tuple[str, str], ...] = ()
    if isinstance(error, RefusedError):
        headers = error.headers
    elif isinstance(error, AuthenticationError):
        headers = (("WWW-Authenticate", _challenge(error)),)
    elif isinstance(error, RtaskError) and "retry_after_s" in error.details:
        headers = (("Retry-After", str(math.ceil(error.details["retry_after_s"]))),)
    return Response(status_of(error), body, PROBLEM_TYPE, headers)


def _challenge(error: AuthenticationError) -> str:
    """Return the challenge (RFC 6750, 3), without an error code if no token was sent."""
    if error.details.get("token_sent"):
        return 'Bearer realm="rtask", error="invalid_token"'
    return 'Bearer realm="rtask"'
