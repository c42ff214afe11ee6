"""The rules of axe-core on the recorded demo, a page of each kind, both sizes and themes.

Somebody who may do everything is signed in, so that no form is left out. What needs no network is
in :mod:`tests.browser.every_page.audits`.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import closing
from typing import Any
from urllib.parse import urldefrag, urlsplit

import pytest

from endpoint.access.tokens import TokenStore
from simulate.demo.recorded import unpack
from tests.browser.pages import LOOKS
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.deep]

LINKS = "() => [...document.querySelectorAll('a[href]:not([download])')].map((link) => link.href)"
HITS = """async () => (await axe.run(document, {resultTypes: ["violations"]})).violations
  .map((hit) => `${hit.id}: ${hit.nodes[0].html.slice(0, 120)}`)"""
IS_PAGE = "() => document.contentType === 'text/html'"
OTHERS = ("/api/", "/world/scene", "/files/", "/report", ".json")
FIRST = ("/", "/login", "/nowhere", "/search?q=carton")
"""Where the walk begins; no link leads to most of them."""
MIN_PAGES = 80
"""Of some ninety kinds that the links lead to: fewer, and the walk has gone astray."""


@pytest.fixture(scope="module")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The script of npm's axe-core."""
    if not shutil.which("npm"):
        pytest.skip("npm is not installed")
    folder = tmp_path_factory.mktemp("axe")
    (folder / "package.json").write_text('{"private": true}')
    command = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts", "axe-core@4.14.1"]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode:
        pytest.skip(f"axe-core cannot be installed: {done.stderr.strip()[-200:]}")
    return (folder / "node_modules" / "axe-core" / "axe.min.js").read_text("utf-8")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    """The recorded demo: two robots with the graph, two without, and their attempts; a token."""
    folder = tmp_path_factory.mktemp("recorded") / "demo"
    unpack(folder)
    with closing(TokenStore(folder / "store")) as tokens:
        admin, _ = tokens.create("admin")
    with running_server(folder / "store") as running:
        yield running, admin


@pytest.mark.parametrize("look", LOOKS)
def test_no_page_breaks_a_rule_of_axe(
    browser: Any, site: tuple[RunningServer, str], axe: str, look: str
) -> None:
    server, token = site
    options = {"bypass_csp": True, "reduced_motion": "reduce"} | LOOKS[look]
    with closing(browser.new_context(**options)) as context:
        page = context.new_page()
        page.goto(f"{server.url}/login?next=/")
        page.get_by_label("Access token").fill(token)
        page.get_by_role("button", name="Sign in").click()
        page.wait_for_url(f"{server.url}/")
        waiting, kinds, hits = list(FIRST), {urlsplit(path).path for path in FIRST}, []
        for address in waiting:
            page.goto(server.url + address, wait_until="load")
            if not page.evaluate(IS_PAGE):
                continue
            page.evaluate(axe)
            hits += [f"{address}: {hit}" for hit in page.evaluate(HITS)]
            for link in page.evaluate(LINKS):
                kind = urlsplit(link).path
                if link.startswith(server.url) and kind not in kinds and not _is_other(kind):
                    kinds.add(kind)
                    waiting.append(urldefrag(link).url.removeprefix(server.url))
        assert hits == []
        assert len(waiting) >= MIN_PAGES


def _is_other(path: str) -> bool:
    return any(part in path for part in OTHERS)
