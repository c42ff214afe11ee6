"""Cards of classes and properties: one address for the page and for programs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import closing

import pytest
from flask.testing import FlaskClient

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.asking.cards import card_of, find_term, list_terms
from rtask.asking.check.checker import Checker
from rtask.engine import Engine
from rtask.rdf.terms import prologue
from tests.servers import new_application

pytestmark = pytest.mark.slow  # opens the ontology

HTML = {"Accept": "text/html"}


@pytest.fixture(scope="module")
def kb() -> Iterator[rtask.KnowledgeBase]:
    with rtask.open(":memory:", base="urn:lab/") as kb:
        kb.update(
            f"{prologue({'rt': ontology.NS})} INSERT DATA {{ "
            "<urn:m> a rt:Mug ; rt:name 'red' ; rt:mass 0.2e0 . <urn:b> a rt:Bottle }"
        )
        yield kb


@pytest.fixture(scope="module")
def client(kb: rtask.KnowledgeBase) -> Iterator[FlaskClient]:
    with closing(TokenStore(None)) as tokens, Engine(kb) as engine:
        application = new_application(kb, engine, tokens, Config())
        yield create_app(application).test_client()
        application.close()


@pytest.mark.parametrize("written", ["Mug", "rt:Mug", f"<{ontology.NS}Mug>", "mug"])
def test_a_class_is_described_with_its_members_properties_and_a_query(
    client: FlaskClient, kb: rtask.KnowledgeBase, written: str
) -> None:
    card = client.get("/terms", query_string={"term": written}).get_json()
    assert (card["term"], card["kind"], card["count"]) == ("rt:Mug", "class", 1)
    assert card["above"] == ["rt:Cup"]
    assert {"term": "rt:mass", "count": 1} in card["uses"]
    rows = kb.select(prologue(ontology.PREFIXES) + card["example"]).to_dicts()
    assert {row["thing"] for row in rows} == {"urn:m"}


def test_a_property_is_described_with_the_most_specific_classes_that_it_relates(
    client: FlaskClient, kb: rtask.KnowledgeBase
) -> None:
    card = client.get("/terms", query_string={"term": "rt:mass"}).get_json()
    assert (card["domain"], card["range"]) == (["rt:ManipulableObject"], ["xsd:double"])
    assert card["uses"] == [{"term": "rt:Mug", "count": 1}]
    assert len(kb.select(prologue(ontology.PREFIXES) + card["example"])) == card["count"] == 1


def test_an_action_is_described_with_what_must_hold_before_it_and_holds_after_it(
    client: FlaskClient, kb: rtask.KnowledgeBase
) -> None:
    card = client.get("/terms", query_string={"term": "rt:Place"}).get_json()
    assert "?thing a rt:Exemplar" in card["parameters"][0]
    assert {"?robot rt:reaches ?place", "?thing rt:locatedOn ?hand"} <= set(card["preconditions"])
    assert "?thing rt:locatedOn ?place" in card["additions"]
    assert "?thing rt:locatedOn ?hand" in card["removals"]
    lines = card_of(kb.select, find_term(kb.select, "rt:Place")).lines()
    assert "before: ?robot rt:reaches ?place" in lines
    page = client.get("/terms", query_string={"term": "rt:Place"}, headers=HTML).text
    assert "<code>?robot rt:reaches ?place</code>" in page
    assert client.get("/terms", query_string={"term": "rt:Mug"}).get_json()["preconditions"] == []


def test_every_listed_term_has_a_card_whose_query_can_be_asked(
    client: FlaskClient, kb: rtask.KnowledgeBase
) -> None:
    listed = client.get("/terms", query_string={"words": "grasp"}).get_json()["terms"]
    assert "rt:hasGrasp" in [line["term"] for line in listed]
    for line in listed:
        card = client.get("/terms", query_string={"term": line["term"]}).get_json()
        assert card["kind"] == line["kind"]
        kb.select(prologue(ontology.PREFIXES) + card["example"])


@pytest.mark.parametrize(
    "kind", [pytest.param("every", marks=pytest.mark.deep), "of a sample", "of a search"]
)
def test_the_check_finds_no_fault_in_the_query_of_a_card(
    kb: rtask.KnowledgeBase, kind: str
) -> None:
    terms = [line.term for line in list_terms(kb.select)]
    if kind == "of a sample":
        terms = terms[::40]
    elif kind == "of a search":
        terms = ["rt:matches", "rt:score", "rt:text", "rt:limit", "rt:lang", "rt:waitsFor"]
    checker = Checker(kb)
    for term in terms:
        card = card_of(kb.select, find_term(kb.select, term))
        query = prologue(ontology.PREFIXES) + card.example
        assert [finding.words for finding in checker.check(query)] == [], term
        kb.query(query)


def test_people_get_the_same_as_pages_that_lead_to_the_workbench(client: FlaskClient) -> None:
    page = client.get("/terms", query_string={"term": "Mug"}, headers=HTML).text
    assert "A cup with a handle." in page
    assert "/sparql?query=" in page
    assert "rt:hasGrasp" in client.get("/terms?words=has+grasp", headers=HTML).text
    assert "No class or property" in client.get("/terms?words=nonesuch", headers=HTML).text


def test_cards_lead_to_terms_that_have_one(client: FlaskClient) -> None:
    page = client.get("/terms", query_string={"term": "rt:graspWidth"}, headers=HTML).text
    assert "xsd:double" in page
    linked = set(re.findall(r'href="(/terms[?]term=[^"]+)"', page))
    assert linked
    assert {client.get(link, headers=HTML).status_code for link in linked} == {200}


def test_what_is_no_term_is_refused_with_the_nearest_name(client: FlaskClient) -> None:
    for headers in ({}, HTML):
        answered = client.get("/terms", query_string={"term": "Mugg"}, headers=headers)
        assert answered.status_code == 404
        assert "mug" in answered.text
        thing = client.get("/terms", query_string={"term": "kb:object/7"}, headers=headers)
        assert thing.status_code == 404
        assert client.get("/terms?term=no:such", headers=headers).status_code == 400


def test_the_example_of_a_property_of_records_finds_them(kb: rtask.KnowledgeBase) -> None:
    """Graphs of records are not reasoned about, so that a domain does not tell their types."""
    card = card_of(kb.select, find_term(kb.select, "rt:graphOwner"))
    assert "a rt:NamedGraph" in card.example
    with rtask.open(":memory:", base="urn:lab/") as lab:
        lab.update("INSERT DATA { <urn:a> <urn:b> <urn:c> }", agent="nao")
        card = card_of(lab.select, find_term(lab.select, "rt:graphOwner"))
        assert card.count == 1
        assert len(lab.select(prologue(ontology.PREFIXES) + card.example)) == 1


def test_a_page_leads_only_to_pages_that_the_server_has(client: FlaskClient) -> None:
    """This application offers no services, so that there is no editor of grasps or pipelines."""
    page = client.get("/terms", headers=HTML).get_data(as_text=True)
    leads = set(re.findall(r'(?:header|nav|footer|a)[^>]* href="(/[a-z/]*)"', page))
    assert {"/objects", "/terms", "/plan"} <= leads
    missing = {path for path in leads if client.get(path, headers=HTML).status_code == 404}
    assert missing == set()
    found = client.get("/search", query_string={"q": "pipeline"}).get_data(as_text=True)
    assert "/tools/pipeline" not in found
