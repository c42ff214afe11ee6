"""The form of an operation in a real browser, with scripts switched off."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

import ontology
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder: Path = tmp_path_factory.mktemp("forms") / "store"
    with running_server(folder) as running:
        yield running


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A page without scripts that fails the test on an error in its console."""
    faults: list[str] = []
    context = browser.new_context(java_script_enabled=False, locale="en-GB")
    opened = context.new_page()
    opened.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
    opened.expected_faults = []
    yield opened
    context.close()
    assert [one for one in faults if not any(p in one for p in opened.expected_faults)] == []


def test_a_person_introduces_a_robot_with_two_hands_by_the_form(
    page: Any, server: RunningServer
) -> None:
    page.goto(server.url)
    page.get_by_role("link", name="Operations, each with a form").click()
    page.get_by_role("link", name="register_robot").click()
    page.get_by_label("name *", exact=True).first.fill("desk-1")
    page.get_by_label("model *").fill("arm v2")
    page.get_by_role("button", name="One more").first.click()
    assert page.get_by_label("model *").input_value() == "arm v2"
    for k, hand in enumerate(("left", "right")):
        group = page.get_by_role("group", name=f"end effectors {k + 1}")
        group.get_by_label("name *", exact=True).fill(hand)
        group.get_by_label("gripper type *").fill("pinch")
        group.get_by_label("max opening (m)").fill("0.08")
        group.get_by_label("max payload (kg) *").fill("0.5")
    group.get_by_label("max payload (kg) *").press("Enter")  # sends, and adds no third hand
    answer = json.loads(page.get_by_role("status").inner_text())
    assert set(answer) == {"robot", "graph", "commit"}
    hands, name = f"<{ontology.NS}hasEndEffector>", f"<{ontology.NS}name>"
    query = f"SELECT ?name {{ <{answer['robot']}> {hands}/{name} ?name }} ORDER BY ?name"
    rows = httpx.get(f"{server.url}/sparql", params={"query": query}).json()["results"]["bindings"]
    assert [row["name"]["value"] for row in rows] == ["left", "right"]


def test_a_number_out_of_its_bounds_is_not_sent(page: Any, server: RunningServer) -> None:
    page.goto(f"{server.url}/operations/plan_in_space")
    page.get_by_label("object *").fill("cup")
    page.get_by_label("friction").fill("9")
    page.get_by_role("button", name="Send").click()
    has_count(page.get_by_role("alert"), 0)
    has_count(page.locator("#friction:invalid"), 1)


def test_what_the_server_refuses_is_said_above_the_form_which_keeps_its_values(
    page: Any, server: RunningServer
) -> None:
    page.expected_faults = ["404", "422"]
    page.goto(f"{server.url}/operations/recall_grasps")
    page.get_by_label("object *").fill("no such cup")
    page.get_by_role("button", name="Send").click()
    assert "no such cup" in page.get_by_role("alert").inner_text()
    assert page.get_by_label("object *").input_value() == "no such cup"


def test_a_browser_that_opens_an_operation_is_sent_to_its_form(
    page: Any, server: RunningServer
) -> None:
    page.goto(f"{server.url}/engine/search_object")
    assert page.url == f"{server.url}/operations/search_object"
    assert page.locator("#data").get_attribute("type") == "file"
