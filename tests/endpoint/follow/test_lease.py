"""A follower out of contact lets no token in: its writer may have revoked it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

import rtask
from endpoint.access.auth import Authenticator
from endpoint.access.tokens import TokenStore
from endpoint.follow.follower import Follower
from endpoint.http.messages import RefusedError, Request
from endpoint.settings import Config
from rtask.errors import AuthenticationError

Follow = Callable[[float], Follower]


class Clock:
    """A time that stands still until it is moved."""

    now = 1_000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def tokens(clock: Clock) -> Iterator[TokenStore]:
    with closing(TokenStore(None, clock)) as opened:
        yield opened


@pytest.fixture
def following(tokens: TokenStore, clock: Clock, tmp_path: Path) -> Iterator[Follow]:
    """Start following with a lease, without a connection."""
    with ExitStack() as stack:

        def follow(lease_s: float) -> Follower:
            kb = stack.enter_context(rtask.open(tmp_path / "copy", plain=True))
            made = Follower(kb, tokens, "http://127.0.0.1:9", None, lease_s=lease_s, clock=clock)
            return stack.enter_context(closing(made))

        yield follow


def asked(text: str) -> Request:
    return Request("GET", "/query", "", {"host": "localhost", "authorization": f"Bearer {text}"})


def test_a_token_is_let_in_only_while_the_writer_is_heard(
    tokens: TokenStore, clock: Clock, following: Follow
) -> None:
    text, token = tokens.create("robot", agent="nao-1")
    follower, auth = following(60.0), Authenticator(tokens, Config())
    with pytest.raises(RefusedError) as never_heard:
        auth.identify(asked(text))
    assert (never_heard.value.http_status, never_heard.value.is_transient) == (503, True)
    follower._heard_at = clock.now
    clock.now += 60.0
    caller = auth.identify(asked(text))
    assert auth.still_valid(caller)
    clock.now += 0.6
    with pytest.raises(RefusedError, match="out of contact with its writer"):
        auth.identify(asked(text))
    assert not auth.still_valid(caller), "open websockets end as well"
    follower._heard_at = clock.now
    assert auth.identify(asked(text)).access.agent == "nao-1"
    tokens.revoke(token.id)
    with pytest.raises(AuthenticationError, match="revoked"):
        auth.identify(asked(text))


def test_a_lease_of_nothing_is_no_bound(
    tokens: TokenStore, clock: Clock, following: Follow
) -> None:
    text, _ = tokens.create("robot", agent="nao-1")
    following(0.0)
    clock.now += 1e6
    assert tokens.authenticate(text).agent == "nao-1"


def test_those_without_a_token_are_answered_as_before(
    tokens: TokenStore, following: Follow
) -> None:
    following(60.0)
    caller = Authenticator(tokens, Config()).identify(
        Request("GET", "/query", "", {"host": "localhost"})
    )
    assert caller.access.role == "anonymous"
