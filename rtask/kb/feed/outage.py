"""Log messages about something that is tried again and again."""

from __future__ import annotations

import logging

__all__ = ["Outage"]


class Outage:
    """Logs a failure when it begins or its reason changes, and its end.

    Parameters
    ----------
    log
        Logger of the module that tries.
    what
        What fails, as a sentence to which the reason is added.
    """

    def __init__(self, log: logging.Logger, what: str) -> None:
        self._log = log
        self._what = what
        self._reason: str | None = None

    @property
    def is_on(self) -> bool:
        """Whether the last attempt failed."""
        return self._reason is not None

    def failed(self, error: Exception) -> None:
        """Note a failed attempt."""
        reason = str(error) or type(error).__name__
        if reason != self._reason:
            self._reason = reason
            self._log.warning("%s: %s", self._what, reason)

    def ended(self) -> None:
        """Note an attempt that succeeded."""
        if self._reason is not None:
            self._reason = None
            self._log.info("no longer: %s", self._what)
