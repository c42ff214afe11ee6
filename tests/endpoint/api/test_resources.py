"""`/api/robots`, tasks, objects, outcomes: pages, filters, media types, entity tags, mistakes."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pyoxigraph
import pytest
from flask.testing import FlaskClient
from jsonschema import Draft202012Validator

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.api.collections import COLLECTIONS
from endpoint.api.openapi import document
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.engine import Engine
from rtask.knowledge_base import KnowledgeBase
from tests.servers import new_application

RT, PREFIXES = ontology.NS, ontology.PREFIXES
NAO_1 = "urn:lab/robot/nao-1"


def mug(number: int) -> str:
    """Return the statements of one mug."""
    return f"""
  <urn:lab/object/{number}> a rt:Mug ; rt:objectId "lab/{number}" ; rt:name "mug {number}" ;
    rt:extentX 0.1e0 ; rt:extentY 0.08e0 ; rt:extentZ 0.09e0 ;
    rt:hasGrasp <urn:lab/grasp/{number}> .
  <urn:lab/grasp/{number}> a rt:PlanarGrasp ."""


def attempt(number: int, thing: int, held: bool) -> str:
    """Return the statements of one attempt, at a minute of its own."""
    time = f"2026-01-01T10:{number:02d}:00Z"
    return f"""
  <urn:lab/task/{number}> a rt:Grasp ; rt:handles <urn:lab/object/{thing}> ;
    rt:through <urn:lab/attempt/{number}> .
  <urn:lab/attempt/{number}> a rt:GraspAttempt ; rt:performedBy <{NAO_1}> ;
    rt:executesGrasp <urn:lab/grasp/{thing}> ; rt:requestId "urn:t:{number}" ;
    rt:hasOutcome <urn:lab/outcome/{number}> ; prov:endedAtTime "{time}"^^xsd:dateTime .
  <urn:lab/outcome/{number}> a rt:GraspOutcome ; rt:success {str(held).lower()} ;
    rt:hasReason rt:reason_{"ok" if held else "slip_lift"} ."""


FACTS = f"""
{" ".join(f"PREFIX {name}: <{PREFIXES[name]}>" for name in ("rt", "prov", "cora", "xsd"))}
INSERT DATA {{
  <{NAO_1}> a cora:Robot ; rt:name "nao-1" ; rt:hasEndEffector <urn:lab/hand> .
  <urn:lab/hand> a rt:Hand ; rt:gripperType "nao" .
  <urn:lab/robot/nao-2> a cora:Robot ; rt:name "nao 2, \\"old\\"" .
  {"".join(mug(n) for n in range(1, 6))}
  {"".join(attempt(n, 1 + n % 2, n % 3 > 0) for n in range(7))}
  <urn:lab/object/8> rt:mergedInto <urn:lab/object/1> .
}}"""


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base="urn:lab/") as opened:
        opened.update(FACTS, "nao-1")
        yield opened


@pytest.fixture(scope="module")
def client(kb: KnowledgeBase) -> Iterator[FlaskClient]:
    with closing(TokenStore(None)) as tokens, Engine(kb) as engine:
        app = create_app(new_application(kb, engine, tokens, Config()))
        yield app.test_client()
        app.extensions["rtask"].close()


def get(client: FlaskClient, address: str, status: int = 200, **headers: str) -> Any:
    answer = client.get(address, headers={k.replace("_", "-"): v for k, v in headers.items()})
    assert answer.status_code == status, answer.text
    return answer.get_json() if answer.text else None


def test_what_is_described_is_what_comes(client: FlaskClient) -> None:
    paths = document(Engine)["paths"]  # type: ignore[arg-type]
    for name in COLLECTIONS:
        content = paths[f"/api/{name}"]["get"]["responses"]["200"]["content"]
        schema = content["application/json"]["schema"]
        Draft202012Validator.check_schema(schema)
        page = get(client, f"/api/{name}?total=1")
        Draft202012Validator(schema).validate(page)
        assert page["total"] == len(page["items"]) > 0
        declared = {member.name for member in COLLECTIONS[name].members} | {"iri"}
        assert set(page["items"][0]) == declared
        one = page["items"][0]
        single = get(client, f"/api/{name}/{one['iri'].rpartition('/')[2]}")
        assert single == one


def test_counts_are_those_of_the_graph(client: FlaskClient) -> None:
    nao = get(client, "/api/robots/nao-1")
    assert (nao["attempts"], nao["successes"]) == (7, 4)
    assert nao["last_attempt"].startswith("2026-01-01T10:06:00")
    assert nao["grippers"] == ["nao"]
    mugs = {one["iri"]: one for one in get(client, "/api/objects")["items"]}
    first, last = mugs["urn:lab/object/1"], mugs["urn:lab/object/5"]
    assert (first["attempts"], first["successes"], first["grasps"]) == (4, 2, 1)
    assert (last["attempts"], last["views"]) == (0, 0)
    assert RT + "DrinkingVessel" in first["classes"]  # derived
    assert first["length_m"] == 0.1


@pytest.mark.parametrize("name", sorted(COLLECTIONS))
def test_pages_neither_repeat_nor_miss(client: FlaskClient, name: str) -> None:
    whole = [one["iri"] for one in get(client, f"/api/{name}")["items"]]
    found: list[str] = []
    address = f"/api/{name}?limit=2"
    while address:
        page = get(client, address)
        found += [one["iri"] for one in page["items"]]
        address = page["next"]
    assert found == whole
    assert len(set(found)) == len(found)


def test_a_task_names_its_attempts_and_what_came_of_them(client: FlaskClient) -> None:
    task = get(client, "/api/tasks/2")
    assert task["attempts"] == ["urn:lab/attempt/2"]
    assert task["outcomes"] == ["urn:lab/outcome/2"]
    assert (task["success"], task["robot"], task["task_id"]) == (True, NAO_1, "urn:t:2")
    outcome = get(client, "/api/outcomes/3")
    assert (outcome["reported"], outcome["success"], outcome["reason"]) == (
        False, False, "slip_lift",
    )  # fmt: skip


def test_lists_by_time_begin_with_the_newest(client: FlaskClient) -> None:
    times = [one["time"] for one in get(client, "/api/outcomes")["items"]]
    assert times == sorted(times, reverse=True)


@pytest.mark.parametrize(
    ("query", "count"),
    [
        ("outcomes?success=true", 4),
        ("outcomes?object=urn:lab/object/1", 4),
        ("outcomes?robot=urn:lab/robot/nao-2", 0),
        ("outcomes?grasp=urn:lab/grasp/2&success=false", 1),
        ("tasks?since=2026-01-01T10:05:00Z", 2),
        ("objects?class=" + (RT + "Mug").replace("#", "%23"), 5),
        ("objects?text=UG%203", 1),
        ("objects?robot=urn:lab/robot/nao-1", 2),
        ("objects?iri=urn:lab/object/3", 1),
        ("robots?gripper_type=nao", 1),
        ("robots?name=nao-1", 1),
    ],
)
def test_filters(client: FlaskClient, query: str, count: int) -> None:
    assert len(get(client, f"/api/{query}")["items"]) == count


def test_fields_media_types_and_tags(client: FlaskClient) -> None:
    few = get(client, "/api/robots?fields=name,attempts")["items"]
    assert set(few[0]) == {"iri", "name", "attempts"}
    table = client.get("/api/robots", headers={"Accept": "text/csv"})
    assert table.content_type.startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(table.text)))
    assert [row["name"] for row in rows] == ["nao-1", 'nao 2, "old"']
    linked = client.get("/api/objects", headers={"Accept": "application/ld+json"})
    assert linked.content_type == "application/ld+json"
    model = json.loads(linked.text)
    assert model["@context"].endswith("/api/context.jsonld")
    model["@context"] = get(client, "/api/context.jsonld")["@context"]
    found = pyoxigraph.parse(json.dumps(model), format=pyoxigraph.RdfFormat.JSON_LD)
    said = {(quad.subject, quad.predicate.value, quad.object.value) for quad in found}
    first = pyoxigraph.NamedNode("urn:lab/object/1")
    assert (first, RT + "name", "mug 1") in said
    assert (first, PREFIXES["rdf"] + "type", RT + "Mug") in said
    tag = table.headers["ETag"]
    assert client.get("/api/robots").headers["ETag"] != tag
    same = client.get("/api/robots", headers={"Accept": "text/csv", "If-None-Match": tag})
    assert same.status_code == 304
    assert get(client, "/api/robots", 406, Accept="image/png")["available"]


def test_a_list_is_one_query(
    client: FlaskClient, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    run = kb.query
    monkeypatch.setattr(kb, "query", lambda text, **more: asked.append(text) or run(text, **more))
    get(client, "/api/objects")
    assert len(asked) == 1


@pytest.mark.parametrize(
    ("address", "status", "words"),
    [
        ("/api/objcts", 404, "did you mean /api/objects?"),
        ("/api/search_object", 404, "did you mean /engine/search_object?"),
        ("/api/objects?clas=x", 400, "did you mean class?"),
        ("/api/objects?fields=nam", 400, "did you mean name?"),
        ("/api/objects?limit=0", 400, "from 1 to 1000"),
        ("/api/objects?limit=2&limit=3", 400, "twice"),
        ("/api/outcomes?success=yes", 400, "true or false"),
        ("/api/outcomes?since=yesterday", 400, "2026-01-31"),
        ("/api/outcomes?cursor=abc", 400, "`next`"),
        ("/api/objects?class=a%20b", 400, "class: not an absolute IRI"),
        ("/api/objects/99", 404, "see /api/objects"),
        ("/api/objects?text=%22%20%7D%20%23", 200, "items"),
    ],
)
def test_mistakes_are_named(client: FlaskClient, address: str, status: int, words: str) -> None:
    answer = client.get(address)
    assert (answer.status_code, words in answer.text) == (status, True), answer.text


def test_an_old_name_leads_to_the_new_and_nothing_is_written_here(client: FlaskClient) -> None:
    moved = client.get("/api/objects/8")
    assert (moved.status_code, moved.headers["Location"]) == (308, "/api/objects/1")
    refused = client.post("/api/objects", json={})
    assert (refused.status_code, refused.headers["Allow"]) == (405, "GET, HEAD, OPTIONS")
