"""Packing of frames on request: fragments, PNG or CBOR (rosbridge protocol 2, 3.1 to 3.3).

Clients that do not ask get plain text frames, for roslibpy reads no others. Unknown compressions,
``cbor-raw`` among them, fall back to plain JSON. Fragments from clients are put together again.
"""

from __future__ import annotations

import base64
import itertools
import json
import math
import re
import struct
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from rtask.errors import UsageError

Frame = str | bytes

MIN_PIECE = 64
MAX_IDS = 8
MAX_PARTS = 10_000
MAX_CHARACTERS = 64 << 20
MAX_AGE_S = 30.0
_MAX_DIGITS = 22
_LONG = re.compile(r"\d{20}")
_ids = itertools.count(1)


@dataclass(frozen=True)
class Packing:
    """The packing of the frames of one interaction.

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
    def from_message(cls, message: dict[str, Any]) -> Packing:
        """Read the packing that a request asks for.

        Raises
        ------
        UsageError
            ``fragment_size`` is not a number.
        """
        size = message.get("fragment_size") or 0
        if isinstance(size, bool) or not isinstance(size, int | float):
            raise UsageError("fragment_size: expected a number of characters")
        compression = message.get("compression")
        return cls(
            compression if isinstance(compression, str) else "none",
            int(min(max(size, MIN_PIECE), MAX_CHARACTERS)) if size > 0 else 0,
        )

    @property
    def is_plain(self) -> bool:
        """Whether messages are sent unchanged."""
        return not self.fragment_size and self.compression not in ("png", "cbor")

    def frames(self, text: str) -> Iterator[Frame]:
        """Yield the frames that carry a message."""
        if self.compression == "cbor":
            yield cbor(text)
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


def cbor(text: str) -> bytes:
    """Return a message in CBOR (RFC 8949), lengths definite.

    Numbers beyond 64 bits become floats, as in JavaScript, whose clients read no others. Halves of
    surrogate pairs, which UTF-8 cannot carry, become question marks.

    Examples
    --------
    >>> cbor('{"a": [1, -1, "x", null, true]}').hex()
    'a161618501206178f6f5'
    """
    import cbor2

    value = json.loads(text, parse_int=_parse_integer if _LONG.search(text) else None)
    try:
        return cbor2.dumps(value)
    except UnicodeEncodeError:
        whole = json.dumps(value, ensure_ascii=False).encode("utf-8", "replace")
        return cbor2.dumps(json.loads(whole))


def _parse_integer(digits: str) -> int | float:
    # Python refuses to read integers of some thousand digits.
    value = int(digits) if len(digits) < _MAX_DIGITS else None
    return value if value is not None and -(2**64) <= value < 2**64 else float(digits)


@dataclass
class _Partial:
    """The fragments of one message received so far."""

    total: int
    began: float
    parts: dict[int, str] = field(default_factory=dict)
    size: int = 0
    """Number of characters received."""

    def put(self, number: int, data: str) -> None:
        self.size += len(data) - len(self.parts.get(number, ""))
        self.parts[number] = data


class Fragments:
    """Reassembles the messages of one session; what exceeds a limit is dropped and reported.

    Examples
    --------
    >>> fragments = Fragments()
    >>> fragments.add({"id": "a", "data": "wor", "num": 1, "total": 3})
    >>> fragments.add({"id": "a", "data": "ld", "num": 2, "total": 3})
    >>> fragments.add({"id": "a", "data": "hello ", "num": 0, "total": 3})
    'hello world'
    """

    def __init__(self) -> None:
        self._sets: dict[Any, _Partial] = {}

    def add(self, message: dict[str, Any], now: float | None = None) -> str | None:
        """Add a fragment; return the whole message once it is complete.

        Fragments may come in any order; a repeated one replaces the first.

        Raises
        ------
        UsageError
            Not a fragment, too many incomplete messages, or a message that is too large, too old or
            whose total changed.
        """
        now = time.monotonic() if now is None else now
        name, data, num, total = _read_fragment(message)
        stale = [
            key for key, message_set in self._sets.items() if now - message_set.began > MAX_AGE_S
        ]
        for key in stale:
            del self._sets[key]
        if stale and name in stale:
            raise UsageError(f"fragment {name!r}: not complete within {MAX_AGE_S:g} s; dropped")
        if name not in self._sets and len(self._sets) >= MAX_IDS:
            raise UsageError(f"fragment {name!r}: {MAX_IDS} incomplete messages already")
        message_set = self._sets.setdefault(name, _Partial(total, now))
        if message_set.total != total:
            del self._sets[name]
            raise UsageError(f"fragment {name!r}: total changed; dropped")
        message_set.put(num, data)
        if sum(other.size for other in self._sets.values()) > MAX_CHARACTERS:
            del self._sets[name]
            raise UsageError(f"fragment {name!r}: above {MAX_CHARACTERS} characters; dropped")
        if len(message_set.parts) < total:
            return None
        del self._sets[name]
        return "".join(message_set.parts[k] for k in range(total))


def _read_fragment(message: dict[str, Any]) -> tuple[Any, str, int, int]:
    name, data = message.get("id"), message.get("data")
    num, total = message.get("num"), message.get("total")
    if not isinstance(name, str | int) or not isinstance(data, str):
        raise UsageError("fragment: expected id and data (a text)")
    if type(num) is not int or type(total) is not int or not 0 <= num < total:
        raise UsageError("fragment: expected num and total, 0 <= num < total")
    if total > MAX_PARTS:
        raise UsageError(f"fragment: {total} pieces; at most {MAX_PARTS}")
    return name, data, num, total
