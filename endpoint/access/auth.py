"""Identifies callers and checks what they may do: tokens, scopes, Host and Origin.

Checking Host stops DNS rebinding: a hostile page whose name suddenly resolves to 127.0.0.1 still
sends its own name. Checking Origin keeps other sites that the operator visits from driving the
robots: browsers send it with each websocket and each request that changes something.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from urllib.parse import urlsplit

from endpoint.access.sessions import (
    TICKET_LIFETIME_S,
    TICKET_PREFIX,
    Sessions,
    SignedIn,
    Tickets,
    session_name,
)
from endpoint.access.tokens import Token, TokenStore
from endpoint.http.messages import Request, json_response
from endpoint.http.plan import Plan
from endpoint.settings import Config, is_loopback
from rtask.errors import AuthenticationError, ForbiddenError
from rtask.kb.commit.access import Access


@dataclass(frozen=True)
class Caller:
    """The sender of a request.

    Parameters
    ----------
    access
        Rights in the knowledge base.
    token
        The token presented; none for callers without one.
    session
        The session, if a cookie stood in for the token. Browsers send cookies unasked, so such a
        caller must prove with each change that one of our own pages made it.
    address
        Network address of the sender.
    """

    access: Access
    token: Token | None = None
    session: SignedIn | None = None
    address: str = ""

    @property
    def key(self) -> str:
        """Key under which requests are counted."""
        return self.token.id if self.token else self.address

    def note(self, request: Request) -> str:
        """Return the note about the request that the provenance of a change keeps."""
        token = f", token {self.token.id}" if self.token else ""
        return f"request {request.id}{token}"

    @property
    def name(self) -> str:
        """Name for logs and statistics."""
        return self.access.agent or self.access.role


class Authenticator:
    """Identifies callers.

    Parameters
    ----------
    tokens
        Tokens of the data folder.
    config
        Where the server is bound, and which hosts and origins it accepts.
    clock
        Returns seconds, for sessions and tickets.
    """

    def __init__(
        self, tokens: TokenStore, config: Config, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._tokens = tokens
        self._config = config
        self.sessions = Sessions(clock)
        self.tickets = Tickets(clock)

    def identify(
        self, request: Request, *, ticket_in_url: bool = False, limited: bool = False
    ) -> Caller:
        """Return the caller of a request.

        Callers without a token: on loopback they are ``anonymous`` and may write until the first
        token is issued, and may read afterwards, until one that is limited to some graphs is;
        elsewhere every request requires a token.

        Parameters
        ----------
        request
            The request as received.
        ticket_in_url
            Whether ``?token=`` may carry a ticket, for browsers cannot set headers on a websocket.
            A token there is refused: addresses end up in histories and proxy logs.
        limited
            Whether to admit callers that may read some graphs only. Whoever says so answers them
            from these graphs or refuses them; all other parts of the server are closed to them.

        Raises
        ------
        AuthenticationError
            A required token is missing or invalid.
        ForbiddenError
            The Host is not a name of this server, or the caller may read some graphs only.
        """
        caller = self._identify(request, ticket_in_url)
        if caller.access.reads is not None and not limited:
            raise limited_refusal(request.raw_path)
        return caller

    def _identify(self, request: Request, ticket_in_url: bool) -> Caller:
        self.check_host(request)
        text = self._token_text(request, ticket_in_url)
        if text is not None:
            is_ticket = ticket_in_url and text.startswith(TICKET_PREFIX)
            token = self._of_ticket(text) if is_ticket else self._tokens.authenticate(text)
            return Caller(token.access, token, address=request.client)
        signed_in = self._signed_in(request)
        if signed_in is not None:
            return signed_in
        if not self._config.on_loopback or self._tokens.ever_limited():
            raise AuthenticationError("a token is needed; send Authorization: Bearer <token>")
        if self._config.plain or not self._tokens.ever_issued():
            return Caller(_ANONYMOUS, address=request.client)
        return Caller(_READER, address=request.client)

    def _of_ticket(self, ticket: str) -> Token:
        """Use up a ticket and return its token."""
        token_id = self.tickets.redeem(ticket)
        token = self._tokens.get(token_id) if token_id else None
        if token is None:
            raise AuthenticationError(
                "the ticket has been used or has expired; request another", token_sent=True
            )
        return token

    def _signed_in(self, request: Request) -> Caller | None:
        """Return the caller whose session cookie stands for a valid token."""
        cookie = request.headers.get("cookie")
        session = self.sessions.find(session_name(cookie)) if cookie else None
        if session is None:
            return None
        token = self._tokens.get(session.token_id)
        if token is None:
            return None
        return Caller(token.access, token, session, request.client)

    def still_valid(self, caller: Caller) -> bool:
        """Tell whether the token behind a long-lived connection is still valid."""
        if caller.token is None:
            return not self._tokens.ever_limited()
        return self._tokens.is_valid(caller.token.id)

    def check_host(self, request: Request) -> None:
        """Refuse a Host that is not a name of this server, if the server is bound to loopback."""
        if not self._config.on_loopback:
            return
        # A page may have its own name resolve to 127.0.0.1 (DNS rebinding): the browser then takes
        # it for a page of ours, and only the Host still tells the name.
        name = _host_name(request.header("host", "localhost"))
        if is_loopback(name) or name in self._config.allowed_hosts:
            return
        raise ForbiddenError(f"Host {name!r} is not a name of this server")

    def check_origin(self, request: Request, caller: Caller | None = None) -> None:
        """Refuse a change or a websocket that a page of another origin requests.

        A bearer token passes, for no page can send one that it does not know. A cookie does not:
        browsers send it on behalf of any page.

        Raises
        ------
        ForbiddenError
            The Origin is neither absent nor our own nor an allowed one.
        """
        origin = request.headers.get("origin")
        by_cookie = caller is not None and caller.session is not None
        if caller and caller.token and not by_cookie:
            return
        if origin is None:
            if by_cookie:
                raise ForbiddenError("a change by cookie needs an Origin; send a bearer token")
            return
        allowed = (*self._config.allowed_origins, *self._config.cors)
        if origin in allowed or _authority(origin) == request.header("host").lower():
            return
        raise ForbiddenError(f"Origin {origin!r} may not change anything here")

    def require_write(self, request: Request, caller: Caller) -> None:
        """Refuse callers that may not write at all; the knowledge base decides graph by graph.

        Raises
        ------
        AuthenticationError
            No token was sent, and one might help.
        ForbiddenError
            The token does not permit writing, or the Origin is foreign.
        """
        self.check_origin(request, caller)
        if caller.access.role != "reader":
            return
        if caller.token is None:
            raise AuthenticationError("writing needs a token; send Authorization: Bearer <token>")
        raise ForbiddenError("needs scope write; this token may only read")

    @staticmethod
    def _token_text(request: Request, ticket_in_url: bool) -> str | None:
        header = request.headers.get("authorization")
        if header is not None:
            scheme, _, text = header.partition(" ")
            if scheme.lower() != "bearer" or not text.strip():
                raise AuthenticationError("send Authorization: Bearer <token>", token_sent=True)
            return text.strip()
        if ticket_in_url and (values := request.values("token")):
            if not values[-1].startswith(TICKET_PREFIX):
                raise AuthenticationError(
                    "a token does not belong in an address; send Authorization: Bearer <token>, or "
                    "?token=<ticket> with a ticket from POST /tokens/ticket",
                    token_sent=True,
                )
            return values[-1]
        return None


def limited_refusal(address: str) -> ForbiddenError:
    """Return the error for a caller that may read some graphs only, at an address that reads all.

    Parameters
    ----------
    address
        Path of the request.
    """
    return ForbiddenError(
        f"this token is limited to some graphs, and {address[:200]} reads all of them; "
        "query /sparql or /query, or read /store?graph=<iri>"
    )


def plan_ticket(auth: Authenticator, caller: Caller) -> Plan:
    """Plan the answer to ``POST /tokens/ticket``: a ticket in exchange for a token or session.

    Parameters
    ----------
    caller
        One with a token.
    """
    assert caller.token is not None
    body = {"ticket": auth.tickets.issue(caller.token.id), "expires_in": int(TICKET_LIFETIME_S)}
    headers = (("Cache-Control", "no-store"),)
    return Plan.ready(json_response(body, 201, headers))


def cors_headers(request: Request, config: Config) -> tuple[tuple[str, str], ...]:
    """Return the header fields that let a page of another origin read an answer."""
    origin = request.headers.get("origin")
    if origin is None or not config.cors:
        return ()
    if "*" in config.cors:
        allowed = "*"
    elif origin in config.cors:
        allowed = origin
    else:
        return ()
    # Without Access-Control-Allow-Credentials: no cookie lets a page of another origin read.
    exposed = "ETag, Location, Retry-After, RTASK-Remark, RTASK-Request-Id, RTASK-Version"
    return (
        ("Access-Control-Allow-Origin", allowed),
        ("Access-Control-Expose-Headers", exposed),
    )


def preflight_headers(request: Request, config: Config) -> tuple[tuple[str, str], ...]:
    """Return the further fields for a preflight request; empty if the origin is not allowed."""
    if not cors_headers(request, config):
        return ()
    return (
        ("Access-Control-Allow-Methods", "GET, HEAD, POST, PUT, DELETE"),
        (
            "Access-Control-Allow-Headers",
            "authorization, content-type, accept, if-match, if-none-match, rtask-request-id",
        ),
        ("Access-Control-Max-Age", "600"),
    )


@lru_cache(maxsize=256)
def _host_name(host: str) -> str:
    """Return a Host header without its port; empty if it is malformed."""
    try:
        return urlsplit("//" + host).hostname or ""
    except ValueError:
        return ""


def _authority(origin: str) -> str:
    """Return the host and port of an Origin in lower case; empty for ``null`` and the like."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


_ANONYMOUS = Access(None, "anonymous")
_READER = Access(None, "reader")
SCOPES = {
    "reader": frozenset(("read",)),
    "robot": frozenset(("read", "call", "write")),
    "teacher": frozenset(("read", "call", "write", "teach", "dataset")),
    "anonymous": frozenset(("read", "call", "write", "teach", "dataset", "deploy")),
    "admin": frozenset(("read", "call", "write", "teach", "dataset", "deploy", "admin")),
}


def require_scope(access: Access, scope: str) -> None:
    """Refuse a caller whose role does not include a scope.

    Raises
    ------
    ForbiddenError
        Naming the scope.

    Examples
    --------
    >>> require_scope(Access(None, "reader"), "write")
    Traceback (most recent call last):
    rtask.errors.ForbiddenError: needs scope write; a reader has read
    """
    held = SCOPES[access.role]
    if scope not in held:
        raise ForbiddenError(f"needs scope {scope}; a {access.role} has {', '.join(sorted(held))}")
