"""README's own transaction against a server: who writes, and why, is in the server's records."""

from __future__ import annotations

import httpx
import pytest

import rtask
from rtask.errors import AccessError, UnsupportedError
from tests.servers import RunningServer

NOTES = """PREFIX prov: <http://www.w3.org/ns/prov#>
SELECT ?note WHERE {
  ?commit a prov:Activity ; ?says ?note FILTER(CONTAINS(STR(?note), "table")) }"""


def add_mug(kb: rtask.Graph, name: str, agent: str | None, note: str | None = None) -> None:
    with kb.transaction(agent=agent, note=note) as tx:
        tx.add(f"urn:{name}", "urn:mass", 0.31)


def graphs_of(kb: rtask.Graph, name: str) -> list[str]:
    return [str(quad.graph_name) for quad in kb.match(f"urn:{name}", "urn:mass")]


def test_without_tokens_who_writes_is_whom_it_names(server: RunningServer) -> None:
    with rtask.open(server.url + "/sparql") as kb:
        add_mug(kb, "one", "nao-1", "a mug on the table")
        add_mug(kb, "two", None)
        (mine,) = graphs_of(kb, "one")
        assert mine.endswith("/graph/agent/nao-1>")
        (shared,) = graphs_of(kb, "two")
        assert shared.endswith("/graph/shared>")
        notes = [str(row.value("note")) for row in kb.select(NOTES)]
        assert any(note.startswith("a mug on the table (request") for note in notes)
        kb.update("DELETE WHERE { GRAPH ?g { <urn:one> ?p ?o } }", agent="nao-1", note="wrong")
        assert not graphs_of(kb, "one")


def test_who_shows_a_token_is_its_agent(guarded: RunningServer, make_token) -> None:
    token = make_token("--robot", "nao-1")
    with rtask.open(guarded.url + "/sparql", token=token) as kb:
        add_mug(kb, "three", "nao-1")
        assert graphs_of(kb, "three")[0].endswith("/graph/agent/nao-1>")
        with pytest.raises(AccessError, match="belongs to 'nao-1'"):
            add_mug(kb, "four", "nao-2")
        assert not graphs_of(kb, "four")


def test_a_bare_dataset_keeps_no_authors(server: RunningServer) -> None:
    with (
        rtask.open(server.url + "/sparql", plain=True) as kb,
        pytest.raises(UnsupportedError, match="neither agents nor notes"),
    ):
        add_mug(kb, "five", "nao-1")


@pytest.mark.parametrize(
    "fields",
    [{"note": "x" * 501}, {"agent": "a\nb"}, {"agent": ["a", "b"]}],
    ids=["long", "two lines", "two names"],
)
def test_what_is_no_name_or_note_is_refused(
    client: httpx.Client, fields: dict[str, str | list[str]]
) -> None:
    update = "INSERT DATA { <urn:six> <urn:p> 1 }"
    answer = client.post("/update", data={"update": update, **fields})
    assert answer.status_code == 400
    assert "printable characters" in answer.json()["detail"]
    ask = client.get("/sparql", params={"query": "ASK { <urn:six> ?p ?o }"})
    assert ask.json()["boolean"] is False
