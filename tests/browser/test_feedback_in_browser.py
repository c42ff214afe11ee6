"""Two people judge an attempt in a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import cv2
import numpy as np
import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from tests.servers import RunningServer, running_server

FACTS = f"""
PREFIX rt: <{ontology.NS}> PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX cora: <{ontology.PREFIXES["cora"]}> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
INSERT DATA {{
  <urn:lab/robot/nao-1> a cora:Robot ; rt:name "nao-1" .
  <urn:lab/hand> a rt:Hand ; rt:gripperType "nao" .
  <urn:lab/object/1> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue mug" ;
    rt:hasGrasp <urn:lab/grasp/1> .
  <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao" .
  <urn:lab/task/1> a rt:Grasp ; rt:handles <urn:lab/object/1> ; rt:through <urn:lab/attempt/1> .
  <urn:lab/attempt/1> a rt:GraspAttempt ; rt:performedBy <urn:lab/robot/nao-1> ;
    rt:activates <urn:lab/hand> ; rt:executesGrasp <urn:lab/grasp/1> ; rt:requestId "urn:task:1" ;
    rt:hasOutcome <urn:lab/outcome/1> ; prov:endedAtTime "2026-01-01T10:00:00Z"^^xsd:dateTime .
  <urn:lab/outcome/1> a rt:GraspOutcome ; rt:success true ; rt:hasReason rt:reason_ok ;
    rt:hasFeedback <urn:lab/feedback/1> .
  <urn:lab/feedback/1> a rt:PhysicsFeedback ; rt:verdict true .
  <urn:lab/attempt/1/image/1> a rt:ColorImage ; rt:name "lifted" ; rt:hasBlob <BLOB> ;
    prov:wasGeneratedBy <urn:lab/attempt/1> .
}}"""

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str, str]]:
    """A server with one attempt and its picture, and the tokens of two people."""
    folder = tmp_path_factory.mktemp("judging") / "store"
    _, png = cv2.imencode(".png", np.full((60, 80, 3), 128, np.uint8))
    with rtask.open(folder, base="urn:lab/") as kb:
        with kb.transaction(agent="nao-1") as tx:
            blob = tx.blob(png.tobytes(), "image/png")
        kb.update(FACTS.replace("BLOB", blob.value), "nao-1")
    with closing(TokenStore(folder)) as tokens:
        ann, bob = (tokens.create("teacher", agent=name)[0] for name in ("ann", "bob"))
    with running_server(folder) as running:
        yield running, ann, bob


def signed_in(browser: Any, server: RunningServer, token: str) -> Any:
    page = browser.new_context(locale="en").new_page()
    page.set_default_timeout(60_000)
    page.faults = []
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.goto(f"{server.url}/login?next=/feedback")
    page.get_by_label("Access token").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url("**/feedback")
    return page


def test_two_people_disagree_and_both_words_are_kept(
    browser: Any, site: tuple[RunningServer, str, str]
) -> None:
    server, token_ann, token_bob = site
    ann = signed_in(browser, server, token_ann)
    card = ann.locator("#attempt-1")
    image = card.get_by_role("img", name="blue mug, lifted")
    image.scroll_into_view_if_needed()
    ann.wait_for_function("() => document.querySelector('#attempt-1 img').naturalWidth === 80")
    card.get_by_text("Correct", exact=True).click()
    card.get_by_label("Outcome").select_option("false")
    card.get_by_label("Reason").select_option("slip_lift")
    card.get_by_role("button", name="Store the correction").click()
    ann.wait_for_url("**/feedback#attempt-1")
    assert card.get_by_text("ann: did not hold (slip_lift)").count() == 1

    bob = signed_in(browser, server, token_bob)
    card = bob.locator("#attempt-1")
    assert card.get_by_text("You speak as bob.").count() == 1
    card.get_by_role("button", name="Confirm").click()
    bob.wait_for_url("**/feedback#attempt-1")
    assert card.get_by_text("disputed, nothing").count() == 1
    assert card.get_by_text("ann: did not hold").count() == 1
    assert card.get_by_text("bob: held").count() == 1
    assert ann.faults == bob.faults == []
    for page in (ann, bob):
        page.context.close()
