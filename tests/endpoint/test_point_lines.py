"""Point queries in line at a reader: each gets its own answer, whatever the others do."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from collections.abc import Awaitable, Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

import rtask
from endpoint import point_lines
from endpoint.point_lines import Instead, PointLines, PointQuery
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream
from rtask.knowledge_base import KnowledgeBase
from rtask.sparql.slow_shapes import SlowShapes

pytestmark = pytest.mark.slow

JSON = "application/sparql-results+json"
LONG = "SELECT ?o { <urn:long> <urn:line> ?o }"
# Quick by its looks: each pattern starts from a constant. There are 27 million combinations.
SLOW = (
    "SELECT ?a { <urn:hub> <urn:has> ?a . <urn:hub> <urn:has> ?b . <urn:hub> <urn:has> ?c "
    "FILTER(STRLEN(CONCAT(STR(?a), STR(?b), STR(?c))) < 3) }"
)
Found = Answer | ReaderStream | Instead


def value(number: int) -> str:
    return f"SELECT ?o {{ <urn:thing:{number}> <urn:number> ?o }}"


@pytest.fixture(scope="module")
def kb(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KnowledgeBase]:
    folder: Path = tmp_path_factory.mktemp("kb")
    with rtask.open(folder, ontologies=False, reason=False, flush="os") as kb:
        things = " ".join(f"<urn:thing:{n}> <urn:number> {n} ." for n in range(200))
        hub = ", ".join(f"<urn:{n}>" for n in range(300))
        lines = ", ".join(f'"{n} {"x" * 90}"' for n in range(4_000))
        few = ", ".join(f"<urn:{n}>" for n in range(8))
        kb.update(
            f"INSERT DATA {{ {things} <urn:hub> <urn:has> {hub} . <urn:few> <urn:has> {few} }}"
        )
        kb.update(f"INSERT DATA {{ <urn:long> <urn:line> {lines} }}")
        kb.readers.start()
        yield kb


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave nothing to threads because the machine is busy."""
    monkeypatch.setattr(point_lines, "QUICK_S", 60.0)
    monkeypatch.setattr(point_lines, "WAIT_S", 60.0)
    monkeypatch.setattr(point_lines, "MAX_ATTEMPTS", 1_000)


class Asked:
    """Queries that were asked on one loop, and what was found for each."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self._kb = kb
        self.slow = SlowShapes()
        self.lines = PointLines(kb.readers, self._start_reader, self.slow)

    def _start_reader(self) -> None:
        asyncio.get_running_loop().run_in_executor(None, self._kb.readers.start, False)

    def ask(self, text: str) -> tuple[PointQuery, asyncio.Future[Found]]:
        """Ask; return the query, and what will be found."""
        payload = self._kb.encode_query(text, JSON)
        assert payload is not None
        found: asyncio.Future[Found] = asyncio.get_running_loop().create_future()
        query = PointQuery(payload, text, found.set_result)
        self.lines.ask(query)
        return query, found


def _start_two(kb: KnowledgeBase) -> None:
    """Have two readers ready."""
    kb.readers.start()
    one = kb.readers.open_line()
    kb.readers.start()
    if one is not None:
        one.close(is_reusable=True)
    assert kb.stats()["readers"]["idle"] >= 2


def run(kb: KnowledgeBase, work: Callable[[Asked], Awaitable[None]]) -> None:
    """Do something on a loop, and close the lines."""

    async def main() -> None:
        _start_two(kb)
        asked = Asked(kb)
        with closing(asked.lines):
            await asyncio.wait_for(work(asked), 60)

    asyncio.run(main())
    assert kb.stats()["readers"]["running"] == 0


def number_in(found: Found) -> int:
    assert isinstance(found, Answer)
    [row] = json.loads(found.body)["results"]["bindings"]
    return int(row["o"]["value"])


def test_a_query_that_takes_longer_than_it_looked_is_noted(kb: KnowledgeBase) -> None:
    some = SLOW.replace("<urn:hub> <urn:has> ?c", "<urn:few> <urn:has> ?c")

    async def work(asked: Asked) -> None:
        number_in(await asked.ask(value(1))[1])
        assert value(2) not in asked.slow
        await asked.ask(some)[1]
        assert some in asked.slow

    run(kb, work)


def test_each_of_many_queries_gets_its_own_answer_from_few_readers(kb: KnowledgeBase) -> None:
    async def work(asked: Asked) -> None:
        for _ in range(3):
            found = [asked.ask(value(n))[1] for n in range(200)]
            assert [number_in(await one) for one in found] == list(range(200))
        assert kb.stats()["readers"]["running"] <= kb.readers.limits.reserved

    run(kb, work)


def test_a_query_that_takes_its_time_holds_nobody_up(kb: KnowledgeBase) -> None:
    async def work(asked: Asked) -> None:
        slow, late = asked.ask(SLOW)
        behind = [asked.ask(value(n))[1] for n in range(20)]
        assert [number_in(await one) for one in behind] == list(range(20))
        assert not late.done()
        asked.lines.forget(slow)

    run(kb, work)


def test_a_query_that_only_looks_quick_is_to_be_asked_among_the_long_ones(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(point_lines, "QUICK_S", 0.1)

    async def work(asked: Asked) -> None:
        assert await asked.ask(SLOW)[1] is Instead.ASK_AMONG_LONG

    run(kb, work)


def test_a_long_answer_becomes_a_stream_and_the_others_are_answered(kb: KnowledgeBase) -> None:
    async def work(asked: Asked) -> None:
        before = asked.ask(value(1))[1]
        long = asked.ask(LONG)[1]
        behind = [asked.ask(value(n))[1] for n in range(2, 9)]
        assert number_in(await before) == 1
        stream = await long
        assert isinstance(stream, ReaderStream)
        assert [number_in(await one) for one in behind] == list(range(2, 9))

        def read() -> bytes:
            with stream:
                stream.start()
                return stream.read()

        data = await asyncio.to_thread(read)
        assert len(json.loads(data)["results"]["bindings"]) == 4_000

    run(kb, work)


def test_when_a_reader_is_killed_its_queries_are_asked_again(kb: KnowledgeBase) -> None:
    async def work(asked: Asked) -> None:
        slow = asked.ask(SLOW)[1]
        behind = [asked.ask(value(n))[1] for n in range(5)]
        readers = kb.stats()["readers"]["processes"][1:]
        for reader in readers:
            os.kill(reader, signal.SIGKILL)
        assert await slow is Instead.ASK_IN_THREAD
        for number, one in enumerate(behind):
            found = await one
            assert found is Instead.ASK_IN_THREAD or number_in(found) == number
        while set(readers) & set(kb.stats()["readers"]["processes"]):
            await asyncio.sleep(0.01)

    run(kb, work)


def test_a_reader_does_not_go_on_for_a_client_that_has_gone(kb: KnowledgeBase) -> None:
    async def work(asked: Asked) -> None:
        killed = kb.stats()["readers"]["killed"]
        slow, found = asked.ask(SLOW)
        asked.lines.forget(slow)
        while kb.stats()["readers"]["killed"] == killed:
            await asyncio.sleep(0.01)
        assert not found.done()

    run(kb, work)


def test_a_query_that_fails_is_left_to_a_thread_and_its_reader_goes_on(kb: KnowledgeBase) -> None:
    async def work(asked: Asked) -> None:
        wrong = asked.ask("SELECT ?o { <urn:thing:1> <urn:number> ?o ")[1]
        right = asked.ask(value(7))[1]
        assert await wrong is Instead.ASK_IN_THREAD
        assert number_in(await right) == 7

    run(kb, work)


def test_a_reader_with_much_to_catch_up_with_is_replaced(kb: KnowledgeBase) -> None:
    async def work(asked: Asked) -> None:
        assert number_in(await asked.ask(value(3))[1]) == 3
        many = " ".join(f"<urn:more:{n}> <urn:number> {n} ." for n in range(600))
        await asyncio.to_thread(kb.update, f"INSERT DATA {{ {many} }}")
        text = "SELECT ?o { <urn:more:5> <urn:number> ?o }"
        while not isinstance(found := await asked.ask(text)[1], Answer):
            await asyncio.sleep(0.01)
        assert number_in(found) == 5

    run(kb, work)
