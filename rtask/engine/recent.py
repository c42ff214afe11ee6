"""A bounded cache that drops the least recently used entries."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Generic, TypeVar

__all__ = ["Recent"]

T = TypeVar("T")


class Recent(Generic[T]):
    """The most recently used values by key; safe to share between threads.

    Examples
    --------
    >>> kept = Recent[int](size=2)
    >>> for key in "aba", "c":
    ...     kept.put(key, len(key))
    >>> kept.put("d", 4)
    >>> kept.get("aba"), kept.get("c")
    (None, 1)
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._kept: OrderedDict[str, T] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: str | None) -> T | None:
        """Return a value, or None when it is forgotten."""
        with self._lock:
            value = None if key is None else self._kept.get(key)
            if key is not None and value is not None:
                self._kept.move_to_end(key)
            return value

    def put(self, key: str, value: T) -> None:
        """Remember a value."""
        with self._lock:
            self._kept[key] = value
            self._kept.move_to_end(key)
            while len(self._kept) > self._size:
                self._kept.popitem(last=False)
