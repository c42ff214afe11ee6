"""The page about learning: its counts are those of the graph."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from flask.testing import FlaskClient

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.pages.drawn import belief_over
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.wsgi import create_app
from tests.servers import new_application

pytestmark = pytest.mark.slow

TRIES = (  # robot, object, whether it held; the oldest first
    ("a", 1, False), ("a", 1, True), ("b", 1, True), ("b", 2, False), ("b", 2, True),
    ("a", 2, True), ("b", 2, True),
)  # fmt: skip


def _facts() -> str:
    lines = [f"<urn:lab/robot/{name}> a cora:Robot ; rt:name 'robot {name}' ." for name in "ab"]
    for thing in (1, 2):
        lines.append(f"<urn:lab/object/{thing}> a rt:Mug ; rt:objectId 'lab/{thing}' ;"
                     f" rt:name '<i>mug {thing}</i>' ; rt:hasGrasp <urn:lab/grasp/{thing}> ."
                     f"<urn:lab/grasp/{thing}> a rt:PlanarGrasp .")  # fmt: skip
    for number, (robot, thing, held) in enumerate(TRIES):
        lines.append(f"<urn:lab/attempt/{number}> a rt:GraspAttempt ;"
                     f" rt:performedBy <urn:lab/robot/{robot}> ;"
                     f" rt:executesGrasp <urn:lab/grasp/{thing}> ;"
                     f" rt:hasOutcome <urn:lab/outcome/{number}> ;"
                     f" rt:priorAlpha {1 + number}.0e0 ; rt:priorBeta 1.0e0 ;"
                     f" prov:endedAtTime '2026-01-01T10:00:0{number}Z'^^xsd:dateTime ."
                     f"<urn:lab/outcome/{number}> a rt:GraspOutcome ;"
                     f" rt:judgedSuccess {str(held).lower()} .")  # fmt: skip
    return f"""PREFIX rt: <{ontology.NS}> PREFIX prov: <http://www.w3.org/ns/prov#>
    PREFIX cora: <{ontology.PREFIXES["cora"]}> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
    INSERT DATA {{ {" ".join(lines)} }}"""


@pytest.fixture
def client(tmp_path: Path) -> Iterator[FlaskClient]:
    with rtask.open(":memory:", base="urn:lab/") as kb, closing(TokenStore(tmp_path)) as tokens:
        kb.update(_facts(), "ann")
        yield create_app(new_application(kb, NoEngine(), tokens, Config())).test_client()


def test_attempts_are_counted_by_what_was_known_before(client: FlaskClient) -> None:
    model = client.get("/learning.json").get_json()
    assert model["attempts"] == len(TRIES)
    assert {one["name"]: (one["attempts"], one["held"]) for one in model["known"]} == {
        "nobody had tried the object": (2, 0),
        "only the robot itself had": (2, 2),
        "only other robots had": (2, 2),
        "the robot and others had": (1, 1),
    }
    counts = [(one["name"], one["attempts"], one["held"]) for one in model["counts"]]
    assert counts == [("none", 2, 0), ("1", 2, 2), ("2 to 4", 3, 3)]
    (last,) = belief_over([False, True, True, True])[-1:]
    assert model["grasps"][0]["grasp"] == "urn:lab/grasp/2"
    assert model["grasps"][0]["mean"] == pytest.approx(last["mean"])
    assert [(one["name"], one["attempts"]) for one in model["robots"]] == [
        ("robot a", 3), ("robot b", 4),
    ]  # fmt: skip


def test_the_page_shows_them_and_its_query_and_names_are_harmless(client: FlaskClient) -> None:
    page = client.get("/learning", headers={"Accept": "text/html"}).text
    assert "only other robots had" in page
    assert "&lt;i&gt;mug 1&lt;/i&gt;" in page
    assert "rt:judgedSuccess ?success" in page


def test_an_empty_graph_says_how_outcomes_come(tmp_path: Path) -> None:
    with rtask.open(":memory:") as kb, closing(TokenStore(tmp_path)) as tokens:
        application = new_application(kb, NoEngine(), tokens, Config())
        page = create_app(application).test_client().get("/learning").text
    assert "No outcome is known yet" in page


def test_curves_follow_own_attempts_with_and_without_those_of_others(client: FlaskClient) -> None:
    alone, shared = client.get("/learning.json").get_json()["curves"]
    # By own earlier attempts: object 1 by a: 0, 1; object 2 by b: 0, 1. Then others had tried.
    assert [(one["attempts"], one["held"]) for one in alone["points"]] == [(2, 0), (2, 2)]
    # Object 1 by b: 0; object 2 by a: 0, and by b, which had tried it twice: no point at 1.
    assert [(one["attempts"], one["held"]) for one in shared["points"]] == [(2, 2)]


def test_beliefs_before_are_shown_beside_what_happened(client: FlaskClient) -> None:
    found = client.get("/learning.json").get_json()["expected"]
    # Prior means of the seven attempts: 1/2, 2/3, 3/4, 4/5, 5/6, 6/7, 7/8.
    assert [(one["name"], one["attempts"], one["held"]) for one in found] == [
        ("40 to 60 %", 1, 0), ("60 to 80 %", 2, 2), ("80 to 100 %", 4, 3),
    ]  # fmt: skip
    assert found[1]["expected"] == pytest.approx((2 / 3 + 3 / 4) / 2)
