"""The query editor in a real browser: completion, errors where they are, stopping a query."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

import ontology
import rtask
from endpoint.pages.graph.workbench import _EDITOR
from tests.browser.pages import EACH_LOOK, LOOKS, fits, keep_picture, open_page
from tests.servers import RunningServer, running_server

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(not _EDITOR.exists(), reason="the editor needs npm at set-up"),
]

HOSTILE = '<img src=x onerror="document.title=1">'
ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i . ?j ?k ?l }"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder: Path = tmp_path_factory.mktemp("editor") / "store"
    with rtask.open(folder, base="urn:lab/") as kb, kb.transaction(agent="ann") as tx:
        tx.add("urn:lab/mug", ontology.NS + "name", HOSTILE)
        tx.update(f"""PREFIX rt: <{ontology.NS}> INSERT DATA {{
            <urn:lab/mug> a rt:Mug ; rt:objectId "lab/1" }}""")
    with running_server(folder) as running:
        yield running


def _editor(page: Any, server: RunningServer) -> Any:
    page.goto(f"{server.url}/sparql")
    page.locator("sparql-editor[data-ready]").wait_for()
    content = page.get_by_role("textbox", name="Query")
    content.click()
    page.keyboard.press("Control+a")
    page.keyboard.press("Delete")
    return content


def paste(page: Any, text: str) -> None:
    """Paste a text into the editor in place of what is selected."""
    page.get_by_role("textbox", name="Query").evaluate(
        """(field, text) => {
             const clipboardData = new DataTransfer();
             clipboardData.setData("text/plain", text);
             const options = { clipboardData, bubbles: true, cancelable: true };
             field.dispatchEvent(new ClipboardEvent("paste", options));
           }""",
        text,
    )


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_class_is_completed_its_prefix_declared_and_the_query_run(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, **LOOKS[look]) as page:
        content = _editor(page, server)
        page.keyboard.type("SELECT * { ?o a rt:Mu")
        option = page.get_by_role("option", name="rt:Mug", exact=False).first
        option.wait_for()
        keep_picture(page, f"editor-{look}", full_page=False)
        option.click()
        page.keyboard.type(" ; rt:name ?n ")
        text = page.locator("#query").input_value()
        assert text.startswith(f"PREFIX rt: <{ontology.NS}>\n")
        assert "?o a rt:Mug ; rt:name ?n" in text
        content.press("Control+Enter")
        page.locator("#answer table").wait_for()
        assert page.locator("#answer").get_by_text(HOSTILE).count() == 1
        assert page.title() != "1"
        assert page.url.startswith(f"{server.url}/sparql?query=")
        page.reload()
        assert page.locator("#answer").get_by_text(HOSTILE).count() == 1
        assert fits(page)


def test_an_error_is_marked_at_its_line_and_column(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url) as page:
        _editor(page, server)
        paste(page, "SELECT ?x\nWHERE {\n  ?x ?p }\nLIMIT oops")
        page.locator('sparql-editor[data-fault="4:7"]').wait_for()
        assert page.locator(".cm-lintRange-error").inner_text() == "oops"
        content = page.get_by_role("textbox", name="Query")
        content.press("Control+a")
        paste(page, "ASK { ?x ?p ?o }")
        page.locator('sparql-editor[data-fault=""]').wait_for()


@pytest.mark.parametrize("look", LOOKS)
def test_a_fault_is_underlined_and_its_repair_applied_by_a_click(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, **LOOKS[look]) as page:
        _editor(page, server)
        head = f"PREFIX rt: <{ontology.NS}>\n"
        paste(page, head + "SELECT ?name { ?mug a rt:Mug ; rt:nmae ?name }")
        page.locator('sparql-editor[data-findings="1"]').wait_for()
        underlined = page.locator(".cm-lintRange-error")
        assert underlined.inner_text() == "rt:nmae"
        underlined.hover()
        said = page.locator(".cm-tooltip .cm-diagnostic")
        said.wait_for()
        assert "there is no property rt:nmae; did you mean rt:name?" in said.inner_text()
        assert fits(page)
        keep_picture(page, f"editor-fault-{look}", full_page=False)
        said.get_by_role("button", name="write rt:name").click()
        page.locator('sparql-editor[data-findings=""]').wait_for()
        assert page.locator("#query").input_value() == (
            head + "SELECT ?name { ?mug a rt:Mug ; rt:name ?name }"
        )
        page.get_by_role("button", name="Run").click()
        page.locator("#answer").get_by_text(HOSTILE).wait_for()


def test_a_running_query_is_stopped(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url) as page:
        _editor(page, server)
        page.keyboard.insert_text(ENDLESS)
        page.get_by_role("button", name="Run").click()
        page.get_by_role("button", name="Stop").click()
        page.get_by_text("Stopped.", exact=True).wait_for()
        assert not page.get_by_role("button", name="Stop").is_visible()


def test_inferred_statements_are_left_out_on_request(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url) as page:
        _editor(page, server)
        page.keyboard.insert_text("SELECT ?k { <urn:lab/mug> a ?k }")
        page.get_by_label("with inferred statements").uncheck()
        page.get_by_role("button", name="Run").click()
        page.get_by_text("1 row in").wait_for()


def test_the_check_answers_for_programs(server: RunningServer) -> None:
    def check(text: str, kind: str = "query") -> Any:
        headers = {"Content-Type": f"application/sparql-{kind}"}
        return httpx.post(f"{server.url}/sparql/check", content=text, headers=headers)

    assert check("ASK {}").json() == {"ok": True}
    assert check("DELETE WHERE { ?s ?p 1 }", "update").json() == {"ok": True}
    wrong = check("ASK {\n  x:y ?p ?o }").json()
    assert (wrong["ok"], wrong["line"], wrong["column"]) == (False, 2, 3)
    assert "x:" in wrong["detail"]
    assert check("INSERT DATA { <urn:a> <urn:b> <urn:c> }", "update").json()["ok"]
    asked = {"query": "ASK { <urn:a> ?p ?o }"}
    assert not httpx.get(f"{server.url}/sparql", params=asked).json()["boolean"]
    assert httpx.get(f"{server.url}/sparql/check").status_code == 405
    assert httpx.post(f"{server.url}/sparql/check", content="ASK {}").status_code == 415
