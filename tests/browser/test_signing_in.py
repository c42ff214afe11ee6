"""Whoever is refused for lack of a token is offered to sign in, and returns to the same place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.pages import EACH_LOOK, LOOKS, open_page
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

REFUSED = ("401", "403")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    """A server that only those with a right may read, and the token of one of them."""
    folder: Path = tmp_path_factory.mktemp("private") / "store"
    with rtask.open(folder, base="urn:lab/") as kb:
        graph = str(kb.graphs.agent("ann")).strip("<>")
        kb.update(
            f"""PREFIX rt: <{ontology.NS}> INSERT DATA {{
            <urn:lab/object/1> a rt:Mug ; rt:objectId "lab/1" }}""",
            "ann",
        )
    with closing(TokenStore(folder)) as tokens:
        tokens.create("reader", rights=[f"read:{graph}"])
        admin, _ = tokens.create("admin")
    with running_server(folder) as running:
        yield running, admin


@pytest.mark.parametrize("look", EACH_LOOK)
@pytest.mark.parametrize("path", ["/objects", "/robots", "/feedback", "/tools/grasp", "/services"])
def test_a_stranger_is_led_to_signing_in_and_back(
    browser: Any, site: tuple[RunningServer, str], look: str, path: str
) -> None:
    server, token = site
    with open_page(browser, server.url, expected=REFUSED, **LOOKS[look]) as page:
        page.goto(server.url + path)
        rows = 1 if look.startswith("laptop") else 2
        assert page.locator("header.bar").bounding_box()["height"] < rows * 70
        if urlsplit(page.url).path != "/login":
            page.get_by_role("link", name="Sign in").first.click()
        page.get_by_label("Access token").fill(token)
        page.get_by_role("button", name="Sign in").click()
        page.wait_for_url(server.url + path)
        assert page.locator("h1").count() == 1


@pytest.mark.parametrize("path", ["/tools/grasp", "/tools/arm", "/sparql"])
def test_an_open_page_whose_session_ended_offers_to_sign_in_where_it_was_refused(
    browser: Any, site: tuple[RunningServer, str], path: str
) -> None:
    server, token = site
    with open_page(browser, server.url, token, expected=REFUSED) as page:
        page.goto(server.url + path)
        page.wait_for_load_state("networkidle")
        page.context.clear_cookies()
        if path == "/sparql":
            page.get_by_role("button", name="Run").click()
        else:
            page.locator("form.operation input[type=number]").first.fill("0.01")
        link = page.locator(".problem").get_by_role("link", name="Sign in")
        link.wait_for()
        there = parse_qs(urlsplit(link.get_attribute("href")).query)["next"][0]
        assert there.startswith(path)
