"""The page of questions: a person sees what a robot asks, and answers by a button."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from flask.testing import FlaskClient

from rtask.kb.commit.access import Access
from tests.endpoint.sites import HOST, OWN, Site
from tests.rtask.tasks.conftest import LAB
from tests.rtask.tasks.test_questions import ask, claim, listed, store

pytestmark = pytest.mark.slow

NOTHING = "INSERT DATA { <urn:x> <urn:p> 1 }"


@pytest.fixture
def site() -> Iterator[Site]:
    with Site.opened(NOTHING) as opened:
        opened.kb.update(LAB.replace("https://example.org/kb/", "urn:lab/"))
        yield opened


def page(browser: FlaskClient) -> str:
    answer = browser.get("/questions", base_url=HOST, headers={"Accept": "text/html"})
    assert answer.status_code == 200
    return answer.text


def test_a_person_answers_what_a_robot_asks_and_can_take_it_back(site: Site) -> None:
    ann = site.signed_in("ann")
    assert "No robot waits for an answer" in page(ann)
    store(site.engine)
    asked = ask(site.engine, claim(site.engine).task, chance=0.1, text="Is <b>it</b> dry?")
    shown = page(ann)
    assert "Is &lt;b&gt;it&lt;/b&gt; dry?" in shown
    assert "asking costs 5 and is expected to save 27" in shown
    buttons = re.findall(r'name="choice" value="(\d)"[^>]*>([^<]+)', shown)
    assert buttons == [("1", "Try it"), ("2", "I have helped")]
    fields = dict(re.findall(r'type="hidden" name="([^"]+)" value="([^"]*)"', shown))
    assert fields["question"] == asked.question
    answered = ann.post("/questions", data={**fields, "choice": "2"}, base_url=HOST, headers=OWN)
    assert answered.status_code == 303
    after = ann.get(answered.headers["Location"], base_url=HOST).text
    assert "Answered: the robot takes up its step again." in after
    assert "Take it back" in after
    (question,) = listed(site.engine)
    assert (question.answered_by, question.chosen) == ("ann", 2)
    assert "1 of 1 questions that ended" in page(ann)
    again = ann.post("/questions", data={**fields, "choice": "1"}, base_url=HOST, headers=OWN)
    assert again.status_code == 409


def test_robots_see_questions_and_cannot_answer_and_strangers_see_none(site: Site) -> None:
    store(site.engine)
    asked = ask(site.engine, claim(site.engine, Access("panda-1", "robot")).task, chance=0.1)
    robot = site.signed_in("nao-1")
    shown = page(robot)
    assert "What shall I do?" in shown
    assert 'name="choice"' not in shown
    fields = {"question": asked.question, "choice": "1"}
    refused = robot.post("/questions", data=fields, base_url=HOST, headers=OWN)
    assert refused.status_code == 403
    stranger = site.app.test_client().get(
        "/questions", base_url=HOST, headers={"Accept": "text/html"}
    )
    assert stranger.status_code == 303
