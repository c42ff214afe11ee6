"""Questions in words over HTTP: one address for the page and for programs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest
from flask.testing import FlaskClient

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.engine import Engine
from tests.servers import new_application

pytestmark = pytest.mark.slow  # opens the ontology

HTML = {"Accept": "text/html"}
ATTEMPT = f"""PREFIX rt: <{ontology.NS}> INSERT DATA {{
  <urn:lab/robot/nao> rt:name "nao" .
  <urn:lab/attempt/1> a rt:GraspAttempt ; rt:performedBy <urn:lab/robot/nao> ;
    rt:hasOutcome <urn:lab/outcome/1> .
  <urn:lab/outcome/1> rt:success true }}"""
CUPS = {"text": "which cups are there?"}


@pytest.fixture(scope="module")
def client() -> Iterator[FlaskClient]:
    with (
        closing(TokenStore(None)) as tokens,
        rtask.open(":memory:", base="urn:lab/") as kb,
        Engine(kb) as engine,
    ):
        kb.update(
            f"INSERT DATA {{ <urn:cup> a <{ontology.NS}Cup> ; <{ontology.NS}name> 'red <b>' }}"
        )
        kb.update(ATTEMPT)
        application = new_application(kb, engine, tokens, Config())
        yield create_app(application).test_client()
        application.close()


def test_programs_get_the_answer_its_query_and_what_was_understood(client: FlaskClient) -> None:
    answered = client.get("/ask", query_string=CUPS).get_json()
    assert answered["sentence"] == "Cups: red <b>."
    assert f"<{ontology.NS}Cup>" in answered["sparql"]
    assert len(answered["rows"]) == 1


def test_people_get_the_same_as_a_page_that_leads_to_the_workbench(client: FlaskClient) -> None:
    page = client.get("/ask", query_string=CUPS, headers=HTML).text
    assert "Cups: red &lt;b&gt;." in page
    assert "/resource?iri=urn%3Acup" in page
    assert "/sparql?query=" in page


def test_each_number_of_an_answer_leads_to_what_it_rests_on(client: FlaskClient) -> None:
    asked = {"text": "how often did each robot succeed in grasping?"}
    answered = client.get("/ask", query_string=asked).get_json()
    assert answered["rows"]
    assert len(answered["why"]) == len(answered["rows"])
    assert answered["why"] == ["/feedback?robot=urn%3Alab%2Frobot%2Fnao"]
    page = client.get("/ask", query_string=asked, headers=HTML).text
    # Three cells of the table, and the number in the sentence above it.
    assert page.count('data-figure href="/feedback?robot=urn%3Alab%2Frobot%2Fnao"') == 4
    assert client.get(answered["why"][0], headers=HTML).status_code == 200
    plain = client.get("/ask", query_string=CUPS).get_json()
    assert plain["why"] == [""]


def test_words_that_are_near_to_no_question_get_the_three_nearest(client: FlaskClient) -> None:
    asked = {"text": "pale ideas sleep furiously"}
    answered = client.get("/ask", query_string=asked).get_json()
    assert (answered["question"], answered["rows"]) == (None, [])
    assert len(answered["nearest"]) == 3
    page = client.get("/ask", query_string=asked, headers=HTML).text
    assert page.count('href="/ask?text=') == 3


def test_no_text_lists_the_questions_to_people_and_is_an_error_for_programs(
    client: FlaskClient,
) -> None:
    assert client.get("/ask").status_code == 400
    listed = client.get("/ask", headers=HTML).text
    queries = [path.read_text("utf-8") for path in ontology.queries()]
    here = [text for text in queries if "kb/sample/" not in text]  # this graph has no example
    assert 0 < len(here) < len(queries)
    assert listed.count('href="/ask?text=') == len(here)
    assert client.get("/ask", query_string={"text": "x" * 1_001}).status_code == 400
    assert "1 to 1000 characters" in client.get(
        "/ask", query_string={"text": "x" * 1_001}, headers=HTML
    ).text  # fmt: skip
