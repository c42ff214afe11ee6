"""The pages of an ontology are valid, complete, linked, and need nothing from elsewhere."""

from __future__ import annotations

import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

import ontology
from rtask.ontology_docs import Vocabulary, bundled, read_source, write_pages

VOID = {"meta", "br", "link", "img", "input", "hr"}


class Page(HTMLParser):
    """Reads a page, and notes what a browser would have to mend."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: set[str] = set()
        self.faults: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        self.faults += self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        if len(names) != len(set(names)):
            self.faults.append(f"attribute twice in {tag}")
        if tag in ("section", "h2", "table", "p") and self._open[-1:] == ["p"]:
            self.faults.append(f"{tag} in p")
        values = dict(attrs)
        self.tags.add(tag)
        self.ids += [values["id"] or ""] if "id" in values else []
        self.links += [values["href"] or ""] if "href" in values else []
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("rect", "path", *VOID):
            self.faults.append(f"{tag} closes itself")

    def handle_endtag(self, tag: str) -> None:
        if not self._open or self._open.pop() != tag:
            self.faults.append(f"</{tag}>")


@pytest.fixture(scope="module")
def vocabulary() -> Vocabulary:
    return Vocabulary(bundled(shapes=True))


@pytest.fixture(scope="module")
def folder(vocabulary: Vocabulary, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    write_pages(vocabulary, folder)
    return folder


@pytest.fixture(scope="module")
def pages(folder: Path) -> dict[str, Page]:
    return {p.name: Page(p.read_text(encoding="utf-8")) for p in folder.iterdir()}


def test_there_is_a_page_for_each_module(vocabulary: Vocabulary, pages: dict[str, Page]) -> None:
    assert len(pages) == len(vocabulary.modules) + 1
    assert {"index.html", "rtask-grasp.html", "shapes-graph-single-values.html"} <= set(pages)


def test_pages_are_well_formed(pages: dict[str, Page]) -> None:
    assert {name: page.faults for name, page in pages.items() if page.faults} == {}
    assert all(len(page.ids) == len(set(page.ids)) for page in pages.values())


def test_every_link_leads_to_a_page_and_a_term(pages: dict[str, Page]) -> None:
    lost = [
        (name, link)
        for name, page in pages.items()
        for link in page.links
        if (parts := link.partition("#"))
        if parts[0] not in pages or (parts[2] and parts[2] not in pages[parts[0]].ids)
    ]
    assert lost == []


def test_nothing_comes_from_elsewhere(folder: Path, pages: dict[str, Page]) -> None:
    for page in pages.values():
        assert not page.tags & {"script", "link", "img", "iframe", "object"}
    assert not any("url(" in path.read_text(encoding="utf-8") for path in folder.iterdir())


def test_every_term_has_an_entry(vocabulary: Vocabulary, pages: dict[str, Page]) -> None:
    entries = [entry for page in pages.values() for entry in page.ids]
    assert len(entries) == len(vocabulary)


def test_an_entry_says_what_the_term_is(folder: Path) -> None:
    text = (folder / "rtask-object.html").read_text(encoding="utf-8")
    entry = text.partition('<section id="rt-mass">')[2].partition("</section>")[0]
    for part in ("The mass of the object.", "unit:KiloGM", "domain", "xsd:double", "checked by"):
        assert part in entry
    assert ":mug " in entry  # an example


def test_diagrams_show_classes_and_relations(folder: Path) -> None:
    text = (folder / "rtask-grasp.html").read_text(encoding="utf-8")
    hierarchy, relations = re.findall(r"<svg.*?</svg>", text, re.S)
    assert hierarchy.count("<rect") > 20
    assert all(name in hierarchy for name in ("rt:PushGrasp", "rt:RobotManipulationAction"))
    assert all(name in relations for name in ("executesGrasp", "rt:DecisionPolicy"))


@pytest.mark.slow
def test_the_same_ontology_gives_the_same_bytes(
    vocabulary: Vocabulary, folder: Path, tmp_path: Path
) -> None:
    again = write_pages(Vocabulary(bundled(shapes=True)), tmp_path)
    assert all(file.read_bytes() == (folder / file.name).read_bytes() for file in again)


def test_hostile_text_stays_text(tmp_path: Path) -> None:
    (tmp_path / "bad.ttl").write_text(
        """@prefix o: <http://www.w3.org/2002/07/owl#> .
        @prefix r: <http://www.w3.org/2000/01/rdf-schema#> .
        <urn:a%3Cb> a o:Class ; r:label "<script>x</script>" ; r:comment "a & b </p>\\"" ;
            r:subClassOf <urn:a%3Cb>, <urn:c> . <urn:c> a o:Class ; r:subClassOf <urn:a%3Cb> .
        <urn:A#b> a o:Class . <urn:A-b> a o:Class .
        """
    )
    files = write_pages(Vocabulary(read_source(str(tmp_path / "bad.ttl"))), tmp_path / "out")
    for file in files:
        page = Page(file.read_text(encoding="utf-8"))
        assert not page.faults
        assert "script" not in page.tags
        assert len(page.ids) == len(set(page.ids))


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium here")
def test_a_browser_shows_a_page(folder: Path, tmp_path: Path) -> None:
    """Chromium lays the page out; its own reading of it has the headings and the drawings."""
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    command += [f"--user-data-dir={tmp_path}", (folder / "rtask-grasp.html").as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if done.returncode != 0:
        pytest.skip(f"Chromium does not start here: {done.stderr[-200:]}")
    assert done.stdout.count("<svg") == 2
    assert done.stdout.count("<section") == len(
        Page((folder / "rtask-grasp.html").read_text(encoding="utf-8")).ids
    )
    assert f"{ontology.ONTOLOGY}/grasp" in done.stdout
