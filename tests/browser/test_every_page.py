"""A walk over all pages: one heading, nothing sideways, links that answer, twins, contrast."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote, urljoin, urlsplit

import httpx
import pytest

import ontology
import rtask
from endpoint.access.tokens import TokenStore
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
    "/operations/register_robot", "/admin/tokens", "/admin/audit", "/admin/queries", "/openapi",
)  # fmt: skip
MIN_CONTRAST = 4.5
"""WCAG 2.2, 1.4.3."""

# Pairs of text and ground that occur: quiet text on panels, marks, buttons.
CONTRAST = """() => {
  const style = getComputedStyle(document.documentElement);
  const probe = document.createElement("i");
  document.body.append(probe);
  const rgb = (name) => {
    probe.style.color = style.getPropertyValue(name);
    return getComputedStyle(probe).color.match(/[\\d.]+/g).slice(0, 3).map(Number);
  };
  const luminance = (name) => {
    const [r, g, b] = rgb(name).map((v) => {
      const s = v / 255;
      return s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const pairs = [["--ink", "--ground"], ["--ink", "--panel"], ["--quiet", "--ground"],
    ["--quiet", "--panel"], ["--quiet", "--soft"], ["--accent", "--panel"],
    ["--accent", "--ground"], ["--accent-ink", "--accent"],
    ["--good", "--good-soft"], ["--bad", "--bad-soft"]];
  const found = pairs.map(([a, b]) => {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return [`${a} on ${b}`, (high + 0.05) / (low + 0.05)];
  });
  probe.remove();
  return found;
}"""
# What a screen reader could not name, and what the keyboard could not reach.
NAMELESS = """() => [...document.querySelectorAll("a[href], button, input, select, textarea")]
  .filter((e) => e.type !== "hidden" && e.checkVisibility())
  .filter((e) => !(e.textContent.trim() || e.ariaLabel || e.labels?.length || e.title
    || e.querySelector("img[alt]:not([alt=''])") || e.ariaHidden === "true"))
  .map((e) => e.outerHTML.slice(0, 120))"""
# Tables become cards on a phone; only the answer of a query may have any number of columns.
SIDEWAYS = """() => [...document.querySelectorAll(".scroll, main")]
  .filter((e) => e.scrollWidth > e.clientWidth + 1).map((e) => e.textContent.trim().slice(0, 60))"""
IMAGES = """() => [...document.images].filter((i) => !i.hasAttribute("alt")).map((i) => i.src)"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    folder: Path = tmp_path_factory.mktemp("walk") / "store"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(
            f"""PREFIX rt: <{ontology.NS}> PREFIX cora: <{ontology.PREFIXES["cora"]}>
            INSERT DATA {{ <{OBJECT}> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue mug" .
            <urn:lab/robot/nao-1> a cora:Robot ; rt:name "nao-1" . }}""",
            "ann",
        )
    with closing(TokenStore(folder)) as tokens:
        admin, _ = tokens.create("admin")
    with running_server(folder) as running:
        yield running, admin


@pytest.mark.parametrize("look", ALL_LOOKS)
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
            faults += [f"{path}: nameless {one}" for one in page.evaluate(NAMELESS)]
            faults += [f"{path}: image without words {one}" for one in page.evaluate(IMAGES)]
            keep_picture(page, f"walk-{path.strip('/').replace('/', '-')[:24]}-{look}")
        for pair, ratio in page.evaluate(CONTRAST):
            if ratio < MIN_CONTRAST:
                faults.append(f"{look}: {pair} has a contrast of {ratio:.2f}")
        page.goto(server.url)
        page.keyboard.press("Tab")
        assert page.evaluate("() => document.activeElement.className") == "skip"
    assert faults == [], "\n".join(faults)


def test_every_inner_link_answers_and_every_twin_is_the_model_of_its_page(
    browser: Any, site: tuple[RunningServer, str]
) -> None:
    server, token = site
    links: dict[str, str] = {}
    twins: dict[str, str] = {}
    with open_page(browser, server.url, token, java_script_enabled=False) as page:
        for path in PATHS:
            page.goto(server.url + path)
            for link in page.locator("a[href]").all():
                address = urljoin(page.url, link.get_attribute("href")).partition("#")[0]
                if urlsplit(address).netloc == urlsplit(server.url).netloc:
                    links.setdefault(address, path)
            alternate = page.locator("link[rel=alternate]")
            if alternate.count():
                twins[path] = urljoin(page.url, alternate.get_attribute("href"))
    headers = {**bearer(token), "Accept": "text/html"}
    broken = []
    with httpx.Client(headers=headers, timeout=60) as client:
        for address, path in links.items():
            if "/logout" not in address and client.get(address).status_code >= 400:
                broken.append(f"{path} -> {address}")
        for path, address in twins.items():
            answer = client.get(address)
            assert answer.headers["content-type"].startswith("application/json"), path
            assert isinstance(answer.json(), dict), path
    assert broken == [], "\n".join(broken)
    assert len(twins) >= 15
    assert quote(OBJECT, safe="") in "".join(links)
