"""`/proposals`: who sees, makes and decides them, and how they come about."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest
from flask.testing import FlaskClient

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.wsgi import create_app
from tests.servers import new_application

Bearer = dict[str, str]
AXIOM = (
    "INSERT DATA { <https://w3id.org/rtask-kg/ns#Mug> "
    "<http://www.w3.org/2000/01/rdf-schema#subClassOf> <urn:Vessel> }"
)
LINE = "<urn:cup> <urn:p> <urn:o> ."


class Served:
    """A server that keeps refused axioms, and what its callers send."""

    def __init__(self, tokens: TokenStore) -> None:
        self.kb = rtask.open(":memory:", base="urn:lab/", ontologies=False)
        config = Config(write_rate=1e6, propose_axioms=True)
        self.app = create_app(new_application(self.kb, NoEngine(), tokens, config))
        self.client: FlaskClient = self.app.test_client()
        made = {
            "ann": tokens.create("admin", agent="ann"),
            "eve": tokens.create("teacher", agent="eve", rights=("schema",)),
            "nao-1": tokens.create("robot", agent="nao-1"),
            "nao-2": tokens.create("robot", agent="nao-2"),
            "reader": tokens.create("reader"),
        }
        self.who = {name: {"Authorization": f"Bearer {text}"} for name, (text, _) in made.items()}

    def get(self, name: str, address: str = "/proposals") -> Any:
        return self.client.get(address, headers=self.who[name])

    def post(self, name: str, address: str, **fields: Any) -> Any:
        return self.client.post(address, json=fields, headers=self.who[name])


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with closing(TokenStore(None)) as tokens:
        made = Served(tokens)
        yield made
        made.app.extensions["rtask"].close()
        made.kb.close()


def test_a_refused_axiom_is_named_in_the_answer_and_waits_for_a_decision(served: Served) -> None:
    refused = served.client.post("/update", data={"update": AXIOM}, headers=served.who["nao-1"])
    assert (refused.status_code, refused.json["right"]) == (403, "schema")
    number = refused.json["proposal"]
    own = served.get("nao-1", f"/proposals/{number}").json
    assert (own["author"], own["state"], len(own["added"])) == ("nao-1", "proposed", 1)
    for address in (f"/proposals/{number}/adopt", f"/proposals/{number}/refuse"):
        denied = served.post("nao-1", address)
        assert (denied.status_code, denied.json["right"]) == (403, "schema")
    adopted = served.post("ann", f"/proposals/{number}/adopt").json
    assert (adopted["state"], adopted["decided_by"]) == ("adopted", "ann")
    assert adopted["commit"] == served.kb.seq
    assert served.post("ann", f"/proposals/{number}/adopt").status_code == 409


def test_a_robot_proposes_and_sees_what_became_of_it_but_not_the_proposals_of_others(
    served: Served,
) -> None:
    made = served.post("nao-2", "/proposals", added=[LINE], reason="seen there")
    assert made.status_code == 201
    assert made.json["added"] == ["<urn:cup> <urn:p> <urn:o> <urn:lab/graph/agent/nao-2> ."]
    address = made.location
    assert served.get("nao-1", address).status_code == 404
    assert all(one["author"] == "nao-1" for one in served.get("nao-1").json["proposals"])
    assert made.json in served.get("eve").json["proposals"]
    assert served.get("reader").status_code == 401
    refused = served.post("eve", f"{address}/refuse", remark="it was a mug").json
    assert (refused["state"], refused["decided_by"]) == ("refused", "eve")
    assert served.get("nao-2", address).json["remark"] == "it was a mug"
    listed = served.get("eve", "/proposals?state=refused&author=nao-2").json["proposals"]
    assert [one["number"] for one in listed] == [made.json["number"]]


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ({}, 400),
        ({"added": LINE}, 400),
        ({"added": ["no statement"]}, 400),
        ({"added": [LINE], "rests_on": True}, 400),
        ({"add": [LINE]}, 400),
    ],
)
def test_a_request_that_is_no_proposal_says_why(
    served: Served, fields: dict[str, Any], status: int
) -> None:
    assert served.post("nao-1", "/proposals", **fields).status_code == status
    assert served.get("ann", "/proposals/999999").status_code == 404
    assert served.get("ann", "/proposals/one").status_code == 404
    assert served.get("ann", "/proposals?state=open").status_code == 400
