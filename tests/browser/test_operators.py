"""Signing in and making a token in a real browser; and what a page from elsewhere cannot do."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import httpx
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

WRITE = "INSERT DATA { GRAPH <urn:evil> { <urn:evil> <urn:was> 'here' } }"

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def admin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    """A server with tokens, and the token of its operator."""
    folder = tmp_path_factory.mktemp("operators") / "store"
    rtask.open(folder).close()
    with closing(TokenStore(folder)) as tokens:
        text, _ = tokens.create("admin")
    with running_server(folder) as running:
        yield running, text


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A page that reports what went wrong on it."""
    context = browser.new_context(locale="en")
    opened = context.new_page()
    faults: list[str] = []
    opened.on("pageerror", lambda error: faults.append(str(error)))
    yield opened
    context.close()
    assert faults == []


def test_an_operator_signs_in_makes_a_token_and_leaves(
    page: Any, admin: tuple[RunningServer, str]
) -> None:
    server, token = admin
    page.goto(f"{server.url}/login?next=/admin/tokens")
    page.get_by_label("Access token").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url("**/admin/tokens")
    page.get_by_label("Role").select_option("robot")
    page.get_by_label("Robot or person").fill("nao-7")
    page.get_by_label("Ends in").fill("12h")
    page.get_by_role("button", name="Make").click()
    made = page.locator("#made").inner_text()
    assert re.fullmatch(r"rtk_[0-9a-f]{12}_[0-9a-f]{32}", made)
    headers = {"Authorization": f"Bearer {made}"}
    insert = {"update": "INSERT DATA { <urn:cup> <urn:p> 1 }"}
    assert httpx.post(f"{server.url}/update", data=insert, headers=headers).status_code == 204
    page.get_by_role("link", name="Audit trail").click()
    has_count(page.get_by_text("token-created"), 1)
    page.get_by_role("link", name="Tokens").click()
    page.get_by_role("button", name=f"Revoke {made.split('_')[1]}").click()
    page.wait_for_url("**/admin/tokens")
    assert httpx.post(f"{server.url}/update", data=insert, headers=headers).status_code == 401
    page.get_by_role("button", name="Sign out").click()
    page.wait_for_url("**/login")


def test_a_page_from_elsewhere_gets_neither_websocket_nor_write(
    page: Any, admin: tuple[RunningServer, str]
) -> None:
    server, token = admin
    page.goto(f"{server.url}/login")
    page.get_by_label("Access token").fill(token)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_url(f"{server.url}/")
    page.goto("about:blank")  # another origin, in the browser of somebody who is signed in
    opened = page.evaluate(
        """url => new Promise(done => {
             const socket = new WebSocket(url);
             socket.onopen = () => done(true);
             socket.onerror = () => done(false);
           })""",
        server.websocket,
    )
    assert opened is False
    page.evaluate(
        """([url, text]) => fetch(url, {method: "POST", mode: "no-cors", credentials: "include",
             headers: {"Content-Type": "application/x-www-form-urlencoded"},
             body: "update=" + encodeURIComponent(text)}).catch(() => null)""",
        [f"{server.url}/update", WRITE],
    )
    found = httpx.get(f"{server.url}/query", params={"query": "ASK { <urn:evil> ?p ?o }"})
    assert found.json()["boolean"] is False
