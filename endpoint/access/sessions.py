"""Sessions of people who signed in with a token, and one-time tickets for websockets.

A session's cookie holds a random name and nothing else. The token behind it is looked up again for
each request, so revoking the token ends the session too. Each session has a second secret, which
its forms carry: a page of another origin can send a form but cannot read ours (OWASP, "Cross-Site
Request Forgery Prevention").
"""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie

COOKIE = "rtask_session"
LIFETIME_S = 12 * 3600.0
_MAX_SESSIONS = 1_000
TICKET_PREFIX = "rtt_"
TICKET_LIFETIME_S = 30.0
_MAX_TICKETS = 10_000


@dataclass(frozen=True)
class SignedIn:
    """The session of one person.

    Parameters
    ----------
    token_id
        The token with which the person signed in.
    form_secret
        The secret that the session's forms carry.
    until
        When it ends, in seconds of the clock of :class:`Sessions`.
    """

    token_id: str
    form_secret: str
    until: float

    def accepts_form(self, secret: str) -> bool:
        """Tell whether a form was made for this session."""
        return hmac.compare_digest(self.form_secret.encode(), secret.encode())


class Sessions:
    """All sessions of a server; they end when it stops.

    Parameters
    ----------
    clock
        Returns seconds; tests pass their own.

    Examples
    --------
    >>> sessions = Sessions()
    >>> name = sessions.begin("0123456789ab")
    >>> sessions.find(name).token_id
    '0123456789ab'
    >>> sessions.end(name)
    >>> sessions.find(name) is None
    True
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._open: dict[str, SignedIn] = {}

    def begin(self, token_id: str) -> str:
        """Start a session and return its name, for the cookie."""
        name = secrets.token_urlsafe(32)
        entry = SignedIn(token_id, secrets.token_urlsafe(24), self._clock() + LIFETIME_S)
        with self._lock:
            if len(self._open) >= _MAX_SESSIONS:
                del self._open[min(self._open, key=lambda key: self._open[key].until)]
            self._open[name] = entry
        return name

    def find(self, name: str) -> SignedIn | None:
        """Return the session of a name; none if there is none, or it has expired."""
        with self._lock:
            entry = self._open.get(name)
            if entry is not None and entry.until <= self._clock():
                del self._open[name]
                return None
            return entry

    def end(self, name: str) -> None:
        """End a session."""
        with self._lock:
            self._open.pop(name, None)


class Tickets:
    """One-time tickets that stand for a token when a browser opens a websocket.

    A browser can send credentials for a websocket in its address only, and addresses end up in
    histories and proxy logs. A ticket that was used, or is older than half a minute, is worth
    nothing there.

    Parameters
    ----------
    clock
        Returns seconds; tests pass their own.

    Examples
    --------
    >>> tickets = Tickets()
    >>> ticket = tickets.issue("0123456789ab")
    >>> tickets.redeem(ticket), tickets.redeem(ticket)
    ('0123456789ab', None)
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._open: dict[str, tuple[str, float]] = {}

    def issue(self, token_id: str) -> str:
        """Return a new ticket for a token."""
        ticket, now = f"{TICKET_PREFIX}{secrets.token_hex(16)}", self._clock()
        with self._lock:
            # The oldest come first.
            for old, (_, until) in list(self._open.items()):
                if until > now and len(self._open) < _MAX_TICKETS:
                    break
                del self._open[old]
            self._open[ticket] = (token_id, now + TICKET_LIFETIME_S)
        return ticket

    def redeem(self, ticket: str) -> str | None:
        """Use up a ticket and return its token; none if the ticket is unknown or too old."""
        with self._lock:
            token_id, until = self._open.pop(ticket, ("", 0.0))
        return token_id if token_id and until > self._clock() else None


def session_name(cookie_header: str) -> str:
    """Return the session name in a Cookie header; empty if there is none.

    Examples
    --------
    >>> session_name("a=b; rtask_session=xyz")
    'xyz'
    """
    if COOKIE not in cookie_header:
        return ""
    try:
        morsel = SimpleCookie(cookie_header).get(COOKIE)
    except CookieError:
        return ""
    return morsel.value if morsel else ""


def set_cookie(name: str, *, secure: bool) -> str:
    """Return the Set-Cookie field of a session or, for an empty name, the one that deletes it."""
    age = int(LIFETIME_S) if name else 0
    rest = "; Secure" if secure else ""
    return f"{COOKIE}={name}; Path=/; Max-Age={age}; HttpOnly; SameSite=Strict{rest}"
