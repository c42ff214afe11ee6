"""A program whose statements are on `rtask serve`, which is killed and started again meanwhile."""

from __future__ import annotations

import itertools
import threading
from contextlib import ExitStack
from pathlib import Path

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
        with rtask.open(f"http://127.0.0.1:{port}/sparql", timeout_s=20) as kb:
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
