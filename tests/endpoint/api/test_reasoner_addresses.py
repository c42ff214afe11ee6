"""`/reasoner/rules`: who may add rules of the user, and what comes back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest
from flask.testing import FlaskClient

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.engine import Engine
from tests.servers import new_application

pytestmark = pytest.mark.slow

TEXT = "CONSTRUCT { ?a <urn:t:above> ?b } WHERE { ?a <urn:t:on> ?b }"
RULE = {"label": "on is above", "text": TEXT, "comment": "for stacking"}
Bearer = dict[str, str]


@pytest.fixture(scope="module")
def tokens() -> Iterator[TokenStore]:
    with closing(TokenStore(None)) as made:
        yield made


@contextmanager
def served(tokens: TokenStore) -> Iterator[FlaskClient]:
    """Serve a store of its own."""
    with rtask.open(":memory:", base="urn:lab/") as kb, Engine(kb) as engine:
        kb.update("INSERT DATA { <urn:t:a> <urn:t:on> <urn:t:b> }")
        app = create_app(new_application(kb, engine, tokens, Config()))
        yield app.test_client()
        app.extensions["rtask"].close()


@pytest.fixture(scope="module")
def client(tokens: TokenStore) -> Iterator[FlaskClient]:
    with served(tokens) as made:
        yield made


def bearer(tokens: TokenStore, role: str, *rights: str, agent: str | None = None) -> Bearer:
    text, _ = tokens.create(role, agent=agent, rights=rights)
    return {"Authorization": f"Bearer {text}"}


def test_without_tokens_nobody_may_add_rules() -> None:
    with closing(TokenStore(None)) as nobody, served(nobody) as client:
        refused = client.post("/reasoner/rules", json=RULE)
        assert (refused.status_code, refused.json["type"]) == (403, "/errors/graph-forbidden")
        assert client.get("/reasoner/rules").json == {"rules": []}


def test_ordinary_tokens_may_not_add_rules_whichever_way(
    client: FlaskClient, tokens: TokenStore
) -> None:
    robot = bearer(tokens, "robot", agent="nao-1")
    teacher = bearer(tokens, "teacher", agent="ada")
    insert = (
        "INSERT DATA { GRAPH <urn:lab/graph/rules> "
        f"{{ <urn:r> <https://w3id.org/rtask-kg/ns#ruleText> '{TEXT}' }} }}"
    )
    for who in (robot, teacher):
        assert client.post("/reasoner/rules", json=RULE, headers=who).status_code == 403
        assert client.post("/update", data={"update": insert}, headers=who).status_code == 403
        triple = "<urn:r> <https://w3id.org/rtask-kg/ns#ruleText> 'x' ."
        put = client.put(
            "/store?graph=urn:lab/graph/rules",
            data=triple,
            headers={**who, "Content-Type": "text/turtle"},
        )
        assert put.status_code == 403
        assert client.delete("/reasoner/rules/none", headers=who).status_code == 403
    reader = bearer(tokens, "reader")
    assert client.post("/reasoner/rules", json=RULE, headers=reader).status_code == 403
    assert client.post("/reasoner/rules", json=RULE).status_code == 401
    assert client.get("/reasoner/rules").json == {"rules": []}


def test_a_rule_is_added_shown_and_removed(client: FlaskClient, tokens: TokenStore) -> None:
    may = bearer(tokens, "robot", "rules", agent="nao-2")
    added = client.post("/reasoner/rules", json=RULE, headers=may)
    assert added.status_code == 201, added.text
    assert added.json["derived"] == 1
    assert added.json["author"] == "urn:lab/robot/nao-2"
    place = added.headers["Location"]
    assert client.get(place).json["text"] == TEXT
    ask = client.get("/sparql", query_string={"query": "ASK { <urn:t:a> <urn:t:above> ?b }"})
    assert ask.json["boolean"] is True
    again = client.post("/reasoner/rules", json={**RULE, "text": TEXT + " "}, headers=may)
    assert again.status_code == 201
    assert again.json["derived"] == 0
    other = {**RULE, "text": TEXT.replace("on>", "under>")}
    assert client.post("/reasoner/rules", json=other, headers=may).status_code == 409
    replaced = client.post(
        "/reasoner/rules?label=on is above&replace=1",
        data=TEXT,
        headers={**may, "Content-Type": "application/sparql-query"},
    )
    assert replaced.status_code == 201
    removed = client.delete(place, headers=may)
    assert (removed.status_code, removed.json["removed"]) == (200, "on is above")
    assert client.get("/reasoner/rules").json == {"rules": []}
    assert client.get(place).status_code == 422


def test_several_rules_are_one_commit(client: FlaskClient, tokens: TokenStore) -> None:
    may = bearer(tokens, "admin")
    under = {
        "label": "under",
        "text": "CONSTRUCT { ?b <urn:t:under> ?a } WHERE { ?a <urn:t:on> ?b }",
    }
    bad = {"label": "bad", "text": "CONSTRCUT { }"}
    address = "/reasoner/rules"
    assert client.post(address, json={"rules": [RULE, bad]}, headers=may).status_code == 400
    assert client.get(address).json == {"rules": []}
    added = client.post(address, json={"rules": [RULE, under]}, headers=may)
    assert added.status_code == 201, added.text
    assert [one["label"] for one in added.json["rules"]] == ["on is above", "under"]
    assert (added.json["derived"], added.json["changed"]) == (2, True)
    again = client.post(address, json={"rules": [RULE, under]}, headers=may)
    assert (again.json["commit"], again.json["changed"]) == (added.json["commit"], False)
    assert client.delete(address, headers=may).status_code == 400
    gone = client.delete(address + "?label=under&label=none", headers=may)
    assert gone.status_code == 422
    assert len(client.get(address).json["rules"]) == 2
    named = {"label": ["under", added.json["rules"][0]["iri"]]}
    gone = client.delete(address, query_string=named, headers=may)
    assert gone.json == {
        "removed": ["under", "on is above"],
        "commit": added.json["commit"] + 1,
        "withdrawn": 2,
    }
    assert client.get(address).json == {"rules": []}


@pytest.mark.parametrize(
    ("sent", "status", "words"),
    [
        ({"rules": []}, 400, "a list of objects"),
        ({"rules": [RULE], "text": TEXT}, 400, "unknown field 'text'; one of rules, replace"),
        ({"rules": [{**RULE, "replace": True}]}, 400, "unknown field 'replace'"),
        ({"rules": ["x"]}, 400, "label and text"),
        ({"rules": [RULE] * 1001}, 413, "at most 1000 rules"),
        ({**RULE, "text": "CONSTRCUT { }"}, 400, "did you mean 'CONSTRUCT'"),
        ({"label": "x"}, 400, "label and text"),
        ({**RULE, "text": 3}, 400, "label and text"),
        ({**RULE, "label": " "}, 400, "label"),
        ({**RULE, "txet": ""}, 400, "unknown field 'txet'"),
    ],
)
def test_a_bad_rule_is_refused_with_reason_and_place(
    client: FlaskClient, tokens: TokenStore, sent: dict[str, object], status: int, words: str
) -> None:
    answer = client.post("/reasoner/rules", json=sent, headers=bearer(tokens, "admin"))
    assert answer.status_code == status, answer.text
    assert words in answer.json["detail"]
    if "CONSTRCUT" in str(sent.get("text", "")):
        assert (answer.json["line"], answer.json["column"]) == (1, 1)


def test_other_methods_media_types_and_addresses_are_refused(
    client: FlaskClient, tokens: TokenStore
) -> None:
    admin = bearer(tokens, "admin")
    assert client.put("/reasoner/rules", json=RULE, headers=admin).status_code == 405
    assert client.post("/reasoner/rules", data="x", headers=admin).status_code == 415
    assert client.get("/reasoner/nothing").status_code == 404
    assert "POST" in client.options("/reasoner/rules").headers["Allow"]


def test_a_token_file_of_an_earlier_version_gains_the_column(tmp_path) -> None:  # type: ignore[no-untyped-def]
    import sqlite3

    with closing(sqlite3.connect(tmp_path / "tokens.sqlite")) as connection:
        connection.execute(
            "CREATE TABLE tokens (id TEXT PRIMARY KEY, digest BLOB NOT NULL, agent TEXT, "
            "role TEXT NOT NULL, created TEXT NOT NULL, expires TEXT, revoked TEXT) STRICT"
        )
        connection.execute(
            "INSERT INTO tokens (id, digest, agent, role, created) "
            "VALUES ('0123456789ab', x'00', 'nao-1', 'robot', '2026')"
        )
        connection.commit()
    with closing(TokenStore(tmp_path)) as tokens:
        (old,) = tokens.all()
        assert (old.agent, old.rights) == ("nao-1", ())
        text, _ = tokens.create("teacher", agent="ada", rights=["rules"])
        assert tokens.authenticate(text).access.rights == {"rules"}


MUG = (
    "INSERT DATA { <urn:t:mug> a <urn:t:Mug> . "
    "<urn:t:Mug> <http://www.w3.org/2000/01/rdf-schema#subClassOf> <urn:t:Vessel> }"
)
TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"
SUB_CLASS = "http://www.w3.org/2000/01/rdf-schema#subClassOf"


@pytest.fixture
def vessels(client: FlaskClient, tokens: TokenStore) -> FlaskClient:
    admin = bearer(tokens, "admin")
    assert client.post("/update", data={"update": MUG}, headers=admin).status_code == 204
    return client


def test_why_a_statement_holds(vessels: FlaskClient) -> None:
    asked = {"s": "urn:t:mug", "p": TYPE, "o": "urn:t:Vessel"}
    body = vessels.get("/reasoner/explain", query_string=asked).json
    assert (body["holds"], body["asserted_in"]) == (True, [])
    assert body["proof"]["rule"] == "cax-sco"
    assert body["proof"]["premises"][0]["graphs"] == ["urn:lab/graph/shared"]
    assert body["text"].startswith("<urn:t:mug> a <urn:t:Vessel>")
    short = {**asked, "p": "rdf:type"}
    assert vessels.get("/reasoner/explain", query_string=short).json == body
    none = vessels.get("/reasoner/explain", query_string={**asked, "o": "urn:t:Plate"}).json
    assert (none["holds"], none["proof"], none["unknown"]) == (False, None, ["<urn:t:Plate>"])
    bounded = vessels.get("/reasoner/explain", query_string={**asked, "budget": 1}).json
    assert (bounded["holds"], bounded["verdict"], bounded["budget"]) == (None, "not decided", 1)
    far = vessels.get("/reasoner/explain", query_string={**asked, "budget": 10**9})
    assert far.status_code == 400


def test_whether_statements_follow(vessels: FlaskClient) -> None:
    asked = {"s": "urn:t:mug", "p": TYPE, "o": "urn:t:Vessel"}
    body = vessels.get("/reasoner/entails", query_string=asked).json
    assert (body["entailed"], body["missing"]) == (True, [])
    assert body["proofs"][0]["rule"] == "cax-sco"
    turtle = (
        f"<urn:t:mug> a <urn:t:Vessel>, <urn:t:Cup> . <urn:t:Mug> <{SUB_CLASS}> <urn:t:Vessel> ."
    )
    sent = vessels.post(
        "/reasoner/entails", data=turtle, headers={"Content-Type": "text/turtle"}
    ).json
    assert sent["entailed"] is False
    assert sent["missing"] == [["<urn:t:mug>", f"<{TYPE}>", "<urn:t:Cup>"]]
    assert len(sent["proofs"]) == 2
    assert vessels.post("/reasoner/entails", json={"text": turtle}).json == sent


def test_questions_that_cannot_be_read_are_refused(vessels: FlaskClient) -> None:
    get, post = vessels.get, vessels.post
    assert get("/reasoner/entails?s=urn:a&p=urn:b").status_code == 400
    assert get("/reasoner/explain?s=urn:a&p=urn:b&o=%22x").status_code == 400
    assert get('/reasoner/explain?s="a"&p=urn:b&o=urn:c').status_code == 422
    assert post("/reasoner/entails", data="x").status_code == 415
    turtle = {"Content-Type": "text/turtle"}
    assert post("/reasoner/entails", data="<urn:a> <urn:b>", headers=turtle).status_code == 400
    many = "".join(f"<urn:a> <urn:b> {n} ." for n in range(1_001))
    assert post("/reasoner/entails", data=many, headers=turtle).status_code == 413
    for body in ({}, {"text": 1}, {"text": "", "form": "turtle"}, [], "x"):
        assert post("/reasoner/entails", json=body).status_code == 400, body
    assert post("/reasoner/explain").status_code == 405


def test_a_refused_change_names_its_causes(vessels: FlaskClient, tokens: TokenStore) -> None:
    admin = bearer(tokens, "admin")
    insert = (
        "PREFIX owl: <http://www.w3.org/2002/07/owl#> INSERT DATA { "
        "<urn:t:Vessel> owl:disjointWith <urn:t:Fish> . <urn:t:mug> a <urn:t:Fish> ; <urn:t:p> 1 }"
    )
    # Causes are looked for during half a second, which may not suffice on a busy machine.
    for _ in range(20):
        refused = vessels.post("/update", data={"update": insert}, headers=admin)
        assert (refused.status_code, refused.json["type"]) == (422, "/errors/inconsistent")
        causes = refused.json["causes"]
        if causes and causes[0]["smallest"]:
            break
    (cause,) = causes
    assert len(cause["statements"]) == 2
    assert cause["smallest"] is True
    assert "urn:lab/graph/shared" in cause["graphs"]
    assert vessels.get("/reasoner/contradictions").json == {"contradictions": [], "causes": []}


def test_the_addresses_are_described_for_programs_and_people(client: FlaskClient) -> None:
    paths = client.get("/openapi.json").json["paths"]
    assert {path for path in paths if path.startswith("/reasoner/")} == {
        "/reasoner/rules",
        "/reasoner/rules/{name}",
        "/reasoner/explain",
        "/reasoner/entails",
        "/reasoner/contradictions",
    }
    page = client.get("/openapi")
    assert page.status_code == 200
    assert "POST /reasoner/entails" in page.text
