"""What a server is told at its start."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from endpoint.sparql.limits import Limits

MEGABYTE = 1 << 20
# What a caller of a role may ask for at most; the others: the server's limit.
ROLE_TIMEOUT_S = {"reader": 30.0, "robot": 30.0, "teacher": 60.0}


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
    write_timeout_s
        For the WHERE parts of an update; an admin has what a client may ask for.
    max_upload_bytes
        Largest request body, after unpacking too.
    max_message_bytes
        Largest websocket message.
    max_rows, max_result_bytes
        Where the answer of a query is broken off.
    max_queries
        Queries that run at once, of everybody together; as many again wait.
    rate, write_rate
        Requests and changes a second of one token, else of one address; twice as many at once.
        Zero: without limit. This machine, while nobody needs a token, is not limited.
    max_in_flight
        Requests of one token that are under way at once.
    allow_service, allow_load
        Address prefixes that ``SERVICE`` and ``LOAD`` may reach; nothing else is.
    tls_cert, tls_key
        PEM files; read again on SIGHUP.
    behind_proxy
        A proxy on this machine passes requests of others on; what it says about them is believed,
        and this machine has no privileges.
    drain_delay_s
        From "not ready" to the end of listening.
    backup_dir
        Where backups go; beside the data folder unless given.
    log_queries
        Write the text of every query to the log, not of slow ones only.
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
    write_timeout_s: float = 5.0
    max_upload_bytes: int = 256 * MEGABYTE
    max_message_bytes: int = 64 * MEGABYTE
    max_rows: int = 5_000_000
    max_result_bytes: int = 2048 * MEGABYTE
    max_queries: int = 32
    rate: float = 200.0
    write_rate: float = 100.0
    max_in_flight: int = 32
    allow_service: tuple[str, ...] = ()
    allow_load: tuple[str, ...] = ()
    tls_cert: Path | None = None
    tls_key: Path | None = None
    behind_proxy: bool = False
    drain_delay_s: float = 0.0
    backup_dir: Path | None = None
    log_queries: bool = False
    limits: Limits = field(default_factory=Limits)

    @property
    def on_loopback(self) -> bool:
        """Whether only this machine reaches the server."""
        return is_loopback(self.host) and not self.behind_proxy

    def site(self, scheme: str, host: str) -> str:
        """Return scheme and authority under which a request came in."""
        return self.public_url.rstrip("/") or f"{scheme}://{host}"

    def backups_of(self, folder: Path | None) -> Path:
        """Return the folder of the backups of a data folder."""
        if self.backup_dir is not None or folder is None:
            return self.backup_dir or Path("backups")
        return folder.resolve().with_name(f"{folder.resolve().name}-backups")

    def effective_timeout(self, wanted: float | None, role: str = "admin") -> float:
        """Return the seconds a query gets: what was asked for, up to what the role may have."""
        allowed = self.max_timeout_s
        if role in ROLE_TIMEOUT_S:
            allowed = min(allowed, max(self.timeout_s, ROLE_TIMEOUT_S[role]))
        return min(wanted or self.timeout_s, allowed)


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
