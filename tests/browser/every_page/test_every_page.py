"""A walk over all pages: one heading, nothing sideways, links that answer, twins, contrast."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote, urljoin, urlsplit

import httpx
import pytest

from endpoint.access.tokens import TokenStore
from tests.browser.attempts import store_of_attempts
from tests.browser.every_page.audits import AUDITS, CONTRAST, SIDEWAYS, SMALL_TARGETS
from tests.browser.pages import ALL_LOOKS, fits, keep_picture, open_page
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
    "/ask?text=which+mugs+are+there", "/terms", "/terms?term=sumo:_UnaryFunction",
    "/operations/register_robot", "/admin/tokens", "/admin/audit", "/admin/queries",
    "/admin/proposals", "/openapi",
    "/world", "/world?at=2026-01-01T12:30:00Z", "/plan", "/plan?goal=every+mug+into+the+box",
    "/questions",
)  # fmt: skip
SOME_PATHS = ("/sparql", f"/object?iri={OBJECT}", "/feedback")
MIN_CONTRAST = 4.5
"""WCAG 2.2, 1.4.3."""

DRAWN = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
WITHOUT_SCRIPTS = {
    "says something": """() => [...document.querySelectorAll("h1 ~ *, :has(> h1) ~ *")]
      .some((e) => e.checkVisibility())""",
    "links": """() => [...document.querySelectorAll("a[href]")]
      .map((link) => link.getAttribute("href"))""",
    "twin": "() => document.querySelector('link[rel=alternate]')?.getAttribute('href')",
}
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


@pytest.mark.parametrize(
    ("look", "other"),
    [
        ("phone-dark", "laptop-light"),
        pytest.param("laptop-dark", "phone-light", marks=pytest.mark.deep),
    ],
)
def test_every_page_has_one_heading_fits_names_its_controls_and_can_be_touched(
    browser: Any, site: tuple[RunningServer, str], look: str, other: str
) -> None:
    """Each page is loaded in one look, and seen in another: as wide, and as dark, as that one.

    It is touched where the first look is a phone's.
    """
    server, token = site
    faults: list[str] = []
    with open_page(browser, server.url, token, **ALL_LOOKS[look]) as page:
        for path in PATHS:
            page.goto(server.url + path)
            for seen_as in (look, other):
                _look_as(page, seen_as)
                if not fits(page):
                    faults.append(f"{path} ({seen_as}): not one h1, or wider than the screen")
                scripts = dict(AUDITS)
                if seen_as.startswith("phone"):
                    scripts["scrolls sideways"] = SIDEWAYS
                    if "has_touch" in ALL_LOOKS[look]:
                        scripts["too low for a finger"] = SMALL_TARGETS
                for fault, places in page.evaluate(_at_once(scripts)).items():
                    faults += [f"{path} ({seen_as}): {fault}: {place}" for place in places]
                keep_picture(page, f"walk-{path.strip('/').replace('/', '-')[:24]}-{seen_as}")
        for seen_as in (look, other):
            _look_as(page, seen_as)
            for pair, ratio in page.evaluate(CONTRAST):
                if ratio < MIN_CONTRAST:
                    faults.append(f"{seen_as}: {pair} has a contrast of {ratio:.2f}")
        page.goto(server.url)
        page.keyboard.press("Tab")
        assert page.evaluate("() => document.activeElement.className") == "skip"
    assert faults == [], "\n".join(faults)


def _look_as(page: Any, look: str) -> None:
    page.set_viewport_size(ALL_LOOKS[look]["viewport"])
    page.emulate_media(color_scheme=ALL_LOOKS[look]["color_scheme"])
    page.evaluate(DRAWN)  # or what a script draws anew would still be as wide as before


def _at_once(scripts: Mapping[str, str]) -> str:
    """Return one script that carries out all: each question to the browser takes its time."""
    members = ", ".join(f"{json.dumps(name)}: ({script})()" for name, script in scripts.items())
    return f"() => ({{{members}}})"


@pytest.mark.parametrize(
    "paths",
    [
        pytest.param(SOME_PATHS, id="some"),
        pytest.param(PATHS, id="all", marks=pytest.mark.deep),
    ],
)
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


@pytest.mark.parametrize("most", [2, pytest.param(10_000, marks=pytest.mark.deep)])
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
            seen = page.evaluate(_at_once(WITHOUT_SCRIPTS))
            if not seen["says something"]:  # below the heading
                mute.append(path)
            for link in seen["links"]:
                address = urljoin(page.url, link).partition("#")[0]
                if urlsplit(address).netloc == urlsplit(server.url).netloc:
                    links.setdefault(address, path)
            if seen.get("twin"):
                twins[path] = urljoin(page.url, seen["twin"])
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
