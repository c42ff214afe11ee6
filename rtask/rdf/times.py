"""Moments as they are written in the journal and in literals."""

from __future__ import annotations

import datetime as dt

from rtask.errors import UsageError

__all__ = ["moment"]

_UNKNOWN = dt.datetime(1, 1, 1, tzinfo=dt.UTC)


def moment(value: dt.datetime | str | float | None) -> dt.datetime:
    """Return a moment in UTC; text is ISO 8601, a number seconds since 1970, nothing long ago.

    >>> moment("2026-01-02T03:04:05Z").isoformat()
    '2026-01-02T03:04:05+00:00'

    Raises
    ------
    UsageError
        If it is no moment.
    """
    if value is None or value == "":
        return _UNKNOWN
    if isinstance(value, int | float):
        return dt.datetime.fromtimestamp(value, dt.UTC)
    try:
        found = dt.datetime.fromisoformat(value) if isinstance(value, str) else value
    except ValueError as error:
        raise UsageError(f"{value!r} is no time; write 2026-01-02T03:04:05Z") from error
    return found.astimezone(dt.UTC) if found.tzinfo else found.replace(tzinfo=dt.UTC)
