"""People who signed in with a token: a cookie stands for it until they leave.

The cookie holds a random name and nothing else; the token it stands for is looked up again with
each request, so a revocation ends the session too. Each session has a second secret that forms
carry, for a page of another origin can send a form but cannot read this one (OWASP, "Cross-Site
Request Forgery Prevention").
"""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie

COOKIE = "rtask_session"
LIFETIME_S = 12 * 3600.0
_MAX_SESSIONS = 1_000


@dataclass(frozen=True)
class SignedIn:
    """One person's session.

    Parameters
    ----------
    token_id
        Token that the person showed.
    form_secret
        What forms carry.
    until
        End, in seconds of the monotonic clock.
    """

    token_id: str
    form_secret: str
    until: float

    def accepts_form(self, secret: str) -> bool:
        """Tell whether a form was made for this session."""
        return hmac.compare_digest(self.form_secret.encode(), secret.encode())


class Sessions:
    """All sessions of a server; they end with it.

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

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[str, SignedIn] = {}

    def begin(self, token_id: str) -> str:
        """Start a session and return its name, for the cookie."""
        name = secrets.token_urlsafe(32)
        entry = SignedIn(token_id, secrets.token_urlsafe(24), time.monotonic() + LIFETIME_S)
        with self._lock:
            if len(self._open) >= _MAX_SESSIONS:
                del self._open[min(self._open, key=lambda key: self._open[key].until)]
            self._open[name] = entry
        return name

    def find(self, name: str) -> SignedIn | None:
        """Return a session that goes on."""
        with self._lock:
            entry = self._open.get(name)
            if entry is not None and entry.until <= time.monotonic():
                del self._open[name]
                return None
            return entry

    def end(self, name: str) -> None:
        """End a session."""
        with self._lock:
            self._open.pop(name, None)


def session_name(cookie_header: str) -> str:
    """Return the session that a Cookie header names; empty where it names none.

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
    """Return the Set-Cookie field of a session; without a name, the one that deletes it."""
    age = int(LIFETIME_S) if name else 0
    rest = "; Secure" if secure else ""
    return f"{COOKIE}={name}; Path=/; Max-Age={age}; HttpOnly; SameSite=Strict{rest}"
