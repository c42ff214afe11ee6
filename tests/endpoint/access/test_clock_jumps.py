"""A wall clock that is set ahead or back changes neither limits nor what was granted for a time."""

from __future__ import annotations

import time

import pytest

from endpoint.access.auth import Caller
from endpoint.access.rate import Limiter
from endpoint.access.sessions import Sessions, Tickets
from endpoint.http.messages import RefusedError
from rtask.kb.commit.access import Access

_YEARS_S = 4 * 366 * 86_400.0


@pytest.mark.parametrize("jump", [_YEARS_S, -_YEARS_S])
def test_limits_sessions_and_tickets_stay_when_the_clock_is_set(
    monkeypatch: pytest.MonkeyPatch, jump: float
) -> None:
    limiter = Limiter(rate=0.001, write_rate=0.001, max_in_flight=8)  # one in 1,000 s
    robot = Caller(Access("nao-1", "robot"), address="10.0.0.7")
    limiter.admit(robot)()
    sessions, tickets = Sessions(), Tickets()
    name, ticket = sessions.begin("0123456789ab"), tickets.issue("0123456789ab")
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + jump)
    with pytest.raises(RefusedError) as refused:
        limiter.admit(robot)
    assert int(dict(refused.value.headers)["Retry-After"]) <= 1_000
    assert sessions.find(name) is not None
    assert tickets.redeem(ticket) == "0123456789ab"
