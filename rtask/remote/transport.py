"""HTTP requests to a SPARQL server: retries, errors and answers.

Texts are always sent as a form (SPARQL 1.1 Protocol, 2.1.2 and 2.2.1), which every server takes;
some never answer a text that is sent directly. A read is repeated when the server or the connection
fails. An update is repeated only if the answer proves that it did not run, or was rolled back.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import unquote, urlsplit, urlunsplit

import httpx

from rtask.errors import (
    AuthenticationError,
    CallFailedError,
    ClosedError,
    ForbiddenError,
    InconsistentError,
    QuerySyntaxError,
    QueryTimeout,
    RemoteUnavailableError,
    RtaskError,
    ValidationError,
    VersionConflictError,
)
from rtask.sparql.results import Solutions, Triples, read_answer
from rtask.wire.address import authorization

__all__ = ["Connection", "checked", "read_whole", "without_password"]

_ATTEMPTS = 3
_PAUSE_S = 0.2
_CONNECT_S = 5.0
_UNAVAILABLE = (502, 503, 504)
_DID_NOT_RUN = (429, 503)
_ROLLED_BACK = "40001"
"""State of SQL: the transaction lost a deadlock or a conflict, and left nothing behind."""

_REFUSALS: dict[str, type[RtaskError]] = {
    kind.slug: kind for kind in (InconsistentError, ValidationError, VersionConflictError)
}
"""What a server of RTASK says of data that it does not take, as if they had been stored here."""


class Connection:
    """A connection to one server; usable from several threads.

    Parameters
    ----------
    token
        ``name:password``, sent by the scheme for which the server asks (basic or digest), or a
        bearer token.
    timeout_s
        Time limit for one answer.

    Attributes
    ----------
    requests
        Number of requests sent so far.
    """

    def __init__(self, token: str | None, timeout_s: float) -> None:
        limits = httpx.Timeout(timeout_s, connect=min(timeout_s, _CONNECT_S))
        name, colon, password = (token or "").partition(":")
        self._login = (name, password) if colon else None
        headers = {} if colon else authorization(token)
        self._http: httpx.Client | None = httpx.Client(
            headers=headers, timeout=limits, auth=self._login
        )
        self.timeout_s = timeout_s
        self.requests = 0

    def send(
        self,
        url: str,
        fields: Sequence[tuple[str, str]] | None,
        accept: str = "*/*",
        *,
        repeat: bool,
        timeout_s: float | None = None,
        headers: Mapping[str, str] | None = None,
        judged: bool = True,
    ) -> httpx.Response:
        """Send a form and return the answer.

        Parameters
        ----------
        fields
            ``query`` or ``update`` with the text, and the parameters of the dataset; ``None`` asks
            by GET for what is at the address.
        repeat
            Whether the request may safely be sent twice.
        timeout_s
            Time limit for all attempts together; ``None`` applies the connection's limit to each
            attempt.
        headers
            Further fields of the header.
        judged
            Raise what the server refused; otherwise return the refusal like any answer.

        Raises
        ------
        RemoteUnavailableError
            No answer after three attempts.
        QueryTimeout
            The time is up.
        RemoteError, AccessError, DataError
            The server refused the request; the message is the server's.
        """
        form: dict[str, list[str]] = {}
        for name, value in fields or ():
            form.setdefault(name, []).append(value)
        method = "GET" if fields is None else "POST"
        sent = {**(headers or {}), "Accept": accept}
        until = None if timeout_s is None else time.monotonic() + timeout_s
        where = without_password(url)
        for attempt in range(_ATTEMPTS):
            last = attempt + 1 == _ATTEMPTS
            wait: Any = httpx.USE_CLIENT_DEFAULT
            if until is not None:
                wait = max(0.001, until - time.monotonic())
            try:
                answer = self._request(method, url, form, sent, wait)
            except httpx.HTTPError as error:
                if until is not None and time.monotonic() >= until:
                    raise QueryTimeout(
                        f"{where}: no complete answer within {timeout_s:g} s", timeout_s=timeout_s
                    ) from error
                # An update may have been carried out although its answer was lost; one that never
                # left was not.
                never_sent = isinstance(error, httpx.ConnectError | httpx.ConnectTimeout)
                if last or not (repeat or never_sent):
                    reason = str(error) or type(error).__name__
                    raise RemoteUnavailableError(f"{where}: {reason}") from error
            else:
                # 502 and 504 come from a proxy, behind which an update may have run.
                again = answer.status_code in (_UNAVAILABLE if repeat else _DID_NOT_RUN)
                if last or not (again or _was_rolled_back(answer)):
                    return checked(answer, where) if judged else answer
            time.sleep(_PAUSE_S * 2**attempt)
        raise AssertionError("the last attempt returns or raises")

    def _request(
        self,
        method: str,
        url: str,
        form: dict[str, list[str]],
        headers: dict[str, str],
        timeout: Any,
    ) -> httpx.Response:
        http = self._http
        if http is None:
            raise ClosedError("the connection is closed")
        self.requests += 1
        answer = http.request(method, url, data=form, headers=headers, timeout=timeout)
        # Virtuoso asks for digest, where other servers take a basic login at once.
        wants_digest = answer.headers.get("WWW-Authenticate", "").lower().startswith("digest")
        login = self._login or _login_of(url)
        if answer.status_code == 401 and wants_digest and login:
            http.auth = httpx.DigestAuth(*login)
            self.requests += 1
            return http.request(
                method, without_password(url), data=form, headers=headers, timeout=timeout
            )
        return answer

    def close(self) -> None:
        """Close the connection."""
        if self._http is not None:
            self._http.close()
            self._http = None


def without_password(url: str) -> str:
    """Return an address without the name and password in it.

    >>> without_password("http://dba:secret@host:8890/sparql-auth")
    'http://host:8890/sparql-auth'
    """
    parts = urlsplit(url)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def _login_of(url: str) -> tuple[str, str] | None:
    parts = urlsplit(url)
    if parts.username is None:
        return None
    return unquote(parts.username), unquote(parts.password or "")


def read_whole(kind: str, data: bytes) -> Solutions | bool | Triples:
    """Parse an answer as :func:`rtask.sparql.results.read_answer` does.

    Raises
    ------
    RemoteUnavailableError
        If the answer is incomplete.
    """
    try:
        return read_answer(kind, data)
    except SyntaxError as error:
        raise RemoteUnavailableError(f"the answer broke off: {error}") from error


def _was_rolled_back(answer: httpx.Response) -> bool:
    """Tell whether a server gave a request up for another one (Virtuoso tells it as a fault)."""
    return answer.status_code == 500 and _ROLLED_BACK in answer.text[:200]


def checked(answer: httpx.Response, url: str) -> httpx.Response:
    """Return an answer that is whole and no refusal.

    Raises
    ------
    RemoteError, AccessError, DataError
        What the server says, after the address.
    """
    if answer.is_success:
        limit = answer.headers.get("X-SPARQL-MaxRows")
        # Virtuoso cuts answers silently but for this header: a part would be taken for all there
        # is.
        if limit is not None:
            raise CallFailedError(
                f"{url} cut its answer after {limit} rows; raise ResultSetMaxRows in its settings",
                status=answer.status_code,
            )
        return answer
    reason = _reason(answer)
    message = f"{url}: {answer.status_code} {reason}"
    refusal = _REFUSALS.get(_problem_of(answer))
    if refusal is not None:
        raise refusal(message)
    if answer.status_code == 401:
        raise AuthenticationError(message)
    if answer.status_code == 403:
        raise ForbiddenError(message)
    if answer.status_code == 400:
        raise QuerySyntaxError(message)
    if answer.status_code in (502, 503, 504):
        raise RemoteUnavailableError(message)
    raise CallFailedError(message, status=answer.status_code)


def _problem_of(answer: httpx.Response) -> str:
    """Return the kind of error that a server of RTASK names (RFC 9457); empty for others."""
    if answer.headers.get("Content-Type", "").partition(";")[0] != "application/problem+json":
        return ""
    try:
        return str(answer.json()["type"]).removeprefix("/errors/")
    except (ValueError, KeyError, TypeError):
        return ""


def _reason(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["detail"])
    except (ValueError, KeyError, TypeError):
        return answer.text.strip()[:200] or answer.reason_phrase
