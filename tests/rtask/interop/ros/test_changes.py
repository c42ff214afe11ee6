"""Commits of a server that goes away and comes back, as the nodes of ROS publish them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rtask.errors import AuthenticationError, GoneError, RemoteUnavailableError
from rtask.interop.ros.changes import commits_of


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    monkeypatch.setattr("rtask.interop.ros.changes._PAUSE_S", 0.0)


def commit(number):
    return SimpleNamespace(version=f"v{number}", seq=number)


def test_it_goes_on_after_the_last_commit_that_was_heard():
    asked, ends = [], [RemoteUnavailableError("away"), GoneError("too old", version="v7"), None]

    def follow(*, since=None):
        asked.append(since)
        yield commit(len(asked) if len(asked) < 3 else 8)
        if end := ends.pop(0):
            raise end

    heard = [each.seq for each in commits_of(follow, lambda: bool(ends))]
    assert (heard, asked) == ([1, 2, 8], [None, "v1", "v7"])


def test_it_ends_while_the_server_is_away_where_nobody_listens_any_more():
    def follow(*, since=None):
        raise RemoteUnavailableError("away")
        yield

    assert list(commits_of(follow, lambda: False)) == []


def test_a_refusal_is_an_error():
    def follow(*, since=None):
        raise AuthenticationError("the token is not valid")
        yield

    with pytest.raises(AuthenticationError):
        list(commits_of(follow, lambda: True))
