"""Pages: what they show, how few queries they need, and that hostile data stay data."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from html import escape
from html.parser import HTMLParser
from typing import Any
from urllib.parse import quote, urlencode

import pytest
from flask.testing import FlaskClient

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.knowledge_base import KnowledgeBase
from tests.servers import new_application

pytestmark = pytest.mark.slow

RT = ontology.NS
PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c4890000000d4944415478da63fcff"
    "9f61000005a301e2d5b4c5970000000049454e44ae426082"
)
HOSTILE = "<img src=x onerror=alert(1)>\"'</script><script>alert(2)</script>"
HTML = {"Accept": "text/html"}


class NoOperations:
    """An engine that pages never call."""

    operations: dict[str, Any] = {}  # noqa: RUF012 - read only

    def call(self, name: str, args: dict[str, Any], access: object) -> dict[str, Any]:
        raise AssertionError


@pytest.fixture(scope="module")
def kb() -> Iterator[KnowledgeBase]:
    """The sample of the ontology, and a mug that a hostile robot named, seen in one picture."""
    with rtask.open(":memory:", base="urn:lab/") as opened:
        opened.load(ontology.path("examples/sample.trig"))
        with opened.transaction(agent="nao-1") as tx:
            picture = tx.blob(PIXEL, "image/png")
            for subject, name, value in [
                ("urn:lab/object/1", "name", HOSTILE),
                ("urn:lab/object/1", "objectId", "nao-1/1"),
                ("urn:lab/robot/nao-1", "name", HOSTILE),
            ]:
                tx.add(subject, RT + name, value)
            tx.add("urn:lab/attempt/1", ontology.PREFIXES["rdfs"] + "comment", HOSTILE)
            tx.update(
                f"""PREFIX rt: <{RT}> PREFIX prov: <{ontology.PREFIXES["prov"]}>
                PREFIX cora: <{ontology.PREFIXES["cora"]}> PREFIX xsd: <{ontology.PREFIXES["xsd"]}>
                INSERT DATA {{
                  <urn:lab/object/1> a rt:Mug ; rt:hasView <urn:lab/view/1> ;
                    rt:hasGrasp <urn:lab/grasp/1> .
                  <urn:lab/view/1> a rt:View ; rt:viewContent <urn:lab/image/1> .
                  <urn:lab/image/1> a rt:ColorImage ; rt:hasBlob <{picture.value}> .
                  <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao_hand" ;
                    rt:graspQuality 0.5e0 .
                  <urn:lab/robot/nao-1> a cora:Robot .
                  <urn:lab/attempt/1> a rt:GraspAttempt ; rt:executesGrasp <urn:lab/grasp/1> ;
                    rt:performedBy <urn:lab/robot/nao-1> ; rt:hasOutcome <urn:lab/outcome/1> ;
                    prov:endedAtTime "2026-01-01T10:00:00Z"^^xsd:dateTime .
                  <urn:lab/attempt/2> a rt:GraspAttempt ; rt:executesGrasp <urn:lab/grasp/1> ;
                    rt:performedBy <urn:lab/robot/nao-1> ; rt:hasOutcome <urn:lab/outcome/2> ;
                    prov:endedAtTime "2026-01-02T10:00:00Z"^^xsd:dateTime .
                  <urn:lab/outcome/1> a rt:GraspOutcome ; rt:success true ;
                    rt:hasReason rt:reason_ok .
                  <urn:lab/outcome/2> a rt:GraspOutcome ; rt:success false ;
                    rt:hasReason rt:reason_slip_lift .
                }}"""
            )
        yield opened


@pytest.fixture(scope="module")
def app(kb: KnowledgeBase) -> Iterator[Any]:
    tokens = TokenStore(None)
    made = create_app(new_application(kb, NoOperations(), tokens, Config()))
    yield made
    made.extensions["rtask"].close()
    tokens.close()


@pytest.fixture
def client(app: Any) -> FlaskClient:
    return app.test_client()


PAGES = [
    "/",
    "/sparql",
    "/sparql?query=" + quote("SELECT ?s ?n { ?s <" + RT + "name> ?n }", safe=""),
    "/objects",
    "/object?iri=urn:lab/object/1",
    "/object/merge?iri=urn:lab/object/1",
    "/object/split?iri=urn:lab/object/1",
    "/object/forget?iri=urn:lab/object/1",
    "/curation",
    "/teach",
    "/operations",
    "/robots",
    "/search",
    "/search?q=mug",
    "/ask",
    "/ask?text=which+mugs+are+there",
    "/terms",
    "/terms?term=Mug",
    "/plan",
    "/terms?term=rt:mass",
    "/resource?iri=urn:lab/object/1",
    "/resource?iri=urn:lab/robot/nao-1",
    "/resource?iri=urn:lab/attempt/1",
]
TWINS = [
    ("/", "/index.json"),
    ("/objects", "/objects.json"),
    ("/object?iri=urn:lab/object/1", "/object.json?iri=urn:lab/object/1"),
    ("/robots", "/robots.json"),
    ("/resource?iri=urn:lab/object/1", "/resource.json?iri=urn:lab/object/1"),
]


class Tags(HTMLParser):
    """All start tags of a page with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def named(self, *names: str) -> list[dict[str, str | None]]:
        return [attributes for tag, attributes in self.found if tag in names]


@pytest.mark.parametrize("address", PAGES)
def test_hostile_names_stay_text_on_every_page(client: FlaskClient, address: str) -> None:
    answer = client.get(address, headers=HTML)
    assert answer.status_code == 200
    tags = Tags(answer.text)
    assert not [image for image in tags.named("img") if image.get("src") == "x"]
    assert not [name for _, attributes in tags.found for name in attributes if name[:2] == "on"]
    assert all(script.get("src", "") for script in tags.named("script"))
    if "nao-1" in address or "object" in address:
        assert "&lt;img src=x onerror=alert(1)&gt;" in answer.text


@pytest.mark.parametrize("address", PAGES)
def test_pages_are_built_for_everybody(client: FlaskClient, address: str) -> None:
    text = client.get(address, headers=HTML).text
    tags = Tags(text)
    assert len(tags.named("h1")) == 1
    assert len(tags.named("main")) == 1
    assert not tags.named("style")
    assert not [name for _, attributes in tags.found for name in attributes if name == "style"]
    for field in tags.named("input", "textarea", "select"):
        labelled = field.get("aria-label") or f'for="{field.get("id")}"' in text or "<label" in text
        assert labelled
    for picture in tags.named("img"):
        assert "alt" in picture
    for tag, attributes in tags.found:
        for name in ("src", "href", "action"):
            value = attributes.get(name) or "/"
            assert value.startswith(("/", "#")) or attributes.get("rel") == "noreferrer noopener", (
                f"<{tag} {name}={value}> leaves the server"
            )


@pytest.mark.parametrize("address", PAGES)
def test_every_page_carries_the_headers_that_keep_it_harmless(
    client: FlaskClient, address: str
) -> None:
    headers = client.get(address, headers=HTML).headers
    policy = headers["Content-Security-Policy"]
    assert "script-src 'self'" in policy
    assert "unsafe" not in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "same-origin"


@pytest.mark.parametrize(("address", "twin"), TWINS)
def test_a_page_names_its_twin_and_the_twin_is_json(
    client: FlaskClient, address: str, twin: str
) -> None:
    page = Tags(client.get(address, headers=HTML).text)
    alternates = [link["href"] for link in page.named("link") if link.get("rel") == "alternate"]
    assert alternates == [twin]
    assert isinstance(json.loads(client.get(twin).text), dict)


@pytest.mark.parametrize(
    ("address", "most"),
    [("/", 5), ("/objects", 2), ("/object?iri=urn:lab/object/1", 6), ("/robots", 1),
     ("/resource?iri=urn:lab/object/1", 2)],
)  # fmt: skip
def test_no_page_loops_over_queries(
    client: FlaskClient, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, address: str, most: int
) -> None:
    asked: list[str] = []
    run = kb.query

    def counting(text: str, **options: Any) -> Any:
        asked.append(text)
        return run(text, **options)

    monkeypatch.setattr(kb, "query", counting)
    client.get(address, headers=HTML)
    assert 1 <= len(asked) <= most


def test_the_home_page_counts_and_shows_what_is_there(client: FlaskClient) -> None:
    model = client.get("/index.json").get_json()
    assert model["counts"]["robots"] == 4  # three of the sample and ours
    assert model["counts"]["attempts"] == 7
    assert model["addresses"]["sparql"] == "http://localhost/sparql"
    assert len(model["samples"]) == len(ontology.queries())
    (mug,) = [o for o in model["objects"] if o["object"] == "urn:lab/object/1"]
    assert (mug["attempts"], mug["successes"], mug["mean"]) == (2, 1, 0.5)
    assert (mug["views"], mug["grasps"]) == (1, 1)
    assert mug["classes"] == "mug"  # not also a cup and a container
    benefit = model["benefit"]
    assert benefit is None or benefit["sentence"] in client.get("/").get_data(as_text=True)


def test_an_object_has_its_picture_and_the_blob_is_served_safely(client: FlaskClient) -> None:
    model = client.get("/object.json?iri=urn:lab/object/1").get_json()
    picture = client.get(f"/api/blobs/{model['views'][0]['image']}")
    assert picture.data == PIXEL
    assert picture.content_type == "image/png"
    assert "sandbox" in picture.headers["Content-Security-Policy"]


def test_an_object_shows_its_grasps_and_the_newest_outcome_first(client: FlaskClient) -> None:
    model = client.get("/object.json?iri=urn:lab/object/1").get_json()
    (grasp,) = model["grasps"]
    assert (grasp["gripper"], grasp["quality"], grasp["successes"]) == ("nao_hand", 0.5, 1)
    assert [outcome["reason"] for outcome in model["outcomes"]] == ["slip_lift", "ok"]
    assert [outcome["success"] for outcome in model["outcomes"]] == [False, True]


def test_a_robot_has_one_row_with_its_last_outcome(client: FlaskClient) -> None:
    robots = client.get("/robots.json").get_json()["robots"]
    assert len({robot["robot"] for robot in robots}) == len(robots) == 4
    (mine,) = [robot for robot in robots if robot["robot"] == "urn:lab/robot/nao-1"]
    assert (mine["attempts"], mine["successes"]) == (2, 1)
    assert (mine["success"], mine["reason"]) == (False, "slip_lift")
    assert mine["object"] == "urn:lab/object/1"


def test_stated_and_derived_statements_are_apart(client: FlaskClient) -> None:
    model = client.get("/resource.json?iri=urn:lab/object/1").get_json()
    stated = {row["p"]["text"] for row in model["stated"]}
    assert RT + "objectId" in stated
    assert {row["graph"] for row in model["derived"]} == {"urn:lab/graph/inferred"}
    types = {row["o"]["text"] for row in model["derived"]}
    assert RT + "DrinkingVessel" in types
    assert model["names"][RT + "DrinkingVessel"] == "drinking vessel"
    assert model["page"] == "/object"


def test_a_prefixed_name_is_understood(client: FlaskClient) -> None:
    assert client.get("/resource.json?iri=rt:Mug").get_json()["iri"] == RT + "Mug"


@pytest.mark.parametrize(
    ("address", "status"),
    [
        ("/object?iri=urn:nothing", 404),
        ("/object", 400),
        ("/object?iri=not an iri", 422),
        ("/resource?iri=urn:nothing", 404),
        ("/resource", 400),
        ("/nowhere", 404),
        ("/objects?page=99999", 200),
        ("/objects?page=minus", 200),
        ("/activity?since=:" + "9" * 5000, 400),
    ],
)
def test_faults_are_a_page_for_people_and_a_problem_for_programs(
    client: FlaskClient, address: str, status: int
) -> None:
    page = client.get(address, headers=HTML)
    assert page.status_code == status
    assert page.content_type.startswith("text/html")
    assert "Traceback" not in page.text
    if status >= 400:
        path, _, query = address.partition("?")
        problem = client.get(f"{path}.json?{query}")
        assert problem.content_type == "application/problem+json"


def test_the_workbench_without_scripts_draws_the_table(client: FlaskClient) -> None:
    query = f"SELECT ?name {{ <urn:lab/object/1> <{RT}name> ?name }}"
    text = client.get("/sparql", query_string={"query": query}, headers=HTML).text
    assert "1 row in" in text
    assert "&lt;img src=x" in text.partition('id="answer"')[2]


@pytest.mark.parametrize(
    ("words", "group", "address"),
    [
        ("mug", "objects", "/object?iri=urn%3Alab%2Fobject%2F1"),
        ("MGU", "objects", "/object?iri=urn%3Alab%2Fobject%2F1"),
        ("mug", "classes", "/classes?iri=https%3A%2F%2Fw3id.org%2Frtask-kg%2Fns%23Mug"),
        ("nao", "objects", "/object?iri=urn%3Alab%2Fobject%2F1"),
        ("outcom", "pages", "/feedback"),
    ],
)
def test_things_are_found_by_words_beginnings_and_typing_errors(
    client: FlaskClient, words: str, group: str, address: str
) -> None:
    groups = client.get("/search.json", query_string={"q": words}).get_json()["groups"]
    (found,) = (one["found"] for one in groups if one["name"] == group)
    assert address in [one["address"] for one in found]
    page = client.get("/search", query_string={"q": words}, headers=HTML)
    assert f'href="{escape(address)}"' in page.text
    assert HOSTILE not in page.text


def test_what_is_new_is_found_at_once(client: FlaskClient, kb: KnowledgeBase) -> None:
    search = {"q": "samovar"}
    assert client.get("/search.json", query_string=search).get_json()["groups"] == []
    kb.update(
        f"""INSERT DATA {{ <urn:lab/object/9> a <{RT}Can> ; <{RT}objectId> "nao-1/9" ;
            <{RT}name> "old samovar" }}""",
        "nao-1",
    )
    (group,) = client.get("/search.json", query_string=search).get_json()["groups"]
    assert [one["title"] for one in group["found"]] == ["old samovar"]


@pytest.mark.parametrize("name", ["rt:Mug", "urn:lab/object/1"])
def test_a_term_that_is_searched_for_leads_to_its_page(client: FlaskClient, name: str) -> None:
    answer = client.get("/search", query_string={"q": name}, headers=HTML)
    assert (answer.status_code, answer.headers["Location"]) == (
        303,
        "/resource?" + urlencode({"iri": name}),
    )


def test_the_workbench_draws_large_answers_for_browsers_that_take_gzip(client: FlaskClient) -> None:
    query = "SELECT ?s ?p ?o { ?s ?p ?o } LIMIT 200"
    browser = {**HTML, "Accept-Encoding": "gzip, deflate, br"}
    page = client.get("/sparql", query_string={"query": query}, headers=browser)
    assert page.status_code == 200
    assert "200 rows in" in page.text


def test_the_workbench_shows_what_is_wrong_with_a_query(client: FlaskClient) -> None:
    page = client.get("/sparql", query_string={"query": "SELECT ?x {"}, headers=HTML)
    assert page.status_code == 200
    assert re.search(r'class="problem"[^>]*>[^<]+', page.text)


def test_flask_alone_serves_what_programs_ask(client: FlaskClient) -> None:
    """Under another WSGI server, every address except websockets answers all the same."""
    assert client.get("/sparql?query=ASK{}").get_json()["boolean"] is True
    assert client.post("/query", data={"query": "ASK {}"}).get_json()["boolean"] is True
    update = "INSERT DATA { GRAPH <urn:g:flask> { <urn:s> <urn:p> 1 } }"
    assert client.post("/update", data={"update": update}).status_code == 204
    assert client.get("/store?graph=urn:g:flask").status_code == 200
    assert client.get("/health").get_json()["ready"] is True
    assert client.delete("/sparql").status_code == 405
    assert client.options("/sparql").status_code == 204
    assert client.head("/sparql?query=ASK{}").data == b""
