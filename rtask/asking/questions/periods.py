"""Times in questions: today, yesterday, the last two hours, since or before a date."""

from __future__ import annotations

import datetime as dt
import re
from dataclasses import dataclass

__all__ = ["Period", "find_period"]

_UNITS = {"second": 1, "minute": 60, "hour": 3600, "day": 86400, "week": 604800}
_NUMBER_WORDS = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
_NUMBERS = {word: n for n, word in enumerate(_NUMBER_WORDS, 1)}
_ISO = r"(\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d(?:\.\d+)?)?(?:Z|[+-]\d\d:\d\d)?)?)"
_SPAN = re.compile(
    r"\b(?:in |within |during |over )?(?:the )?(?:last|past) "
    r"(?:(\d+|" + "|".join(_NUMBERS) + r") )?(second|minute|hour|day|week)s?\b",
    re.I,
)
_DAY = re.compile(r"\b(today|yesterday|this week)\b", re.I)
_DATE = re.compile(r"\b(since|after|from|before|until|till|on) " + _ISO, re.I)


@dataclass(frozen=True)
class Period:
    """A stretch of time.

    Parameters
    ----------
    start, end
        Bounds in UTC; None where it is open. The end is excluded.
    text
        The words for it.
    """

    start: dt.datetime | None
    end: dt.datetime | None
    text: str

    def condition(self, variable: str) -> str:
        """Return the SPARQL condition that a variable lies within."""
        bounds = ((">=", self.start), ("<", self.end))
        return " && ".join(
            f'{variable} {sign} "{time.isoformat()}"^^xsd:dateTime'
            for sign, time in bounds
            if time is not None
        )

    def overlap(self, begin: str, end: str) -> str:
        """Return the SPARQL condition that what lasts from one variable to another touches it.

        What has no end lasts yet.
        """
        bounds = []
        if self.start is not None:
            since = f'"{self.start.isoformat()}"^^xsd:dateTime'
            bounds.append(f"(!BOUND({end}) || {end} > {since})")
        if self.end is not None:
            bounds.append(f'{begin} < "{self.end.isoformat()}"^^xsd:dateTime')
        return " && ".join(bounds)


def find_period(text: str, now: dt.datetime) -> Period | None:
    """Return the period that a text names, or None.

    >>> now = dt.datetime(2026, 5, 6, 12, tzinfo=dt.UTC)
    >>> find_period("what failed in the last two hours?", now).start.isoformat()
    '2026-05-06T10:00:00+00:00'
    >>> find_period("what was held before 2026-05-01?", now).condition("?t")
    '?t < "2026-05-01T00:00:00+00:00"^^xsd:dateTime'
    >>> find_period("where is the mug?", now)
    """
    midnight = now.replace(hour=0, minute=0, second=0, microsecond=0)
    day = dt.timedelta(days=1)
    if span := _SPAN.search(text):
        number = (span[1] or "1").lower()
        seconds = int(_NUMBERS.get(number, number)) * _UNITS[span[2].lower()]
        return Period(now - dt.timedelta(seconds=min(seconds, 10**9)), None, span[0])
    if named := _DAY.search(text):
        if named[1].lower() == "today":
            return Period(midnight, None, named[0])
        if named[1].lower() == "yesterday":
            return Period(midnight - day, midnight, named[0])
        return Period(midnight - now.weekday() * day, None, named[0])
    if dated := _DATE.search(text):
        return _dated(dated, day)
    return None


def _dated(dated: re.Match[str], day: dt.timedelta) -> Period | None:
    try:
        time = dt.datetime.fromisoformat(dated[2])
    except ValueError:
        return None
    time = time if time.tzinfo else time.replace(tzinfo=dt.UTC)
    word = dated[1].lower()
    if word == "on":
        return Period(time, time + day, dated[0])
    if word in ("before", "until", "till"):
        return Period(None, time, dated[0])
    return Period(time, None, dated[0])
