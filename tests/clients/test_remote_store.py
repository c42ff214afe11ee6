"""A bare dataset on another machine: this server before `oxigraph serve`, killed under load."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.servers import RunningServer, running_server
from tests.sparql_servers import OXIGRAPH, Oxigraph

pytestmark = pytest.mark.skipif(OXIGRAPH is None, reason="the program oxigraph is not installed")


@pytest.fixture
def oxigraph(tmp_path: Path) -> Iterator[Oxigraph]:
    running = Oxigraph(tmp_path / "oxigraph")
    running.start()
    yield running
    running.kill()


@pytest.fixture
def fronted(oxigraph: Oxigraph) -> Iterator[RunningServer]:
    with running_server(None, "--store", oxigraph.address, "--profile", "plain") as server:
        yield server


def test_what_passes_through_and_what_needs_the_embedded_store(
    oxigraph: Oxigraph, fronted: RunningServer
) -> None:
    with httpx.Client(base_url=fronted.url, timeout=60) as client:
        update = {"update": "INSERT DATA { <urn:s> <urn:p> 1, 2 }"}
        assert client.post("/update", data=update).status_code == 204
        json_type = {"Accept": "application/sparql-results+json"}
        ask = {"query": "SELECT ?o { <urn:s> <urn:p> ?o } ORDER BY ?o"}
        answer = client.get("/sparql", params=ask, headers=json_type)
        assert [r["o"]["value"] for r in answer.json()["results"]["bindings"]] == ["1", "2"]
        # Somebody else writes to the other server: no answer is taken for known.
        httpx.post(f"{oxigraph.url}/update", data={"update": "INSERT DATA { <urn:s> <urn:p> 3 }"})
        etag = {"If-None-Match": answer.headers["etag"], **json_type}
        again = client.get("/sparql", params=ask, headers=etag)
        assert again.status_code == 200
        assert len(again.json()["results"]["bindings"]) == 3
        graph = client.get("/sparql", params={"query": "CONSTRUCT WHERE { ?s ?p ?o }"},
                           headers={"Accept": "text/turtle"})  # fmt: skip
        assert "urn:s" in graph.text
        assert client.get("/health/ready").status_code == 200
        assert client.get("/health/live").status_code == 200
        needs: list[tuple[str, str, dict[str, Any]]] = [
            ("POST", "/engine/search_object", {"json": {"data": "eA=="}}),
            ("GET", f"/api/blobs/{'0' * 64}", {}),
            ("PUT", "/store?graph=urn:g", {"content": b"", "headers": {
                "Content-Type": "text/turtle"}}),
        ]  # fmt: skip
        for method, path, options in needs:
            refused = client.request(method, path, **options)
            assert (refused.status_code, path) == (501, path), refused.text
            assert "needs the embedded store" in refused.json()["detail"]
        assert client.get("/sparql", params={"query": "SELECT nonsense"}).status_code == 400


@pytest.mark.slow
def test_the_store_is_killed_and_restarted_under_load(
    oxigraph: Oxigraph, fronted: RunningServer
) -> None:
    """Reads fail or wait, no update runs twice, acknowledged ones stay, no restart is needed."""
    stop = threading.Event()
    acknowledged: list[int] = []
    statuses: list[int] = []

    def write() -> None:
        with httpx.Client(base_url=fronted.url, timeout=60) as client:
            for number in range(100_000):
                if stop.is_set():
                    return
                text = (
                    "INSERT { <urn:n> <urn:is> ?next } WHERE "
                    f"{{ BIND(CONCAT('{number}-', STRUUID()) AS ?next) }}"
                )
                done = client.post("/update", data={"update": text})
                statuses.append(done.status_code)
                if done.status_code == 204:
                    acknowledged.append(number)

    def read() -> None:
        with httpx.Client(base_url=fronted.url, timeout=60) as client:
            while not stop.is_set():
                params = {"query": "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }", "timeout": "5"}
                statuses.append(client.get("/sparql", params=params).status_code)

    threads = [threading.Thread(target=target) for target in (write, read, read)]
    for thread in threads:
        thread.start()
    for _ in range(3):
        _wait_for_more(acknowledged, 2)  # it is in the midst of work
        oxigraph.kill()
        _wait_for_more(statuses, 3)  # and is missed
        oxigraph.start()
    _wait_for_more(acknowledged, 5)  # it goes on by itself
    stop.set()
    for thread in threads:
        thread.join(60)
    assert set(statuses) <= {200, 204, 503, 504}, sorted(set(statuses))
    rows = httpx.get(
        f"{fronted.url}/sparql",
        params={"query": "SELECT ?o { <urn:n> <urn:is> ?o }"},
        headers={"Accept": "application/sparql-results+json"},
    ).json()["results"]["bindings"]
    stored = [int(row["o"]["value"].split("-")[0]) for row in rows]
    assert len(stored) == len(set(stored))  # each update makes a new value: none ran twice
    # A killed process cannot lose what the system has taken over.
    assert set(acknowledged) <= set(stored)


def _wait_for_more(of: list[int], number: int) -> None:
    wanted = len(of) + number
    deadline = time.monotonic() + 60
    while len(of) < wanted:
        assert time.monotonic() < deadline, "it did not go on by itself"
        time.sleep(0.02)


def test_a_robot_hears_over_the_websocket_too_what_is_not_possible(
    fronted: RunningServer,
) -> None:
    import json

    from websockets.sync.client import connect

    with connect(fronted.websocket) as robot:
        robot.send(json.dumps({"op": "call_service", "service": "/rtask/search_object"}))
        answer = json.loads(robot.recv(timeout=60))
    assert answer["result"] is False
    assert "needs the embedded store" in answer["values"]
