"""The command line: what it prints, its exit codes, and that listing commands imports none."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.cli import main
from rtask.cli.options import term
from rtask.rdf.terms import literal
from tests.docs.command_reference import reference

pytestmark = pytest.mark.slow


class Outcome:
    """Result of a command: exit code and both streams."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


class Shell:
    """Runs commands in this process on one folder."""

    def __init__(self, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.data = data
        self._capsys = capsys

    def __call__(self, *arguments: str) -> Outcome:
        with pytest.raises(SystemExit) as caught:
            main(list(arguments))
        out, err = self._capsys.readouterr()
        code = caught.value.code
        return Outcome(code if isinstance(code, int) else 0, out, err)


@pytest.fixture
def shell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Shell:
    monkeypatch.setenv("RTASK_DATA", str(tmp_path / "kb"))
    return Shell(tmp_path / "kb", capsys)


@pytest.fixture(scope="module")
def mug_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A knowledge base with the ontology and one mug; made once, copied for each test."""
    folder = tmp_path_factory.mktemp("cli") / "kb"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(
            f'INSERT DATA {{ <urn:mug> a <{ontology.NS}Mug> ; <urn:label> "mug, blue" }}', "nao-1"
        )
    return folder


@pytest.fixture
def filled(shell: Shell, mug_folder: Path) -> Shell:
    shutil.copytree(mug_folder, shell.data)
    return shell


def test_help_and_version_import_nothing_heavy() -> None:
    heavy = "pyoxigraph reasoner numpy flask pybullet open3d rdflib numba cv2"
    code = f"""
import sys
import rtask, rtask.cli
try:
    rtask.cli.main(["--help"])
except SystemExit:
    pass
found = [name for name in {heavy.split()!r} if name in sys.modules]
assert not found, found
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ("load", "query", "serve", "demo", "doctor"):
        assert f"\n  {name} " in done.stdout
    assert "not installed" not in done.stdout


def test_version(shell: Shell) -> None:
    assert shell("--version").out == f"rtask, version {rtask.__version__}\n"


def test_a_wrong_command_says_what_may_be_meant(shell: Shell) -> None:
    done = shell("qurey")
    assert done.code == 2
    assert "Did you mean 'query'?" in done.err
    assert "Did you mean" not in shell("zzz").err


def test_an_error_is_one_line_and_debug_shows_the_rest(shell: Shell) -> None:
    done = shell("stats")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith(f"rtask: {shell.data} is not a knowledge base")
    assert done.err.count("\n") == 1
    with pytest.raises(rtask.errors.StoreFormatError):
        main(["--debug", "stats"])


def test_an_error_of_the_system_that_names_no_file_is_one_line_too(
    filled: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("rtask.knowledge_base.KnowledgeBase.dump", full)
    done = filled("export", str(tmp_path / "all.trig"))
    assert (done.code, done.err) == (3, "rtask: No space left on device\n")


def test_an_argument_that_is_not_utf8_is_an_error_of_one_line(filled: Shell) -> None:
    done = filled("contributors", "withdraw", "nao-\udcff")
    assert (done.code, done.err) == (2, "rtask: 'nao-\\udcff' cannot be written in utf-8\n")


@pytest.mark.parametrize(
    ("written", "iri"),
    [("<http://h/mug>", "http://h/mug"), ("http://h/mug", "http://h/mug"), ("rt:Mug", None)],
)
def test_a_term_is_an_iri_with_or_without_brackets(written: str, iri: str | None) -> None:
    assert term(written, "").value == (iri or ontology.NS + "Mug")


def test_a_term_may_be_a_literal_that_contains_an_address() -> None:
    assert term('"http://h/mug"', "") == literal("http://h/mug")


@pytest.mark.parametrize("written", ["http://a b/", "<http://a b/>", "urn:a b", "\udcff", ""])
def test_what_is_no_term_is_refused(filled: Shell, written: str) -> None:
    done = filled("explain", written, "rdf:type", "rt:Mug")
    assert done.code in (2, 3)
    assert done.err.startswith("rtask: ")
    assert done.err.count("\n") == 1


def test_usage_errors_have_their_own_code(shell: Shell) -> None:
    assert shell("query").code == 2
    assert shell("query", "ASK {}", "--no-such").code == 2


def test_load_then_query(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "mugs.ttl"
    file.write_text(f"<urn:m> a <{ontology.NS}Mug> .")
    done = shell("load", str(file))
    assert done.code == 0
    assert done.err.startswith("undo: rtask update 'DROP GRAPH <")
    assert done.err.count("\n") == 1
    assert f"{file}: turtle, 1 statements, +1 -0" in done.out
    rows = shell("query", "SELECT ?s { ?s a rt:Container }")
    assert rows.out.splitlines() == ["s", "-----", "urn:m"]
    assert rows.err == "1 row\n"
    assert shell("query", "--no-inferred", "ASK { <urn:m> a rt:Container }").out == "no\n"
    assert shell("query", "-F", "csv", "SELECT ?s { ?s a rt:Mug }").out == "s\r\nurn:m\r\n"
    report = json.loads(shell("load", "--json", "--dry-run", "--replace", str(file)).out)
    assert report[0]["files"][0]["added"] == 0


def test_a_bad_file_is_named_with_its_line(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "bad.ttl"
    file.write_text("<urn:a> <urn:p> 1 .\n<urn:a> <urn:p")
    done = shell("load", str(file))
    assert done.code == 3
    assert done.err.startswith(f"rtask: {file}:2:")


def test_update_writes_as_an_agent(filled: Shell) -> None:
    done = filled("update", "INSERT DATA { <urn:cup> <urn:p> 1 }", "--agent", "nao-2", "--json")
    assert json.loads(done.out)["added"] == 1
    with rtask.open(filled.data, mode="r") as kb:
        assert [q.graph_name for q in kb.match("urn:cup")] == [kb.graphs.agent("nao-2")]
    forbidden = filled(
        "update", "INSERT DATA { GRAPH <urn:g> { <urn:cup> <urn:p> 2 } }", "--agent", "nao-2"
    )
    assert (forbidden.code, forbidden.out) == (3, "")
    assert "may not write <urn:g>" in forbidden.err


def test_text_comes_from_a_file_or_standard_input(
    filled: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import io

    (tmp_path / "q.rq").write_text("ASK { <urn:mug> a rt:Mug }")
    assert filled("query", "--file", str(tmp_path / "q.rq")).out == "yes\n"
    assert filled("query", "--file", str(tmp_path / "absent.rq")).code == 2
    (tmp_path / "latin.rq").write_bytes("ASK { ?s ?p 'é' }".encode("latin-1"))
    done = filled("query", "--file", str(tmp_path / "latin.rq"))
    assert done.code == 2
    assert done.err.startswith(f"rtask: {tmp_path / 'latin.rq'} is not text in UTF-8")
    monkeypatch.setattr(sys, "stdin", io.StringIO("ASK {}"))
    assert filled("query", "-").out == "yes\n"


@pytest.mark.slow
def test_explain_names_who_asserts_and_what_follows(filled: Shell) -> None:
    assert filled("explain", "urn:mug", "a", "rt:Mug").out == (
        "asserted in <urn:lab/graph/agent/nao-1>\n"
    )
    proof = filled("explain", "urn:mug", "a", "rt:Container")
    assert proof.code == 0
    assert "asserted: urn:lab/graph/agent/nao-1" in proof.out
    absent = filled("explain", "urn:mug", "a", "rt:Ball")
    assert (absent.code, absent.err.splitlines()[0]) == (1, "<urn:mug> a rt:Ball does not hold")
    assert filled("explain", "urn:mug", "a", "x:Ball").code == 2
    cut = filled("explain", "urn:mug", "a", "rt:Ball rt:Mug")
    assert (cut.code, cut.err) == (2, "rtask: 'rt:Mug' is left over after the term rt:Ball\n")
    short = filled("explain", "urn:mug", "a", "rt:Container", "--budget", "1")
    assert short.code == 3
    assert "not decided within a budget of 1 steps" in short.err


def test_history_lists_commits(filled: Shell) -> None:
    lines = filled("history", "urn:mug", "-s").out.splitlines()
    assert "nao-1" in lines[0]
    assert "+2 -0" in lines[0]
    assert len(lines) == 3


def test_stats_and_ontologies(filled: Shell) -> None:
    found = json.loads(filled("stats", "--json").out)
    assert found["base"] == "urn:lab/"
    assert found["graphs"]["urn:lab/graph/agent/nao-1"] == 2
    assert "closure      current" in filled("stats").out
    assert ontology.ONTOLOGY in filled("ontology", "list").out
    assert filled("ontology", "path", ontology.ONTOLOGY).out.endswith("rtask.ttl\n")


def test_export_and_original(filled: Shell, tmp_path: Path) -> None:
    out = tmp_path / "mug.nt"
    graph = "urn:lab/graph/agent/nao-1"
    assert filled("export", str(out), "-g", graph).err == "2 statements\n"
    assert '"mug, blue"' in out.read_text()
    assert filled("export", "-", "--original").code == 2


@pytest.mark.slow
def test_verify_backup_restore_rebuild(filled: Shell, tmp_path: Path) -> None:
    assert filled("verify").out == "all well\n"
    assert filled("rebuild").out == "inferred: +0 -0\n"
    assert filled("backup", str(tmp_path / "copy")).code == 0
    assert filled("restore", str(tmp_path / "copy"), str(tmp_path / "again")).code == 0
    assert filled("stats", "-d", str(tmp_path / "again")).code == 0
    with rtask.open(filled.data) as kb:
        kb.store.raw.remove(kb.match(graph=kb.graphs.inferred)[0])
    done = filled("verify")
    assert done.code == 1
    assert "closure" in done.out
    assert filled("verify", "--repair").code == 0
    assert filled("verify", "--json").out == "[]\n"


def test_prefixes_are_predefined_in_updates_as_in_queries(filled: Shell) -> None:
    assert filled("update", "INSERT DATA { <urn:jar> a rt:Mug ; rdfs:label 'jar' }").code == 0
    assert filled("query", "ASK { <urn:jar> a rt:Mug }").out == "yes\n"


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("query", "SELECT * { ?x a rt:Mug } }"),
        ("update", "INSERT DATA { <urn:x> a rt:Mug } }"),
    ],
)
def test_the_place_of_a_syntax_error_is_that_in_the_text_as_given(
    filled: Shell, command: str, text: str
) -> None:
    given = filled(command, text)
    spelt = filled(command, text.replace("rt:Mug", "<urn:>"))  # as long, and without a prefix
    assert given.code == spelt.code == 2
    assert given.err == spelt.err


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (("query", "ASK { <urn:mug> a rt:Mug }"), 0),
        (("stats",), 0),
        (("history",), 0),
        (("episodes", "list"), 1),
    ],
)
def test_reading_recovers_a_folder_that_was_not_closed(
    filled: Shell, command: tuple[str, ...], code: int
) -> None:
    from rtask.kb.durability.recovery import Checkpoint

    Checkpoint(0, clean=False).save(filled.data)
    done = filled(*command)
    assert done.code == code
    assert "not closed properly" not in done.err


def test_writing_to_a_folder_in_use_is_refused_in_one_line(filled: Shell) -> None:
    with rtask.open(filled.data) as kb:
        kb.publish(url="http://127.0.0.1:9/sparql")
        done = filled("update", "INSERT DATA { <urn:a> <urn:b> <urn:c> }")
    assert done.code == 3
    assert "use the server at http://127.0.0.1:9/sparql" in done.err
    assert done.err.count("\n") == 1


def test_a_folder_in_use_is_read_with_every_commit_of_its_writer(filled: Shell) -> None:
    with rtask.open(filled.data) as kb:
        before = filled("query", "ASK { <urn:new> ?p ?o }")
        kb.update("INSERT DATA { <urn:new> <urn:p> 1 }")
        after = filled("query", "ASK { <urn:new> ?p ?o }")
    assert (before.out, after.out) == ("no\n", "yes\n")


def test_the_reference_has_a_section_for_every_command() -> None:
    page = reference()
    for name in ("rtask", "rtask grasp", "rtask grasp space", "rtask study", "rtask serve"):
        assert f"\n## {name}\n\n```text\nUsage: {name} [OPTIONS]" in page
