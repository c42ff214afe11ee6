"""HTTP requests to a SPARQL server: retries, errors and answers.

A read is repeated when the server or the connection fails. An update is repeated only if the
answer proves that it did not run.
"""

from __future__ import annotations

import time
from typing import Any

import httpx
from pyoxigraph import (
    QueryBoolean,
    QueryResultsFormat,
    QuerySolutions,
    RdfFormat,
    parse,
    parse_query_results,
)

from rtask.errors import (
    AuthenticationError,
    CallFailedError,
    ClosedError,
    ForbiddenError,
    QuerySyntaxError,
    QueryTimeout,
    RemoteUnavailableError,
)
from rtask.sparql.results import Solutions, Triples

__all__ = ["Connection", "read_rows", "read_triples"]

_ATTEMPTS = 3
_PAUSE_S = 0.2
_UNAVAILABLE = (502, 503, 504)
_DID_NOT_RUN = (429, 503)


class Connection:
    """A connection to one server.

    Parameters
    ----------
    token
        Sent as a bearer token.
    timeout_s
        Time limit for one answer.
    """

    def __init__(self, token: str | None, timeout_s: float) -> None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._http: httpx.Client | None = httpx.Client(headers=headers, timeout=timeout_s)

    def send(
        self,
        url: str,
        parameters: list[tuple[str, str]],
        text: str,
        headers: dict[str, str],
        repeat: bool,
        timeout_s: float | None = None,
    ) -> bytes:
        """Send a text and return the answer's body.

        Parameters
        ----------
        repeat
            Whether the request may safely be sent twice.
        timeout_s
            Time limit for all attempts together; ``None`` applies the connection's limit to each
            attempt.

        Raises
        ------
        RemoteUnavailableError
            No answer after three attempts.
        QueryTimeout
            The time is up.
        RemoteError, AccessError, QuerySyntaxError
            The server refused the request; the message is the server's.
        """
        if self._http is None:
            raise ClosedError("the connection is closed")
        query = httpx.QueryParams(tuple(parameters))
        until = None if timeout_s is None else time.monotonic() + timeout_s
        for attempt in range(_ATTEMPTS):
            last = attempt + 1 == _ATTEMPTS
            wait: Any = httpx.USE_CLIENT_DEFAULT
            if until is not None:
                wait = max(0.001, until - time.monotonic())
            try:
                answer = self._http.post(
                    url, params=query, content=text.encode(), headers=headers, timeout=wait
                )
            except httpx.HTTPError as error:
                if until is not None and time.monotonic() >= until:
                    raise QueryTimeout(
                        f"{url}: no complete answer within {timeout_s:g} s", timeout_s=timeout_s
                    ) from error
                never_sent = isinstance(error, httpx.ConnectError | httpx.ConnectTimeout)
                if last or not (repeat or never_sent):
                    reason = str(error) or type(error).__name__
                    raise RemoteUnavailableError(f"{url}: {reason}") from error
            else:
                if last or answer.status_code not in (_UNAVAILABLE if repeat else _DID_NOT_RUN):
                    return _checked(answer, url)
            time.sleep(_PAUSE_S * 2**attempt)
        raise AssertionError("the last attempt returns or raises")

    def close(self) -> None:
        """Close the connection."""
        if self._http is not None:
            self._http.close()
            self._http = None


def read_rows(data: bytes) -> Solutions | bool:
    """Return the answer of a SELECT or ASK.

    Raises
    ------
    RemoteUnavailableError
        If the answer is incomplete.
    """
    try:
        answer = parse_query_results(data, format=QueryResultsFormat.JSON)
        if isinstance(answer, QueryBoolean):
            return bool(answer)
        assert isinstance(answer, QuerySolutions)
        names = [variable.value for variable in answer.variables]
        return Solutions(names, [tuple(row) for row in answer])
    except SyntaxError as error:
        raise RemoteUnavailableError(f"the answer broke off: {error}") from error


def read_triples(data: bytes) -> Triples:
    """Return the answer of a CONSTRUCT or DESCRIBE; raises as :func:`read_rows`."""
    try:
        return Triples(tuple(quad.triple for quad in parse(data, format=RdfFormat.N_TRIPLES)))
    except SyntaxError as error:
        raise RemoteUnavailableError(f"the answer broke off: {error}") from error


def _checked(answer: httpx.Response, url: str) -> bytes:
    if answer.is_success:
        return answer.content
    reason = _reason(answer)
    message = f"{url}: {answer.status_code} {reason}"
    if answer.status_code == 401:
        raise AuthenticationError(message)
    if answer.status_code == 403:
        raise ForbiddenError(message)
    if answer.status_code == 400:
        raise QuerySyntaxError(message)
    if answer.status_code in (502, 503, 504):
        raise RemoteUnavailableError(message)
    raise CallFailedError(message, status=answer.status_code)


def _reason(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["detail"])
    except (ValueError, KeyError, TypeError):
        return answer.text.strip()[:200] or answer.reason_phrase
