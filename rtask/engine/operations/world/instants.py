"""Times in requests about the world: what may be asked about, and what may be stated."""

from __future__ import annotations

import time

from rtask.errors import UsageError

__all__ = ["asked_instant", "stated_instant"]

_MAX_S = 253_402_300_799.0
"""End of the year 9999, beyond which there is no calendar date."""
_MAX_AHEAD_S = 60.0


def asked_instant(stamp: float | None) -> float:
    """Return the Unix time, s, that a question is about; now without a stamp.

    Raises
    ------
    UsageError
        The stamp is before 1970 or after the year 9999.
    """
    if stamp is None:
        return time.time()
    if not 0.0 <= stamp <= _MAX_S:
        raise UsageError(f"stamp: expected s since 1970, got {stamp:g}", field="stamp")
    return stamp


def stated_instant(stamp: float | None) -> float:
    """Return the Unix time, s, from which a statement holds; now without a stamp.

    Raises
    ------
    UsageError
        The stamp is no date, or more than a minute ahead of the clock here.
    """
    time_s = asked_instant(stamp)
    ahead_s = time_s - time.time()
    if ahead_s > _MAX_AHEAD_S:
        raise UsageError(
            f"stamp: it is {ahead_s:.0f} s ahead of the clock here; set the robot's clock, or "
            "leave stamp out", field="stamp",
        )  # fmt: skip
    # What a clock a little ahead says happened now; nobody could ask about it before it had.
    return min(time_s, time.time()) if ahead_s > 0.0 else time_s
