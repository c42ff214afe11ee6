"""Packing of frames on request: fragments, PNG or CBOR (rosbridge protocol 2, 3.1 to 3.3).

Clients that do not ask get plain text frames, for roslibpy reads no others. Unknown compressions,
``cbor-raw`` among them, fall back to plain JSON.
"""

from __future__ import annotations

import base64
import itertools
import json
import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rtask.errors import UsageError

Frame = str | bytes

_LEAST_PIECE = 64
_ids = itertools.count(1)


@dataclass(frozen=True)
class Packing:
    """How frames for one interaction are packed.

    Parameters
    ----------
    compression
        ``png``, ``cbor``, or anything else for plain JSON.
    fragment_size
        Most characters in one fragment; 0 to send messages whole.
    """

    compression: str = "none"
    fragment_size: int = 0

    @classmethod
    def wanted(cls, message: dict[str, Any]) -> Packing:
        """Read the packing that a request asks for.

        Raises
        ------
        UsageError
            ``fragment_size`` is not a number.
        """
        size = message.get("fragment_size") or 0
        if isinstance(size, bool) or not isinstance(size, int | float) or not math.isfinite(size):
            raise UsageError("fragment_size: expected a number of characters")
        compression = message.get("compression")
        return cls(
            compression if isinstance(compression, str) else "none",
            max(int(size), _LEAST_PIECE) if size > 0 else 0,
        )

    @property
    def is_plain(self) -> bool:
        """Whether messages are sent unchanged."""
        return not self.fragment_size and self.compression not in ("png", "cbor")

    def frames(self, text: str) -> Iterator[Frame]:
        """Yield the frames that carry a message."""
        if self.compression == "cbor":
            yield cbor(json.loads(text))
            return
        if self.compression == "png":
            text = json.dumps({"op": "png", "data": base64.b64encode(png(text)).decode()})
        if not self.fragment_size or len(text) <= self.fragment_size:
            yield text
            return
        yield from pieces(text, self.fragment_size)


def pieces(text: str, size: int) -> Iterator[str]:
    """Yield a message as ``fragment`` ops (rosbridge protocol 2, 3.2.1).

    Examples
    --------
    >>> [json.loads(piece)["data"] for piece in pieces("abcde", 2)]
    ['ab', 'cd', 'e']
    """
    name = f"fragment:{next(_ids)}"
    total = -(-len(text) // size)
    for num in range(total):
        data = text[num * size : (num + 1) * size]
        message = {"op": "fragment", "id": name, "data": data, "num": num, "total": total}
        yield json.dumps(message, ensure_ascii=False, separators=(",", ":"))


def png(text: str) -> bytes:
    """Return a text as the pixels of an RGB picture (rosbridge protocol 2, 3.2.2).

    Characters beyond ASCII are escaped, because decoders take each byte for one character. The last
    row is padded with line ends, which JSON ignores.
    """
    data = json.dumps(json.loads(text), separators=(",", ":")).encode("ascii")
    width = max(int(math.sqrt(len(data) / 3)), 1)
    height = -(-len(data) // (3 * width))
    data += b"\n" * (3 * width * height - len(data))
    # Filter 0 before each row: the bytes are no picture, and filters would not help.
    rows = b"".join(
        b"\0" + data[start : start + 3 * width] for start in range(0, len(data), 3 * width)
    )
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


def cbor(value: Any) -> bytes:
    """Return a JSON value in CBOR (RFC 8949), lengths definite, floats of 64 bits.

    Examples
    --------
    >>> cbor({"a": [1, -1, "x", None, True]}).hex()
    'a161618501206178f6f5'
    """
    out: list[bytes] = []
    _write(value, out)
    return b"".join(out)


def _write(value: Any, out: list[bytes]) -> None:
    if value is None or isinstance(value, bool):
        out.append({None: b"\xf6", True: b"\xf5", False: b"\xf4"}[value])
    elif isinstance(value, int) and -(2**64) <= value < 2**64:
        out.append(_head(0, value) if value >= 0 else _head(1, -1 - value))
    elif isinstance(value, int | float):
        out.append(b"\xfb" + struct.pack(">d", value))
    elif isinstance(value, str):
        data = value.encode("utf-8", "surrogatepass")
        out.append(_head(3, len(data)) + data)
    elif isinstance(value, list):
        out.append(_head(4, len(value)))
        for entry in value:
            _write(entry, out)
    else:
        out.append(_head(5, len(value)))
        for key, entry in value.items():
            _write(key, out)
            _write(entry, out)


def _head(major: int, number: int) -> bytes:
    """Return the first bytes of an item (RFC 8949, 3)."""
    if number < 24:
        return bytes([major << 5 | number])
    for extra, size, kind in ((24, 1, "B"), (25, 2, "H"), (26, 4, "I"), (27, 8, "Q")):
        if number < 1 << 8 * size:
            return bytes([major << 5 | extra]) + struct.pack(f">{kind}", number)
    raise AssertionError(number)
