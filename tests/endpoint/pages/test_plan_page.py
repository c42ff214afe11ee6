"""The page of plans: an operator types a goal, sees steps with proofs, and stores that plan."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator

import pytest
from flask.testing import FlaskClient

from rtask.rdf.namespaces import PREFIXES, RT
from rtask.rdf.terms import iri
from tests.endpoint.sites import HOST, OWN, Site
from tests.rtask.tasks.conftest import BASE, LAB

pytestmark = pytest.mark.slow

GOAL = {"goal": "every cup into the left box"}
NOTHING = "INSERT DATA { <urn:x> <urn:p> 1 }"


@pytest.fixture(scope="module")
def site() -> Iterator[Site]:
    with Site.opened(NOTHING) as opened:
        opened.kb.update(LAB)
        yield opened


def page(browser: FlaskClient, **query: str) -> str:
    answer = browser.get(
        "/plan", query_string=query, base_url=HOST, headers={"Accept": "text/html"}
    )
    assert answer.status_code == 200
    return answer.text


def form_of(text: str) -> dict[str, str]:
    (form,) = re.findall(r'aria-label="Store this plan">(.*?)</form>', text, re.S)
    return dict(re.findall(r'name="([^"]+)" value="([^"]*)"', form))


def test_a_person_stores_the_plan_that_is_shown_and_can_take_it_back(site: Site) -> None:
    ann = site.signed_in("ann")
    shown = page(ann, **GOAL)
    assert "panda-1 picks red cup up from right box" in shown
    assert re.search(r'href="/explain\?s=[^"]*canGrasp[^"]*">panda-1 can grasp red cup</a>', shown)
    assert "red cup located on table: after step 2" in shown
    stored = ann.post("/plan", data=form_of(shown), base_url=HOST, headers=OWN)
    assert stored.status_code == 303
    after = ann.get(stored.headers["Location"], base_url=HOST).text
    task = re.search(r"Stored as <a href=\"/resource\?iri=([^\"]+)\"", after)
    assert task
    assert "Take it back" in after
    (plan,) = site.kb.select(f"SELECT ?t {{ ?t {RT.goalText} 'every cup into the left box' }}")
    assert site.kb.graphs.agent("ann") in {
        quad.graph_name for quad in site.kb.match(iri(str(plan.value("t"))), RT.hasSubTask)
    }


def test_the_examples_are_about_what_stands_here_and_can_be_planned(site: Site) -> None:
    ann = site.signed_in("ann")
    goals = re.findall(r'<li><a href="/plan\?goal=([^"]+)">([^<]+)</a>', page(ann))
    assert goals
    for _, goal in goals:
        assert "means nothing" not in page(ann, goal=goal)
    shown = page(ann, goal="every cup into the moon")
    assert all(goal in shown for _, goal in goals)  # a way on where the words were not understood


def test_a_plan_that_is_no_longer_the_one_shown_is_not_stored(site: Site) -> None:
    ann = site.signed_in("ann")
    form = form_of(page(ann, goal="every pen into the right box"))
    site.kb.update(
        f"{PREFIXES} DELETE WHERE {{ GRAPH ?g {{ <{BASE}robot/panda-1> rt:reaches ?x }} }}"
    )
    refused = ann.post("/plan", data=form, base_url=HOST, headers=OWN)
    assert refused.status_code == 409
    assert "plan again" in refused.text
    site.kb.update(
        f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ <{BASE}robot/panda-1> "
        f"rt:reaches <{BASE}place/table>, <{BASE}place/right> }} }}"
    )


def test_what_is_not_possible_or_not_understood_is_said_on_the_page(site: Site) -> None:
    ann = site.signed_in("ann")
    assert "no hand of nao-1 opens beyond 50 mm" in page(ann, goal="the jug into the left box")
    assert "the nearest names are jug" in page(ann, goal="the jugg into the left box")
    assert "every cup into the left box" in page(ann)
    assert "<script>" not in page(ann, goal="every <script> into the left <script>")


def test_what_may_only_not_be_known_is_a_way_to_state_it(site: Site) -> None:
    ann = site.signed_in("ann")
    shown = page(ann, goal="the jug into the left box")
    (address,) = re.findall(r'href="(/operations/state_reach[^"]*)">State that panda-1', shown)
    form = ann.get(html.unescape(address), base_url=HOST, headers={"Accept": "text/html"}).text
    assert f'value="{BASE}robot/panda-1"' in form
    assert f'value="{BASE}place/left"' in form
    assert "State that" not in page(ann, **GOAL), "nothing is missing there"


def test_robots_see_plans_and_strangers_do_not(site: Site) -> None:
    robot = page(site.signed_in("nao-1"), **GOAL)
    assert "panda-1 picks red cup" in robot
    assert "Store it" not in robot
    stranger = site.app.test_client().get(
        "/plan", query_string=GOAL, base_url=HOST, headers={"Accept": "text/html"}
    )
    assert stranger.status_code == 303


def test_what_a_refused_sentence_seems_to_mean_is_a_button_that_only_plans(site: Site) -> None:
    shown = page(site.signed_in("ann"), goal="hungry people come, so every cup into the left box")
    (form,) = re.findall(r'aria-label="Did you mean this\?">(.*?)</form>', shown, re.S)
    assert re.findall(r'name="goal" value="([^"]*)"', form) == ["every cup to the left box"]
    assert "hungry people come" in form
    assert "secret" not in form, "it is no form that stores anything"
