"""The page of outcomes: who sees it, who judges, and that no other page can."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from flask.testing import FlaskClient

import ontology
from rtask.engine.words import REASONS
from tests.endpoint.sites import HOST, Site

pytestmark = pytest.mark.slow

FACTS = f"""
PREFIX rt: <{ontology.NS}> PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX cora: <{ontology.PREFIXES["cora"]}> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
INSERT DATA {{
  <urn:lab/robot/nao-1> a cora:Robot ; rt:name "nao-1" ; rt:hasEndEffector <urn:lab/hand> .
  <urn:lab/hand> a rt:Hand ; rt:gripperType "nao" ; rt:name "hand" ; rt:maxOpening 0.05e0 .
  <urn:lab/object/1> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue <mug>" ;
    rt:hasGrasp <urn:lab/grasp/1> .
  <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao" ; rt:graspQuality 0.8e0 .
  <urn:lab/task/1> a rt:Grasp ; rt:handles <urn:lab/object/1> ; rt:through <urn:lab/attempt/1> .
  <urn:lab/attempt/1> a rt:GraspAttempt ; rt:performedBy <urn:lab/robot/nao-1> ;
    rt:activates <urn:lab/hand> ; rt:executesGrasp <urn:lab/grasp/1> ; rt:requestId "urn:task:1" ;
    rt:hasOutcome <urn:lab/outcome/1> ; prov:endedAtTime "2026-01-01T10:00:00Z"^^xsd:dateTime .
  <urn:lab/outcome/1> a rt:GraspOutcome ; rt:success true ; rt:hasReason rt:reason_ok ;
    rt:hasFeedback <urn:lab/feedback/1> .
  <urn:lab/feedback/1> a rt:PhysicsFeedback ; rt:verdict true .
}}"""


@pytest.fixture
def site() -> Iterator[Site]:
    with Site.opened(FACTS) as opened:
        yield opened


def page(browser: FlaskClient) -> str:
    answer = browser.get("/feedback", base_url=HOST, headers={"Accept": "text/html"})
    assert answer.status_code == 200
    return answer.text


def judge(browser: FlaskClient, origin: str | None = HOST, **form: str) -> Any:
    secret = re.search(r'name="secret" value="([^"]+)"', page(browser))
    assert secret
    form = {"secret": secret.group(1), "task_id": "urn:task:1", **form}
    headers = {"Origin": origin} if origin else {}
    return browser.post("/feedback", data=form, base_url=HOST, headers=headers)


def attempt(browser: FlaskClient) -> dict[str, Any]:
    (only,) = browser.get("/feedback.json", base_url=HOST).get_json()["attempts"]
    return dict(only)


def test_strangers_are_asked_to_sign_in(site: Site) -> None:
    answer = site.app.test_client().get("/feedback", base_url=HOST, headers={"Accept": "text/html"})
    assert answer.status_code == 303
    assert answer.headers["Location"].startswith("/login")


def test_two_people_disagree_and_the_page_says_so(site: Site) -> None:
    ann, bob = site.signed_in("ann"), site.signed_in("bob")
    assert "blue &lt;mug&gt;" in page(ann)
    answer = judge(ann, verdict="correct", held="false", reason="slip_lift", comment="slid <b>out")
    assert answer.status_code == 303
    assert answer.headers["Location"].endswith("#attempt-1")
    found = attempt(ann)
    assert (found["decided"], found["judged"], found["disputed"]) == (True, False, False)
    assert judge(bob, verdict="confirm").status_code == 303
    found = attempt(bob)
    assert (found["judged"], found["disputed"]) == (None, True)
    assert [(v["by"], v["held"], v["reason"]) for v in found["verdicts"]] == [
        ("ann", False, "slip_lift"), ("bob", True, ""),
    ]  # fmt: skip
    text = page(bob)
    assert "disputed" in text
    assert "slid &lt;b&gt;out" in text


def test_neither_robots_nor_foreign_pages_judge(site: Site) -> None:
    robot = site.signed_in("nao-1")
    assert 'class="judge"' not in page(robot)
    form = {"task_id": "urn:task:1", "verdict": "confirm"}
    headers = {"Authorization": f"Bearer {site.tokens['nao-1']}"}
    assert robot.post("/feedback", data=form, base_url=HOST, headers=headers).status_code == 403
    ann = site.signed_in("ann")
    assert judge(ann, origin="https://evil.example", verdict="confirm").status_code == 403
    assert judge(ann, secret="another", verdict="confirm").status_code == 403
    assert judge(ann, verdict="confirm", operator="bob").status_code == 403
    assert attempt(ann)["verdicts"] == []


def test_an_operator_gives_the_name_of_who_speaks(site: Site) -> None:
    boss = site.signed_in("boss")
    assert 'name="operator"' in page(boss)
    assert "You speak as" in page(boss)  # who is signed in need not type a name
    assert 'name="operator"' not in page(site.signed_in("ann"))
    answer = judge(boss, verdict="refuse", operator="cleo")
    assert "by=cleo" in answer.headers["Location"]
    assert attempt(boss)["verdicts"][0]["by"] == "cleo"
    server = site.app.extensions["rtask"].context
    assert server.audit.recent(1)[0]["event"] == "feedback"


def test_pictures_stand_in_the_order_of_time_whatever_the_graph_gives(site: Site) -> None:
    images = ""
    for number, phase in enumerate(["pre_grasp", "closed", "held", "placed", "rinsed"], 1):
        with site.kb.transaction(agent="nao-1") as tx:
            blob = tx.blob(f"picture {number}".encode(), "image/png").value
        images += f"""<urn:lab/attempt/1/image/{number}> a rt:ColorImage ; rt:name "{phase}" ;
            rt:hasBlob <{blob}> ; prov:wasGeneratedBy <urn:lab/attempt/1> . """
    site.kb.update(f"{FACTS.partition('INSERT')[0]} INSERT DATA {{ {images} }}", "nao-1")
    ann = site.signed_in("ann")
    found = attempt(ann)
    phases = [picture["phase"] for picture in found["pictures"]]
    assert phases == ["pre_grasp", "closed", "held", "placed", "rinsed"]
    assert (found["before"]["phase"], found["after"]["phase"]) == ("pre_grasp", "placed")
    before, after = (
        re.search(rf'src="/api/blobs/{found[name]["sha"]}" alt="([^"]*)"', page(ann))
        for name in ("before", "after")
    )
    assert before
    assert before.group(1) == "blue &lt;mug&gt;, before the grasp"
    assert after
    assert after.group(1) == "blue &lt;mug&gt;, put down"


def test_the_page_speaks_in_words_and_not_in_codes(site: Site) -> None:
    ann = site.signed_in("ann")
    assert judge(ann, verdict="correct", held="false", reason="ik").status_code == 303
    text = page(ann)
    assert "did not hold (the hand could not reach it)" in text
    assert ">ik<" not in text


def test_every_reason_of_the_ontology_has_words(site: Site) -> None:
    codes = site.kb.select(
        f"SELECT ?code {{ ?reason a <{ontology.NS}OutcomeReason> ; <{ontology.NS}code> ?code }}"
    )
    assert {str(row.value("code")) for row in codes} == set(REASONS)


@pytest.mark.parametrize(
    ("show", "found"), [("all", 1), ("unjudged", 1), ("disputed", 0), ("failed", 0)]
)
def test_attempts_are_filtered_before_they_are_counted(site: Site, show: str, found: int) -> None:
    ann = site.signed_in("ann")
    asked = ann.get(f"/feedback.json?show={show}", base_url=HOST).get_json()
    assert len(asked["attempts"]) == found
    judge(ann, verdict="refuse")
    now = {
        name: len(ann.get(f"/feedback.json?show={name}", base_url=HOST).get_json()["attempts"])
        for name in ("all", "unjudged", "failed")
    }
    assert now == {"all": 1, "unjudged": 0, "failed": 1}
    elsewhere = ann.get("/feedback.json?robot=urn:lab/robot/nao-2", base_url=HOST).get_json()
    assert elsewhere["attempts"] == []
    assert ann.get("/feedback.json?show=lost", base_url=HOST).status_code == 400


def test_an_attempt_that_does_not_exist_gets_a_problem_page(site: Site) -> None:
    ann = site.signed_in("ann")
    answer = judge(ann, verdict="confirm", task_id="urn:task:2")
    assert answer.status_code == 422
    assert "did you mean" in answer.text
