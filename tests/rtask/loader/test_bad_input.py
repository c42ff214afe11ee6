"""Faults of files, disks and ontologies: a clear error each, the store unchanged."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

import pytest

import rtask
from rtask.errors import InconsistentError, ParseError, StorageFullError, TooLargeError
from rtask.kb.durability import blobs
from rtask.knowledge_base import KnowledgeBase
from tests.commands import run_program

_XML = (
    '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:e="urn:e:">\n'
    '<rdf:Description rdf:about="{name}">{body}</rdf:Description></rdf:RDF>'
)
_LOAD = "from rtask.cli import main; main()"
_OWL = "http://www.w3.org/2002/07/owl#"


@pytest.fixture
def kb() -> KnowledgeBase:
    return rtask.open(":memory:", ontologies=False)


def _file(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("name", "body", "where", "reason"),
    [
        ("urn:a b", "<e:p>1</e:p>", ":2:29:", "urn:a b"),
        ("urn:a", "<x:p>1</x:p>", ":2:", "unbound prefix|Unknown prefix x:"),
    ],
)
def test_rdf_xml_says_where_too(
    tmp_path: Path, kb: KnowledgeBase, name: str, body: str, where: str, reason: str
) -> None:
    path = _file(tmp_path, "a.rdf", _XML.format(name=name, body=body))
    with pytest.raises(ParseError, match=reason) as caught:
        kb.load(path)
    assert str(caught.value).startswith(f"{path}{where}")
    assert kb.seq == 0


def test_a_class_may_be_an_individual(kb: KnowledgeBase) -> None:
    text = (
        f"@prefix owl: <{_OWL}> . <urn:Mug> a owl:Class, <urn:Kind> . <urn:Kind> a owl:Class . "
        "<urn:mug> a <urn:Mug> ."
    )
    kb.load(text.encode(), format="turtle")
    assert kb.query("ASK { <urn:Mug> a <urn:Kind> . <urn:mug> a <urn:Mug> }") is True


def test_ten_levels_of_blank_nodes_are_kept(kb: KnowledgeBase) -> None:
    kb.load(f"<urn:a> <urn:p> {'[ <urn:p> ' * 10}1{' ]' * 10} .".encode(), format="turtle")
    path = "/".join(["<urn:p>"] * 11)
    assert kb.query(f"ASK {{ <urn:a> {path} 1 }}") is True
    assert kb.query("ASK { ?s ?p ?o FILTER(isBlank(?s)) }") is False


@pytest.mark.parametrize(
    ("form", "text"),
    [
        ("jsonld", '{"urn:p": ' * 5_000 + "1" + "}" * 5_000),
        ("turtle", "<urn:a> <urn:p> " + "<<( <urn:a> <urn:p> " * 5_000),
    ],
)
def test_depth_that_would_end_the_process_is_refused(
    kb: KnowledgeBase, form: str, text: str
) -> None:
    with pytest.raises(TooLargeError, match="nested deeper"):
        kb.load(text.encode(), format=form)
    assert kb.seq == 0


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ('{"@id": "urn:a b", "urn:p": 1}', "1:10: 'urn:a b' is not an IRI: write ' ' as %20"),
        ('{"@context": {"id": "@id"},\n "id": "urn:a|b", "urn:p": 1}', "2:9: 'urn:a|b'"),
        (
            '{"@context": {"p": {"@id": "urn:p", "@type": "@id"}},\n'
            '"@id": "urn:a", "p": "urn:x y"}',
            "2:23: 'urn:x y'",
        ),
    ],
)
def test_json_ld_about_what_is_no_iri_is_refused_not_left_out(
    kb: KnowledgeBase, text: str, where: str
) -> None:
    with pytest.raises(ParseError, match=re.escape(where)):
        kb.load(text.encode(), format="jsonld")
    assert kb.seq == 0


def test_json_ld_may_say_what_it_likes_in_literals(kb: KnowledgeBase) -> None:
    kb.load(b'{"@id": "urn:a", "urn:p": "see {here} | there", "@type": "urn:A"}', format="jsonld")
    assert kb.query("ASK { <urn:a> a <urn:A> ; <urn:p> 'see {here} | there' }") is True


def test_an_ontology_that_makes_everything_inconsistent_is_refused(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:x> a <urn:A> }")
    before = set(map(str, kb.store.raw))
    text = f"@prefix owl: <{_OWL}> . <urn:o> a owl:Ontology . <urn:A> owl:disjointWith <urn:A> ."
    with pytest.raises(InconsistentError) as caught:
        kb.load(text.encode(), format="turtle")
    assert caught.value.details["contradictions"][0]["triples"]
    assert set(map(str, kb.store.raw)) == before
    kb.update("INSERT DATA { <urn:y> a <urn:A> }")


@pytest.mark.parametrize("large", [False, True])
def test_a_disk_that_fills_up_leaves_the_store_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, large: bool
) -> None:
    def full(*args: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    if large:
        monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 10)
    text = "".join(f"<urn:s{n}> <urn:p> {n} .\n" for n in range(100))
    path = _file(tmp_path, "a.ttl", text)
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:q> 1 }")
        before = set(map(str, kb.store.raw))
        with monkeypatch.context() as broken:
            broken.setattr(blobs.os, "fsync", full)
            with pytest.raises(StorageFullError):
                kb.load(path)
        assert set(map(str, kb.store.raw)) == before
        assert kb.query("ASK { <urn:a> <urn:q> 1 }") is True
        assert kb.load(path).added == 100
        assert [f for f in kb.verify() if f.severity == "error"] == []


def test_a_second_process_is_told_who_holds_the_folder(tmp_path: Path) -> None:
    with rtask.open(tmp_path, ontologies=False, reason=False):
        done = run_program(_LOAD, "load", "--data", str(tmp_path), "-")
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1
    assert f"is open for writing by pid {os.getpid()}" in done.stderr


def test_a_dry_run_names_terms_that_nothing_is_known_of(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:known> a <urn:Thing> }")
    text = "<urn:a> a <urn:Own> ; <urn:known> 1 ; <urn:typo> 2 . <urn:Own> <urn:known> 3 ."
    report = kb.load(text.encode(), format="turtle", dry_run=True)
    assert report.undeclared == ["urn:typo"]
    assert kb.load(text.encode(), format="turtle").undeclared == []


@pytest.mark.slow
def test_progress_tells_bytes_of_the_file(tmp_path: Path, kb: KnowledgeBase) -> None:
    path = _file(tmp_path, "a.ttl", "".join(f"<urn:s{n}> <urn:p> {n} .\n" for n in range(9_000)))
    told: list[tuple[str, int, int]] = []
    kb.load(path, on_read=lambda *progress: told.append(progress))
    size = path.stat().st_size
    assert told[-1] == (str(path), size, size)
    assert all(0 <= read <= size for _, read, _ in told)


@pytest.mark.slow
def test_all_real_ontologies_load(ontologies_dir: Path) -> None:
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        report = kb.load(ontologies_dir, missing_imports="ignore")
        assert len({file.name for file in report.files}) >= 30
        assert {file.format for file in report.files} >= {"turtle", "rdfxml", "jsonld", "n3"}
        assert sum(file.read for file in report.files) > 30_000
        assert [f for f in kb.verify() if f.severity == "error"] == []
