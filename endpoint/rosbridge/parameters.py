"""Parameters that robots share through `/rosapi/set_param`: JSON texts, in memory."""

from __future__ import annotations

import json
import threading

from rtask.errors import UsageError

MAX_PARAMETERS = 1_000
MAX_TEXT = 64 << 10


class Parameters:
    """Named JSON texts.

    Examples
    --------
    >>> parameters = Parameters()
    >>> parameters.set("rate", "10")
    >>> parameters.get("/rate")
    '10'
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._texts: dict[str, str] = {}

    def set(self, name: str, text: str) -> None:
        """Set a parameter.

        Raises
        ------
        UsageError
            The value is not JSON or too long, or there are too many parameters.
        """
        try:
            json.loads(text)
        except (ValueError, RecursionError):
            raise UsageError("value: expected a JSON text") from None
        if len(text) > MAX_TEXT:
            raise UsageError(f"value: above {MAX_TEXT} characters")
        with self._lock:
            if _full(name) not in self._texts and len(self._texts) >= MAX_PARAMETERS:
                raise UsageError(f"more than {MAX_PARAMETERS} parameters")
            self._texts[_full(name)] = text

    def get(self, name: str) -> str | None:
        """Return the text of a parameter; none if it is not set."""
        return self._texts.get(_full(name))

    def delete(self, name: str) -> bool:
        """Delete a parameter; tell whether there was one."""
        with self._lock:
            return self._texts.pop(_full(name), None) is not None

    def names(self) -> list[str]:
        """Return the names, sorted."""
        with self._lock:
            return sorted(self._texts)


def _full(name: str) -> str:
    return "/" + name.lstrip("/")
