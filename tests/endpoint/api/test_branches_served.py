"""`/branches`, and `/sparql?branch=`: made, changed, compared, merged and dropped over HTTP."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from flask.testing import FlaskClient

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.wsgi import create_app
from tests.servers import new_application

_COUNT = "SELECT (COUNT(*) AS ?n) { ?s a <urn:Vessel> }"
_SCHEMA = "<http://www.w3.org/2000/01/rdf-schema#subClassOf>"


class Served:
    """A served folder, and what its callers send."""

    def __init__(self, tokens: TokenStore, folder: Path) -> None:
        self.kb = rtask.open(folder, base="urn:lab/", ontologies=False, flush="os")
        self.kb.update(f"INSERT DATA {{ <urn:Cup> {_SCHEMA} <urn:Vessel> . <urn:c0> a <urn:Cup> }}")
        config = Config(write_rate=1e6)
        self.app = create_app(new_application(self.kb, NoEngine(), tokens, config))
        self.client: FlaskClient = self.app.test_client()
        roles = {"ann": "admin", "nao-1": "robot", "nao-2": "robot", "guest": "reader"}
        self.who = {
            name: {"Authorization": f"Bearer {tokens.create(role, agent=name)[0]}"}
            for name, role in roles.items()
        }

    def call(self, name: str, method: str, address: str, fields: Any = None) -> Any:
        return self.client.open(address, method=method, json=fields, headers=self.who[name])

    def update(self, name: str, text: str, **fields: str) -> Any:
        data = {"update": text, **fields}
        headers = {**self.who[name], "Accept": "application/json"}
        return self.client.post("/sparql", data=data, headers=headers)

    def vessels(self, name: str, **fields: str) -> int:
        answer = self.client.get(
            "/sparql",
            query_string={"query": _COUNT, **fields},
            headers={**self.who[name], "Accept": "application/sparql-results+json"},
        )
        assert answer.status_code == 200, answer.text
        [row] = answer.json["results"]["bindings"]
        return int(row["n"]["value"])


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with closing(TokenStore(None)) as tokens:
        made = Served(tokens, tmp_path_factory.mktemp("served") / "kb")
        yield made
        made.app.extensions["rtask"].close()
        made.kb.close()


@pytest.mark.slow
def test_a_robot_works_in_a_branch_and_merges_it(served: Served) -> None:
    made = served.call("nao-1", "POST", "/branches", {"name": "tue", "note": "a day"})
    assert (made.status_code, made.location) == (201, "/branches/tue")
    assert (made.json["author"], made.json["note"]) == ("nao-1", "a day")
    changed = served.update("nao-1", "INSERT DATA { <urn:c1> a <urn:Cup> }", branch="tue")
    assert (changed.json["added"], changed.json["derived"]) == (1, 1)
    assert served.vessels("nao-1", branch="tue") == 2
    assert served.vessels("nao-1") == 1
    assert [b["name"] for b in served.call("guest", "GET", "/branches").json["branches"]] == ["tue"]
    compared = served.call("nao-1", "GET", "/branches/tue").json
    assert (len(compared["added"]), compared["derived"], compared["conflicts"]) == (1, 1, [])
    assert served.call("guest", "POST", "/branches/tue/merge").status_code == 403
    merged = served.call("nao-1", "POST", "/branches/tue/merge", {"note": "it went well"})
    assert (merged.status_code, merged.json["added"], merged.json["derived"]) == (200, 1, 1)
    assert served.vessels("nao-1") == 2
    assert served.kb.history()[-1].note == "it went well"
    assert served.call("nao-1", "GET", "/branches/tue").status_code == 404


@pytest.mark.slow
def test_a_conflict_is_named_and_nothing_is_merged(served: Served) -> None:
    served.call("nao-1", "POST", "/branches", {"name": "late"})
    served.update("ann", "INSERT DATA { <urn:c7> a <urn:Cup> }")
    served.call("ann", "POST", "/branches", {"name": "later"})
    served.update("ann", "INSERT DATA { <urn:c7> <urn:p> 1 }", branch="later")
    gone = "DELETE WHERE { GRAPH <urn:lab/graph/agent/ann> { <urn:c7> ?p ?o } }"
    assert served.update("ann", gone).json["removed"] == 1
    stranger = served.update("nao-2", "INSERT DATA { <urn:c8> a <urn:Cup> }", branch="late")
    assert stranger.status_code == 403
    assert "branch late is of nao-1" in stranger.json["detail"]
    refused = served.call("ann", "POST", "/branches/later/merge")
    assert refused.status_code == 409
    assert [c["kind"] for c in refused.json["conflicts"]] == ["withdrawn"]
    assert served.call("nao-2", "DELETE", "/branches/late").status_code == 403
    assert served.call("nao-1", "DELETE", "/branches/late").json["name"] == "late"
    assert served.call("ann", "DELETE", "/branches/later").status_code == 200
    assert served.call("ann", "GET", "/branches").json == {"branches": []}


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ({}, 400),
        ({"name": "../x"}, 400),
        ({"name": "x", "at": True}, 400),
        ({"name": "x", "at": 10_000}, 400),
        ({"name": "x", "hours": 25}, 400),
        ({"name": "x", "size": 1}, 400),
    ],
)
def test_a_request_that_makes_no_branch_says_why(
    served: Served, fields: dict[str, Any], status: int
) -> None:
    assert served.call("nao-1", "POST", "/branches", fields).status_code == status
    assert served.call("guest", "POST", "/branches", {"name": "x"}).status_code == 403


def test_a_branch_that_is_not_there_is_not_found(served: Served) -> None:
    for address in ("/branches/none", "/sparql?query=ASK+%7B%7D&branch=none"):
        assert served.call("ann", "GET", address).status_code == 404
    assert (
        served.update("ann", "INSERT DATA { <urn:a> <urn:b> 1 }", branch="none").status_code == 404
    )
    both = served.call("ann", "GET", "/sparql?query=ASK+%7B%7D&branch=none&as_of=1")
    assert both.status_code == 400
