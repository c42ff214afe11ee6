"""A person names, merges and splits objects in a real browser, without a script running."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np
import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

PREFIXES = " ".join(f"PREFIX {name}: <{ontology.PREFIXES[name]}>" for name in ("rt", "rdf"))
NAMES = ["tea tin", "box 2", "pen 3"]

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    """A server with three objects, two of them unnamed, and the token of a person."""
    folder = tmp_path_factory.mktemp("curating") / "store"
    with rtask.open(folder, base="urn:lab/") as kb, kb.transaction(agent="nao-1") as tx:
        for number, name in enumerate(NAMES, 1):
            pictures = [tx.blob(_picture(10 * number + k), "image/png").value for k in (0, 1)]
            tx.update(_object(number, name, pictures))
    with closing(TokenStore(folder)) as tokens:
        ann, _ = tokens.create("teacher", agent="ann")
    with running_server(folder) as running:
        yield running, ann


def _picture(seed: int) -> bytes:
    rng = np.random.default_rng(seed)
    image = cv2.resize(rng.integers(0, 255, (6, 8, 3), np.uint8), (160, 120))
    return bytes(cv2.imencode(".png", image)[1].tobytes())


def _object(number: int, name: str, pictures: list[str]) -> str:
    thing, kind = f"urn:lab/object/{number}", "rt:Can" if number == 1 else "rt:Box"
    said = (
        ""
        if number == 1
        else f"""
      <urn:lab/statement/{number}> rdf:reifies <<( <{thing}> a {kind} )>> ; rt:confidence 0.6e0 ."""
    )
    views = "".join(
        f"""
      <{thing}> rt:hasView <urn:lab/view/{number}{k}> .
      <urn:lab/view/{number}{k}> a rt:View ; rt:viewContent <urn:lab/image/{number}{k}> .
      <urn:lab/image/{number}{k}> a rt:ColorImage ; rt:hasBlob <{blob}> ."""
        for k, blob in enumerate(pictures)
    )
    return f"""{PREFIXES} INSERT DATA {{
      <{thing}> a rt:ManipulableObject, {kind} ; rt:objectId "nao-1/{number}" ; rt:name "{name}" .
      {said}{views} }}"""


@pytest.fixture
def page(browser: Any, site: tuple[RunningServer, str]) -> Iterator[Any]:
    """A narrow page of a person who signed in; no script runs on it."""
    server, token = site
    size = {"width": 360, "height": 740}
    context = browser.new_context(locale="en", java_script_enabled=False, viewport=size)
    opened = context.new_page()
    opened.set_default_timeout(60_000)
    faults: list[str] = []
    opened.on(
        "response", lambda answer: faults.append(answer.url) if answer.status >= 400 else None
    )
    opened.goto(f"{server.url}/login?next=/teach")
    opened.get_by_label("Access token").fill(token)
    opened.get_by_role("button", name="Sign in").click()
    opened.wait_for_url("**/teach")
    yield opened
    context.close()
    assert faults == []


def keep(page: Any, name: str) -> None:
    """Keep a picture of the page where ``RTASK_SCREENSHOTS`` says."""
    if os.environ.get("RTASK_SCREENSHOTS"):
        folder = Path(os.environ["RTASK_SCREENSHOTS"])
        page.screenshot(path=str(folder / f"{name}.png"), full_page=True)


def _unnamed(page: Any) -> list[str]:
    """Return the objects that the page asks to be named."""
    return [str(text) for text in page.get_by_role("heading", level=2).all_inner_texts()]


def test_an_unnamed_object_is_narrowed_by_words_merged_and_taken_back(page: Any) -> None:
    # The other test names the pen.
    assert [name for name in _unnamed(page) if name != "pen 3"] == ["box 2"]
    page.get_by_role("link", name="Say what it is: box 2").click()
    page.get_by_label("What kind of thing").fill("can")
    page.get_by_role("button", name="Find").click()
    has_count(page.get_by_role("button", name="It is a thing of its own, a “can”"), 1)
    keep(page, "teach")
    page.get_by_role("link", name="It is this one: tea tin").click()
    has_count(page.locator(".side img"), 4)
    assert "It will have 4 views" in page.locator("main").inner_text()
    keep(page, "merge")
    page.get_by_role("button", name="Merge them").click()
    page.wait_for_url("**/object?iri=**")
    assert page.get_by_role("heading", level=1).inner_text() == "tea tin"
    assert page.get_by_role("img", name="view 4").count() == 1
    page.get_by_role("button", name="Take it back").click()
    page.wait_for_url("**/curation")
    rows = page.locator("tbody tr").all_inner_texts()
    assert "taken back" in rows[1]
    assert "ann" in rows[0]
    keep(page, "curation")


def test_an_object_is_named_and_its_views_are_split_off(
    page: Any, site: tuple[RunningServer, str]
) -> None:
    server, _ = site
    assert _unnamed(page) == ["box 2", "pen 3"]
    page.goto(f"{server.url}/teach?iri={quote('urn:lab/object/3', safe='')}")
    page.get_by_label("Name", exact=True).fill("ann's pen")
    page.get_by_label("What kind of thing").fill("fountain pen")
    page.get_by_role("button", name="Find").click()
    page.get_by_role("button", name="of the new kind “fountain pen”").click()
    page.wait_for_url("**/object?iri=**")
    assert page.get_by_role("heading", level=1).inner_text() == "ann's pen"
    page.get_by_role("link", name="Some views show something else").click()
    page.get_by_label("view 2").check()
    page.get_by_label("Name of the new object").fill("a ruler")
    keep(page, "split")
    page.get_by_role("button", name="Make them another object").click()
    page.wait_for_url("**/object?iri=**")
    assert page.get_by_role("heading", level=1).inner_text() == "a ruler"
    assert page.get_by_role("img", name="view 1").count() == 1
    assert page.get_by_role("img", name="view 2").count() == 0
