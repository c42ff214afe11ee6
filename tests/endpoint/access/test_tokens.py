"""Tokens: shown once, kept as digests, revoked within half a second."""

from __future__ import annotations

import sqlite3
import stat
import time
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import pytest

from endpoint.access.lifetimes import parse_lifetime
from endpoint.access.tokens import CHECK_EVERY_S, TokenStore
from rtask.errors import AuthenticationError, StoreFormatError, UsageError


def test_a_token_gives_the_rights_of_its_robot(tmp_path: Path) -> None:
    with closing(TokenStore(tmp_path)) as tokens:
        text, made = tokens.create("robot", agent="nao-1")
        assert text.startswith(f"rtk_{made.id}_")
        found = tokens.authenticate(text)
    assert (found.access.agent, found.access.role) == ("nao-1", "robot")


def test_the_secret_is_nowhere_in_the_file_and_nobody_else_reads_it(tmp_path: Path) -> None:
    with closing(TokenStore(tmp_path)) as tokens:
        text, _ = tokens.create("admin")
    file = tmp_path / "tokens.sqlite"
    secret = text.split("_")[2]
    assert secret.encode() not in file.read_bytes()
    assert bytes.fromhex(secret) not in file.read_bytes()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_an_existing_file_with_a_loose_mode_is_tightened(tmp_path: Path) -> None:
    (tmp_path / "tokens.sqlite").touch(mode=0o644)
    TokenStore(tmp_path).close()
    assert stat.S_IMODE((tmp_path / "tokens.sqlite").stat().st_mode) == 0o600


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text[:-1] + ("0" if text[-1] != "0" else "1"),
        lambda text: "rtk_" + "0" * 12 + text[16:],
        lambda text: text.upper(),
        lambda text: text + " ",
        lambda text: "",
        lambda text: "rtk_' OR 1=1 --_" + "0" * 32,
    ],
)
def test_a_text_that_is_not_exactly_a_token_opens_nothing(change: object) -> None:
    with closing(TokenStore(None)) as tokens:
        text, _ = tokens.create("admin")
        with pytest.raises(AuthenticationError, match="not a token") as caught:
            tokens.authenticate(change(text))  # type: ignore[operator]
    assert text.split("_")[2] not in str(caught.value)


def test_revoking_holds_in_every_process_within_half_a_second(tmp_path: Path) -> None:
    now = [100.0]
    with (
        closing(TokenStore(tmp_path, clock=lambda: now[0])) as server,
        closing(TokenStore(tmp_path)) as operator,
    ):
        text, made = operator.create("robot", agent="nao-1")
        assert server.authenticate(text).id == made.id
        assert operator.revoke(made.id)
        now[0] += CHECK_EVERY_S
        with pytest.raises(AuthenticationError, match="revoked"):
            server.authenticate(text)
        assert not server.is_valid(made.id)
        assert not operator.revoke(made.id)


def test_a_token_found_void_by_its_id_is_refused_at_once(tmp_path: Path) -> None:
    # Its connections are closed by a look at its id; coming back must not succeed after that.
    with (
        closing(TokenStore(tmp_path, clock=lambda: 100.0)) as server,
        closing(TokenStore(tmp_path)) as operator,
    ):
        text, made = operator.create("robot", agent="nao-1")
        assert server.authenticate(text).id == made.id
        assert operator.revoke(made.id)
        assert not server.is_valid(made.id)
        with pytest.raises(AuthenticationError, match="revoked"):
            server.authenticate(text)


def test_revoking_holds_at_once_in_the_process_that_does_it(tmp_path: Path) -> None:
    with closing(TokenStore(tmp_path, clock=lambda: 100.0)) as server:
        text, made = server.create("robot", agent="nao-1")
        assert server.authenticate(text).id == made.id
        assert server.revoke(made.id)
        with pytest.raises(AuthenticationError, match="revoked"):
            server.authenticate(text)


def test_a_token_expires() -> None:
    with closing(TokenStore(None)) as tokens:
        text, _ = tokens.create("reader", lifetime=timedelta(seconds=-1))
        with pytest.raises(AuthenticationError, match="expired"):
            tokens.authenticate(text)
        lasting, _ = tokens.create("reader", lifetime=timedelta(hours=1))
        assert tokens.authenticate(lasting).expires


def test_a_store_remembers_that_tokens_were_issued_even_when_all_are_revoked(
    tmp_path: Path,
) -> None:
    with closing(TokenStore(tmp_path)) as tokens:
        assert not tokens.ever_issued()
        _, made = tokens.create("admin")
        tokens.revoke(made.id)
        assert tokens.ever_issued()
    with closing(TokenStore(tmp_path)) as again:
        assert again.ever_issued()


def test_a_first_token_of_another_process_is_noticed(tmp_path: Path) -> None:
    with closing(TokenStore(tmp_path)) as server, closing(TokenStore(tmp_path)) as operator:
        assert not server.ever_issued()
        operator.create("admin")
        deadline = time.monotonic() + 60
        while not server.ever_issued():
            assert time.monotonic() < deadline
            time.sleep(0.01)


@pytest.mark.parametrize(
    ("role", "agent", "part"),
    [
        ("king", None, "unknown role"),
        ("robot", None, "needs the name"),
        ("teacher", None, "needs the name"),
        ("robot", "a/b", "is not a valid name"),
        ("robot", "../x", "is not a valid name"),
        ("robot", "", "is not a valid name"),
        ("robot", "x" * 65, "is not a valid name"),
    ],
)
def test_a_token_without_a_sound_owner_is_not_made(role: str, agent: str | None, part: str) -> None:
    with closing(TokenStore(None)) as tokens, pytest.raises(UsageError, match=part):
        tokens.create(role, agent=agent)


def test_the_list_has_everything_but_the_secret() -> None:
    with closing(TokenStore(None)) as tokens:
        text, made = tokens.create("robot", agent="nao-1")
        listed = tokens.all()
    assert listed == [made]
    assert text.split("_")[2] not in repr(listed)


def test_a_lifetime_is_at_most_a_hundred_years() -> None:
    longest = timedelta(hours=876_000)
    assert parse_lifetime("2w") == timedelta(weeks=2)
    assert parse_lifetime("876000h") == parse_lifetime("36500d") == longest
    for text in ("876001h", "36501d", "5215w", "99999w"):
        with pytest.raises(UsageError, match=f"--expires {text} is longer than a hundred years"):
            parse_lifetime(text, "--expires ")


def test_a_damaged_file_of_tokens_is_named_with_a_cure(tmp_path: Path) -> None:
    path = tmp_path / "tokens.sqlite"
    path.write_bytes(b"no database at all" * 100)
    with pytest.raises(StoreFormatError, match=r"tokens\.sqlite is damaged.*rtask token create"):
        TokenStore(tmp_path)
    path.unlink()
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE tokens (id TEXT, secret TEXT)")
    with pytest.raises(StoreFormatError, match="its table has no agent, created, digest"):
        TokenStore(tmp_path)
