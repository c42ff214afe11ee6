"""The page of a failure: causes, what would have helped, and trying it without being written."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator

import pytest
from flask.testing import FlaskClient

from rtask.kb.commit.access import Access
from rtask.services.definition import define
from simulate.services import FailureTrials
from tests.endpoint.pages.test_why import bare_figures
from tests.endpoint.sites import HOST, OWN, Site
from tests.rtask.tasks.conftest import LAB

pytestmark = pytest.mark.slow

NOTHING = "INSERT DATA { <urn:x> <urn:p> 1 }"
BASE = "urn:lab/"


@pytest.fixture(scope="module")
def failed() -> Iterator[tuple[Site, str]]:
    """A site with a step of the Panda that failed."""
    with Site.opened(NOTHING) as site:
        site.app.extensions["rtask"].context.services.registry.add(define(FailureTrials))
        site.kb.update(LAB.replace("https://example.org/kb/", BASE))
        goal = f"<{BASE}thing/3> rt:locatedOn <{BASE}place/right>"
        site.engine.call("store_plan", {"goal": goal}, Access("ann", "teacher"))
        robot = Access("panda-1", "robot")
        claim = site.engine.call("claim_step", {}, robot)
        ended = {"task": claim.task, "result": "failed", "comment": "ik"}
        site.engine.call("end_step", {**ended, "place": f"{BASE}place/table"}, robot)
        yield site, str(claim.task)


def page(browser: FlaskClient, address: str) -> str:
    answer = browser.get(address, base_url=HOST, headers={"Accept": "text/html"})
    assert answer.status_code == 200, answer.text
    return str(answer.text)


def test_the_page_says_causes_and_offers_to_try(failed: tuple[Site, str]) -> None:
    site, step = failed
    shown = page(site.signed_in("ann"), f"/why?iri={step}")
    assert "the arm cannot get there" in shown
    assert "It would have held" in shown
    assert "Try what would have helped</button>" in shown
    assert bare_figures(shown) == []


def test_a_robot_reads_it_without_a_button_and_a_wrong_iri_is_said(
    failed: tuple[Site, str],
) -> None:
    site, step = failed
    robot = site.app.test_client()
    auth = {"Authorization": f"Bearer {site.tokens['nao-1']}", "Accept": "text/html"}
    shown = robot.get(f"/why?iri={step}", base_url=HOST, headers=auth).text
    assert "the arm cannot get there" in shown
    assert "Try what would have helped</button>" not in shown
    stranger = site.app.test_client().post("/why", data={"iri": step}, base_url=HOST, headers=OWN)
    assert stranger.status_code in (401, 403)
    assert "no step that ended" in page(site.signed_in("ann"), "/why?iri=urn:lab/none")
    assert site.signed_in("ann").get("/why", base_url=HOST).status_code == 400


def test_the_plan_that_failed_leads_to_the_page(failed: tuple[Site, str]) -> None:
    site, _ = failed
    (row,) = site.kb.select(
        "PREFIX rt: <https://w3id.org/rtask-kg/ns#> SELECT ?plan WHERE { ?plan a rt:TaskPlan }"
    )
    shown = page(site.signed_in("ann"), f"/resource?iri={row.value('plan')}")
    (link,) = re.findall(r'href="(/why[^"]*)">its page', shown)
    assert "the arm cannot get there" in page(site.signed_in("ann"), html.unescape(link))
