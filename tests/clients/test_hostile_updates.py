"""Updates that would end the server: each ends within its limit and hurts nobody else."""

from __future__ import annotations

import contextlib
import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from tests.servers import STOP_S, RunningServer, bearer, running_server

pytestmark = pytest.mark.slow

UPDATE = {"Content-Type": "application/sparql-update"}
GROW = "INSERT { <urn:s> <urn:p> ?z } WHERE { <urn:s> <urn:p> ?x BIND(CONCAT(?x, ?x) AS ?z) }"
# The default time of an update is 5 s. The rest is room for a machine with other work to do.
PATIENCE_S = 5.0 + 25.0


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with running_server(tmp_path_factory.mktemp("hostile") / "store") as running:
        data = " . ".join(f"<urn:a{i}> <urn:b> {i % 7}" for i in range(400))
        answer = httpx.post(
            f"{running.url}/update",
            content=f"INSERT DATA {{ {data} . <urn:s> <urn:p> 'xxxxxxxxxx' }}",
            headers=UPDATE,
        )
        assert answer.status_code == 204
        yield running


def resident(server: RunningServer) -> int:
    """Return the memory of the server and all its children, in bytes."""
    return sum(memory.rss for memory in of_each(server, psutil.Process.memory_info))


def spent_s(server: RunningServer) -> float:
    """Return the processor time that the server and its running children took, s."""
    return sum(spent.user + spent.system for spent in of_each(server, psutil.Process.cpu_times))


def of_each(server: RunningServer, measure: Callable[[psutil.Process], Any]) -> list[Any]:
    """Measure the server and those of its children that have not ended."""
    own = psutil.Process(server.process.pid)
    values = []
    for process in (own, *own.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            values.append(measure(process))
    return values


def send(server: RunningServer, text: str) -> httpx.Response:
    return httpx.post(f"{server.url}/update", content=text, headers=UPDATE, timeout=PATIENCE_S + 30)


def test_forty_doublings_in_one_request_leave_the_server_as_it_was(server: RunningServer) -> None:
    before = psutil.Process(server.process.pid).memory_info().rss
    answer = send(server, " ;\n".join([GROW] * 40))
    assert (answer.status_code, answer.json()["limit"]) == (400, "literal")
    assert psutil.Process(server.process.pid).memory_info().rss - before < 100 << 20
    count = httpx.get(
        f"{server.url}/sparql",
        params={"query": "SELECT (COUNT(*) AS ?n) { <urn:s> <urn:p> ?x }"},
        headers={"Accept": "text/csv"},
    )
    assert count.text.split() == ["n", "1"]


def _harmless(rng: random.Random) -> str:
    return rng.choice(
        (
            f"INSERT DATA {{ <urn:h{rng.randrange(99)}> <urn:b> {rng.randrange(9)} }}",
            "DELETE WHERE { <urn:nothing> ?p ?o }",
            "INSERT { <urn:s> <urn:r> ?n } WHERE { <urn:a1> <urn:b> ?n }",
            "CREATE SILENT GRAPH <urn:g>",
        )
    )


def _hostile(rng: random.Random) -> str:
    pairs = " . ".join(f"?a{i} <urn:b> ?b{i}" for i in range(rng.randint(4, 6)))
    steps = " ".join(f"BIND(CONCAT(?x{i}, ?x{i}) AS ?x{i + 1})" for i in range(40))
    return rng.choice(
        (
            " ;\n".join([GROW] * rng.randint(30, 60)),
            f"INSERT {{ ?a0 <urn:c> ?b1 }} WHERE {{ {pairs} }}",
            f"INSERT {{ <urn:s> <urn:c> ?x40 }} WHERE {{ <urn:s> <urn:p> ?x0 {steps} }}",
            "INSERT { ?a <urn:reach> ?c } WHERE { ?a (!<urn:none>|^!<urn:none>)* ?c . "
            "?d (!<urn:none>|^!<urn:none>)* ?e }",
            "INSERT { ?s <urn:u> ?u } WHERE { ?s <urn:b> ?o . ?t <urn:b> ?q . ?v <urn:b> ?w "
            "BIND(UUID() AS ?u) }",
            " ;\n".join(
                ["INSERT { ?s ?p _:n . _:n <urn:b> ?o } WHERE { ?s ?p ?o }"] * rng.randint(15, 30)
            ),
            "INSERT { <urn:s> <urn:n> ?n } WHERE { { SELECT (COUNT(*) AS ?n) { "
            f"{{ SELECT * {{ {pairs} }} }} }} }} }}",
        )
    )


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.deep) for seed in range(2, 6))]
)
def test_a_hostile_update_ends_while_others_are_served(server: RunningServer, seed: int) -> None:
    rng = random.Random(seed)
    steps = [*(_harmless(rng) for _ in range(rng.randint(0, 3))), _hostile(rng)]
    text = " ;\n".join(steps)
    answers: list[httpx.Response] = []
    attacker = threading.Thread(target=lambda: answers.append(send(server, text)))
    attacker.start()
    served = 0
    deadline = time.monotonic() + PATIENCE_S
    with httpx.Client(base_url=server.url, timeout=PATIENCE_S) as client:
        while attacker.is_alive() and time.monotonic() < deadline:
            assert client.get("/health/live").status_code == 200
            insert = f"INSERT DATA {{ <urn:robot> <urn:saw> {seed * 10_000 + served} }}"
            assert client.post("/update", content=insert, headers=UPDATE).status_code == 204
            served += 1
            time.sleep(0.05)
    attacker.join(timeout=60)
    assert answers
    assert answers[0].status_code in (204, 400, 503, 504), answers[0].text
    assert served > 0


ENDS_S = 5.0
"""Processor time between SIGTERM and the end of a server."""
ENDLESS = "SELECT (COUNT(*) AS ?n) { " + " . ".join(f"?a{i} <urn:b> ?b{i}" for i in range(6)) + " }"
CHAIN = " ".join(f"<urn:t{i}> <urn:t> <urn:t{i + 1}> ." for i in range(1_500))
TRANSITIVE = "<urn:t> a <http://www.w3.org/2002/07/owl#TransitiveProperty> ."


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    data = " . ".join(f"<urn:a{i}> <urn:b> {i}" for i in range(400))
    with rtask.open(tmp_path / "store") as kb:
        kb.update(f"INSERT DATA {{ {data} }}")
    return tmp_path / "store"


def stopped_beside(running: RunningServer, work: Callable[[], httpx.Response]) -> httpx.Response:
    """Send SIGTERM while a request is worked on; return its answer, once the server has ended."""
    answers: list[httpx.Response] = []
    before_s = spent_s(running)
    caller = threading.Thread(target=lambda: answers.append(work()))
    caller.start()
    deadline = time.monotonic() + PATIENCE_S
    while spent_s(running) < before_s + 0.3:  # no list names updates; evaluating takes time
        assert not answers, answers
        assert time.monotonic() < deadline
        time.sleep(0.01)
    children = psutil.Process(running.process.pid).children(recursive=True)
    spent = at_signal = spent_s(running)
    running.process.terminate()
    deadline = time.monotonic() + STOP_S
    while running.process.poll() is None:
        assert time.monotonic() < deadline
        with contextlib.suppress(psutil.Error):
            spent = max(spent, spent_s(running))
        time.sleep(0.01)
    # On an idle machine as many seconds of the clock: what is under way would take ten times that.
    assert spent - at_signal < ENDS_S
    assert running.stop() == 0
    caller.join(timeout=60)
    assert not psutil.wait_procs(children, timeout=60)[1]
    return answers[0]


@pytest.mark.parametrize(
    "text",
    [
        f"INSERT {{ <urn:s> <urn:n> ?n }} WHERE {{ {ENDLESS} }}",
        f"INSERT DATA {{ {TRANSITIVE} {CHAIN} }}",
    ],
    ids=["evaluation", "derivation"],
)
def test_sigterm_ends_a_hostile_update_at_once(folder: Path, text: str) -> None:
    with closing(TokenStore(folder)) as tokens:  # an operator's may take minutes
        operator, _ = tokens.create("admin")
    with running_server(folder) as running:
        headers, url = {**UPDATE, **bearer(operator)}, f"{running.url}/update"
        answer = stopped_beside(
            running, lambda: httpx.post(url, content=text, headers=headers, timeout=90)
        )
    assert answer.status_code == 503
    assert "the server is stopping; nothing was stored" in answer.json()["detail"]
    with rtask.open(folder, mode="r") as kb:
        assert kb.query("ASK { <urn:a0> <urn:b> 0 }")
        assert not kb.query("ASK { <urn:s> <urn:n> ?n }")
        assert not kb.query("ASK { <urn:t> ?p ?o }")


def test_sigterm_ends_a_query_soon_and_says_so(folder: Path) -> None:
    with running_server(folder, "--timeout", "600") as running:
        query = {"query": ENDLESS}
        answer = stopped_beside(
            running, lambda: httpx.get(f"{running.url}/sparql", params=query, timeout=90)
        )
    assert (answer.status_code, answer.json()["type"]) == (503, "/errors/query-stopped")
