"""The page about a robot: what it is, what it has, what it tried, and what is wrong to ask."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from flask.testing import FlaskClient

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.engine.engine import Engine
from tests.servers import new_application

pytestmark = pytest.mark.slow

HAND = {"name": "left", "gripper_type": "two-jaw", "max_opening": 0.06, "max_payload": 0.3,
        "max_force": 12.0}  # fmt: skip
CAMERA = {"name": "head", "frame_id": "head_optical", "width": 640, "height": 480, "fx": 525.0,
          "min_range": 0.3, "max_range": 3.0}  # fmt: skip
OUTCOMES = (True, True, False, True)


@pytest.fixture
def client(tmp_path: Path) -> Iterator[FlaskClient]:
    with rtask.open(":memory:", base="urn:lab/") as kb, closing(TokenStore(tmp_path)) as tokens:
        engine = Engine(kb)
        engine.call("register_robot", {"name": "nao-1", "model": "<i>nao</i>-v5",
                                       "end_effectors": [HAND], "cameras": [CAMERA]})  # fmt: skip
        engine.call("register_robot", {"name": "nao-2", "model": "nao-v5",
                                       "end_effectors": [HAND]})  # fmt: skip
        kb.update(_attempts(), "ann")
        yield create_app(new_application(kb, engine, tokens, Config())).test_client()


def _attempts() -> str:
    lines = [
        "<urn:lab/object/1> a rt:Mug ; rt:objectId 'lab/1' ; rt:name 'blue mug' ;"
        " rt:hasGrasp <urn:lab/grasp/1> . <urn:lab/grasp/1> a rt:PlanarGrasp ."
    ]
    for number, held in enumerate(OUTCOMES):
        lines.append(
            f"<urn:lab/task/{number}> a rt:GraspTask ; rt:through <urn:lab/attempt/{number}> ;"
            " rt:handles <urn:lab/object/1> ."
            f"<urn:lab/attempt/{number}> a rt:GraspAttempt ; rt:performedBy <urn:lab/robot/nao-1> ;"
            f" rt:executesGrasp <urn:lab/grasp/1> ; rt:hasOutcome <urn:lab/outcome/{number}> ;"
            f" prov:endedAtTime '2026-01-01T10:00:0{number}Z'^^xsd:dateTime ."
            f"<urn:lab/outcome/{number}> a rt:GraspOutcome ; rt:success {str(held).lower()} ;"
            f" rt:judgedSuccess {str(held).lower()} ."
        )
    return f"""PREFIX rt: <{ontology.NS}> PREFIX prov: <http://www.w3.org/ns/prov#>
    PREFIX xsd: <http://www.w3.org/2001/XMLSchema#> INSERT DATA {{ {" ".join(lines)} }}"""


def test_the_page_says_what_the_robot_is_has_and_did(client: FlaskClient) -> None:
    (nao,) = [
        one for one in client.get("/robots.json").get_json()["robots"] if one["name"] == "nao-1"
    ]
    model = client.get("/robot.json", query_string={"iri": nao["robot"]}).get_json()
    assert (model["name"], model["model"]) == ("nao-1", "<i>nao</i>-v5")
    assert (model["attempts"], model["successes"]) == (len(OUTCOMES), sum(OUTCOMES))
    (hand,), (camera,) = model["hands"], model["cameras"]
    assert (hand["name"], hand["type"], hand["max_opening"]) == ("left", "two-jaw", 0.06)
    assert (camera["width"], camera["height"], camera["max_range"]) == (640, 480, 3.0)
    assert len(model["belief"]) == len(OUTCOMES)
    assert model["belief"][-1]["mean"] == pytest.approx(4 / 6)  # Beta(1 + 3, 1 + 1)
    assert [task["judged"] for task in model["tasks"]] == [*reversed(OUTCOMES)]
    assert {task["object_name"] for task in model["tasks"]} == {"blue mug"}
    text = client.get("/robot", query_string={"iri": nao["robot"]}).get_data(as_text=True)
    assert "&lt;i&gt;nao&lt;/i&gt;-v5" in text
    assert "0 to 60 mm" in " ".join(text.split())


def test_a_robot_that_did_nothing_says_how_to_go_on(client: FlaskClient) -> None:
    answer = client.get("/robot", query_string={"iri": "urn:lab/robot/nao-2"})
    assert answer.status_code == 200
    assert "It has not tried a grasp yet" in answer.get_data(as_text=True)


@pytest.mark.parametrize(
    ("asked", "status", "words"),
    [
        ("urn:lab/robot/nao-3", 404, "no robot urn:lab/robot/nao-3; see /robots"),
        ("urn:lab/object/1", 404, "no robot urn:lab/object/1"),
        ("", 400, "which robot?"),
        ("no iri", 422, "no iri"),
    ],
)
def test_what_is_no_robot_is_said(client: FlaskClient, asked: str, status: int, words: str) -> None:
    answer = client.get("/robot.json", query_string={"iri": asked})
    assert answer.status_code == status
    assert words in answer.get_json()["detail"]


def test_home_shows_what_robots_did_last_and_leads_to_them(client: FlaskClient) -> None:
    events = client.get("/index.json").get_json()["events"]
    assert events
    assert "wrote" not in {event["kind"] for event in events}
    assert 'href="/robot?iri=' in client.get("/").get_data(as_text=True)
