"""Every number that experience taught leads to the outcomes and the robots behind it."""

from __future__ import annotations

import html
import re
from collections import Counter
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from typing import Any

import pytest
from flask.testing import FlaskClient

import ontology
from endpoint.pages.curation import Alike
from rtask.asking.tools.toolbox import TOOLS, Toolbox
from rtask.engine.context import SCOPES
from rtask.kb.commit.access import Access
from tests.endpoint.sites import HOST, Site
from tests.rtask.tasks.conftest import LAB

ROBOTS = ("nao-7", "panda-7")
ATTEMPTS = ((1, "nao-7", "true"), (2, "nao-7", "false"), (3, "panda-7", "true"), (4, "panda-7", ""))


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
  <urn:lab/robot/nao-7> rt:hasEndEffector <urn:lab/hand/1> .
  <urn:lab/hand/1> a rt:Hand ; rt:name "nao hand" ; rt:gripperType "nao" ;
    rt:minOpening 0e0 ; rt:maxOpening 0.08e0 ; rt:maxPayload 0.3e0 .
  <urn:lab/object/1> a rt:Mug ; rt:objectId "mine/1" ; rt:name "blue mug" ;
    rt:graspWidth 0.04e0 ; rt:mass 0.2e0 ; rt:hasGrasp <urn:lab/grasp/1> .
  <urn:lab/grasp/1> a rt:PlanarGrasp ; rt:gripperType "nao" ; rt:graspQuality 0.8e0 .
  {"".join(_attempt(*one) for one in ATTEMPTS)}
}}"""
POSE = f"""
PREFIX rt: <{ontology.NS}> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#>
INSERT DATA {{
  <urn:lab/estimate/1> a rt:PoseEstimate ; rt:poseOf <urn:lab/object/1> ;
    rt:estimatedPose <urn:lab/pose/1> ; rt:poseConfidence 0.9e0 .
  <urn:lab/grasp/1> rt:graspPose <urn:lab/pose/2> ; rt:contactWidth 0.04e0 ; rt:jawOpening 0.06e0 .
  <urn:lab/object/1> rt:bodyFrame <urn:lab/frame/2> .
  <urn:lab/pose/2> a rt:PlanarPose ; rt:inFrame <urn:lab/frame/2> ;
    rt:x 0e0 ; rt:y 0e0 ; rt:z 0.02e0 ; rt:theta 0e0 .
  <urn:lab/pose/1> a rt:Pose ; rt:inFrame <urn:lab/frame/1> ; rt:x 0.1e0 ; rt:y 0e0 ; rt:z 0e0 ;
    rt:atTime "2026-01-01T10:00:00Z"^^xsd:dateTime .
}}"""
_PLACED = """
  <urn:lab/thing/1> a rt:Exemplar ; rt:exemplarOf <urn:lab/object/1> ; rt:name "this mug" ;
    rt:currentPlacement <urn:lab/placement/1> .
  <urn:lab/placement/1> a rt:Placement ; rt:placementOf <urn:lab/thing/1> ;
    rt:placementPose <urn:lab/pose/9> ; time:hasBeginning <urn:lab/instant/1> .
  <urn:lab/instant/1> a time:Instant ;
    time:inXSDDateTimeStamp "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp .
  <urn:lab/frame/9> a rt:Frame ; rt:frameId "map" .
  <urn:lab/pose/9> a rt:Pose ; rt:inFrame <urn:lab/frame/9> ; rt:x 1e0 ; rt:y 0e0 ; rt:z 0e0 ;
    rt:qx 0e0 ; rt:qy 0e0 ; rt:qz 0e0 ; rt:qw 1e0 ."""
PAGES = (
    "/", "/objects", "/object?iri=urn:lab/object/1", "/robots", "/robot?iri=urn:lab/robot/nao-7",
    "/learning", "/activity", "/feedback", "/search?q=mug",
    "/plan?goal=every cup into the left box",
    "/ask?text=Which grasps are proven, on which gripper type?",
)  # fmt: skip
NOT_LEARNT = re.compile(r"/(benchmarks|setup|operations|explain|resource|static|.*\\.json)")
"""Figures of another machine, units in forms, proofs, and statements with their graphs."""
MAX_ALIKE = 3
"""Pages of one kind that a walk looks at."""
LEARNT = re.compile(
    r"\d+ of \d+ held|(?<!\d)(?!9[05] %)\d{1,3} %|\b0\.\d\d\b|\b(expected|chance) [01.]*\d+ ?%?"
)
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
def site() -> Iterator[Site]:
    with Site.opened(FACTS) as opened:
        opened.kb.update(LAB)
        yield opened


@pytest.fixture(scope="module")
def browser(site: Site) -> FlaskClient:
    return site.signed_in("ann")


def text_of(browser: FlaskClient, address: str) -> str:
    answer = browser.get(address, base_url=HOST, headers={"Accept": "text/html"})
    assert answer.status_code == 200, address
    return str(answer.text)


def bare_figures(page: str) -> list[str]:
    """Return what states a learnt number without a link, apart from the evidence itself."""
    before, _, rest = page.partition('id="evidence"')
    shown = before + rest.partition("</section>")[2]
    return [words for words, links in Figures(shown).blocks if LEARNT.search(words) and not links]


@pytest.mark.parametrize("address", PAGES)
def test_each_learnt_number_has_a_link(browser: FlaskClient, address: str) -> None:
    assert bare_figures(text_of(browser, address)) == []


def test_so_it_is_on_every_page_that_links_lead_to(browser: FlaskClient) -> None:
    waiting, seen, alike = list(PAGES), set(PAGES), Counter[str]()
    while waiting:
        address = waiting.pop(0)
        answer = browser.get(address, base_url=HOST, headers={"Accept": "text/html"})
        if answer.status_code != 200 or answer.mimetype != "text/html":
            continue
        assert bare_figures(answer.text) == [], address
        for link in map(html.unescape, re.findall(r'href="(/[^"#]*)', answer.text)):
            kind = link.partition("?")[0]
            if link not in seen and alike[kind] < MAX_ALIKE and not NOT_LEARNT.match(kind):
                alike[kind] += 1
                seen.add(link)
                waiting.append(link)
    assert {"/sparql", "/robot", "/object", "/feedback", "/terms"} <= alike.keys()
    assert len(seen) > 40


def test_what_was_expected_and_whether_a_thing_is_still_there_lead_on() -> None:
    """Numbers of events and of the world, which are not stated before a server runs."""
    attempt = _attempt(9, "nao-7", "true")
    with Site.opened(FACTS) as site:
        browser = site.signed_in("ann")
        head = FACTS.partition("INSERT DATA")[0]
        site.kb.update(f"{head} INSERT DATA {{ {attempt} }}", "nao-7")
        site.kb.update(
            f"{head} PREFIX time: <{ontology.PREFIXES['time']}> INSERT DATA {{ {_PLACED} }}",
            "nao-7",
        )
        shown = text_of(browser, "/activity")
        assert "expected to hold: 67%" in shown
        assert bare_figures(shown) == []
        shown = text_of(browser, "/world")
        assert "Still there" in shown
        assert re.search(r"data-figure[^>]*>\d+ %</a>", shown)
        assert bare_figures(shown) == []


def test_an_attempt_is_called_by_its_robot_and_object_and_its_outcome_by_the_attempt(
    browser: FlaskClient,
) -> None:
    for iri, name in (
        ("urn:lab/attempt/1", "an attempt of nao-7 at blue mug"),
        ("urn:lab/outcome/1", "outcome of an attempt of nao-7 at blue mug"),
    ):
        assert f"<h1>{name}</h1>" in text_of(browser, f"/resource?iri={iri}")


def test_a_likeness_leads_to_both_objects_side_by_side_and_says_what_agrees(
    browser: FlaskClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def alike(subject: str, description: str) -> Any:
        counts = dict.fromkeys(("views", "grasps", "attempts", "successes"), 1)
        row = {"object": "urn:lab/object/1", "name": "blue mug", "classes": "mug", "image": None}
        return Alike([{**row, **counts, "confidence": 0.62, "why": "31 places agree"}])

    monkeypatch.setattr("endpoint.pages.teach.objects_alike", alike)
    monkeypatch.setattr("endpoint.pages.curation.objects_alike", alike)
    shown = text_of(browser, "/teach?iri=kb:object/1")
    assert bare_figures(shown) == []
    links = [link for _, own in Figures(shown).blocks for link in own]
    (link,) = {link for link in links if link.startswith("/object/merge")}
    assert link.endswith("#why")
    into = "/object/merge?iri=https://example.org/kb/object/1&into=urn:lab/object/1"
    why = text_of(browser, into).partition('id="why"')[2]
    assert "62 %" in why
    assert "31 places agree" in why


def test_a_chance_of_a_plan_leads_to_the_outcomes_of_such_tasks(browser: FlaskClient) -> None:
    page = text_of(browser, "/plan?goal=every cup into the left box")
    figures = Figures(page).blocks
    link = next(
        own[0] for words, own in figures if "picks red cup up" in words and "chance" in words
    )
    assert "of all tasks of this kind 2 of 3, weighed as 2 attempts" in " ".join(page.split())
    rows = browser.get(link, base_url=HOST, headers={"Accept": "text/csv"}).text
    assert rows.count("urn:lab/robot/") == 3


class Waiting:
    """A call that nobody stops."""

    is_stopped = False

    def on_stop(self, stop: Callable[[], None]) -> None:
        """Nobody stops it."""

    def report(self, share: float, words: str) -> None:
        """Nobody asked."""


CALLS: dict[str, list[dict[str, Any]]] = {
    "ask": [{"text": "Which grasps are proven, on which gripper type?"}],
    "ask_sparql": [
        {"query": "SELECT ?g ?q { ?g rt:graspQuality ?q }"},
        {
            "query": "SELECT ?name (COUNT(?a) AS ?n) { ?a rt:performedBy/rt:name ?name }"
            " GROUP BY ?name"
        },
    ],
    "check_sparql": [],
    "search": [{"words": "mug"}],
    "describe": [{"term": "kb:grasp/1"}, {"term": "kb:attempt/1"}],
    "explain": [{"s": "kb:grasp/1", "p": "rt:graspQuality", "o": "0.8"}],
    "history": [{"term": "kb:grasp/1"}],
    "where_is": [{"object": "kb:object/1"}],
    "recall_grasps": [{"object": "kb:object/1"}],
    "find_object": [{"wish": "a mug", "gripper": "nao hand", "objects": ["kb:object/1"]}],
    "propose_change": [],
}
STATED = {"confidence", "expected", "chance", "attempts", "successes"}


def learnt_in(part: Any, why: str = "") -> Iterator[tuple[Any, str]]:
    """Yield each learnt number of an answer, with the nearest address of what it rests on."""
    if isinstance(part, list):
        for item in part:
            yield from learnt_in(item, why)
    elif isinstance(part, dict):
        why = part.get("why") or part.get("proof") or why
        if part.get("type") == "number":
            yield part["value"], why
        for name, value in part.items():
            if name in STATED and value is not None:
                yield value, why
            else:
                yield from learnt_in(value, why)


def test_each_learnt_number_in_an_answer_of_a_tool_has_an_address(
    site: Site, browser: FlaskClient
) -> None:
    site.kb.update(POSE, "nao-1")
    toolbox = Toolbox(site.kb, site.engine, lambda access: SCOPES[access.role])
    assert set(CALLS) == set(TOOLS)
    learnt = Counter[str]()
    for name, calls in CALLS.items():
        for arguments in calls:
            result = toolbox.call(name, arguments, Access("nao-7", "robot"), "", Waiting())
            assert not result["isError"], result
            for number, why in learnt_in(result["structuredContent"]):
                learnt[name] += 1
                assert why, (name, number)
                assert "<h1>" in text_of(browser, why), why
    assert learnt.keys() >= {"ask_sparql", "describe", "where_is", "recall_grasps", "find_object"}


TWINS = (
    "/index.json", "/objects.json", "/robots.json", "/learning.json", "/feedback.json",
    "/object.json?iri=urn:lab/object/1", "/robot.json?iri=urn:lab/robot/nao-7",
    "/object/merge.json?iri=urn:lab/object/1",
)  # fmt: skip


@pytest.mark.parametrize("address", TWINS)
def test_each_learnt_number_in_the_json_of_a_page_has_an_address(
    browser: FlaskClient, address: str
) -> None:
    answer = browser.get(address, base_url=HOST, headers={"Accept": "application/json"})
    numbers = [
        (number, why)
        for number, why in learnt_in(answer.get_json())
        if not isinstance(number, list | bool)
    ]
    assert numbers, address
    for number, why in set(numbers):
        assert why, (address, number)
        assert "<h1>" in text_of(browser, why), why


def test_counts_of_json_agree_with_the_outcomes_that_they_lead_to(browser: FlaskClient) -> None:
    rows = browser.get("/robots.json", base_url=HOST).get_json()["robots"]
    for row in rows:
        assert row["why"].startswith("/feedback?robot=")
        page = " ".join(re.sub("<[^>]+>", " ", text_of(browser, row["why"])).split())
        if row["attempts"]:
            assert f"{row['successes']} of {row['attempts']} held" in page, row


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
    assert "2 of 3 held (67 %): nao-7 1 of 2, panda-7 1 of 1." in page
    assert "1 more does not count, because nothing decided whether it held." in page


def test_a_filter_that_is_no_iri_is_refused(browser: FlaskClient) -> None:
    answer = browser.get("/feedback?grasp=not an iri", base_url=HOST)
    assert answer.status_code == 422


@pytest.mark.parametrize(
    ("limit", "address"),
    [
        ("objects.MAX_OUTCOMES", "/object?iri=kb:object/1"),
        ("robots._MAX_ROBOTS", "/"),
        ("robots._MAX_ROBOTS", "/robots"),
        ("robots._SHOWN_OUTCOMES", "/robot?iri=kb:robot/nao-7"),
        ("robots._SHOWN_ATTEMPTS", "/robot?iri=kb:robot/nao-7"),
        ("graph.resource.MAX_OUTGOING", "/resource?iri=kb:object/1"),
        ("graph.resource.MAX_INCOMING", "/resource?iri=kb:object/1"),
        ("graph.classes.MAX_MEMBERS", "/classes?iri=rt:GraspAttempt"),
        ("feedback.PAGE_SIZE", "/feedback"),
    ],
)
def test_a_list_that_is_cut_says_so_and_leads_to_the_rest(
    browser: FlaskClient, monkeypatch: pytest.MonkeyPatch, limit: str, address: str
) -> None:
    def rests(page: str) -> list[str]:
        cut = re.findall(r'data-left-out>.*?href="([^"]*)"', page, re.S)
        cut += re.findall(r'href="(/feedback[^"]*page=2)', page)
        return [html.unescape(link) for link in cut]

    whole = rests(text_of(browser, address))
    monkeypatch.setattr(f"endpoint.pages.{limit}", 1)
    (rest,) = set(rests(text_of(browser, address))) - set(whole)
    assert "<h1>" in text_of(browser, rest)


def test_candidates_and_changes_that_are_cut_are_said_to_be(
    site: Site, browser: FlaskClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in (8, 9):
        site.kb.update(
            f"PREFIX rt: <{ontology.NS}> "
            f'INSERT DATA {{ <urn:lab/object/{number}> a rt:Mug ; rt:objectId "{number}" }}'
        )
    merge = "/object/merge?iri=kb:object/1"
    assert "data-left-out" not in text_of(browser, merge)
    assert "Nothing yet" in text_of(browser, "/curation")
    monkeypatch.setattr("endpoint.pages.curation.MAX_CANDIDATES", 1)
    monkeypatch.setattr("endpoint.pages.curation._RECENT_COMMITS", 1)
    assert "The 1 that were tried most; there are more" in text_of(browser, merge)
    changes = text_of(browser, "/curation")
    assert "Nothing since commit" in changes
    assert "Nothing yet" not in changes
