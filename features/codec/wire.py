"""Bytes as text, for JSON."""

from __future__ import annotations

import base64
import binascii
import re

from features.codec.limits import CloudFormatError

__all__ = ["from_wire", "to_wire"]

_SPACE = re.compile(r"\s+")
_STANDARD_ALPHABET = str.maketrans("-_", "+/")


def to_wire(data: bytes) -> str:
    """Return bytes as base64 text, standard alphabet, padded.

    Examples
    --------
    >>> to_wire(b"RTKC")
    'UlRLQw=='
    """
    return base64.b64encode(data).decode("ascii")


def from_wire(text: str | bytes) -> bytes:
    """Return the bytes of base64 text; bytes pass through as they are.

    Both alphabets, missing padding and white space are accepted.

    Raises
    ------
    CloudFormatError
        When it is not base64.

    Examples
    --------
    >>> from_wire("UlRL\\nQw")
    b'RTKC'
    """
    if isinstance(text, bytes):
        return text
    packed = _SPACE.sub("", text).translate(_STANDARD_ALPHABET).rstrip("=")
    try:
        return base64.b64decode(packed + "=" * (-len(packed) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise CloudFormatError(f"not base64: {error}; it begins with {text[:12]!r}") from None
