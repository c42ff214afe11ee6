"""What the HTTP server is made to refuse before a request reaches the application.

uvicorn waits for ever for the end of a header, takes headers of any size, and leaves it to the
parser what a message with two lengths is (request smuggling, RFC 9112, 11.2).
"""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

HEADER_S = 30.0
MAX_HEADER_BYTES = 64 << 10
MAX_URL_BYTES = 32 << 10


class GuardedProtocol(HttpToolsProtocol):
    """uvicorn's protocol with a limit on the time and size of a header."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._header_timer: asyncio.TimerHandle | None = None
        self._header_bytes = 0
        self._refusal = HTTPStatus.BAD_REQUEST

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Wait for the first header."""
        super().connection_made(transport)  # type: ignore[arg-type]
        self._arm()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        self._disarm()
        super().connection_lost(exc)

    def on_message_begin(self) -> None:
        """Wait for the end of the next header."""
        super().on_message_begin()
        self._header_bytes = 0
        if self._header_timer is None:
            self._arm()

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
        """Refuse a message that says its length twice, then go on."""
        self._disarm()
        lengths = [v for n, v in self.headers if n == b"content-length"]
        if len(lengths) > 1 or (
            lengths and any(name == b"transfer-encoding" for name, _ in self.headers)
        ):
            self._refuse(HTTPStatus.BAD_REQUEST)
        super().on_headers_complete()

    def send_400_response(self, msg: str) -> None:
        """Answer what cannot be read; the connection ends."""
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

    def _arm(self) -> None:
        self._header_timer = self.loop.call_later(HEADER_S, self._give_up)

    def _disarm(self) -> None:
        if self._header_timer is not None:
            self._header_timer.cancel()
            self._header_timer = None

    def _give_up(self) -> None:
        self._header_timer = None
        if not self.transport.is_closing():
            self.transport.close()
