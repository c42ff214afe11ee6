"""A robot writes its own graph and no other, whichever way it tries."""

from __future__ import annotations

import json
from urllib.parse import quote

import httpx
import pytest
from websockets.sync.client import connect

from ontology import PREFIXES
from rtask.rdf.namespaces import owned_uuid7
from tests.servers import RunningServer

pytestmark = pytest.mark.slow

TURTLE = {"Content-Type": "text/turtle"}
MARK = "<urn:mark> <urn:p> 1"


def graph_of(base: str, name: str) -> str:
    return f"{base}graph/agent/{name}"


def update(client: httpx.Client, text: str) -> httpx.Response:
    return client.post("/update", data={"update": text})


def content(client: httpx.Client, graph: str) -> list[str]:
    answer = client.get(
        f"/store?graph={quote(graph, safe='')}", headers={"Accept": "application/n-triples"}
    )
    return sorted(answer.text.splitlines()) if answer.status_code == 200 else []


def test_a_robots_statements_go_to_its_own_graph(nao_1: httpx.Client, base: str) -> None:
    assert update(nao_1, "INSERT DATA { <urn:nao-1:cup> <urn:p> 1 }").status_code == 204
    assert any("urn:nao-1:cup" in line for line in content(nao_1, graph_of(base, "nao-1")))
    put = nao_1.post("/store?default", content="<urn:nao-1:pot> <urn:p> 1 .", headers=TURTLE)
    assert put.status_code in (201, 204)
    assert any("urn:nao-1:pot" in line for line in content(nao_1, graph_of(base, "nao-1")))


OTHER = "{base}graph/agent/nao-1"
ATTACKS = [
    "INSERT DATA {{ GRAPH <" + OTHER + "> {{ <urn:evil> <urn:p> 1 }} }}",
    "DELETE WHERE {{ GRAPH ?g {{ <urn:mark> ?p ?o }} }}",
    "DELETE {{ GRAPH ?g {{ <urn:mark> ?p ?o }} }} WHERE {{ GRAPH ?g {{ <urn:mark> ?p ?o }} }}",
    "INSERT {{ GRAPH ?g {{ <urn:evil> <urn:p> 1 }} }} WHERE {{ GRAPH ?g {{ <urn:mark> ?p ?o }} }}",
    "INSERT {{ GRAPH ?g {{ <urn:evil> <urn:p> 1 }} }} WHERE {{ BIND(IRI('" + OTHER + "') AS ?g) }}",
    "WITH <" + OTHER + "> DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o }}",
    "CLEAR GRAPH <" + OTHER + ">",
    "DROP GRAPH <" + OTHER + ">",
    "COPY GRAPH <" + OTHER.replace("nao-1", "nao-2") + "> TO GRAPH <" + OTHER + ">",
    "MOVE GRAPH <" + OTHER + "> TO GRAPH <" + OTHER.replace("nao-1", "nao-2") + ">",
    "ADD GRAPH <" + OTHER.replace("nao-1", "nao-2") + "> TO GRAPH <" + OTHER + ">",
    "PREFIX a: <{base}graph/agent/> INSERT DATA {{ GRAPH a:nao-1 {{ <urn:evil> <urn:p> 1 }} }}",
    "BASE <{base}graph/agent/> INSERT DATA {{ GRAPH <nao-1> {{ <urn:evil> <urn:p> 1 }} }}",
    "INSERT DATA {{ GRAPH <{base}graph/agent/n\\u0061o-1> {{ <urn:evil> <urn:p> 1 }} }}",
    "INSERT DATA {{ <urn:fine> <urn:p> 1 }} ; CLEAR GRAPH <" + OTHER + ">",
    "CREATE GRAPH <{base}graph/agent/nao-3>",
]


@pytest.mark.parametrize("attack", ATTACKS)
def test_another_robots_graph_is_out_of_reach_by_update(
    nao_1: httpx.Client, nao_2: httpx.Client, base: str, attack: str
) -> None:
    update(nao_1, f"INSERT DATA {{ {MARK} }}")
    update(nao_2, "INSERT DATA { <urn:of:nao-2> <urn:p> 1 }")
    before = content(nao_1, graph_of(base, "nao-1")), content(nao_2, graph_of(base, "nao-2"))
    refused = update(nao_2, attack.format(base=base))
    assert refused.status_code == 403, refused.text
    assert refused.json()["type"] == "/errors/graph-forbidden"
    assert refused.json()["graph"].startswith(f"{base}graph/agent/nao-")
    after = content(nao_1, graph_of(base, "nao-1")), content(nao_2, graph_of(base, "nao-2"))
    assert after == before


@pytest.mark.parametrize("method", ["PUT", "POST", "DELETE"])
def test_another_robots_graph_is_out_of_reach_by_the_graph_store(
    nao_1: httpx.Client, nao_2: httpx.Client, base: str, method: str
) -> None:
    update(nao_1, f"INSERT DATA {{ {MARK} }}")
    graph = graph_of(base, "nao-1")
    before = content(nao_1, graph)
    body = b"" if method == "DELETE" else b"<urn:evil> <urn:p> 1 ."
    refused = nao_2.request(
        method, f"/store?graph={quote(graph, safe='')}", content=body, headers=TURTLE
    )
    assert refused.status_code == 403
    assert refused.json()["graph"] == graph
    assert content(nao_1, graph) == before


def test_clearing_everything_clears_only_what_is_ones_own(
    nao_1: httpx.Client, nao_2: httpx.Client, base: str
) -> None:
    update(nao_1, f"INSERT DATA {{ {MARK} }}")
    before = content(nao_1, graph_of(base, "nao-1"))
    update(nao_2, "INSERT DATA { <urn:of:nao-2> <urn:p> 1 }")
    assert update(nao_2, "CLEAR ALL").status_code == 204
    assert content(nao_2, graph_of(base, "nao-2")) == []
    assert content(nao_1, graph_of(base, "nao-1")) == before


@pytest.mark.parametrize("name", ["inferred", "meta", "provenance"])
def test_not_even_an_admin_writes_what_the_knowledge_base_keeps(
    guarded: RunningServer, make_token: object, base: str, name: str
) -> None:
    token = make_token("--role", "admin")  # type: ignore[operator]
    headers = {"Authorization": f"Bearer {token}"}
    text = f"INSERT DATA {{ GRAPH <{base}graph/{name}> {{ {MARK} }} }}"
    refused = httpx.post(f"{guarded.url}/update", data={"update": text}, headers=headers)
    assert refused.status_code == 403


def test_without_a_token_one_reads_but_does_not_write(
    guarded: RunningServer, nao_1: httpx.Client
) -> None:
    query = httpx.get(f"{guarded.url}/sparql", params={"query": "ASK {}"})
    assert query.json()["boolean"] is True
    refused = httpx.post(f"{guarded.url}/update", data={"update": "CLEAR ALL"})
    assert refused.status_code == 401
    assert refused.headers["www-authenticate"] == 'Bearer realm="rtask"'


def test_a_reader_may_not_write(guarded: RunningServer, make_token: object) -> None:
    token = make_token("--role", "reader")  # type: ignore[operator]
    refused = httpx.post(
        f"{guarded.url}/update",
        data={"update": "CLEAR ALL"},
        headers={"Authorization": f"Bearer {token}"},
    )
    assert refused.status_code == 403
    assert "needs scope write" in refused.json()["detail"]


def test_a_wrong_token_opens_nothing_not_even_reading(guarded: RunningServer) -> None:
    wrong = {"Authorization": f"Bearer rtk_{'0' * 12}_{'0' * 32}"}
    refused = httpx.get(f"{guarded.url}/sparql", params={"query": "ASK {}"}, headers=wrong)
    assert refused.status_code == 401
    assert 'error="invalid_token"' in refused.headers["www-authenticate"]


def test_a_foreign_page_cannot_update_without_a_token(server: RunningServer) -> None:
    """A form POST needs no preflight, so the server itself must look at the Origin."""
    refused = httpx.post(
        f"{server.url}/sparql",
        data={"update": "CLEAR ALL"},
        headers={"Origin": "http://evil.example"},
    )
    assert refused.status_code == 403


def test_a_rebound_name_is_not_this_server(server: RunningServer) -> None:
    refused = httpx.get(f"{server.url}/", headers={"Host": "evil.example"})
    assert refused.status_code == 403


ROBOT = {
    "model": "Nao",
    "end_effectors": [
        {"name": "right_hand", "kind": "ParallelJawGripper", "gripper_type": "two_finger",
         "max_opening": 0.08, "max_payload": 0.5}
    ],
}  # fmt: skip


def test_no_way_in_lets_a_robot_name_the_hand_or_the_task_of_another(
    nao_1: httpx.Client, nao_2: httpx.Client, guarded: RunningServer, base: str
) -> None:
    for robot, name in ((nao_1, "nao-1"), (nao_2, "nao-2")):
        stored = robot.post("/engine/register_robot", json={"name": name, **ROBOT})
        assert stored.status_code == 200, stored.text
    failed = {"success": False, "reason": "missed", "object": f"{base}object/1"}
    hand = f"{base}robot/nao-1/right_hand"
    task = f"{base}task/{owned_uuid7('nao-1')}"
    named = {
        hand: {**failed, "gripper_id": hand},
        task: {**failed, "gripper_id": "right_hand", "task_id": task},
    }
    with connect(
        guarded.websocket, additional_headers={"Authorization": nao_2.headers["Authorization"]}
    ) as robot:
        for full_id, report in named.items():
            ways = {
                "operation": nao_2.post("/engine/report_outcome", json=report),
                "service": nao_2.post("/services/rtask/Engine/report_outcome", json=report),
            }
            for way, answer in ways.items():
                assert answer.status_code == 403, (way, answer.text)
                assert full_id in answer.json()["detail"], way
            call = {"op": "call_service", "service": "/rtask/report_outcome", "args": report}
            robot.send(json.dumps(call))
            refused = json.loads(robot.recv(timeout=60))
            assert (refused["result"], refused["status"]) == (False, 403)
            assert full_id in refused["values"]


def test_neither_a_job_nor_a_branch_nor_a_load_names_another_robot(
    nao_1: httpx.Client, nao_2: httpx.Client, base: str
) -> None:
    for robot, name in ((nao_1, "nao-1"), (nao_2, "nao-2")):
        robot.post("/engine/register_robot", json={"name": name, **ROBOT})
    hand = f"{base}robot/nao-1/right_hand"
    failed = {"success": False, "reason": "missed", "object": f"{base}object/1"}
    made = nao_2.post(
        "/services/rtask/Engine/report_outcome", json={**failed, "gripper_id": hand},
        headers={"Prefer": "respond-async"},
    )  # fmt: skip
    assert made.status_code == 202, made.text
    ended = nao_2.get(made.json()["href"], params={"wait": 60}).json()
    assert ended["state"] == "failed"
    assert hand in json.dumps(ended)
    named = f"<urn:grasp> <{PREFIXES['rt']}performedBy> <{base}robot/nao-1>"
    own = quote(graph_of(base, "nao-2"), safe="")
    nao_2.post("/branches", json={"name": "mine"}).raise_for_status()
    ways = {
        "branch": nao_2.post("/update?branch=mine", data={"update": f"INSERT DATA {{ {named} }}"}),
        "load": nao_2.post(f"/store?graph={own}", content=f"{named} .", headers=TURTLE),
    }
    for way, answer in ways.items():
        assert answer.status_code == 403, (way, answer.text)
        assert "which is 'nao-1'" in answer.json()["detail"]
