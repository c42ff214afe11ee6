"""Queries that run long, answers that are large, clients that read late or leave."""

from __future__ import annotations

import array
import fcntl
import gzip
import json
import socket
import termios
import threading
import time
from collections.abc import Iterator

import httpx
import pytest

from endpoint.sparql.answers import QUICK_S
from rtask.sparql.query_cost import is_quick
from tests.processes import wait_until
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

ROWS = 20_000
# Each pair of rows is looked at and none fits: no byte of an answer before the end of time.
ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"
ALL = "SELECT * { ?s <urn:text> ?text }"
ON_SHELF = "SELECT * { ?s <urn:on> <urn:shelf> ; <urn:text> ?text }"
CSV = {"Accept": "text/csv"}


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """A server with 20,000 statements of 800 bytes: 16 MB of answer."""
    folder = tmp_path_factory.mktemp("long") / "store"
    with running_server(folder, "--max-rows", "30000", "--profile", "plain") as running:
        filler = "x" * 800
        lines = "".join(f'<urn:s{i}> <urn:text> "{filler}{i}" .\n' for i in range(ROWS))
        shelf = "".join(f"<urn:s{i}> <urn:on> <urn:shelf> .\n" for i in range(ROWS))
        for graph, content in (("graph=urn:texts", lines), ("default", lines + shelf)):
            answer = httpx.post(
                f"{running.url}/store?{graph}",
                content=content,
                headers={"Content-Type": "application/n-triples"},
                timeout=60,
            )
            assert answer.status_code in (200, 201, 204)
        yield running


@pytest.fixture
def asker(full: RunningServer) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=full.url, timeout=60) as client:
        yield client


def running(client: httpx.Client) -> list[dict[str, object]]:
    found: list[dict[str, object]] = client.get("/queries").json()["queries"]
    return found


def raw_request(server: RunningServer, query: str, version: str = "1.1") -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", server.port), timeout=60)
    connection.sendall(
        (
            f"POST /query HTTP/{version}\r\nHost: 127.0.0.1\r\nAccept: text/csv\r\n"
            "Content-Type: application/sparql-query\r\n"
            f"Content-Length: {len(query)}\r\n\r\n{query}"
        ).encode()
    )
    return connection


def read_to_end(connection: socket.socket) -> bytes:
    pieces = []
    while piece := connection.recv(1 << 16):
        pieces.append(piece)
    return b"".join(pieces)


def test_queries_end_at_their_limit(asker: httpx.Client, full: RunningServer) -> None:
    answers: list[httpx.Response] = []

    def ask() -> None:
        data = {"query": ENDLESS, "timeout": "1"}
        answers.append(httpx.post(f"{full.url}/query", data=data, timeout=60))

    askers = [threading.Thread(target=ask) for _ in range(3)]
    for thread in askers:
        thread.start()
    for thread in askers:
        thread.join()
    assert [answer.status_code for answer in answers] == [504] * 3
    assert answers[0].json()["type"] == "/errors/query-timeout"
    assert "timeout=" in answers[0].json()["detail"]
    wait_until(lambda: not running(asker))


def test_others_are_answered_while_more_queries_run_than_there_are_readers(
    asker: httpx.Client, full: RunningServer
) -> None:
    endless = [f"endless-{number}" for number in range(8)]
    sorted_rows: list[httpx.Response] = []

    def ask(name: str) -> None:
        data = {"query": ENDLESS, "timeout": "60"}
        httpx.post(f"{full.url}/query", data=data, headers={"RTASK-Request-Id": name}, timeout=90)

    def sort() -> None:  # which waits for a reader that is free
        query = {"query": "SELECT ?o { <urn:s1> <urn:text> ?o } ORDER BY ?o", "timeout": "60"}
        sorted_rows.append(httpx.get(f"{full.url}/query", params=query, timeout=90))

    def listed() -> set[object]:
        return {query["id"] for query in running(asker)} & {*endless}

    askers = [threading.Thread(target=ask, args=(name,)) for name in endless]
    sorter = threading.Thread(target=sort)
    for thread in askers:
        thread.start()
    wait_until(listed)
    sorter.start()
    before = listed()
    for number in range(5):
        lookup = {"query": f"SELECT ?t {{ <urn:s{number}> <urn:text> ?t }}"}
        assert asker.get("/query", params=lookup).status_code == 200
    assert before
    assert before <= listed(), "an endless query ended before others were answered"
    # Stopped one by one, so that those which waited run and are listed in their turn.
    while any(thread.is_alive() for thread in askers):
        for name in sorted(map(str, listed())):
            asker.delete(f"/queries/{name}")
        time.sleep(0.02)
    sorter.join()
    assert sorted_rows[0].status_code == 200
    wait_until(lambda: not running(asker))


def test_a_running_query_is_listed_and_stopped(asker: httpx.Client, full: RunningServer) -> None:
    answers: list[httpx.Response] = []

    def ask() -> None:
        headers = {"RTASK-Request-Id": "stop-me-please"}
        data = {"query": ENDLESS, "timeout": "60"}
        answers.append(httpx.post(f"{full.url}/query", data=data, headers=headers, timeout=90))

    thread = threading.Thread(target=ask)
    thread.start()
    wait_until(lambda: any(query["id"] == "stop-me-please" for query in running(asker)))
    assert asker.delete("/queries/not-that-one").status_code == 404
    assert asker.delete("/queries/stop-me-please").status_code == 204
    thread.join(60)
    assert not thread.is_alive()
    assert answers[0].status_code == 503
    assert "stopped" in answers[0].json()["detail"]
    wait_until(lambda: not running(asker))


def test_a_client_that_leaves_ends_its_query(asker: httpx.Client, full: RunningServer) -> None:
    connection = raw_request(full, ENDLESS)
    wait_until(lambda: running(asker))
    connection.close()
    wait_until(lambda: not running(asker))


def is_full(connection: socket.socket) -> bool:
    """Whether something arrived and no more comes: the server waits until it is read."""

    def unread() -> int:
        fcntl.ioctl(connection, termios.FIONREAD, size)
        return size[0]

    size = array.array("i", [0])
    before = unread()
    time.sleep(0.1)
    return 0 < before == unread()


def test_a_large_answer_is_whole_for_who_reads_late(full: RunningServer) -> None:
    connection = raw_request(full, ALL)
    wait_until(lambda: is_full(connection))
    text = b""
    while b"\r\n0\r\n\r\n" not in text[-16:]:
        piece = connection.recv(1 << 20)
        assert piece, "cut off"
        text += piece
    connection.close()
    assert text.startswith(b"HTTP/1.1 200")
    assert text.count(b"urn:s") == ROWS


def test_a_large_answer_to_a_query_that_looks_quick_is_whole_for_a_slow_reader(
    full: RunningServer,
) -> None:
    assert is_quick(ON_SHELF)
    text, pauses = b"", 0
    with raw_request(full, ON_SHELF) as connection:
        while b"\r\n0\r\n\r\n" not in text[-16:]:
            if len(text) > pauses * 1_000_000 and pauses < 4:
                time.sleep(QUICK_S * 0.7)  # most of the answer leaves after a quick query's time
                pauses += 1
            piece = connection.recv(1 << 16)
            assert piece, "cut off"
            text += piece
    assert text.startswith(b"HTTP/1.1 200")
    assert text.count(b"urn:s") == ROWS


def test_slow_readers_of_quick_looking_queries_leave_readers_for_others(
    asker: httpx.Client, full: RunningServer
) -> None:
    slow = [raw_request(full, ON_SHELF) for _ in range(8)]  # more than there are readers
    for connection in slow[:2]:
        connection.recv(1_000)
    answer = asker.get(
        "/query", params={"query": "SELECT ?t { <urn:s7> <urn:on> ?t FILTER(1 = 1) }"}
    )
    assert answer.status_code == 200
    for connection in slow:
        connection.close()
    wait_until(lambda: not running(asker))


def test_a_client_that_leaves_in_the_middle_frees_its_reader(
    asker: httpx.Client, full: RunningServer
) -> None:
    for _ in range(8):  # more than there are readers
        connection = raw_request(full, ALL)
        connection.recv(1_000)
        connection.close()
    answer = asker.post("/query", data={"query": ALL}, headers=CSV)
    assert answer.text.count("urn:s") == ROWS
    wait_until(lambda: not running(asker))


def test_an_answer_beyond_the_rows_is_broken_off_and_never_ends_well(asker: httpx.Client) -> None:
    wide = "SELECT * { ?s <urn:text> ?t . VALUES ?n { 1 2 3 } }"
    with pytest.raises(httpx.RemoteProtocolError, match=r"incomplete|peer closed"):
        asker.post("/query", data={"query": wide}, headers=CSV)


def test_large_answers_come_packed(asker: httpx.Client) -> None:
    with asker.stream(
        "POST", "/query", data={"query": ALL}, headers={**CSV, "Accept-Encoding": "gzip"}
    ) as answer:
        assert answer.headers["content-encoding"] == "gzip"
        packed = b"".join(answer.iter_raw())
    assert len(packed) < 4_000_000
    assert gzip.decompress(packed).count(b"urn:s") == ROWS


def test_before_http_1_1_an_answer_says_its_length(full: RunningServer) -> None:
    with raw_request(full, ALL, "1.0") as connection:
        answer = read_to_end(connection)
    head, _, body = answer.partition(b"\r\n\r\n")
    assert b"transfer-encoding" not in head.lower()
    length = next(x for x in head.lower().split(b"\r\n") if x.startswith(b"content-length"))
    assert int(length.split(b":")[1]) == len(body)
    assert body.count(b"urn:s") == ROWS


def test_a_whole_graph_comes_in_pieces_too(asker: httpx.Client) -> None:
    accept = {"Accept": "application/n-triples"}
    answer = asker.get("/store?graph=urn:texts", headers=accept)
    assert answer.text.count("<urn:text>") == ROWS
    assert "content-length" not in answer.headers
    everything = asker.get("/store", headers={"Accept": "application/n-quads"})
    assert everything.text.count("<urn:text>") == 2 * ROWS


def test_memory_of_the_server_stays_flat_while_it_sends(
    asker: httpx.Client, full: RunningServer
) -> None:
    def resident() -> float:
        text = asker.get("/metrics").text
        line = next(x for x in text.splitlines() if x.startswith("process_resident"))
        return float(line.split()[1])

    asker.post("/query", data={"query": ALL}, headers=CSV)
    before = resident()
    for _ in range(5):
        asker.post("/query", data={"query": ALL}, headers=CSV)
    # 80 MB went out; what is kept of it would show.
    assert resident() - before < 24 << 20


def test_json_of_a_large_answer_is_json(asker: httpx.Client) -> None:
    answer = asker.post("/query", data={"query": ALL}, headers={"Accept": "application/json"})
    assert len(json.loads(answer.text)["results"]["bindings"]) == ROWS
