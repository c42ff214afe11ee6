"""Requests from this server to others, for SERVICE and LOAD, to addresses that an operator allowed.

Anybody who may query could otherwise make the server call addresses that only it can reach
(server-side request forgery, CWE-918). So an address must begin with an allowed one; its name is
resolved once, the result is checked, and the connection goes to that very address; redirects are
not followed; time and size are bounded.
"""

from __future__ import annotations

import http.client
import ipaddress
import socket
import ssl
import time
from dataclasses import dataclass
from urllib.parse import SplitResult, urlsplit

from rtask.errors import ForbiddenError, RemoteUnavailableError, TooLargeError

MAX_BYTES = 64 << 20
CONNECT_S = 10.0
_PIECE = 1 << 16
_CLIMBING = ("\\", "/../", "/./", "%2e", "%2f", "%5c")
_PORTS = {"http": 80, "https": 443}


@dataclass(frozen=True)
class Fetched:
    """The answer of another server."""

    media_type: str
    body: bytes


@dataclass(frozen=True)
class Outgoing:
    """Client for the addresses that one operation may call.

    Parameters
    ----------
    operation
        ``SERVICE`` or ``LOAD``, named in errors.
    allowed
        Allowed prefixes of addresses.
    """

    operation: str
    allowed: tuple[str, ...]

    def check(self, url: str) -> str:
        """Return the prefix that allows an address.

        Examples
        --------
        >>> Outgoing("LOAD", ("https://w3.org/ns",)).check("https://w3.org/ns/prov.ttl")
        'https://w3.org/ns'

        Raises
        ------
        ForbiddenError
            None does: another scheme, host, port or path, or a name with a password.
        """
        parts = _split(url)
        if parts is not None and parts.scheme in _PORTS and "@" not in parts.netloc:
            plain = url.isprintable() and not any(mark in url.lower() for mark in _CLIMBING)
            for entry in self.allowed:
                stem = entry.rstrip("/")
                # A stem alone would also allow its longer brothers: /data2 for /data.
                extends = url in (entry, stem) or url.startswith((stem + "/", stem + "?"))
                if plain and extends and not parts.path.endswith(("/..", "/.")):
                    return entry
        raise ForbiddenError(
            f"{self.operation} may not call {url[:200]}; an operator allows addresses with "
            f"--allow-{self.operation.lower()}",
            operation=self.operation,
        )

    def fetch(
        self,
        url: str,
        deadline: float,
        *,
        accept: str,
        body: bytes | None = None,
        content_type: str = "",
    ) -> Fetched:
        """Call an allowed address.

        Parameters
        ----------
        deadline
            Time on the monotonic clock.
        accept, body, content_type
            Of the request; with a body it is a POST.

        Raises
        ------
        ForbiddenError
            It is not allowed, or its name resolves to this machine or its network.
        RemoteUnavailableError
            There is no answer, or the answer is an error.
        TooLargeError
            The answer exceeds 64 MiB.
        """
        entry = self.check(url)
        parts = urlsplit(url)
        address = self._resolve(parts, entry)
        headers = {"Accept": accept, "Host": parts.netloc, "Accept-Encoding": "identity"}
        if body is not None:
            headers["Content-Type"] = content_type
        path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        left = max(0.001, min(CONNECT_S, deadline - time.monotonic()))
        connection = _Pinned(parts, address, left)
        try:
            connection.request("GET" if body is None else "POST", path, body, headers)
            return self._read(connection, url, deadline)
        except (OSError, http.client.HTTPException) as error:
            raise RemoteUnavailableError(
                f"{self.operation}: {url[:200]} gave no answer: {error or type(error).__name__}",
                address=url,
            ) from None
        finally:
            connection.close()

    def _read(self, connection: _Pinned, url: str, deadline: float) -> Fetched:
        answer = connection.getresponse()
        if answer.status != 200:
            raise RemoteUnavailableError(
                f"{self.operation}: {url[:200]} answered {answer.status} {answer.reason}",
                address=url,
            )
        pieces, size = [], 0
        # In small pieces, so that a slow sender cannot outlast the deadline.
        while piece := answer.read1(_PIECE):
            size += len(piece)
            if size > MAX_BYTES:
                raise TooLargeError(f"{self.operation}: {url[:200]} sends above {MAX_BYTES} bytes")
            if time.monotonic() > deadline:
                raise TimeoutError("the time is over")
            pieces.append(piece)
        media_type = answer.headers.get_content_type() if "content-type" in answer.headers else ""
        return Fetched(media_type, b"".join(pieces))

    def _resolve(self, parts: SplitResult, entry: str) -> str:
        """Resolve a name; an address in this machine's network must be allowed literally."""
        host = parts.hostname or ""
        port = parts.port or _PORTS[parts.scheme]
        try:
            resolved = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        except OSError as error:
            raise RemoteUnavailableError(
                f"{self.operation}: {host} is not known: {error.strerror}", address=host
            ) from None
        addresses = [str(info[4][0]) for info in resolved]
        named = _is_literal(urlsplit(entry).hostname or "")
        # All of them: a name may mean a public address and one of this network at once.
        for address in addresses:
            if not named and not ipaddress.ip_address(address.partition("%")[0]).is_global:
                raise ForbiddenError(
                    f"{self.operation}: {host} means {address}, an address of this network; "
                    "allow it by its number",
                    operation=self.operation,
                )
        # The address that was checked, since a second look-up may give another.
        return addresses[0]


class _Pinned(http.client.HTTPConnection):
    """Connection to an address that was checked, whatever its name resolves to by now."""

    def __init__(self, parts: SplitResult, address: str, timeout_s: float) -> None:
        port = parts.port or _PORTS[parts.scheme]
        super().__init__(parts.hostname or "", port, timeout=timeout_s)
        self._address = address
        self._tls = ssl.create_default_context() if parts.scheme == "https" else None

    def connect(self) -> None:
        """Connect, using TLS for the name if the scheme is https."""
        self.sock = socket.create_connection((self._address, self.port), self.timeout)
        if self._tls is not None:
            self.sock = self._tls.wrap_socket(self.sock, server_hostname=self.host)


def _split(url: str) -> SplitResult | None:
    try:
        parts = urlsplit(url)
        _ = parts.port
    except ValueError:
        return None
    return parts if parts.hostname else None


def _is_literal(host: str) -> bool:
    """Tell whether an operator allowed a literal address rather than a name."""
    if host == "localhost":
        return True
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True
