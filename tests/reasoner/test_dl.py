"""OWL 2 DL: HermiT and Pellet agree, end in time, and say what is missing."""

from __future__ import annotations

import shutil
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from reasoner.dl import hermit, pellet
from rtask.cli.reasoning import reason
from rtask.errors import UnsupportedError
from tests.reasoner.ttl import triple, triples


@pytest.fixture(autouse=True)
def quick_java(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start Java without the optimising compiler, which takes a third of runs of two seconds."""
    monkeypatch.setenv("JDK_JAVA_OPTIONS", "-XX:+UseSerialGC -XX:TieredStopAtLevel=1")


FAMILY = """
:Parent a owl:Class ; rdfs:subClassOf :Person . :Person a owl:Class .
:Nobody a owl:Class ; rdfs:subClassOf :Person, [ owl:complementOf :Person ; a owl:Class ] .
:has a owl:ObjectProperty .
:Father owl:equivalentClass [ a owl:Class ; owl:intersectionOf (:Parent :Man) ] .
:Mother a owl:Class . :Man a owl:Class . :Father a owl:Class .
[ a owl:Class ; owl:unionOf (:Father :Mother) ] rdfs:subClassOf :Elder . :Elder a owl:Class .
"""
HIDDEN = (
    FAMILY
    + """
:Some a owl:Class ; rdfs:subClassOf [ a owl:Class ; owl:unionOf (:Father :Mother) ] .
"""
)
needs_java = pytest.mark.skipif(shutil.which("java") is None, reason="OWL 2 DL needs Java")
ENGINES = pytest.mark.parametrize("engine", [hermit, pellet], ids=["hermit", "pellet"])
RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"


@pytest.mark.slow
@needs_java
@ENGINES
def test_unsatisfiable_classes_and_the_hierarchy_are_found(engine):
    report = engine.check(triples(FAMILY + ":a a :Parent ."), classify=True, timeout_s=120)
    assert report.is_consistent
    assert report.unsatisfiable == ("urn:t:Nobody",)
    assert (triple(":Parent a :x")[0], triple(":Person a :x")[0]) in set(hermit.subclasses(report))
    assert {("urn:t:Father", "urn:t:Person"), ("urn:t:Father", "urn:t:Elder")} <= hermit.hierarchy(
        report
    )


@pytest.mark.slow
@needs_java
@ENGINES
def test_what_is_said_about_statements_is_left_out(engine):
    said = (
        ":a a :Parent . :r rdf:reifies <<( :a a :Parent )>> ; :confidence 0.9 . "
        ":b :saw <<( :a a :Parent )>> ."
    )
    assert engine.check(triples(FAMILY + said), timeout_s=120).is_consistent


@pytest.mark.slow
@needs_java
@ENGINES
def test_an_inconsistency_is_found(engine):
    assert not engine.check(triples(FAMILY + ":a a :Nobody ."), timeout_s=120).is_consistent


@pytest.mark.slow
@needs_java
@ENGINES
def test_imports_that_cannot_be_fetched_are_dropped(engine):
    header = "<urn:t:onto> a owl:Ontology ; owl:imports <http://nowhere.invalid/x> ."
    assert engine.check(triples(header + FAMILY), timeout_s=120).is_consistent


@pytest.mark.slow
def test_a_process_that_takes_too_long_is_killed_with_its_children(tmp_path):
    mark = tmp_path / "pids"
    code = (
        "import os, subprocess, sys, time; child = subprocess.Popen(['sleep', '600']); "
        f"open({str(mark)!r}, 'w').write(f'{{os.getpid()}} {{child.pid}}'); time.sleep(600)"
    )
    with pytest.raises(hermit.DLError, match=r"no answer within 3 s, stopped"):
        hermit.run_java([sys.executable, "-c", code], timeout_s=3)
    pids = mark.read_text().split()
    deadline = time.monotonic() + 60
    while any(map(is_running, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(is_running, pids))


def is_running(pid: str) -> bool:
    """Tell whether a process runs; the dead may stay listed until somebody collects them."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


@needs_java
@ENGINES
def test_engines_end_in_time(engine):
    with pytest.raises(hermit.DLError, match="no answer within"):
        engine.check(triples(FAMILY), timeout_s=0.01)


@ENGINES
def test_without_java_the_message_says_what_to_install(engine, monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(hermit.DLUnavailableError, match="apt-get install"):
        engine.check(triples(FAMILY))


# The command.


def run(tmp_path: Path, turtle: str, *options: str):
    path = tmp_path / "onto.nt"
    path.write_bytes(hermit._prepare(triples(turtle)))
    return CliRunner().invoke(reason, [str(path), *options])


@pytest.mark.slow
@needs_java
def test_the_command_lists_subclasses_that_only_dl_finds(tmp_path):
    answer = run(tmp_path, HIDDEN, "--profile", "dl")
    assert answer.exit_code == 0, answer.output
    assert "urn:t:Some < urn:t:Elder" in answer.output
    assert "urn:t:Father < urn:t:Person" not in answer.output  # the rules find it, too
    assert "urn:t:Nobody" in answer.output


@pytest.mark.slow
@needs_java
def test_the_command_ends_with_1_where_dl_finds_a_contradiction(tmp_path):
    answer = run(tmp_path, FAMILY + ":a a :Nobody .", "--profile", "dl", "--engine", "pellet")
    assert answer.exit_code == 1
    assert "INCONSISTENT" in answer.output


def test_the_command_without_java_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    answer = run(tmp_path, FAMILY, "--profile", "dl")
    assert isinstance(answer.exception, UnsupportedError)
    assert "apt-get install" in str(answer.exception)


def test_the_command_reports_what_the_rules_find(tmp_path):
    answer = run(tmp_path, FAMILY + ":a a :Parent, :Nobody .")
    assert answer.exit_code == 1
    assert "INCONSISTENT" in answer.output
    assert "cls-com" in answer.output


def test_the_command_lists_classes_that_can_have_no_member(tmp_path):
    answer = run(
        tmp_path,
        ":A rdfs:subClassOf :B, :C . :B owl:disjointWith :C . :D rdfs:subClassOf owl:Nothing . ",
    )
    assert answer.exit_code == 0, answer.output
    assert "unsatisfiable: 2\n  urn:t:A\n  urn:t:D\n" in answer.output


def test_the_command_says_what_leaves_the_profile(tmp_path):
    answer = run(tmp_path, HIDDEN, "--json")
    assert '"unionOf in superclass": 1' in answer.output
