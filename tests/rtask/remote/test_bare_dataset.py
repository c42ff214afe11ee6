"""A bare dataset on a server that others wrote: `oxigraph serve`, killed and started again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.errors import QuerySyntaxError, RemoteUnavailableError
from rtask.rdf.terms import iri, literal
from rtask.remote import transport as wire
from tests.sparql_servers import OXIGRAPH, Oxigraph

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(OXIGRAPH is None, reason="no oxigraph server; pip install oxigraph"),
]


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Oxigraph]:
    monkeypatch.setattr(wire, "_PAUSE_S", 0.01)
    running = Oxigraph(tmp_path / "store", union=True)
    running.start()
    yield running
    running.kill()


def test_reads_writes_transactions_and_loads(server: Oxigraph) -> None:
    with rtask.open(server.address, plain=True) as kb:
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


def test_a_transaction_that_fails_sends_nothing(server: Oxigraph) -> None:
    with rtask.open(server.address, plain=True) as kb:
        with pytest.raises(AttributeError), kb.transaction() as tx:
            tx.add("urn:a", "urn:p", 1).no_such_method()  # type: ignore[attr-defined]
        assert kb.query("ASK { ?s ?p ?o }") is False


def test_reads_fail_clearly_while_it_is_down_and_go_on_after_it(server: Oxigraph) -> None:
    with rtask.open(server.address, plain=True) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        server.kill()
        with pytest.raises(RemoteUnavailableError, match=f"127.0.0.1:{server.port}/query"):
            kb.query("ASK { ?s ?p ?o }")
        with pytest.raises(RemoteUnavailableError, match="/update"):
            kb.update("INSERT DATA { <urn:b> <urn:p> 1 }")
        server.start()
        assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
        assert kb.query("ASK { <urn:b> ?p ?o }") is False


def test_updates_between_kills_run_once_or_not_at_all(server: Oxigraph) -> None:
    """Each update counts one up; no acknowledged one is lost, none runs twice."""
    count = (
        "DELETE { <urn:c> <urn:n> ?n } INSERT { <urn:c> <urn:n> ?m ; <urn:seen> ?m } "
        "WHERE { <urn:c> <urn:n> ?n BIND(?n + 1 AS ?m) }"
    )
    with rtask.open(server.address, plain=True) as kb:
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
