"""Commands say how to undo what they changed, and what a bounded listing leaves out."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from pyoxigraph import Literal, Quad

import ontology
import rtask
from rtask.cli import main
from rtask.rdf.terms import iri

pytestmark = pytest.mark.slow

_OBJECTS = "\n".join(
    f'<urn:mug-{n}> a rt:Mug ; rt:objectId "{n}" ; rt:name "mug {n}" .' for n in range(4)
)
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undo") / "kb"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(f"PREFIX rt: <{ontology.NS}> INSERT DATA {{ {_OBJECTS} }}", "nao-1")
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", "nao-1")
    return folder


@pytest.fixture
def run(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    shutil.copytree(made, tmp_path / "kb")

    def call(*arguments: str, folder: bool = True) -> tuple[int, str, str]:
        where = ["--data", str(tmp_path / "kb")] if folder else []
        with pytest.raises(SystemExit) as caught:
            main([*arguments, *where])
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return call


def _undo(run: Run, said: str) -> tuple[int, str, str]:
    """Run the command that a command printed as its opposite, word by word."""
    (line,) = (line for line in said.splitlines() if line.startswith("undo: "))
    program, *command = shlex.split(line.removeprefix("undo: "))
    assert program == "rtask"
    return run(*command, folder=False)


def test_a_listing_says_how_many_lines_it_leaves_out(run: Run) -> None:
    code, out, err = run("objects", "list", "--limit", "3")
    assert (code, len(out.splitlines())) == (0, 3)
    assert err == "1 more; --limit 0 for all\n"
    assert run("objects", "list")[2] == ""
    assert len(json.loads(run("objects", "list", "--json")[1])) == 4
    assert len(json.loads(run("objects", "list", "--json", "-n", "2")[1])["rows"]) == 2


def test_a_bounded_history_shows_the_latest_commits(run: Run) -> None:
    whole = run("history")[1].splitlines()
    _, out, err = run("history", "--limit", "1")
    assert out.splitlines() == whole[-1:]
    assert err == f"{len(whole) - 1} earlier; --limit 0 for all\n"


def test_a_history_says_which_commits_are_not_kept(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ "No commits" would deny what the journal no longer tells."""
    from rtask.kb.feed.feed import Feed

    code, out, err = run("history", "urn:nobody")
    assert (code, out) == (1, "")
    assert "no statement mentions urn:nobody" in err
    monkeypatch.setattr(Feed, "oldest_retained", lambda self: 3)
    code, out, err = run("history", "urn:nobody")
    assert (code, out) == (1, "")
    assert "commits 1 to 2 are no longer kept: what they changed is not known" in err
    assert "no longer kept" not in run("history", "urn:nobody", "--since", "2")[2]


def test_a_withdrawal_since_a_time_that_is_no_longer_kept_is_refused(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rtask.kb.feed.feed import Feed

    kept = run("history")[1]
    monkeypatch.setattr(Feed, "oldest_retained", lambda self: 3)
    given = ("contributors", "withdraw", "nao-1", "--since", "2020-01-01")
    code, out, err = run(*given)
    assert (code, out) == (3, "")
    assert "since: commits before 3 are no longer kept" in err
    assert len(err.splitlines()) == 1
    monkeypatch.undo()
    assert run("history")[1] == kept


def test_a_merge_is_undone_by_what_the_merge_printed(run: Run) -> None:
    _, _, err = run("objects", "merge", "mug 1", "mug 2")
    assert len(json.loads(run("objects", "list", "--json")[1])) == 3
    assert _undo(run, err)[0] == 0
    assert len(json.loads(run("objects", "list", "--json")[1])) == 4


def test_a_purge_says_that_it_is_final(run: Run) -> None:
    _, _, err = run("objects", "forget", "mug 3", "--purge")
    assert "this cannot be undone" in err
    assert "undo:" not in err


def test_a_load_into_a_new_graph_is_undone_by_what_it_printed(run: Run, tmp_path: Path) -> None:
    (tmp_path / "more.ttl").write_text("<urn:b> <urn:p> 2 .")
    _, _, err = run("load", str(tmp_path / "more.ttl"), "--graph", "urn:g")
    assert run("query", "ASK { GRAPH <urn:g> { <urn:b> ?p ?o } }")[0] == 0
    assert _undo(run, err)[0] == 0
    assert run("query", "ASK { GRAPH <urn:g> { <urn:b> ?p ?o } }")[0] == 1


def test_a_load_into_a_graph_with_statements_is_undone_without_those(
    run: Run, tmp_path: Path
) -> None:
    (tmp_path / "more.ttl").write_text("<urn:b> <urn:p> 2 .")
    run("load", str(tmp_path / "more.ttl"), "--graph", "urn:g")
    (tmp_path / "more.ttl").write_text("<urn:b> <urn:p> 3 .")
    _, _, err = run("load", str(tmp_path / "more.ttl"), "--graph", "urn:g", "--replace")
    assert run("query", "ASK { GRAPH <urn:g> { <urn:b> <urn:p> 3 } }")[0] == 0
    assert _undo(run, err)[0] == 0
    assert run("query", "ASK { GRAPH <urn:g> { <urn:b> <urn:p> 2 } }")[0] == 0
    assert run("query", "ASK { GRAPH <urn:g> { <urn:b> <urn:p> 3 } }")[0] == 1


def test_an_ontology_is_unloaded_by_what_the_load_printed(run: Run, tmp_path: Path) -> None:
    (tmp_path / "own.ttl").write_text(
        "<urn:own> a <http://www.w3.org/2002/07/owl#Ontology> . "
        "<urn:own#C> a <http://www.w3.org/2002/07/owl#Class> ."
    )
    _, _, err = run("load", str(tmp_path / "own.ttl"))
    assert "urn:own" in run("ontology", "list")[1]
    assert _undo(run, err)[0] == 0
    assert "urn:own" not in run("ontology", "list")[1]
    run("load", str(tmp_path / "own.ttl"))
    assert _undo(run, run("ontology", "unload", "urn:own")[2])[0] == 0
    assert "urn:own" in run("ontology", "list")[1]


def test_rules_are_undone_by_what_was_printed(run: Run, tmp_path: Path) -> None:
    rule = tmp_path / "linked.rq"
    rule.write_text("CONSTRUCT { ?a <urn:q> ?b } WHERE { ?a <urn:p> ?b }")
    added = run("rules", "add", str(rule))[2]
    assert run("query", "ASK { <urn:a> <urn:q> 1 }")[0] == 0
    rule.write_text("CONSTRUCT { ?a <urn:r> ?b } WHERE { ?a <urn:p> ?b }")
    replaced = run("rules", "add", str(rule), "--replace")[2]
    assert run("query", "ASK { <urn:a> <urn:q> 1 }")[0] == 1
    assert _undo(run, replaced)[0] == 0
    assert run("query", "ASK { <urn:a> <urn:q> 1 }")[0] == 0
    assert _undo(run, run("rules", "remove", "linked")[2])[0] == 0
    assert run("query", "ASK { <urn:a> <urn:q> 1 }")[0] == 0
    assert _undo(run, added)[0] == 0
    assert run("rules", "list")[0] == 1


def test_tokens_are_undone_by_what_was_printed(run: Run) -> None:
    def state() -> str:
        return run("token", "list")[1]

    _, _, created = run("token", "create", "--robot", "nao-2")
    before = state()
    id = before.split()[0]
    undone = run("token", "expire", id, "12h")[2]
    first = state()
    assert first != before
    assert _undo(run, run("token", "expire", id, "30d")[2])[0] == 0
    assert state() == first
    assert _undo(run, undone)[0] == 0
    assert state() == before
    assert _undo(run, created)[0] == 0
    assert "revoked" in state()


def test_an_update_is_undone_with_what_followed_from_it(run: Run) -> None:
    mug = f"PREFIX rt: <{ontology.NS}> INSERT DATA {{ <urn:mug> a rt:Mug }}"
    _, _, err = run("update", mug)
    assert run("query", "ASK { <urn:mug> a rt:Container }")[0] == 0
    code, out, again = _undo(run, err)
    assert (code, out.split()[1:4]) == (0, ["is", "undone", "by"])
    assert run("query", "ASK { <urn:mug> a rt:Container }")[0] == 1
    assert _undo(run, again)[0] == 0
    assert run("query", "ASK { <urn:mug> a rt:Container }")[0] == 0


def test_what_later_commits_changed_or_built_on_is_undone_last(run: Run) -> None:
    mug = f"PREFIX rt: <{ontology.NS}> INSERT DATA {{ <urn:mug> a rt:Mug }}"
    first = run("update", mug)[2]
    later = run("update", "INSERT DATA { <urn:shelf> <urn:holds> <urn:mug> }")[2]
    code, _, err = _undo(run, first)
    assert code == 3
    assert "later statements refer to <urn:mug>" in err
    assert _undo(run, later)[0] == 0
    assert _undo(run, first)[0] == 0
    code, _, err = _undo(run, first)
    assert code == 3
    assert "is already undone" in err


def test_only_commits_are_undone_that_there_are_and_that_may_be(run: Run) -> None:
    assert "there is no commit c-00099" in run("undo", "99")[2]
    assert "comes with RTASK" in run("undo", "1")[2]
    code, _, err = run("undo", "yesterday")
    assert code == 2
    assert "is not a commit" in err
    seq = json.loads(run("update", "INSERT DATA { <urn:c> <urn:p> 1 }", "--json")[1])["seq"]
    code, _, err = run("undo", str(seq), "--agent", "nao-2")
    assert code == 3
    assert "may not write" in err
    (done,) = json.loads(run("undo", f"c-{seq:05d}", "--json")[1])
    assert (done["undone"], done["removed"]) == (f"c-{seq:05d}", 1)


def test_an_adopted_proposal_is_undone_by_what_was_printed(run: Run, tmp_path: Path) -> None:
    new = Quad(iri("urn:new"), iri("urn:p"), Literal("1"), iri("urn:lab/graph/shared"))
    with rtask.open(tmp_path / "kb") as kb:
        number = kb.propose([new], author="nao-1").number
    _, _, err = run("proposals", "adopt", str(number))
    assert run("query", "ASK { <urn:new> ?p ?o }")[0] == 0
    assert _undo(run, err)[0] == 0
    assert run("query", "ASK { <urn:new> ?p ?o }")[0] == 1
