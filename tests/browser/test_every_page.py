"""A walk over all pages: one heading, nothing sideways, links that answer, twins, contrast."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote, urljoin, urlsplit

import httpx
import pytest

from endpoint.access.tokens import TokenStore
from tests.browser.attempts import store_of_attempts
from tests.browser.audits import AUDITS, CONTRAST, SIDEWAYS, SMALL_TARGETS
from tests.browser.pages import ALL_LOOKS, LOOKS, PHONE, fits, keep_picture, open_page
from tests.servers import RunningServer, bearer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

OBJECT = "urn:lab/object/1"
PATHS = (
    "/", "/activity", "/sparql", "/objects", f"/object?iri={OBJECT}", "/classes?iri=rt:Mug",
    "/robots", "/feedback", "/learning", "/services", "/services/example/Grasping",
    "/setup", "/datasets", "/datasets/robots/Point", "/jobs", "/tools/grasp", "/tools/arm",
    "/tools/pipeline", "/benchmarks", "/robot?iri=urn:lab/robot/nao-1",
    "/teach", f"/teach?iri={OBJECT}", "/curation", f"/object/merge?iri={OBJECT}",
    f"/object/split?iri={OBJECT}", f"/object/forget?iri={OBJECT}", "/resource?iri=rt:Mug",
    f"/explain?s={OBJECT}&p=rdf:type&o=rt:Mug", "/search?q=mug", "/operations",
    "/ask?text=which+mugs+are+there", "/terms", "/terms?term=rt:Mug",
    "/operations/register_robot", "/admin/tokens", "/admin/audit", "/admin/queries",
    "/admin/proposals", "/openapi",
    "/plan", "/plan?goal=every+mug+into+the+box",
)  # fmt: skip
SOME_PATHS = ("/", "/sparql", f"/object?iri={OBJECT}", "/feedback", "/tools/grasp", "/admin/tokens")
FEW_OR_ALL = pytest.mark.parametrize(
    "paths",
    [
        pytest.param(SOME_PATHS, id="some"),
        pytest.param(PATHS, id="all", marks=pytest.mark.deep),
    ],
)
QUICK_OR_DEEP_LOOKS = [
    look if look in LOOKS else pytest.param(look, marks=pytest.mark.deep) for look in ALL_LOOKS
]
MIN_CONTRAST = 4.5
"""WCAG 2.2, 1.4.3."""

LINKS = "links => links.map(link => link.getAttribute('href'))"
MAX_TABS = 400
# Where the Tab key stands: empty behind the last control, "seen", or what is wrong there.
FOCUS = """() => {
  let one = document.activeElement;
  if (!one || one === document.body) return "";
  while (one.shadowRoot?.activeElement) one = one.shadowRoot.activeElement;
  const { width, height, right, bottom } = one.getBoundingClientRect();
  const what = one.outerHTML.slice(0, 120);
  if (width < 1 || height < 1 || right < 0 || bottom < 0) return `out of sight: ${what}`;
  const { outlineStyle } = getComputedStyle(one);
  return outlineStyle !== "none" || one.matches(".cm-content") ? "seen" : `not marked: ${what}`;
}"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    """Attempts with pictures, so that pages have what they show."""
    folder: Path = tmp_path_factory.mktemp("walk") / "store"
    store_of_attempts(folder, 6)
    with closing(TokenStore(folder)) as tokens:
        admin, _ = tokens.create("admin")
    with running_server(folder) as running:
        yield running, admin


@pytest.mark.parametrize("look", QUICK_OR_DEEP_LOOKS)
def test_every_page_has_one_heading_fits_and_names_its_controls(
    browser: Any, site: tuple[RunningServer, str], look: str
) -> None:
    server, token = site
    faults: list[str] = []
    with open_page(browser, server.url, token, **ALL_LOOKS[look]) as page:
        for path in PATHS:
            page.goto(server.url + path)
            if not fits(page):
                faults.append(f"{path}: {page.locator('h1').count()} h1, or wider than the screen")
            if look.startswith("phone"):
                faults += [f"{path}: scrolls sideways: {one}" for one in page.evaluate(SIDEWAYS)]
            for fault, script in AUDITS.items():
                faults += [f"{path}: {fault}: {one}" for one in page.evaluate(script)]
            keep_picture(page, f"walk-{path.strip('/').replace('/', '-')[:24]}-{look}")
        for pair, ratio in page.evaluate(CONTRAST):
            if ratio < MIN_CONTRAST:
                faults.append(f"{look}: {pair} has a contrast of {ratio:.2f}")
        page.goto(server.url)
        page.keyboard.press("Tab")
        assert page.evaluate("() => document.activeElement.className") == "skip"
    assert faults == [], "\n".join(faults)


@FEW_OR_ALL
def test_a_finger_hits_every_button(
    browser: Any, site: tuple[RunningServer, str], paths: tuple[str, ...]
) -> None:
    server, token = site
    faults: list[str] = []
    touch = {"viewport": PHONE, "has_touch": True, "is_mobile": True}
    with open_page(browser, server.url, token, **touch) as page:
        for path in paths:
            page.goto(server.url + path)
            faults += [f"{path}: {one}" for one in page.evaluate(SMALL_TARGETS)]
    assert faults == [], "\n".join(faults)


@FEW_OR_ALL
def test_tab_leads_through_every_page_and_the_focus_is_always_seen(
    browser: Any, site: tuple[RunningServer, str], paths: tuple[str, ...]
) -> None:
    """The keyboard gets from the address bar to the end of each page, and is nowhere caught."""
    server, token = site
    faults: list[str] = []
    with open_page(browser, server.url, token, **ALL_LOOKS["laptop-light"]) as page:
        for path in paths:
            page.goto(server.url + path)
            stops = 0
            while stops < MAX_TABS:
                page.keyboard.press("Tab")
                seen = page.evaluate(FOCUS)
                if seen == "":
                    break
                if seen != "seen":
                    faults.append(f"{path}: {seen}")
                stops += 1
            if not 5 < stops < MAX_TABS:
                faults.append(f"{path}: {stops} stops of the Tab key")
    assert faults == [], "\n".join(faults)


@pytest.mark.parametrize("most", [4, pytest.param(10_000, marks=pytest.mark.deep)])
def test_every_inner_link_answers_and_every_twin_is_the_model_of_its_page(
    browser: Any, site: tuple[RunningServer, str], most: int
) -> None:
    """Of addresses that differ in their query alone, at most so many are asked for."""
    server, token = site
    links: dict[str, str] = {}
    twins: dict[str, str] = {}
    mute: list[str] = []
    with open_page(browser, server.url, token, java_script_enabled=False) as page:
        for path in PATHS:
            page.goto(server.url + path)
            if not page.locator("h1:visible ~ :visible, :has(> h1) ~ :visible").count():
                mute.append(path)  # nothing below the heading without scripts
            for link in page.locator("a[href]").evaluate_all(LINKS):
                address = urljoin(page.url, link).partition("#")[0]
                if urlsplit(address).netloc == urlsplit(server.url).netloc:
                    links.setdefault(address, path)
            alternate = page.locator("link[rel=alternate]")
            if alternate.count():
                twins[path] = urljoin(page.url, alternate.get_attribute("href"))
    assert mute == []
    headers = {**bearer(token), "Accept": "text/html"}
    broken = []
    asked: Counter[str] = Counter()
    with httpx.Client(headers=headers, timeout=60) as client:
        for address, path in links.items():
            asked[urlsplit(address).path] += 1
            if "/logout" in address or asked[urlsplit(address).path] > most:
                continue
            if client.get(address).status_code >= 400:
                broken.append(f"{path} -> {address}")
        for path, address in twins.items():
            answer = client.get(address)
            assert answer.headers["content-type"].startswith("application/json"), path
            assert isinstance(answer.json(), dict), path
    assert broken == [], "\n".join(broken)
    assert len(twins) >= 15
    assert quote(OBJECT, safe="") in "".join(links)
