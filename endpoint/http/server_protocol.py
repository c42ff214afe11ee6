"""HTTP protocol of the server: refuses malformed and oversized requests before the application.

uvicorn waits forever for the end of a header, accepts headers of any size and any number of Host
fields, and leaves it to the parser how long a message with two lengths is (request smuggling,
RFC 9112, 11.2).
"""

from __future__ import annotations

import asyncio
import re
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from endpoint.http.cork import CORK, Cork

HEADER_S = 30.0
MAX_HEADER_BYTES = 64 << 10
MAX_URL_BYTES = 32 << 10
# RFC 3986, 3.2.2 and 3.2.3: a name, an IPv4 address or a bracketed IPv6 address, and a port.
_HOST = re.compile(rb"(?:\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._~!$&'()*+,;=%-]*)(?::[0-9]*)?")


class GuardedProtocol(HttpToolsProtocol):
    """uvicorn's protocol, with bounds on the time and size of a header and a check of Host."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._header_timer: asyncio.TimerHandle | None = None
        self._header_since: float | None = None
        self._header_bytes = 0
        self._refusal = HTTPStatus.BAD_REQUEST

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start the time of the first header."""
        super().connection_made(transport)  # type: ignore[arg-type]
        self._header_since = self.loop.time()
        self._header_timer = self.loop.call_later(HEADER_S, self._check_header)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timer."""
        if self._header_timer is not None:
            self._header_timer.cancel()
            self._header_timer = None
        super().connection_lost(exc)

    def on_message_begin(self) -> None:
        """Start the time of the next header."""
        super().on_message_begin()
        self._header_bytes = 0
        if self._header_since is None:
            self._header_since = self.loop.time()

    def on_url(self, url: bytes) -> None:
        """Count the bytes of the address."""
        super().on_url(url)
        if len(self.url) > MAX_URL_BYTES:
            self._refuse(HTTPStatus.REQUEST_URI_TOO_LONG)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Count the bytes of the header."""
        super().on_header(name, value)
        self._header_bytes += len(name) + len(value) + 4
        if self._header_bytes > MAX_HEADER_BYTES:
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)

    def on_headers_complete(self) -> None:
        """Refuse a message with two lengths, or without exactly one valid Host; then go on."""
        self._header_since = None
        hosts = lengths = encodings = 0
        for name, value in self.headers:
            if name == b"host":
                hosts += 1
                if not _HOST.fullmatch(value):
                    self._refuse(HTTPStatus.BAD_REQUEST)
            elif name == b"content-length":
                lengths += 1
            elif name == b"transfer-encoding":
                encodings += 1
        if lengths > 1 or (lengths and encodings):
            self._refuse(HTTPStatus.BAD_REQUEST)
        # RFC 9112, 3.2: only before HTTP/1.1 may a request come without one.
        if hosts > 1 or (not hosts and self.parser.get_http_version() != "1.0"):
            self._refuse(HTTPStatus.BAD_REQUEST)
        self.begin_request()

    def begin_request(self) -> None:
        """Start answering a request whose header is complete and correct."""
        super().on_headers_complete()
        if self.cycle is not None and self.cycle.scope is self.scope:
            # The task that answers has been created, and begins later.
            self.cork(self.cycle)

    def cork(self, cycle: RequestResponseCycle) -> None:
        """Let the application of a cycle send head and body in one piece."""
        cork = Cork(self.transport)
        cycle.transport = cork  # type: ignore[assignment]
        cycle.scope["extensions"] = {CORK: cork}  # type: ignore[dict-item]

    def send_400_response(self, msg: str) -> None:
        """Answer a request that cannot be parsed, and close the connection."""
        if self.transport.is_closing():
            return
        status = self._refusal
        body = f"{status.phrase}\n".encode()
        self.transport.write(
            f"HTTP/1.1 {status.value} {status.phrase}\r\nconnection: close\r\n"
            "content-type: text/plain; charset=utf-8\r\n"
            f"content-length: {len(body)}\r\n\r\n".encode()
            + body
        )
        self.transport.close()

    def _refuse(self, status: HTTPStatus) -> None:
        self._refusal = status
        raise ValueError(status.phrase)  # the parser stops, and uvicorn sends a 400

    def _check_header(self) -> None:
        """Close the connection if a header takes too long, or look again when it might.

        One timer for a connection: to start and stop one for each header takes longer than to read
        the header.
        """
        since, now = self._header_since, self.loop.time()
        if since is not None and now - since >= HEADER_S:
            self._header_timer = None
            if not self.transport.is_closing():
                self.transport.close()
            return
        at = (now if since is None else since) + HEADER_S
        self._header_timer = self.loop.call_at(at, self._check_header)
