"""One-time values for browsers' websockets, which can send a token in their address only.

Addresses end up in histories and in the logs of proxies; a ticket that was used, or is older than
half a minute, is worth nothing there. It stands for the token that it was asked with: what that one
may, and as long as that one is good.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable

PREFIX = "rtt_"
LIFETIME_S = 30.0
_MOST = 10_000


class Tickets:
    """Tickets that nobody used yet.

    Parameters
    ----------
    clock
        Seconds that only grow.

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
        ticket, now = f"{PREFIX}{secrets.token_hex(16)}", self._clock()
        with self._lock:
            # The oldest come first.
            for old, (_, until) in list(self._open.items()):
                if until > now and len(self._open) < _MOST:
                    break
                del self._open[old]
            self._open[ticket] = (token_id, now + LIFETIME_S)
        return ticket

    def redeem(self, ticket: str) -> str | None:
        """Return the token of a ticket, which is used up now; none where it is not good."""
        with self._lock:
            token_id, until = self._open.pop(ticket, ("", 0.0))
        return token_id if token_id and until > self._clock() else None
