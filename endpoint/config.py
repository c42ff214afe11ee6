"""What a server is told at its start."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, field
from functools import lru_cache

from endpoint.protocol.limits import Limits

MEGABYTE = 1 << 20


@dataclass(frozen=True)
class Config:
    """Settings of one server.

    Parameters
    ----------
    host
        Address that the server is bound to.
    public_url
        Scheme and authority that clients use; empty means: as each request says.
    plain
        A bare SPARQL 1.1 dataset without inference, provenance or rights.
    cors
        Origins whose pages may read (and, when named, write); ``*`` is for reads only.
    allowed_hosts, allowed_origins
        Accepted besides the server's own.
    timeout_s
        Time for a query when the client names none.
    max_timeout_s
        What a client may ask for at most.
    max_upload_bytes
        Largest request body, after unpacking too.
    max_message_bytes
        Largest websocket message.
    limits
        What one SPARQL text may hold.
    """

    host: str = "127.0.0.1"
    public_url: str = ""
    plain: bool = False
    cors: tuple[str, ...] = ()
    allowed_hosts: tuple[str, ...] = ()
    allowed_origins: tuple[str, ...] = ()
    timeout_s: float = 30.0
    max_timeout_s: float = 600.0
    max_upload_bytes: int = 256 * MEGABYTE
    max_message_bytes: int = 64 * MEGABYTE
    limits: Limits = field(default_factory=Limits)

    @property
    def on_loopback(self) -> bool:
        """Whether only this machine reaches the server."""
        return is_loopback(self.host)

    def site(self, scheme: str, host: str) -> str:
        """Return scheme and authority under which a request came in."""
        return self.public_url.rstrip("/") or f"{scheme}://{host}"

    def effective_timeout(self, wanted: float | None) -> float:
        """Return the seconds a query gets."""
        return min(wanted or self.timeout_s, self.max_timeout_s)


@lru_cache(maxsize=256)
def is_loopback(host: str) -> bool:
    """Tell whether a host name or address means this machine only.

    Examples
    --------
    >>> [is_loopback(h) for h in ("localhost", "127.0.0.1", "::1", "0.0.0.0", "robots.lab")]
    [True, True, True, False, False]
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
