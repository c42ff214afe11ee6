"""Following the graph without sockets: what is gone, who is too slow, what fits."""

from __future__ import annotations

import asyncio
import functools
import json
from collections.abc import Iterator
from typing import Any

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.context import ServerContext
from endpoint.follow.changes import Changes, Stream
from endpoint.follow.events import Follower, Pattern, read_pattern, version_of
from endpoint.http.messages import Request
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from rtask.errors import GoneError, UnknownTermError, UsageError
from rtask.kb.feed import feed
from rtask.knowledge_base import KnowledgeBase


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", plain=True) as opened:
        yield opened


@pytest.fixture
def changes(kb: KnowledgeBase) -> Iterator[Changes]:
    tokens = TokenStore(None)
    context = ServerContext.create(kb, NoEngine(), tokens, Config(plain=True))
    yield Changes(context)
    context.close()
    tokens.close()


def write(kb: KnowledgeBase, *numbers: int, subject: str = "urn:s") -> None:
    for number in numbers:
        kb.update(f"INSERT DATA {{ <{subject}> <urn:p> {number} }}")


def request(query: str = "", **headers: str) -> Request:
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    return Request(
        "GET", "/changes", query, {"host": "localhost", **names}, b"", "http://localhost", "::1"
    )


def events(changes: Changes, wish: Request, meanwhile: Any = None, most: int = 100) -> list[Any]:
    """Return the events of a stream until nothing more is there."""

    async def collect() -> list[Any]:
        stream = changes.open(wish)
        assert isinstance(stream, Stream)
        if meanwhile is not None:
            meanwhile()
        found: list[Any] = []
        pieces = stream.pieces()
        try:
            async with asyncio.timeout(0.5):
                async for piece in pieces:
                    lines = dict(
                        line.split(": ", 1) for line in piece.decode().splitlines() if line
                    )
                    found.append({**lines, "data": json.loads(lines["data"])})
                    if len(found) == most:
                        break
        except TimeoutError:
            pass
        finally:
            stream._follower.close()
        return found

    return asyncio.run(collect())


@pytest.mark.slow
def test_commits_that_are_no_longer_kept_are_an_event_and_the_stream_goes_on(
    kb: KnowledgeBase, changes: Changes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feed, "_REMEMBERED", 3)
    write(kb, *range(10))
    old = f"{kb.settings.epoch}:1"
    found = events(changes, request(last_event_id=old), lambda: write(kb, 77))
    assert [event["event"] for event in found] == ["hello", "gone", "change"]
    assert found[1]["data"]["oldest"] == kb.seq - 3  # of before the write
    assert found[1]["id"] == found[0]["data"]["version"]  # who comes back goes on from here
    with pytest.raises(GoneError):
        changes.follower(request(f"since={old}"), version_of(kb), lambda: None)


@pytest.mark.slow
def test_who_is_too_slow_is_told_from_where_to_go_on(
    kb: KnowledgeBase, changes: Changes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kb, "subscribe", functools.partial(kb.subscribe, size=3))
    found = events(changes, request(), lambda: write(kb, *range(9)))
    assert [event["event"] for event in found] == ["hello", *["change"] * 3, "lagged"]
    assert found[-1]["data"]["since"] == found[-2]["id"]
    rest = events(changes, request(last_event_id=found[-1]["data"]["since"]))
    assert len(rest) == 1 + 6  # nothing missed, nothing twice


def test_what_was_committed_before_the_greeting_is_not_missed(
    kb: KnowledgeBase, changes: Changes
) -> None:
    write(kb, 1)
    found = events(changes, request(), lambda: write(kb, 2, 3))
    assert found[0]["data"]["version"] == version_of(kb).replace(f":{kb.seq}", f":{kb.seq - 2}")
    assert [event["data"]["seq"] for event in found[1:]] == [kb.seq - 1, kb.seq]


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        (Pattern(), [1, 2, 3]),
        (Pattern(s="urn:a"), [1]),
        (Pattern(s="<urn:a>"), [1]),
        (Pattern(o='"2"^^<http://www.w3.org/2001/XMLSchema#integer>'), [2]),
        (Pattern(p="urn:q"), []),
        (Pattern(cls="urn:Robot"), [2]),
    ],
)
def test_what_fits_a_pattern(kb: KnowledgeBase, pattern: Pattern, expected: list[int]) -> None:
    kb.update("INSERT DATA { <urn:b> a <urn:Robot> }")
    alone = Follower(kb, [pattern], version_of(kb), lambda: None)
    with_others = Follower(kb, [pattern, Pattern(s="urn:never")], version_of(kb), lambda: None)
    write(kb, 1, subject="urn:a")
    write(kb, 2, subject="urn:b")
    write(kb, 3, subject="urn:c")
    for follower in (alone, with_others):
        found = [int(q.object.value) for change in follower.drain() for q in change.added]
        assert found == expected
        follower.close()


@pytest.mark.parametrize(
    ("pattern", "count"),
    [
        (Pattern(s="kb:object/7"), 1),
        (Pattern(s='"the mug"'), 1),
        (Pattern(s="urn:lab/object/7", p="rt:mass"), 1),
        (Pattern(cls="rt:Mug"), 1),
        (Pattern(s="x-new:thing"), 0),
    ],
)
def test_a_pattern_takes_terms_as_commands_print_them(pattern: Pattern, count: int) -> None:
    rt = "https://w3id.org/rtask-kg/ns#"
    with rtask.open(":memory:", base="urn:lab/", ontologies=False, reason=False) as kb:
        kb.update(f"INSERT DATA {{ <urn:lab/object/7> a <{rt}Mug> ; <{rt}name> 'the mug' }}")
        follower = Follower(kb, [pattern], version_of(kb), lambda: None)
        kb.update(f"INSERT DATA {{ <urn:lab/object/7> <{rt}mass> 0.3 }}")
        assert len(follower.drain()) == count
        follower.close()


def test_what_no_term_can_be_names_its_field() -> None:
    with rtask.open(":memory:", base="urn:lab/", ontologies=False, reason=False) as kb:
        with pytest.raises(UsageError, match="class: 'extra' is left over after the term rt:Mug"):
            Follower(kb, [Pattern(cls="rt:Mug extra")], version_of(kb), lambda: None)
        with pytest.raises(UnknownTermError, match='s: nothing is called "cup"'):
            Follower(kb, [Pattern(s='"cup"')], version_of(kb), lambda: None)


@pytest.mark.parametrize("given", [1, [], {"x": 1}, {"s": 1}, {"inferred": "maybe"}])
def test_a_pattern_that_is_none_is_named(given: Any) -> None:
    with pytest.raises(UsageError):
        read_pattern(given)
