"""Values that were used last."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Generic, TypeVar

__all__ = ["Kept"]

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")


class Kept(Generic[_Key, _Value]):
    """At most so many values by their keys, those that were used last; safe to share.

    Examples
    --------
    >>> kept = Kept(2)
    >>> _ = kept.put("a", 1), kept.put("b", 2), kept.get("a"), kept.put("c", 3)
    >>> kept.get("a"), kept.get("b")
    (1, None)
    """

    def __init__(self, limit: int) -> None:
        self._values: OrderedDict[_Key, _Value] = OrderedDict()
        self._limit, self._lock = limit, threading.Lock()

    def get(self, key: _Key) -> _Value | None:
        """Return a value, None where it is not kept."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def put(self, key: _Key, value: _Value) -> _Value:
        """Keep a value, and return it."""
        with self._lock:
            self._values[key] = value
            while len(self._values) > self._limit:
                self._values.popitem(last=False)
        return value
