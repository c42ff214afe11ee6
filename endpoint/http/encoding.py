"""Encoding of a response's head (RFC 9112, 4 and 5)."""

from __future__ import annotations

import re
from collections.abc import Iterable

__all__ = ["SharedFields", "encode_fields"]

_UNSAFE = re.compile(r"[\x00-\x08\x0a-\x1f\x7f]")


def encode_fields(fields: Iterable[tuple[str, str]]) -> bytes:
    """Return header fields as they are sent.

    Raises
    ------
    RuntimeError
        A value holds a control character, by which it could end the header.

    Examples
    --------
    >>> encode_fields([("Content-Type", "text/csv")])
    b'content-type: text/csv\\r\\n'
    """
    listed = list(fields)
    if _UNSAFE.search("".join([value for _, value in listed])):
        raise RuntimeError("a header field holds a control character")
    head = "".join([f"{name.lower()}: {value}\r\n" for name, value in listed])
    return head.encode("latin-1", "replace")


class SharedFields:
    """Header fields that all responses of a server share, such as the date; encoded once a second.

    Examples
    --------
    >>> SharedFields().of([(b"date", b"Tue, 24 Nov 2026 06:00:00 GMT")])
    b'date: Tue, 24 Nov 2026 06:00:00 GMT\\r\\n'
    """

    def __init__(self) -> None:
        self._fields: list[tuple[bytes, bytes]] | None = None
        self._encoded = b""

    def of(self, fields: list[tuple[bytes, bytes]]) -> bytes:
        """Return a list of fields as it is sent; a list is not changed, but replaced."""
        if fields is not self._fields:
            self._encoded = b"".join([b"%b: %b\r\n" % field for field in fields])
            self._fields = fields
        return self._encoded
