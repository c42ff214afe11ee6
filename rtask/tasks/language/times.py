"""By when: times in the words of a goal."""

from __future__ import annotations

import datetime
import re

from rtask.errors import UsageError
from rtask.tasks.language.lexicon import NUMBERS

__all__ = ["deadline_in"]

_UNITS = {"second": 1, "minute": 60, "hour": 3600}
_SPAN = re.compile(
    r",?\s*\b(?:within|in)\s+(?:the next\s+)?(?P<number>half an|\w+)\s+"
    r"(?P<unit>second|minute|hour)s?\b",
    re.I,
)
_CLOCK = re.compile(
    r",?\s*\b(?:by|before)\s+(?:(?P<date>\d{4}-\d\d-\d\d)[T\s]+)?"
    r"(?P<hour>noon|midnight|\d{1,2})(?:[:.](?P<minute>\d\d))?(?:[:](?P<second>\d\d))?"
    r"\s*(?P<half>am|pm|o['’]clock)?\s*(?P<zone>UTC|GMT|Z|CEST|CET|EEST|EET|WEST|WET|[ECMP][SD]T|[+-]\d\d:?\d\d)?(?=[\s,.;!]|$)",
    re.I,
)
_OTHER = re.compile(
    r"\b(?:by|before|until|till)\s+(?:tonight|tomorrow|today|(?:this |the )?(?:morning|evening|"
    r"afternoon)|next \w+|monday|tuesday|wednesday|thursday|friday|saturday|sunday)\b|"
    r"\b(?:at|by|before|until|till|after|from)\s+(?:one|two|three|four|five|six|seven|eight|nine|ten|"
    r"eleven|twelve)(?:\s+o['’]clock)?(?=\s*(?:[,.;!]|$))|"
    r"\b(?:at|until|till|after|from)\s+(?:\d{1,2}[:.]\d\d|\d{1,2}\s?(?:am|pm)|noon|midnight)\b",
    re.I,
)
_ZONES = {
    "CET": 1, "CEST": 2, "EET": 2, "EEST": 3, "WET": 0, "WEST": 1, "EST": -5, "EDT": -4, "CST": -6,
    "CDT": -5, "MST": -7, "MDT": -6, "PST": -8, "PDT": -7,
}  # fmt: skip
"""Hours from UTC of RFC 5322, 4.3, and of Europe; BST and IST mean two zones each."""
_HOW = (
    "say it with date and time zone: 'by 2026-12-01 12:00 UTC', 'within 20 minutes', or "
    "--deadline 2026-12-01T12:00:00Z with --store"
)


def deadline_in(text: str, now: datetime.datetime) -> tuple[str, datetime.datetime | None]:
    """Return a goal without the time that it names, and that time.

    Parameters
    ----------
    now
        With a time zone. A clock time without a date is the next one.

    Raises
    ------
    UsageError
        A time without a zone, which could be anybody's, or one that is no deadline.

    Examples
    --------
    >>> now = datetime.datetime(2026, 1, 1, 10, tzinfo=datetime.UTC)
    >>> deadline_in("cups into the box by 12:30 UTC", now)[1].isoformat()
    '2026-01-01T12:30:00+00:00'
    >>> deadline_in("within five minutes, clear the table", now)[1].isoformat()
    '2026-01-01T10:05:00+00:00'
    """
    if (other := _OTHER.search(text)) is not None:
        raise UsageError(f"{other[0]!r}: by when a goal is to be reached; {_HOW}")
    matches = [*_SPAN.finditer(text), *_CLOCK.finditer(text)]
    if not matches:
        return text, None
    if len(matches) > 1:
        raise UsageError(f"{matches[0][0]!r} and {matches[1][0]!r}: a goal has one deadline")
    match = matches[0]
    deadline = _span_end(match, now) if match.re is _SPAN else _clock_time(match, now)
    before, after = text[: match.start()], text[match.end() :]
    return (before + " " + after.lstrip(" ,") if not before.strip() else before + after), deadline


def _span_end(match: re.Match[str], now: datetime.datetime) -> datetime.datetime:
    word = match["number"].lower()
    if word == "half an" and match["unit"].lower() == "hour":
        return now + datetime.timedelta(minutes=30)
    number = {"a": 1, "an": 1, "the": 1}.get(word) or NUMBERS.get(word)
    number = number or (word.isdecimal() and int(word))
    if not number or number > 10_000:
        raise UsageError(f"{match[0].strip()!r}: so long is not understood; {_HOW}")
    return now + datetime.timedelta(seconds=number * _UNITS[match["unit"].lower()])


def _clock_time(match: re.Match[str], now: datetime.datetime) -> datetime.datetime:
    words = match[0].strip(" ,")
    if match["zone"] is None:
        raise UsageError(f"{words!r}: in which time zone is not said; {_HOW}")
    hour = {"noon": 12, "midnight": 0}.get(match["hour"].lower())
    hour = int(match["hour"]) if hour is None else hour
    half = (match["half"] or "").lower()
    if half in ("am", "pm"):
        hour = hour % 12 + 12 * (half == "pm") if 1 <= hour <= 12 else 99
    zone = match["zone"].upper()
    hours = _ZONES.get(zone, 0)
    offset = zone if zone[0] in "+-" else f"{'-' if hours < 0 else '+'}{abs(hours):02}:00"
    date = match["date"] or now.date().isoformat()
    try:
        when = datetime.datetime.fromisoformat(
            f"{date}T{hour:02}:{match['minute'] or '00'}:{match['second'] or '00'}{offset}"
        )
    except ValueError as error:
        raise UsageError(f"{words!r} is no time of day; {_HOW}") from error
    if match["date"] is None and when <= now:
        when += datetime.timedelta(days=1)
    if when <= now:  # no step of such a plan would ever be begun
        raise UsageError(f"{words!r} is over already; {_HOW}")
    return when
