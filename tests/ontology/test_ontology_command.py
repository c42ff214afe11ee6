"""``rtask ontology``: print, document, compare."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.cli import main
from rtask.errors import UnknownTermError
from rtask.ontology_docs import Vocabulary, bundled, compare, read_source

ROOM = ontology.path("catalog.toml").parent


def _run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as caught:
        main(["ontology", *map(str, arguments)])
    printed = capsys.readouterr()
    return int(caught.value.code or 0), printed.out, printed.err


def _edited(tmp_path: Path, *changes: tuple[str, str], file: str = "rtask/object.ttl") -> Path:
    """Return a copy of a module with texts replaced."""
    text = ontology.path(file).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / Path(file).name
    path.write_text(text)
    return path


@pytest.mark.slow
def test_show_lists_modules_terms_and_facts(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = _run(capsys, "show")
    assert (code, "rtask/grasp" in out, "rtask/dl" in out) == (0, True, True)
    assert "rt:GraspAttempt" in _run(capsys, "show", "grasp")[1]
    out = _run(capsys, "show", "mass")[1]
    assert "unit:KiloGM" in out
    assert ":mug rt:mass 0.3e0 ." in out


@pytest.mark.slow
def test_show_with_a_graph_prints_the_card_of_a_term_there(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    with rtask.open(tmp_path / "kb") as kb:
        kb.update(f"INSERT DATA {{ <urn:m> a <{ontology.NS}Mug> }}")
    code, out, _ = _run(capsys, "show", "Mug", "--data", tmp_path / "kb")
    assert code == 0
    assert "1 member" in out.splitlines()
    assert "?thing a rt:Mug" in out
    card = json.loads(_run(capsys, "show", "Mug", "--data", tmp_path / "kb", "--json")[1])
    assert (card["count"], card["above"]) == (1, ["rt:Cup"])
    assert "rt:Mug " in _run(capsys, "show", "--limit", "0", "--data", tmp_path / "kb")[1]
    code, _, error = _run(capsys, "show", "Mugg", "--data", tmp_path / "kb")
    assert code != 0
    assert "'mug'" in error


def test_show_gives_json(capsys: pytest.CaptureFixture[str]) -> None:
    facts = json.loads(_run(capsys, "show", "rt:Mug", "--json")[1])
    assert facts["iri"] == ontology.NS + "Mug"
    assert "rt:Mug rdfs:subClassOf rt:DrinkingVessel" in facts["axioms"]
    module = json.loads(_run(capsys, "show", "category", "--json")[1])
    assert facts["iri"] in module["members"]


def test_an_unknown_name_gets_a_hint(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, error = _run(capsys, "show", "rt:Mugg")
    assert (code, out) == (1, "")
    assert error == "rtask: no term or module 'rt:Mugg'; did you mean rt:Mug?\n"


@pytest.mark.slow
def test_docs_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = _run(capsys, "docs", "--out", tmp_path / "a" / "b")
    assert (code, (tmp_path / "a" / "b" / "index.html").is_file()) == (0, True)
    assert "index.html" in out


@pytest.mark.slow
def test_equal_versions_do_not_differ(capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(capsys, "diff", "bundled")[:2] == (0, "level: none\n")
    assert _run(capsys, "diff", ROOM, "bundled")[:2] == (0, "level: none\n")


EXEMPLAR = "rt:exemplarOf a"
# ruff: noqa: E501 - one change is one line
CHANGES = {
    "a comment": ("patch", '"The mass of the object."@en', '"How heavy it is."@en'),
    "a term less": ("major", "rt:surfaceMaterial a owl:DatatypeProperty", "rt:surface a owl:Foo"),
    "a class that was a property": ("major", "rt:similarTo a owl:ObjectProperty", "rt:similarTo a owl:Class"),
    "an axiom less": ("minor", "a owl:ObjectProperty, owl:AsymmetricProperty", "a owl:ObjectProperty"),
    "a second range": ("major", EXEMPLAR, "rt:mass rdfs:range xsd:decimal . rt:exemplarOf a"),
    "a trait more": ("major", EXEMPLAR, "rt:mass a owl:FunctionalProperty . rt:exemplarOf a"),
    "a chain more": ("minor", EXEMPLAR, "rt:knownBy owl:propertyChainAxiom ( rt:exemplarOf rt:knownBy ) . rt:exemplarOf a"),
    "a term given up": ("minor", EXEMPLAR, "rt:mass owl:deprecated true . rt:exemplarOf a"),
    "a new term": ("minor", EXEMPLAR, "rt:Saucer a owl:Class ; owl:disjointWith rt:SupportSurface . rt:exemplarOf a"),
    "a disjointness": ("major", EXEMPLAR, "rt:Symmetry owl:disjointWith rt:SupportSurface . rt:exemplarOf a"),
}  # fmt: skip


@pytest.mark.parametrize(("level", "old", "new"), CHANGES.values(), ids=CHANGES)
def test_a_change_has_a_level(level: str, old: str, new: str, tmp_path: Path) -> None:
    before = read_source(str(ontology.path("rtask/object.ttl")))
    after = read_source(str(_edited(tmp_path, (old, new))))
    assert compare(before, after).level == level


def test_what_is_breaking_sets_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = ontology.path("rtask/object.ttl")
    trait = "rt:mass a owl:FunctionalProperty . rt:exemplarOf a"
    worse = _edited(tmp_path, (EXEMPLAR, trait))
    code, out, _ = _run(capsys, "diff", file, worse)
    assert code == 1
    assert "+ rt:mass rdf:type owl:FunctionalProperty  (breaking)" in out
    found = json.loads(_run(capsys, "diff", worse, file, "--json")[1])
    assert (found["level"], found["breaking"], len(found["axioms"])) == ("minor", False, 1)


def test_a_stricter_shape_is_breaking(tmp_path: Path) -> None:
    old = read_source(str(ontology.path("shapes/object.ttl")))
    change = ("sh:path rt:mass ; sh:minExclusive 0.0e0", "sh:path rt:mass ; sh:minExclusive 1.0e0")
    new = read_source(str(_edited(tmp_path, change, file="shapes/object.ttl")))
    assert compare(old, new).is_breaking


def test_blank_node_labels_and_order_make_no_difference(tmp_path: Path) -> None:
    text = ontology.path("rtask/task.ttl").read_text()
    head, *blocks = text.split("\n\n")
    path = tmp_path / "task.ttl"
    path.write_text("\n\n".join([head, blocks[0], *reversed(blocks[1:])]))
    old = read_source(str(ontology.path("rtask/task.ttl")))
    assert compare(old, read_source(str(path))).level == "none"


@pytest.mark.slow
def test_a_knowledge_base_is_compared_with_the_bundled_version(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rtask.open(tmp_path / "kb").close()
    assert _run(capsys, "diff", tmp_path / "kb")[:2] == (0, "level: none\n")
    with rtask.open(tmp_path / "kb") as kb:
        kb.load(
            b"<urn:x> a <http://www.w3.org/2002/07/owl#Ontology> . "
            b"<urn:x#A> a <http://www.w3.org/2002/07/owl#Class> .",
            "turtle",
            graph="urn:x",
        )
    assert _run(capsys, "diff", tmp_path / "kb")[:2] == (0, "level: none\n")
    assert "<urn:x#A>" in _run(capsys, "show", "x", "--source", tmp_path / "kb")[1]


def test_what_cannot_be_read_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, error = _run(capsys, "diff", tmp_path / "none.ttl")
    assert (code, error.count("\n")) == (2, 1)
    (tmp_path / "bad.ttl").write_text("this is no Turtle")
    code, _, error = _run(capsys, "show", "--source", tmp_path / "bad.ttl")
    assert (code, error.count("\n")) == (3, 1)
    empty = tmp_path / "empty"
    empty.mkdir()
    assert _run(capsys, "show", "--source", empty)[0] == 2


def test_strange_ontologies_are_read(tmp_path: Path) -> None:
    """Cycles of classes and of blank nodes, lists without an end, punning, names without labels."""
    (tmp_path / "odd.ttl").write_text(
        """@prefix o: <http://www.w3.org/2002/07/owl#> .
        @prefix s: <http://www.w3.org/2000/01/rdf-schema#> .
        @prefix f: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
        <urn:A> a o:Class, o:NamedIndividual, o:ObjectProperty ; s:subClassOf <urn:B> .
        <urn:B> a o:Class ; s:subClassOf <urn:A>, [ o:onProperty <urn:A> ] .
        _:l f:first <urn:A> ; f:rest _:l . <urn:C> a o:Class ; o:unionOf _:l .
        _:c o:complementOf _:c . <urn:D> a o:Class ; o:equivalentClass _:c ; s:comment 3 .
        """
    )
    vocabulary = Vocabulary(read_source(str(tmp_path / "odd.ttl")))
    assert len(vocabulary) == 4
    assert vocabulary.find("urn:A").kinds == ("class", "object property", "individual")
    with pytest.raises(UnknownTermError, match="no term"):
        vocabulary.find("")


RELEASED = Path(__file__).parent / "released-terms.txt"


def test_no_released_term_has_vanished() -> None:
    """A published IRI stays; one that is given up is marked ``owl:deprecated``."""
    released = set(RELEASED.read_text().split())
    now = {iri for iri in Vocabulary(bundled()).terms if iri.startswith(ontology.NS)}
    assert {ontology.NS + name for name in released} - now == set()


def test_a_copy_of_the_room_without_a_module_is_breaking(tmp_path: Path) -> None:
    shutil.copytree(ROOM, tmp_path / "old", ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    shutil.copytree(tmp_path / "old", tmp_path / "new")
    (tmp_path / "new" / "rtask" / "category.ttl").unlink()
    found = compare(read_source(str(tmp_path / "old")), read_source(str(tmp_path / "new")))
    assert ontology.NS + "Mug" in found.removed
    assert found.is_breaking
