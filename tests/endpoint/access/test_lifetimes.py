"""How long a token stands, as people write it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import pytest

from endpoint.access.lifetimes import parse_expiry, parse_lifetime
from rtask.errors import UsageError


@pytest.mark.parametrize(
    ("text", "hours"),
    [("0h", 0), ("1h", 1), ("12h", 12), ("1d", 24), ("30d", 720), ("1w", 168), ("4w", 672)],
)
def test_hours_days_and_weeks_are_counted_in_hours(text: str, hours: int) -> None:
    assert parse_lifetime(text) == timedelta(hours=hours)


@pytest.mark.parametrize("text", ["876000h", "36500d", "5214w"])
def test_a_hundred_years_is_the_longest(text: str) -> None:
    number, unit = int(text[:-1]), text[-1]
    parse_lifetime(text)
    with pytest.raises(UsageError, match=rf"^--expires {number + 1}{unit} is longer than a"):
        parse_lifetime(f"{number + 1}{unit}", "--expires ")


@pytest.mark.parametrize(
    "text", ["", "h", "12", "12m", "12 h", "-1h", "1.5h", "12hh", "x12h", "12H", "1234567h"]
)
def test_another_form_is_refused_with_the_forms_that_there_are(text: str) -> None:
    with pytest.raises(UsageError, match=r"^--expires expected .*\(12h, 30d, 4w\)") as refused:
        parse_lifetime(text, "--expires ")
    assert str(refused.value).endswith(f"got {text!r}")


def test_a_lifetime_counts_from_now() -> None:
    before = datetime.now(UTC)
    expiry = parse_expiry("2d")
    after = datetime.now(UTC)
    assert expiry is not None
    assert before + timedelta(days=2) <= expiry <= after + timedelta(days=2)


def test_a_time_is_taken_in_its_own_zone_and_given_in_utc() -> None:
    expiry = parse_expiry("2027-01-31T12:00:00+02:00")
    assert expiry == datetime(2027, 1, 31, 12, tzinfo=timezone(timedelta(hours=2)))
    assert expiry is not None
    assert (expiry.tzinfo, expiry.hour) == (UTC, 10)


@pytest.mark.parametrize("text", ["2027-01-31T12:00:00", "2027-01-31"])
def test_a_time_without_zone_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match=f"{text}' has no time zone; write {text}Z"):
        parse_expiry(text)


def test_only_the_word_never_means_no_end() -> None:
    assert parse_expiry("never") is None
    for text in ("Never", "always", ""):
        with pytest.raises(UsageError):
            parse_expiry(text)
