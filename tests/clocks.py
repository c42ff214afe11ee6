"""Clocks for tests, put in the place of one module's ``time``.

``time`` itself stays as it is: every thread of the process reads it, of the server under test and
of libraries too, and what they sleep would pass here.
"""

from __future__ import annotations


class PassedBySleeping:
    """Time that passes only while somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        """Return the time, s."""
        return self.now_s

    def sleep(self, pause_s: float) -> None:
        """Let time pass, s."""
        self.now_s += pause_s
