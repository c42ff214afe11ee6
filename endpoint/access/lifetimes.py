"""How long a token stands, as people write it: ``12h``, ``30d``, ``4w``, a time, or never."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

from rtask.errors import UsageError

__all__ = ["parse_expiry", "parse_lifetime"]

_LIFETIME = re.compile(r"([0-9]{1,6})([hdw])")
_HOURS = {"h": 1, "d": 24, "w": 168}
_MOST_HOURS = 876_000


def parse_lifetime(text: str, what: str = "") -> timedelta:
    """Parse a lifetime in hours, days or weeks; errors begin with `what`.

    Examples
    --------
    >>> parse_lifetime("30d").days, parse_lifetime("12h").total_seconds()
    (30, 43200.0)

    Raises
    ------
    UsageError
        Not of that form, or longer than a hundred years.
    """
    match = _LIFETIME.fullmatch(text)
    if not match:
        raise UsageError(
            f"{what}expected a lifetime in hours, days or weeks (12h, 30d, 4w), got {text!r}"
        )
    hours = int(match.group(1)) * _HOURS[match.group(2)]
    if hours > _MOST_HOURS:
        raise UsageError(f"{what}{text} is longer than a hundred years")
    return timedelta(hours=hours)


def parse_expiry(text: str) -> datetime | None:
    """Parse when a token expires: a lifetime from now, a time of ISO 8601, or never.

    Examples
    --------
    >>> parse_expiry("never"), parse_expiry("2027-01-31T12:00:00Z").year
    (None, 2027)

    Raises
    ------
    UsageError
        None of these, or a time without its zone.
    """
    if text == "never":
        return None
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return datetime.now(UTC) + parse_lifetime(text)
    if time.tzinfo is None:
        raise UsageError(f"{text!r} has no time zone; write {text}Z")
    return time.astimezone(UTC)
