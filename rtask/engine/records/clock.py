"""Times by the clocks of robots, which may be wrong: none later than a bound after the receipt.

When something was received is the time of its commit. When it happened is stored as the robot's
clock gave it, any time back, since reports may wait for a link. A time that lies further ahead than
clocks differ would outdo all that is seen later, so the time of receipt takes its place.
"""

from __future__ import annotations

import datetime as dt

__all__ = ["Clocked", "clocked"]

Clocked = tuple[dt.datetime, str]


def clocked(stamp_s: float | None, ahead_s: float, now: dt.datetime | None = None) -> Clocked:
    """Return when something happened, and words about a clock that is wrong.

    Parameters
    ----------
    stamp_s
        By the robot's clock, s since the epoch; None = now.
    ahead_s
        How far it may be ahead, s.
    now
        Time of receipt; None = by this machine's clock.

    Examples
    --------
    >>> received = dt.datetime(2026, 5, 1, tzinfo=dt.UTC)
    >>> clocked(received.timestamp() - 1e6, 300.0, received)[0].isoformat()
    '2026-04-19T10:13:20+00:00'
    >>> clocked(received.timestamp() + 7200, 300.0, received)[1].partition(";")[0]
    'the clock of the robot said 2026-05-01T02:00:00+00:00, more than 300 s ahead'
    """
    received = dt.datetime.now(dt.UTC) if now is None else now
    if stamp_s is None:
        return received, ""
    happened = dt.datetime.fromtimestamp(stamp_s, dt.UTC)
    if happened - received <= dt.timedelta(seconds=ahead_s):
        return happened, ""
    return received, (
        f"the clock of the robot said {happened.isoformat()}, more than {ahead_s:g} s ahead; the "
        "time of receipt is stored"
    )
