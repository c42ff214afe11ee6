"""The tree of classes and the proofs of statements in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import httpx
import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.pages import EACH_LOOK, LOOKS, PHONE, fits, keep_picture, open_page
from tests.browser.waiting import has_count
from tests.servers import RunningServer, bearer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

RT = ontology.NS
TYPE = ontology.PREFIXES["rdf"] + "type"
PREFIXES = " ".join(f"PREFIX {name}: <{ontology.PREFIXES[name]}>" for name in ("rt", "owl", "rdfs"))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    """A cup that is a drinking vessel only because of its handle and its use; ann's token."""
    folder: Path = tmp_path_factory.mktemp("proofs") / "store"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(
            f"""{PREFIXES} INSERT DATA {{
            <urn:lab/cup> a rt:ManipulableObject ; rt:objectId "lab/1" ; rt:name "red cup" ;
              rt:hasFunction rt:containLiquid ; rt:hasFeature <urn:lab/handle> .
            <urn:lab/handle> a rt:HandleShape .
            <urn:lab/mug> a rt:Mug ; rt:objectId "lab/2" ; rt:name "blue mug" . }}""",
            "ann",
        )
    with closing(TokenStore(folder)) as tokens:
        ann, _ = tokens.create("teacher", agent="ann", rights=["schema"])
    with running_server(folder) as running:
        yield running, ann


def _count(server: RunningServer, where: str) -> int:
    query = f"{PREFIXES} SELECT (COUNT(DISTINCT ?x) AS ?n) {{ {where} }}"
    rows = httpx.get(f"{server.url}/sparql", params={"query": query}).json()
    return int(rows["results"]["bindings"][0]["n"]["value"])


@pytest.mark.parametrize("look", EACH_LOOK)
def test_the_tree_is_walked_by_keys_and_its_counts_are_those_of_sparql(
    browser: Any, site: tuple[RunningServer, str], look: str
) -> None:
    server, _ = site
    with open_page(browser, server.url, **LOOKS[look]) as page:
        page.goto(f"{server.url}/classes?{urlencode({'iri': 'rt:Cup'})}")
        item = page.locator(f'[role=treeitem][data-iri="{RT}Cup"]')
        assert item.get_attribute("aria-selected") == "true"
        page.wait_for_selector(".scripted")
        item.locator("> a").focus()
        page.keyboard.press("ArrowLeft")  # to the superclass, or closes
        page.keyboard.press("ArrowUp")
        page.keyboard.press("ArrowDown")
        assert page.evaluate("() => document.activeElement.closest('[role=treeitem]') !== null")
        page.goto(f"{server.url}/classes")
        page.wait_for_selector(".scripted")
        closed = page.locator('[role=treeitem][aria-expanded="false"]:visible').first
        closed.locator("> a").focus()
        page.keyboard.press("ArrowRight")
        closed_iri = closed.get_attribute("data-iri")
        assert closed_iri
        page.locator("[role=treeitem] > a:focus").wait_for()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        page.wait_for_url("**/classes?iri=**")
        assert fits(page)
        keep_picture(page, f"classes-{look}")
    told = httpx.get(f"{server.url}/classes.json", params={"iri": "rt:DrinkingVessel"}).json()
    chosen = told["chosen"]
    assert chosen["all"] == _count(server, "?x a rt:DrinkingVessel") == 2
    assert chosen["direct"] == 0
    assert any("some" in one["text"] for one in chosen["axioms"])


def test_a_new_class_appears_on_an_open_page(browser: Any, site: tuple[RunningServer, str]) -> None:
    server, token = site
    with open_page(browser, server.url) as page:
        page.goto(f"{server.url}/classes?{urlencode({'iri': 'rt:Mug'})}")
        page.get_by_role("heading", level=1).wait_for()
        with page.expect_response(lambda r: "/changes?" in r.url):
            page.reload()
        update = f"""{PREFIXES} INSERT DATA {{ <urn:lab/onto#BeerMug> a owl:Class ;
          rdfs:subClassOf rt:Mug ; rdfs:label "beer mug" }}"""
        httpx.post(
            f"{server.url}/update", data={"update": update}, headers=bearer(token)
        ).raise_for_status()
        page.locator('[data-iri="urn:lab/onto#BeerMug"] > a').wait_for(state="attached")


def _proof_of_vessel(server: RunningServer) -> str:
    given = {"s": "urn:lab/cup", "p": TYPE, "o": f"{RT}DrinkingVessel"}
    return f"{server.url}/explain?{urlencode(given)}"


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_derived_statement_leads_to_its_proof(
    browser: Any, site: tuple[RunningServer, str], look: str
) -> None:
    server, _ = site
    with open_page(browser, server.url, **LOOKS[look]) as page:
        page.goto(f"{server.url}/resource?iri=urn:lab/cup")
        row = page.get_by_role("row").filter(has_text="rt:DrinkingVessel")
        row.get_by_role("link", name="proof").click()
        page.wait_for_url("**/explain?**")
        has_count(page.get_by_text("Nobody states it. It follows:"), 1)
        assert page.locator("ol.proof ol.proof").count() >= 1
        claim = page.locator(".claim").first.inner_text()
        assert claim.split("\n")[0].strip() == "red cup is a drinking vessel"
        assert page.get_by_text("by ann").count() >= 1
        assert page.get_by_role("button", name="Withdraw this").count() == 0  # a stranger
        assert fits(page)
        keep_picture(page, f"proof-{look}")


def test_a_proof_of_three_steps_is_told_from_the_conclusion_to_what_was_stated(
    browser: Any, site: tuple[RunningServer, str]
) -> None:
    server, _ = site
    with open_page(browser, server.url, **LOOKS["phone-dark"]) as page:
        asked = {"s": "urn:lab/mug", "p": "rdf:type", "o": "rt:Container"}
        page.goto(f"{server.url}/explain?{urlencode(asked)}")
        claims = page.locator(".proof .claim").evaluate_all(
            "all => all.map(one => [...one.querySelectorAll('a[title]')]"
            ".map(link => link.textContent).join(' '))"
        )
        assert claims == ["blue mug is a container", "blue mug is a cup", "blue mug is a mug"]
        has_count(page.locator("ol.proof ol.proof ol.proof"), 1)
        assert fits(page)


def test_a_withdrawn_leaf_removes_the_conclusion_on_another_open_page(
    browser: Any, site: tuple[RunningServer, str]
) -> None:
    server, token = site
    with (
        open_page(browser, server.url) as watching,
        open_page(browser, server.url, token, viewport=PHONE) as page,
    ):
        with watching.expect_response(lambda r: "/changes?" in r.url):
            watching.goto(_proof_of_vessel(server))
        page.goto(_proof_of_vessel(server))
        leaf = page.locator("ol.proof li").filter(has_text="contain liquid").last
        leaf.get_by_role("button", name="Withdraw this").click()
        page.get_by_text("It does not hold").wait_for()
        watching.get_by_text("It does not hold").wait_for()
    again = f"{PREFIXES} INSERT DATA {{ <urn:lab/cup> rt:hasFunction rt:containLiquid }}"
    httpx.post(
        f"{server.url}/update", data={"update": again}, headers=bearer(token)
    ).raise_for_status()
    assert httpx.get(f"{server.url}/terms.json").json()["terms"]


def test_what_is_no_statement_is_refused_with_the_reason(site: tuple[RunningServer, str]) -> None:
    server, _ = site
    assert httpx.get(f"{server.url}/explain.json").status_code == 400
    wrong = httpx.get(f"{server.url}/explain.json", params={"s": "a b", "p": TYPE, "o": "urn:x"})
    assert wrong.status_code == 400
    assert "'a b' is not an RDF term" in wrong.json()["detail"]
    given = {"s": "urn:lab/cup", "p": f"{RT}name", "o": '"red cup"'}
    stranger = httpx.post(f"{server.url}/explain/withdraw", data=given)
    assert stranger.status_code in (401, 403)
    known = httpx.get(f"{server.url}/terms.json")
    again = httpx.get(f"{server.url}/terms.json", headers={"If-None-Match": known.headers["etag"]})
    assert again.status_code == 304
