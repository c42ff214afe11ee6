"""Every number that experience taught leads to the outcomes and the robots behind it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html.parser import HTMLParser

import pytest
from flask.testing import FlaskClient

import ontology
from tests.endpoint.sites import HOST, Site

ROBOTS = ("nao-1", "panda-1")
ATTEMPTS = ((1, "nao-1", "true"), (2, "nao-1", "false"), (3, "panda-1", "true"), (4, "panda-1", ""))


def _attempt(number: int, robot: str, held: str) -> str:
    outcome = f"; rt:hasOutcome <urn:lab/outcome/{number}>" if held else ""
    return f"""
  <urn:lab/task/{number}> a rt:Grasp ; rt:handles <urn:lab/object/1> ;
    rt:through <urn:lab/attempt/{number}> .
  <urn:lab/attempt/{number}> a rt:GraspAttempt ; rt:performedBy <urn:lab/robot/{robot}> ;
    rt:executesGrasp <urn:lab/grasp/1> ; rt:priorAlpha 2e0 ; rt:priorBeta 1e0 ;
    prov:endedAtTime "2026-01-01T10:0{number}:00Z"^^xsd:dateTime {outcome} .
  """ + (
        f"""<urn:lab/outcome/{number}> a rt:GraspOutcome ; rt:success {held} ;
    rt:hasFeedback <urn:lab/feedback/{number}> .
  <urn:lab/feedback/{number}> a rt:PhysicsFeedback ; rt:verdict {held} ."""
        if held
        else ""
    )


FACTS = f"""
PREFIX rt: <{ontology.NS}> PREFIX prov: <http://www.w3.org/ns/prov#>
PREFIX cora: <{ontology.PREFIXES["cora"]}> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
INSERT DATA {{
  {"".join(f'<urn:lab/robot/{name}> a cora:Robot ; rt:name "{name}" .' for name in ROBOTS)}
  <urn:lab/object/1> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue mug" ;
    rt:hasGrasp <urn:lab/grasp/1> .
  <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao" ; rt:graspQuality 0.8e0 .
  {"".join(_attempt(*one) for one in ATTEMPTS)}
}}"""
PAGES = (
    "/", "/objects", "/object?iri=urn:lab/object/1", "/robots", "/robot?iri=urn:lab/robot/nao-1",
    "/learning", "/activity", "/feedback", "/search?q=mug",
)  # fmt: skip
LEARNT = re.compile(r"\d+ of \d+ held|(?<!\d)(?!9[05] %)\d{1,3} %|\b0\.\d\d\b")
BLOCKS = {"tr", "p", "figcaption", "li", "dd", "td"}


class Figures(HTMLParser):
    """The innermost rows and paragraphs of a page: their texts, and the links of their figures."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self._open: list[tuple[str, list[str], list[str]]] = []
        self._is_hidden = False
        self.blocks: list[tuple[str, list[str]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self._is_hidden |= tag in ("script", "svg", "pre")
        if tag in BLOCKS and tag != "td":
            self._open.append((tag, [], []))
        if "data-figure" in given:
            for _, _, links in self._open:
                links.append(str(given["href"]))

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "svg", "pre"):
            self._is_hidden = False
        if self._open and tag == self._open[-1][0]:
            _, words, links = self._open.pop()
            self.blocks.append((" ".join(" ".join(words).split()), links))

    def handle_data(self, data: str) -> None:
        if self._open and not self._is_hidden:
            self._open[-1][1].append(data)


@pytest.fixture(scope="module")
def browser() -> Iterator[FlaskClient]:
    with Site.opened(FACTS) as site:
        yield site.signed_in("ann")


def text_of(browser: FlaskClient, address: str) -> str:
    answer = browser.get(address, base_url=HOST, headers={"Accept": "text/html"})
    assert answer.status_code == 200, address
    return str(answer.text)


@pytest.mark.parametrize("address", PAGES)
def test_each_learnt_number_has_a_link(browser: FlaskClient, address: str) -> None:
    page = text_of(browser, address).partition('id="evidence"')
    shown = page[0] + page[2].partition("</section>")[2]
    bare = [words for words, links in Figures(shown).blocks if LEARNT.search(words) and not links]
    assert bare == []


def test_the_links_lead_to_the_robots_and_agree_with_the_numbers(browser: FlaskClient) -> None:
    links: dict[str, str] = {}
    for address in PAGES:
        for words, own in Figures(text_of(browser, address)).blocks:
            links.update(dict.fromkeys(own, words))
    assert {link.partition("?")[0] for link in links} >= {"/feedback", "/resource"}
    for link, words in links.items():
        page = " ".join(re.sub("<[^>]+>", " ", text_of(browser, link)).split())
        if link.startswith("/feedback"):
            assert any(name in page for name in ROBOTS), link
            counts = re.search(r"(\d+) of (\d+) held", words)
            if counts:
                assert f"{counts[1]} of {counts[2]} held" in page, (link, words)
    page = " ".join(
        re.sub("<[^>]+>", " ", text_of(browser, "/feedback?grasp=urn:lab/grasp/1")).split()
    )
    assert "2 of 3 held (67 %): nao-1 1 of 2, panda-1 1 of 1." in page
    assert "1 more does not count, because nothing decided whether it held." in page


def test_a_filter_that_is_no_iri_is_refused(browser: FlaskClient) -> None:
    answer = browser.get("/feedback?grasp=not an iri", base_url=HOST)
    assert answer.status_code == 422
