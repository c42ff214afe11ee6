"""The same calls against a server that others wrote: `oxigraph serve`, killed and started again."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

import rtask
from rtask.errors import QuerySyntaxError, RemoteUnavailableError
from rtask.rdf.terms import iri, literal
from rtask.remote import transport as wire

pytestmark = pytest.mark.slow  # starts servers or robots

_START_S = 30.0


def _program() -> str:
    beside = Path(sys.executable).with_name("oxigraph")
    found = str(beside) if beside.exists() else shutil.which("oxigraph")
    if found is None:
        pytest.skip("no oxigraph server; pip install oxigraph")
    return found


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


class Server:
    """A process of ``oxigraph serve`` on a folder."""

    def __init__(self, folder: Path) -> None:
        self.port = _free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self._command = [_program(), "serve", "--union-default-graph", "--location", str(folder)]
        self._command += ["--bind", f"127.0.0.1:{self.port}"]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it and wait until it answers."""
        self._process = subprocess.Popen(
            self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + _START_S
        while True:
            try:
                httpx.post(
                    self.url + "/query",
                    content="ASK {}",
                    headers={"Content-Type": "application/sparql-query"},
                )
                return
            except httpx.TransportError:
                assert time.monotonic() < deadline, "the server does not answer"
                time.sleep(0.05)

    def kill(self) -> None:
        """End it at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    @property
    def address(self) -> str:
        """What :func:`rtask.open` takes."""
        return f"sparql+{self.url}/?query=/query&update=/update&store=/store"


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(wire, "_PAUSE_S", 0.01)
    running = Server(tmp_path / "store")
    running.start()
    yield running
    running.kill()


def test_reads_writes_transactions_and_loads(server: Server) -> None:
    with rtask.open(server.address) as kb:
        with kb.transaction() as tx:
            tx.add("urn:mug", "urn:mass", 0.31, graph="urn:g")
            tx.add("urn:mug", "urn:name", literal('Becher \\ " \n ☕'), graph="urn:g")
            tx.add("urn:mug", "urn:mass", 0.32, graph="urn:h")
        assert len(kb.match("urn:mug")) == 3
        assert len(kb.match("urn:mug", graph="urn:h")) == 1
        rows = kb.select("SELECT ?n { ?s <urn:name> ?n }", bindings={"s": iri("urn:mug")})
        assert rows.to_dicts() == [{"n": 'Becher \\ " \n ☕'}]
        kb.update("DELETE { GRAPH <urn:g> { ?s ?p ?o } } WHERE { ?s ?p ?o }", using=["urn:g"])
        assert kb.load(b"<urn:a> <urn:p> [ <urn:q> 1, 2 ] .", format="turtle", graph="urn:g") == 3
        assert kb.query("ASK { <urn:a> <urn:p>/<urn:q> 1, 2 }") is True
        triples = kb.query("CONSTRUCT { ?s ?p ?o } { ?s ?p ?o FILTER(isNumeric(?o)) }")
        assert len(list(triples)) == 3  # type: ignore[arg-type]
        with pytest.raises(QuerySyntaxError):
            kb.query("SELECT * {")


def test_a_transaction_that_fails_sends_nothing(server: Server) -> None:
    with rtask.open(server.address) as kb:
        with pytest.raises(AttributeError), kb.transaction() as tx:
            tx.add("urn:a", "urn:p", 1).no_such_method()  # type: ignore[attr-defined]
        assert kb.query("ASK { ?s ?p ?o }") is False


def test_reads_fail_clearly_while_it_is_down_and_go_on_after_it(server: Server) -> None:
    with rtask.open(server.address) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        server.kill()
        with pytest.raises(RemoteUnavailableError, match=f"127.0.0.1:{server.port}/query"):
            kb.query("ASK { ?s ?p ?o }")
        with pytest.raises(RemoteUnavailableError, match="/update"):
            kb.update("INSERT DATA { <urn:b> <urn:p> 1 }")
        server.start()
        assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
        assert kb.query("ASK { <urn:b> ?p ?o }") is False


def test_updates_between_kills_run_once_or_not_at_all(server: Server) -> None:
    """Each update counts one up; no acknowledged one is lost, none runs twice."""
    count = (
        "DELETE { <urn:c> <urn:n> ?n } INSERT { <urn:c> <urn:n> ?m ; <urn:seen> ?m } "
        "WHERE { <urn:c> <urn:n> ?n BIND(?n + 1 AS ?m) }"
    )
    with rtask.open(server.address) as kb:
        kb.update("INSERT DATA { <urn:c> <urn:n> 0 }")
        acknowledged = unsure = 0
        for turn in range(12):
            if turn % 4 == 3:
                server.kill()
            try:
                kb.update(count)
                acknowledged += 1
            except RemoteUnavailableError:
                unsure += 1
            if turn % 4 == 3:
                server.start()
        [row] = kb.select("SELECT ?n { <urn:c> <urn:n> ?n }")
    assert acknowledged <= int(str(row.value("n"))) <= acknowledged + unsure
    assert (acknowledged, unsure) == (9, 3)
