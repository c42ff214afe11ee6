"""The home page in a real browser: ask the graph, see objects and robots.

Every test fails on a request to another host, a console error, a page error or a violation of the
page's own content policy. ``RTASK_REQUIRE_BROWSER=1`` turns a missing browser into a failure;
``RTASK_SCREENSHOTS=FOLDER`` keeps pictures of the pages.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import cv2
import httpx
import numpy as np
import pytest

import ontology
import rtask
from tests.browser.pages import open_page
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

HOSTILE = '<img src=x onerror="document.title=1">'
RT = ontology.NS

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """Two objects with pictures, one of them named by somebody hostile; one robot."""
    folder = tmp_path_factory.mktemp("browser") / "store"
    with rtask.open(folder) as kb, kb.transaction(agent="nao-1") as tx:
        for number, name in enumerate(["tea tin", HOSTILE]):
            tx.update(_object(kb.base, number, tx.blob(_picture(number), "image/png").value))
            tx.add(f"{kb.base}object/{number}", RT + "name", name)
        tx.add(f"{kb.base}robot/nao-1", RT + "name", "nao-1")
    with running_server(folder) as running:
        yield running


def _picture(seed: int) -> bytes:
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 255, (6, 8, 3), np.uint8)
    image = cv2.resize(small, (160, 120), interpolation=cv2.INTER_CUBIC)
    return bytes(cv2.imencode(".png", image)[1].tobytes())


def _object(base: str, number: int, picture: str) -> str:
    prefixes = " ".join(
        f"PREFIX {name}: <{ontology.PREFIXES[name]}>" for name in ("rt", "cora", "prov", "xsd")
    )
    return f"""{prefixes} PREFIX : <{base}>
    INSERT DATA {{
      <{base}object/{number}> a rt:Can ; rt:objectId "nao-1/{number}" ;
        rt:hasView <{base}view/{number}> ; rt:hasGrasp <{base}grasp/{number}> .
      <{base}view/{number}> a rt:View ; rt:viewContent <{base}image/{number}> .
      <{base}image/{number}> a rt:ColorImage ; rt:hasBlob <{picture}> .
      <{base}grasp/{number}> a rt:PlanarGrasp ; rt:gripperType "nao_hand" .
      <{base}robot/nao-1> a cora:Robot .
      <{base}attempt/{number}> a rt:GraspAttempt ; rt:executesGrasp <{base}grasp/{number}> ;
        rt:performedBy <{base}robot/nao-1> ; rt:hasOutcome <{base}outcome/{number}> ;
        prov:endedAtTime "2026-01-0{number + 1}T10:00:00Z"^^xsd:dateTime .
      <{base}outcome/{number}> a rt:GraspOutcome ; rt:success {str(number == 0).lower()} ;
        rt:hasReason rt:reason_{"ok" if number == 0 else "slip_lift"} .
    }}"""


@pytest.fixture
def page(browser: Any, server: RunningServer) -> Iterator[Any]:
    """A fresh page that fails the test on anything a person would call broken."""
    faults: list[str] = []
    host = urlsplit(server.url).netloc
    context = browser.new_context(
        viewport={"width": 1280, "height": 800}, locale="en-GB", reduced_motion="reduce"
    )
    context.add_init_script(
        "addEventListener('securitypolicyviolation', "
        "event => console.error('policy violated: ' + event.violatedDirective))"
    )
    # As where npm was missing at set-up: the text area does the work of the editor.
    missing = {"content_type": "text/javascript", "body": "throw new Error('not installed')"}
    context.route("**/static/vendor/**", lambda route: route.fulfill(**missing))
    opened = context.new_page()
    opened.on("pageerror", lambda error: faults.append(f"page error: {error}"))
    opened.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
    opened.on(
        "request",
        lambda request: (
            None
            if urlsplit(request.url).netloc in (host, "") or request.url.startswith("data:")
            else faults.append(f"asked another host: {request.url}")
        ),
    )
    opened.expected_faults = []  # what a test provokes on purpose
    yield opened
    unexpected = [f for f in faults if not any(part in f for part in opened.expected_faults)]
    context.close()
    assert unexpected == []


def keep_picture(page: Any, name: str) -> None:
    """Keep a screenshot where the environment says so."""
    folder = os.environ.get("RTASK_SCREENSHOTS")
    if folder:
        page.screenshot(path=str(Path(folder) / f"{name}.png"), full_page=True)


def test_the_workbench_runs_a_query_and_draws_the_table(page: Any, server: RunningServer) -> None:
    page.goto(server.url)
    page.get_by_role("button", name="Run").click()
    page.wait_for_selector("#answer table")
    names = page.locator("#answer tbody tr td:nth-child(2)").all_inner_texts()
    assert sorted(names) == sorted(["tea tin", HOSTILE])
    keep_picture(page, "home")


def test_a_question_of_the_ontology_is_chosen_and_answered(
    page: Any, server: RunningServer
) -> None:
    page.goto(server.url)
    page.locator("[data-samples]").select_option(label="Why do attempts fail, how often?")
    page.wait_for_selector("#answer td:has-text('slip_lift')")
    assert "rt:FailedOutcome" in page.get_by_role("textbox", name="Query").input_value()


def test_a_mistake_is_explained_and_its_line_selected(page: Any, server: RunningServer) -> None:
    page.expected_faults = ["400"]  # the console notes the status of the answer
    page.goto(server.url)
    page.get_by_role("textbox", name="Query").fill("SELECT ?x WHERE {\n  ?x ?p\n}")
    page.get_by_role("textbox", name="Query").press("Control+Enter")
    page.wait_for_selector("#answer .problem")
    field = "document.querySelector('textarea')"
    selected = page.evaluate(f"{field}.value.slice({field}.selectionStart, {field}.selectionEnd)")
    assert selected in ("  ?x ?p", "}")


def test_objects_are_listed_with_pictures_that_load(page: Any, server: RunningServer) -> None:
    page.goto(server.url)
    cards = page.locator(".card")
    assert cards.count() == 2
    pictures = page.locator(".card img")
    pictures.last.scroll_into_view_if_needed()
    page.wait_for_function(
        "[...document.querySelectorAll('.card img')].every(i => i.complete && i.naturalWidth > 0)"
    )
    assert page.get_by_text("1 of 1 held").first.is_visible()
    assert page.get_by_text("0 of 1 held").first.is_visible()


def test_the_robot_is_listed_with_its_last_outcome(page: Any, server: RunningServer) -> None:
    page.goto(server.url)
    row = page.locator("section[aria-labelledby=robots] tbody tr")
    assert row.count() == 1
    assert "it slipped out while being lifted" in row.inner_text()  # the later of the two attempts


def test_a_hostile_name_does_nothing_anywhere(page: Any, server: RunningServer) -> None:
    query = quote(f"SELECT ?s ?name {{ ?s <{RT}name> ?name }}", safe="")
    objects = httpx.get(f"{server.url}/objects.json").json()["objects"]
    (evil,) = [o["object"] for o in objects if o["name"] == HOSTILE]
    for path in ("/", "/objects", f"/object?iri={evil}", f"/sparql?query={query}"):
        page.goto(server.url + path)
        assert page.title() != "1"
        assert page.get_by_text(HOSTILE).first.is_visible()


def test_pages_fit_wide_and_narrow_screens_in_both_themes(page: Any, server: RunningServer) -> None:
    for path in ("/", "/objects", "/robots", "/resource?iri=rt:Mug", "/sparql"):
        page.goto(server.url + path)
        assert page.locator("h1").count() == 1
        for width, scheme in itertools.product((1280, 360), ("light", "dark")):
            page.set_viewport_size({"width": width, "height": 800})
            page.emulate_media(color_scheme=scheme)
            overflow = page.evaluate(
                "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            )
            assert overflow <= 0, f"{path} is wider than {width} px"
            keep_picture(page, f"{path.strip('/').split('?')[0] or 'index'}-{width}-{scheme}")


def test_everything_is_reached_by_keyboard(page: Any, server: RunningServer) -> None:
    page.goto(server.url)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    page.get_by_role("textbox", name="Query").focus()
    page.keyboard.press("Tab")
    assert "Run" in page.evaluate("document.activeElement.textContent")
    page.keyboard.press("Enter")
    page.wait_for_selector("#answer table")


@pytest.mark.parametrize(("width", "theme"), [(1280, "light"), (360, "dark")])
def test_things_are_searched_for_from_the_header_by_keys(
    page: Any, server: RunningServer, width: int, theme: str
) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    page.emulate_media(color_scheme=theme)
    page.goto(f"{server.url}/robots")
    page.get_by_role("combobox", name="Search").fill("tea tni")
    page.keyboard.press("Enter")
    page.wait_for_url("**/search?q=tea+tni")
    has_count(page.locator("h1"), 1)
    assert page.evaluate("() => document.documentElement.scrollWidth") == width
    found = page.get_by_role("region", name="Objects").get_by_role("link", name="tea tin")
    found.focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**/object?iri=*")
    assert page.get_by_role("heading", level=1).inner_text() == "tea tin"
    page.get_by_role("combobox", name="Search").fill("rt:Mug")
    page.keyboard.press("Enter")
    page.wait_for_url("**/resource?iri=rt%3AMug")
    assert page.get_by_role("heading", level=1).inner_text() == "mug"


@pytest.mark.parametrize("width", [1280, 360])
def test_what_fits_is_suggested_while_one_types_and_opened_by_keys(
    page: Any, server: RunningServer, width: int
) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    page.goto(f"{server.url}/robots")
    field = page.get_by_role("combobox", name="Search")
    page.locator("main").click()
    page.wait_for_selector('.find [role="combobox"]')
    page.keyboard.press("/")
    page.keyboard.type("tea")
    page.get_by_role("option", name="tea tin").wait_for()
    assert page.evaluate("() => document.documentElement.scrollWidth") == width
    page.keyboard.press("Escape")
    assert page.get_by_role("option").count() == 0
    field.fill("kinematcs")  # with a typing error
    page.get_by_role("option", name="example/Kinematics").wait_for()
    assert field.get_attribute("aria-expanded") == "true"
    page.keyboard.press("ArrowDown")
    chosen = page.get_by_role("option", selected=True)
    address = chosen.get_attribute("href")
    page.keyboard.press("Enter")
    page.wait_for_url(f"**{address}")
    page.get_by_role("combobox", name="Search").fill("planararm")
    page.get_by_role("option", name="robots/PlanarArm").click()
    page.wait_for_url("**/datasets/robots/PlanarArm")


def test_a_new_object_is_suggested_without_reload(browser: Any) -> None:
    with running_server(None) as own, open_page(browser, own.url) as page:
        page.goto(f"{own.url}/robots")
        field = page.get_by_role("combobox", name="Search")
        with page.expect_response("**/search.json?q=zebra"):
            field.fill("zebra")
        assert page.get_by_role("option").count() == 0
        update = f"""PREFIX rt: <{RT}> INSERT DATA {{
            <urn:zebra-cup> a rt:Mug ; rt:objectId "zebra-1" ; rt:name "zebra cup" }}"""
        headers = {"Content-Type": "application/sparql-update"}
        httpx.post(f"{own.url}/update", content=update, headers=headers).raise_for_status()
        field.fill("zebra cu")
        page.get_by_role("option", name="zebra cup").wait_for()
