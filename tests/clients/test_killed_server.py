"""A program whose statements are on `rtask serve`, which is killed and started again meanwhile."""

from __future__ import annotations

import itertools
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

import rtask
from rtask.errors import CallFailedError, RemoteError
from tests.servers import RunningServer, running_server
from tests.sparql_servers import free_port

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # it waits for what may take long

_PARTS = 5


def test_acknowledged_transactions_are_there_and_none_is_there_in_part(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "store", ontologies=False):
        pass
    port = free_port()
    acknowledged: list[int] = []
    enough, stop = threading.Semaphore(0), threading.Event()

    def write() -> None:
        with rtask.open(f"http://127.0.0.1:{port}/sparql", timeout_s=60) as kb:
            for number in itertools.count():
                if stop.is_set():
                    return
                try:
                    with kb.transaction(agent="nao-1") as tx:
                        for part in range(_PARTS):
                            tx.add(f"urn:s{number}", f"urn:p{part}", number)
                except CallFailedError:
                    raise  # the server refused it, which it has no reason to
                except RemoteError:
                    stop.wait(0.05)
                    continue
                acknowledged.append(number)
                enough.release()

    with ExitStack() as stack:

        def start() -> RunningServer:
            return stack.enter_context(running_server(tmp_path / "store", "-p", str(port)))

        server = start()
        writer = threading.Thread(target=write)
        writer.start()
        stack.callback(writer.join, 120)
        stack.callback(stop.set)
        for _ in range(2):
            for _ in range(5):
                assert enough.acquire(timeout=240), "no transaction was acknowledged for minutes"
            server.process.kill()
            server.process.wait()
            while enough.acquire(blocking=False):
                pass  # those from before the kill
            server = start()
        for _ in range(5):
            assert enough.acquire(timeout=240), "it did not go on by itself"
        stop.set()
        writer.join(120)
        assert server.stop() == 0
    with rtask.open(tmp_path / "store", ontologies=False) as kb:
        rows = kb.select("SELECT ?s (COUNT(*) AS ?n) { ?s ?p ?o "
                         "FILTER(STRSTARTS(STR(?p), 'urn:p')) } GROUP BY ?s")  # fmt: skip
        sizes = {str(row.value("s")): int(str(row.value("n"))) for row in rows}
        assert {f"urn:s{number}" for number in acknowledged} <= set(sizes)
        assert set(sizes.values()) == {_PARTS}
        assert kb.verify() == []


_GRAPH = "http://example.org/replaced"


def _body(word: str, size: int) -> str:
    return "".join(f"<urn:{word}:{k}> <urn:p> {k % 7} .\n" for k in range(size))


@pytest.mark.parametrize(
    ("size", "after_s"),
    [
        (4_000, 0.1),
        *(pytest.param(60_000, after, marks=pytest.mark.deep) for after in (0.9, 1.8, 2.7)),
    ],
)
def test_a_graph_that_is_replaced_when_the_server_dies_is_the_old_one_or_the_new_one(
    tmp_path: Path, size: int, after_s: float
) -> None:
    """The moments fall into parsing, deriving and storing on most machines; each must do."""
    turtle = {"Content-Type": "text/turtle"}
    with running_server(tmp_path / "store") as server:
        address = f"{server.url}/store?graph={_GRAPH}"
        done = httpx.put(address, content=_body("old", size), headers=turtle, timeout=300)
        assert done.status_code == 201, done.text
        acknowledged = []

        def replace() -> None:
            try:
                answer = httpx.put(address, content=_body("new", size), headers=turtle, timeout=300)
            except httpx.TransportError:
                return  # the server died before it answered
            acknowledged.append(answer.status_code)

        client = threading.Thread(target=replace)
        client.start()
        time.sleep(after_s)
        server.process.kill()
        server.process.wait()
        client.join(120)
        assert not client.is_alive()
    with rtask.open(tmp_path / "store") as kb:
        query = f"""SELECT ?word (COUNT(*) AS ?n)
WHERE {{ GRAPH <{_GRAPH}> {{ ?s <urn:p> ?o }} BIND(SUBSTR(STR(?s), 5, 3) AS ?word) }}
GROUP BY ?word"""
        rows = kb.select(query)
        found = {str(row.value("word")): int(str(row.value("n"))) for row in rows}
        assert found in ({"old": size}, {"new": size})
        assert not acknowledged or found == {"new": size}, "an answered request was lost"
        assert kb.verify() == []
