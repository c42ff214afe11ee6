"""A server of RTASK whose statements are on another server: rights, the engine, the folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

import rtask
from rtask.errors import VersionConflictError
from rtask.model import RTASK
from rtask.remote.served import ServedKnowledgeBase
from tests.commands import run_command
from tests.servers import RunningServer, bearer, running_server
from tests.sparql_servers import OXIGRAPH, Oxigraph

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(OXIGRAPH is None, reason="no oxigraph server; pip install oxigraph"),
]


@pytest.fixture(scope="module")
def oxigraph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Oxigraph]:
    running = Oxigraph(tmp_path_factory.mktemp("oxigraph"))
    running.start()
    yield running
    running.kill()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("served") / "data"


@pytest.fixture(scope="module")
def server(oxigraph: Oxigraph, folder: Path) -> Iterator[RunningServer]:
    with running_server(folder, "--store", oxigraph.address) as running:
        yield running


def _token(folder: Path, *who: str) -> dict[str, str]:
    done = run_command("token", "create", "-d", str(folder), *who, check=True)
    return bearer(done.stdout.strip())


def _select(client: httpx.Client, text: str, **headers: str) -> list[dict[str, Any]]:
    accept = {"Accept": "application/sparql-results+json", **headers}
    answer = client.get("/sparql", params={"query": text}, headers=accept)
    assert answer.status_code == 200, answer.text
    rows: list[dict[str, Any]] = answer.json()["results"]["bindings"]
    return rows


def test_sessions_work_as_over_a_folder(server: RunningServer, folder: Path) -> None:
    token = _token(folder, "--robot", "ann")["Authorization"].removeprefix("Bearer ")
    with rtask.open(server.url + "/sparql", token=token) as kb:
        assert isinstance(kb, ServedKnowledgeBase)
        with kb.session("ann") as s, kb.session("ann") as other:
            pot = RTASK.Mug(iri="urn:pot", object_id="lab/pot-1", mass=0.5)
            s.add(pot)
            s.flush()
            assert pot.mass == 0.5
            pot.mass = 0.7
            other.get(RTASK.Container, "urn:pot").mass = 0.6
            other.flush()
            with pytest.raises(VersionConflictError):
                s.flush()
            s.rollback()
            assert pot.mass == 0.6


def test_robots_write_their_own_graphs_and_everybody_reads_what_follows(
    server: RunningServer, folder: Path
) -> None:
    one, two = _token(folder, "--robot", "nao-1"), _token(folder, "--robot", "nao-2")
    mug = "PREFIX rt: <https://w3id.org/rtask-kg/ns#> INSERT DATA { %s <urn:mug> a rt:Mug %s }"
    with httpx.Client(base_url=server.url, timeout=60) as client:
        stored = client.post("/update", data={"update": mug % ("", "")}, headers=one)
        assert stored.status_code in (200, 204), stored.text
        ours = "GRAPH ?g { <urn:mug> a ?c } FILTER(CONTAINS(STR(?g), 'agent'))"
        [graph] = _select(client, f"SELECT ?g {{ {ours} }}", **two)
        theirs = f"GRAPH <{graph['g']['value']}> {{"
        refused = client.post("/update", data={"update": mug % (theirs, "}")}, headers=two)
        assert refused.status_code == 403, refused.text
        assert "nao-2" in refused.json()["detail"]
        rows = _select(client, "SELECT ?c { <urn:mug> a ?c }", **two)
        classes = {row["c"]["value"] for row in rows}
        assert "https://w3id.org/rtask-kg/ns#Mug" in classes
        assert len(classes) > 1  # and what it is a kind of


def test_the_engine_registers_and_remembers(server: RunningServer, folder: Path) -> None:
    robot = _token(folder, "--robot", "nao-3")
    said = {
        "name": "nao-3",
        "model": "nao-h25-v5",
        "simulated": True,
        "end_effectors": [{"name": "hand", "gripper_type": "nao_hand", "kind": "Hand",
                           "min_opening": 0.0, "max_opening": 0.05, "max_payload": 0.3,
                           "jaw_width": 0.01, "finger_length": 0.05, "max_force": 3.0}],
        "cameras": [],
        "frames": ["base_footprint"],
    }  # fmt: skip
    with httpx.Client(base_url=server.url, timeout=60) as client:
        answer = client.post("/engine/register_robot", json=said, headers=robot)
        assert answer.status_code == 200, answer.text
        rows = _select(client, "SELECT ?r { ?r ?p 'nao-3' }", **robot)
        assert rows
        assert client.get("/health/ready").status_code == 200


def test_the_folder_can_be_opened_in_the_place_of_the_address(
    server: RunningServer, folder: Path
) -> None:
    text = "ASK { ?s a <https://w3id.org/rtask-kg/ns#WriteActivity> }"
    done = run_command("query", "-d", str(folder), text, check=True)
    assert done.stdout == "yes\n"
