"""Shapes of users: those of loaded graphs and of files count, and reports name them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli
from rtask.errors import DataError, ParseError, UsageError, ValidationError
from rtask.knowledge_base import KnowledgeBase

PREFIXES = """@prefix sh: <http://www.w3.org/ns/shacl#> . @prefix e: <urn:e#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
"""
CUP = "e:CupShape a sh:NodeShape ; sh:targetClass e:Cup ; sh:property [ sh:path e:mass ; "
SHAPES = PREFIXES + CUP + "sh:datatype xsd:double ; sh:minCount 1 ] ."
# One case for each family of core constraints (SHACL, 4): what is wrong, and what is right.
CORE = {
    "class": ("sh:property [ sh:path e:p ; sh:class e:K ]", "e:x e:p e:y", "e:y a e:K"),
    "nodeKind": ("sh:property [ sh:path e:p ; sh:nodeKind sh:IRI ]", "e:x e:p 1", ""),
    "maxCount": ("sh:property [ sh:path e:p ; sh:maxCount 1 ]", "e:x e:p 1, 2", ""),
    "range": ("sh:property [ sh:path e:p ; sh:maxExclusive 5 ]", "e:x e:p 5", ""),
    "length": ("sh:property [ sh:path e:p ; sh:minLength 3 ]", "e:x e:p 'ab'", ""),
    "pattern": ("sh:property [ sh:path e:p ; sh:pattern '^a' ]", "e:x e:p 'b'", ""),
    "languageIn": ("sh:property [ sh:path e:p ; sh:languageIn ('en') ]", "e:x e:p 'b'@de", ""),
    "uniqueLang": ("sh:property [ sh:path e:p ; sh:uniqueLang true ]",
                   "e:x e:p 'a'@de, 'b'@de", ""),
    "equals": ("sh:property [ sh:path e:p ; sh:equals e:q ]", "e:x e:p 1", "e:x e:q 1"),
    "disjoint": ("sh:property [ sh:path e:p ; sh:disjoint e:q ]", "e:x e:p 1 ; e:q 1", ""),
    "lessThan": ("sh:property [ sh:path e:p ; sh:lessThan e:q ]", "e:x e:p 2 ; e:q 1", ""),
    "not": ("sh:not [ sh:path e:p ; sh:minCount 1 ]", "e:x e:p 2", ""),
    "or": ("sh:or ([ sh:path e:p ; sh:minCount 1 ] [ sh:path e:q ; sh:minCount 1 ])",
           "", "e:x e:q 1"),
    "node": ("sh:property [ sh:path e:p ; sh:node e:N ] . "
             "e:N a sh:NodeShape ; sh:property [ sh:path e:q ; sh:minCount 1 ]",
             "e:x e:p e:y", "e:y e:q 1"),
    "qualified": ("sh:property [ sh:path e:p ; sh:qualifiedValueShape [ sh:class e:K ] ; "
                  "sh:qualifiedMinCount 1 ]", "e:x e:p e:y", "e:y a e:K"),
    "closed": ("sh:closed true ; sh:ignoredProperties "
               "( <http://www.w3.org/1999/02/22-rdf-syntax-ns#type> )", "e:x e:p 1", ""),
    "hasValue": ("sh:property [ sh:path e:p ; sh:hasValue 1 ]", "", "e:x e:p 1"),
    "in": ("sh:property [ sh:path e:p ; sh:in (1 2) ]", "e:x e:p 3", ""),
    "derived integers": ("sh:property [ sh:path e:p ; sh:datatype xsd:unsignedByte ]",
                         "e:x e:p 256", ""),
    "inverse path": ("sh:property [ sh:path [ sh:inversePath e:p ] ; sh:minCount 1 ]",
                     "", "e:y e:p e:x"),
    "sequence": ("sh:property [ sh:path (e:p e:p e:p e:p) ; sh:minCount 1 ]",
                 "e:x e:p e:a . e:a e:p e:b . e:b e:p e:c", "e:c e:p e:d"),
    "repeated path": ("sh:property [ sh:path [ sh:oneOrMorePath e:p ] ; sh:hasValue e:end ]",
                      "e:x e:p e:a . e:a e:p e:b . e:b e:p e:c . e:c e:p e:d", "e:d e:p e:end"),
}  # fmt: skip


def opened(validate: bool | str = False, *shapes: Path) -> KnowledgeBase:
    found = rtask.open(":memory:", ontologies=False, reason=False, validate=validate, shapes=shapes)
    assert isinstance(found, KnowledgeBase)
    return found


@pytest.fixture
def plain() -> Iterator[KnowledgeBase]:
    with opened() as kb:
        yield kb


def turtle(text: str) -> bytes:
    return (PREFIXES + text).encode()


@pytest.mark.parametrize("name", CORE)
def test_a_core_constraint_of_a_loaded_graph_is_checked_at_once_and_on_commit(name: str) -> None:
    constraint, wrong, right = CORE[name]
    shape = turtle(f"e:S a sh:NodeShape ; sh:targetNode e:x ; sh:targetClass e:C ; {constraint} .")
    with opened("warn") as kb:
        kb.load(shape, format="turtle", graph="urn:shapes")
        update = "PREFIX e: <urn:e#> INSERT DATA { e:x a e:C . %s }"
        first = kb.update(update % wrong)
        assert [v.focus for v in first.warnings] == ["<urn:e#x>"], first.warnings
        assert first.shapes == ("<urn:e#S> (urn:shapes)",)
        report = kb.validate()
        assert [v.focus for v in report] == ["<urn:e#x>"]
        assert not report.conforms
        if right:
            assert kb.update(f"PREFIX e: <urn:e#> INSERT DATA {{ {right} }}").warnings == ()
            assert kb.validate() == []


def test_an_empty_report_names_what_was_checked(plain: KnowledgeBase) -> None:
    plain.load(SHAPES.encode(), format="turtle", graph="urn:shapes")
    report = plain.validate()
    assert report == []
    assert report.conforms
    assert "<urn:e#CupShape> (urn:shapes)" in report.shapes


def test_files_count_for_one_check_and_name_themselves(
    plain: KnowledgeBase, tmp_path: Path
) -> None:
    file = tmp_path / "shapes.ttl"
    file.write_text(SHAPES.replace("CupShape", "Other").replace("e:Cup", "e:Jug"))
    plain.update("INSERT DATA { <urn:jug> a <urn:e#Jug> }")
    assert plain.validate() == []
    report = plain.validate(file)
    assert [v.focus for v in report] == ["<urn:jug>"]
    assert f"<urn:e#Other> ({file})" in report.shapes


def test_a_violation_of_a_loaded_shape_refuses_the_commit_and_names_it() -> None:
    with opened(True) as kb:
        kb.load(SHAPES.encode(), format="turtle", graph="urn:shapes")
        before = kb.seq
        with pytest.raises(ValidationError, match="urn:e#mass") as error:
            kb.update("INSERT DATA { <urn:cup> a <urn:e#Cup> }")
        assert error.value.details["shapes"] == ["<urn:e#CupShape> (urn:shapes)"]
        assert kb.seq == before
        kb.update("DROP GRAPH <urn:shapes>")
        assert kb.update("INSERT DATA { <urn:cup> a <urn:e#Cup> }").shapes == ()


def test_a_shape_is_changed_by_a_change_of_its_parts() -> None:
    with opened("warn") as kb:
        kb.load(turtle("e:S a sh:NodeShape ; sh:targetNode e:x ; sh:property e:P . "
                       "e:P sh:path e:p ; sh:minCount 1 ."),
                format="turtle", graph="urn:shapes")  # fmt: skip
        touch = "INSERT DATA { <urn:e#x> <urn:e#q> %d }"
        assert len(kb.update(touch % 1).warnings) == 1
        kb.update("DELETE WHERE { GRAPH ?g { <urn:e#P> <http://www.w3.org/ns/shacl#minCount> 1 } }")
        assert kb.update(touch % 2).warnings == ()


def test_a_class_that_is_a_shape_targets_its_instances(plain: KnowledgeBase) -> None:
    text = "e:Pen a rdfs:Class, sh:NodeShape ; sh:property [ sh:path e:ink ; sh:minCount 1 ] ."
    plain.load(turtle(text), format="turtle", graph="urn:pens")
    plain.update("INSERT DATA { <urn:pen> a <urn:e#Pen> }")
    assert "<urn:pen>" in [v.focus for v in plain.validate()]


def test_a_robots_shapes_bind_no_commit_of_others_but_are_used_by_validate() -> None:
    shape = (
        "PREFIX sh: <http://www.w3.org/ns/shacl#> INSERT DATA { <urn:S> a sh:NodeShape ; "
        "sh:targetClass <urn:e#Cup> ; sh:property [ sh:path <urn:e#mass> ; sh:minCount 1 ] }"
    )
    with opened(True) as kb:
        for agent in ("nao-1", None):
            kb.update(shape, agent)
        assert kb.update("INSERT DATA { <urn:cup> a <urn:e#Cup> }", "nao-2").added == 1
        report = kb.validate()
        assert {v.focus for v in report} == {"<urn:cup>"}
        assert any("agent/nao-1" in name for name in report.shapes)


def test_shapes_whose_sparql_would_call_out_are_left_out_with_the_reason() -> None:
    text = (
        "e:S a sh:NodeShape ; sh:targetNode e:x ; sh:sparql [ a sh:SPARQLConstraint ; "
        "sh:select '''SELECT $this { SERVICE <http://localhost:1/> { $this ?p ?o } }''' ] ."
    )
    with opened() as kb:
        kb.load(turtle(text), format="turtle", graph="urn:shapes")
        report = kb.validate()
        assert report == []
        assert report.left_out == ("<urn:e#S> (urn:shapes): its SPARQL uses SERVICE",)


BROKEN = {
    "no path": ("sh:property [ sh:minCount 1 ]", "well-formed"),
    "no number": ('sh:property [ sh:path e:p ; sh:minCount "x" ]', "minCount"),
    "no pattern": ('sh:property [ sh:path e:p ; sh:pattern "(" ]', "unterminated"),
    "no prefix": ('sh:sparql [ sh:select "SELECT $this { $this no:p 1 }" ]', "prefix : no"),
    "no query": ('sh:sparql [ sh:select "SELEC $this" ]', "SelectQuery"),
}


@pytest.mark.parametrize("broken", BROKEN)
def test_a_shape_that_cannot_be_applied_is_named_and_stops_no_other(
    broken: str, tmp_path: Path
) -> None:
    constraint, why = BROKEN[broken]
    text = turtle(
        f"e:S a sh:NodeShape ; sh:targetClass e:C ; {constraint} . "
        "e:T a sh:NodeShape ; sh:targetClass e:C ; sh:property [ sh:path e:q ; sh:minCount 1 ] ."
    )
    with opened("refuse") as kb:
        kb.load(text, format="turtle", graph="urn:shapes")
        (left_out,) = kb.validate().left_out  # although nothing is of its kind yet
        assert left_out.startswith("<urn:e#S> (urn:shapes): ")
        assert why in left_out
        kb.update("INSERT DATA { <urn:x> a <urn:e#C> ; <urn:e#p> 'a' ; <urn:e#q> 1 }")
        with pytest.raises(ValidationError, match="urn:e#q"):
            kb.update("INSERT DATA { <urn:y> a <urn:e#C> ; <urn:e#p> 'a' }")
        assert any("urn:e#T" in name for name in kb.validate().shapes)
    file = tmp_path / "shapes.ttl"
    file.write_bytes(text)
    with pytest.raises(DataError, match="cannot be applied"):
        opened("refuse", file)


def test_a_custom_constraint_that_would_call_out_is_not_applied_nor_shapes_that_use_it() -> None:
    text = """e:Component a sh:ConstraintComponent ; sh:parameter [ sh:path e:known ] ;
      sh:validator [ a sh:SPARQLAskValidator ;
        sh:ask "ASK { SERVICE <http://localhost:1/> { $value ?p ?o } }" ] .
    e:S a sh:NodeShape ; sh:targetNode e:x ; e:known true .
    e:T a sh:NodeShape ; sh:targetNode e:x ; sh:property [ sh:path e:q ; sh:minCount 1 ] ."""
    with opened() as kb:
        kb.load(turtle(text), format="turtle", graph="urn:shapes")
        report = kb.validate()
        assert [violation.path for violation in report] == ["<urn:e#q>"]
        (left_out,) = report.left_out
        assert "<urn:e#S>" in left_out
        assert "its SPARQL uses SERVICE" in left_out


def test_files_of_shapes_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with opened() as kb:
        file = tmp_path / "shapes.ttl"
        file.write_text("e:S a")
        with pytest.raises(ParseError, match=r"shapes\.ttl:1:"):
            kb.validate(file)
        with pytest.raises(DataError, match="missing"):
            kb.validate(tmp_path / "missing.ttl")
    with pytest.raises(UsageError, match="validate"):
        opened(False, file)


def test_the_command_line_takes_files_of_shapes(tmp_path: Path) -> None:
    shapes, data, folder = tmp_path / "s.ttl", tmp_path / "d.ttl", tmp_path / "kb"
    shapes.write_text(SHAPES)
    data.write_text("<urn:cup> a <urn:e#Cup> .")
    with rtask.open(folder, ontologies=False, reason=False):
        pass
    here = ["--data", str(folder)]
    loaded = CliRunner().invoke(
        cli, ["load", str(data), *here, "--shapes", str(shapes), "--no-reason"]
    )
    assert loaded.exit_code != 0
    CliRunner().invoke(cli, ["load", str(data), *here, "--no-reason"])
    assert CliRunner().invoke(cli, ["validate", *here]).exit_code == 0
    found = CliRunner().invoke(cli, ["validate", *here, "--shapes", str(shapes), "--json"])
    report = json.loads(found.stdout)
    assert (found.exit_code, report["conforms"]) == (1, False)
    assert f"<urn:e#CupShape> ({shapes})" in report["shapes"]
    text = CliRunner().invoke(cli, ["validate", *here, "--shapes", str(shapes)]).stdout
    assert f"1 of {shapes}" in text


def test_the_command_line_does_not_say_that_data_conform_to_a_shape_it_could_not_apply(
    tmp_path: Path,
) -> None:
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        text = "e:S a sh:NodeShape ; sh:targetClass e:C ; sh:property [ sh:minCount 1 ] ."
        kb.load(turtle(text), format="turtle", graph="urn:shapes")
    done = CliRunner().invoke(cli, ["validate", "--data", str(tmp_path), "--json"])
    assert (done.exit_code, json.loads(done.stdout)["conforms"]) == (3, None)


def test_a_shape_that_refers_to_itself_is_applied() -> None:
    text = """e:S a sh:NodeShape ; sh:targetNode e:x ;
      sh:property [ sh:path e:name ; sh:minCount 1 ], [ sh:path e:knows ; sh:node e:S ] ."""
    with opened() as kb:
        kb.load(turtle(text), format="turtle", graph="urn:shapes")
        kb.update("INSERT DATA { <urn:e#x> <urn:e#name> 'x' ; <urn:e#knows> <urn:e#y> }")
        report = kb.validate()
        assert (len(report), report.left_out) == (1, ()), "y has no name"


def test_a_class_that_was_written_as_text_is_no_fault_of_the_validator() -> None:
    with opened(validate=True) as kb, kb.transaction() as tx:
        tx.add("urn:e#x", "http://www.w3.org/1999/02/22-rdf-syntax-ns#type", "urn:e#Cup")
    assert tx.commit.added == 1


def test_shapes_that_bind_no_commit_are_named_when_the_graph_is_opened(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with_sparql = tmp_path / "sparql.ttl"
    asked = "sh:sparql [ sh:select 'SELECT $this { $this <urn:e#mass> ?m FILTER(?m > 9) }' ] ."
    with_sparql.write_text(f"{PREFIXES} e:Heavy a sh:NodeShape ; sh:targetClass e:Cup ; {asked}")
    with opened(True, with_sparql):
        [line] = [words for words in caplog.messages if "not checked against" in words]
    assert "urn:e#Heavy" in line
