"""Reassembly of fragmented messages (rosbridge protocol 2, 3.2.1)."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

from rtask.errors import UsageError

MAX_IDS = 8
MAX_PARTS = 10_000
MAX_CHARACTERS = 64 << 20
MAX_AGE_S = 30.0


@dataclass
class _Set:
    """The fragments of one message received so far."""

    total: int
    began: float
    parts: dict[int, str] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Number of characters received."""
        return sum(map(len, self.parts.values()))


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
        self._sets: dict[Any, _Set] = {}

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
        name, data, num, total = _read(message)
        stale = [key for key, one in self._sets.items() if now - one.began > MAX_AGE_S]
        for key in stale:
            del self._sets[key]
        if stale and name in stale:
            raise UsageError(f"fragment {name!r}: not complete within {MAX_AGE_S:g} s; dropped")
        if name not in self._sets and len(self._sets) >= MAX_IDS:
            raise UsageError(f"fragment {name!r}: {MAX_IDS} incomplete messages already")
        one = self._sets.setdefault(name, _Set(total, now))
        if one.total != total:
            del self._sets[name]
            raise UsageError(f"fragment {name!r}: total changed; dropped")
        one.parts[num] = data
        if sum(other.size for other in self._sets.values()) > MAX_CHARACTERS:
            del self._sets[name]
            raise UsageError(f"fragment {name!r}: above {MAX_CHARACTERS} characters; dropped")
        if len(one.parts) < total:
            return None
        del self._sets[name]
        return "".join(one.parts[k] for k in range(total))


def _read(message: dict[str, Any]) -> tuple[Any, str, int, int]:
    name, data = message.get("id"), message.get("data")
    num, total = message.get("num"), message.get("total")
    if not isinstance(name, str | int) or not isinstance(data, str):
        raise UsageError("fragment: expected id and data (a text)")
    if type(num) is not int or type(total) is not int or not 0 <= num < total:
        raise UsageError("fragment: expected num and total, 0 <= num < total")
    if total > MAX_PARTS:
        raise UsageError(f"fragment: {total} pieces; at most {MAX_PARTS}")
    return name, data, num, total
