"""Branches: what is written in one stays there until it is merged, and then fits or is refused."""

from __future__ import annotations

import datetime as dt
import random
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

import rtask
from rtask.errors import (
    ConflictError,
    ForbiddenError,
    InconsistentError,
    QueueFullError,
    StoreFormatError,
    TooMuchFollowsError,
    UnknownTermError,
    UnsupportedError,
    UsageError,
)
from rtask.kb.branches.record import MAX_OPEN, MAX_OPEN_EACH
from rtask.kb.commit.access import Access
from rtask.kb.commit.budget import ReasoningLimits
from rtask.kb.commit.commit import Request
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Quad, TripleKey, iri
from tests.commands import run_program
from tests.rtask.kb.branches.conftest import holds, inferred, write


def test_what_is_written_in_a_branch_and_follows_there_stays_there(kb: KnowledgeBase) -> None:
    with kb.branch("tuesday") as branch:
        commit = branch.graph.update("INSERT DATA { <urn:c1> a <urn:Cup> }")
        assert commit.derived > 0
        assert holds(branch.graph, "<urn:c1> a <urn:Vessel>")
        assert branch.graph.query("ASK { <urn:c1> a <urn:Thing> }", timeout_s=10.0)
        assert not holds(kb, "<urn:c1> ?p ?o")
        write(kb, "INSERT DATA { <urn:c2> a <urn:Cup> }")
        assert not holds(branch.graph, "<urn:c2> ?p ?o")


def test_a_withdrawal_in_a_branch_takes_what_followed_along(kb: KnowledgeBase) -> None:
    with kb.branch() as branch:
        write(branch.graph, "DELETE DATA { GRAPH <urn:lab/graph/shared> { <urn:c0> a <urn:Cup> } }")
        assert not holds(branch.graph, "<urn:c0> a <urn:Vessel>")
        assert holds(kb, "<urn:c0> a <urn:Vessel>")
    assert kb.branches() == []


@pytest.mark.slow
def test_what_follows_in_a_branch_is_what_a_closure_of_its_own_holds(kb: KnowledgeBase) -> None:
    """Random commits on both sides: what the branch holds as derived follows from its own."""
    draw = random.Random(37)
    names = [f"<urn:x{number}>" for number in range(6)]

    def statement() -> str:
        kind = draw.randrange(3)
        if kind == 0:
            return f"{draw.choice(names)} a {draw.choice(['<urn:Cup>', '<urn:Vessel>'])}"
        return f"{draw.choice(names)} {['', '<urn:in>', '<urn:on>'][kind]} {draw.choice(names)}"

    with kb.branch("both") as branch:
        for step in range(60):
            target = draw.choice([kb, branch.graph])
            verb = draw.choice(["INSERT", "INSERT", "DELETE"])
            body = " . ".join(statement() for _ in range(draw.randint(1, 3)))
            write(target, f"{verb} DATA {{ GRAPH <urn:lab/graph/shared> {{ {body} }} }}")
            if step == 30:
                write(kb, "DELETE WHERE { GRAPH <urn:lab/onto> { <urn:on> rdfs:domain ?c } }")
            if step % 6 == 0:
                assert [f for f in branch.graph.verify() if f.severity == "error"] == []
        expected = {str(q) for q in branch.graph.match(graph="urn:lab/graph/shared")}
        derived = inferred(branch.graph)
        others = {str(q) for q in kb.match(graph="urn:lab/graph/shared")}
    assert len(derived) > 10
    assert expected != others
    assert [f for f in kb.verify() if f.severity == "error"] == []


def test_a_commit_looks_at_itself_and_not_at_what_the_branch_held_before(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Triples of the store that are looked up for reasoning, after 2 and after 600 others."""
    asked: list[TripleKey] = []
    held = Inference._holds

    def counted(self: Inference, triple: TripleKey) -> bool:
        asked.append(triple)
        return held(self, triple)

    monkeypatch.setattr(Inference, "_holds", counted)
    looked = []
    with kb.branch("grows") as branch:
        for number in range(1, 5):
            size = 300 if number > 2 else 1
            body = " . ".join(f"<urn:c{number}x{k}> a <urn:Cup>" for k in range(size))
            write(branch.graph, f"INSERT DATA {{ {body} }}")
            write(kb, f"INSERT DATA {{ <urn:t{number}> a <urn:Cup> }}")
            asked.clear()
            commit = branch.graph.update(f"INSERT DATA {{ <urn:d{number}> a <urn:Cup> }}")
            assert commit.derived >= 2
            looked.append(len(asked))
        assert [f for f in branch.graph.verify() if f.severity == "error"] == []
    assert looked == [0, 0, 0, 0]


def test_a_branch_goes_on_after_rules_of_its_trunk_have_changed(kb: KnowledgeBase) -> None:
    with kb.branch("goes-on") as branch:
        write(branch.graph, "INSERT DATA { <urn:c1> a <urn:Cup> }")
        kb.add_rules("# rule: tea\nCONSTRUCT { ?x <urn:holds> <urn:tea> } WHERE { ?x a <urn:Cup> }")
        write(branch.graph, "INSERT DATA { <urn:c2> a <urn:Cup> }")
        assert holds(branch.graph, "<urn:c1> <urn:holds> <urn:tea>")
        assert holds(branch.graph, "<urn:c2> <urn:holds> <urn:tea>")
        assert branch.graph.explain("urn:c2", "urn:holds", iri("urn:tea")).holds


def test_merging_makes_one_commit_from_which_the_same_follows(kb: KnowledgeBase) -> None:
    branch = kb.branch("tuesday", agent="nao-1")
    write(branch.graph, "INSERT DATA { <urn:c1> a <urn:Cup> }", agent="nao-1")
    write(branch.graph, "INSERT DATA { <urn:c1> <urn:in> <urn:b1> . <urn:b1> <urn:in> <urn:r1> }")
    write(branch.graph, "DELETE WHERE { GRAPH ?g { <urn:c0> <urn:mass> ?m } }")
    derived = inferred(branch.graph)
    before = kb.seq
    compared = branch.compare()
    assert (len(compared.added), len(compared.removed), compared.commits) == (3, 1, 3)
    assert compared.conflicts == ()
    assert kb.seq == before  # comparing stores nothing
    commit = branch.merge()
    assert (commit.seq, commit.added, commit.removed) == (before + 1, 3, 1)
    assert commit.derived == compared.derived
    assert inferred(kb) == derived
    assert kb.match("urn:c1", graph="urn:lab/graph/agent/nao-1")
    assert kb.branches() == []
    assert "branch tuesday of nao-1, 3 commits" in str(kb.history(start=None)[-1].note)
    assert [f for f in kb.verify() if f.severity == "error"] == []


def test_a_branch_without_changes_merges_into_nothing(kb: KnowledgeBase) -> None:
    branch = kb.branch("idle")
    assert branch.merge().seq == kb.seq
    assert kb.branches() == []


def test_two_values_of_a_functional_property_are_a_conflict(kb: KnowledgeBase) -> None:
    branch = kb.branch("weighed")
    change = (
        "DELETE WHERE {{ GRAPH ?g {{ <urn:c0> <urn:mass> ?m }} }} ; "
        "INSERT DATA {{ <urn:c0> <urn:mass> {} }}"
    )
    write(branch.graph, change.format("0.5e0"))
    assert branch.compare().conflicts == ()
    write(kb, change.format("0.7e0"))
    [conflict] = [c for c in branch.compare().conflicts if c.kind == "value"]
    assert conflict.subject == "urn:c0"
    assert "5" in conflict.branch[0]
    assert "7" in conflict.trunk[0]
    with pytest.raises(ConflictError, match="nothing was merged") as refused:
        branch.merge()
    assert [c["kind"] for c in refused.value.details["conflicts"]] == ["value"]
    assert holds(kb, "<urn:c0> <urn:mass> 0.7e0")
    # The branch stays, so that it can be made to fit.
    write(branch.graph, change.format("0.7e0"))
    branch.merge()
    assert not holds(kb, "<urn:c0> <urn:mass> 0.5e0")


def test_conflicts_that_were_not_looked_for_are_announced(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    branch = kb.branch("many")
    values = "INSERT DATA {{ <urn:c1> <urn:mass> {0} . <urn:c2> <urn:mass> {0} }}"
    write(branch.graph, values.format("0.5e0"))
    write(kb, values.format("0.7e0"))
    assert [c.kind for c in branch.compare().conflicts][:2] == ["value", "value"]
    monkeypatch.setattr("rtask.kb.branches.comparison.MAX_CONFLICTS", 1)
    assert [c.kind for c in branch.compare().conflicts][:2] == ["value", "more"]
    branch.drop()


def test_the_same_change_on_both_sides_is_no_conflict(kb: KnowledgeBase) -> None:
    branch = kb.branch("same")
    for graph in (kb, branch.graph):
        write(graph, "INSERT DATA { <urn:c1> <urn:mass> 0.5e0 }")
    assert branch.compare().conflicts == ()
    assert branch.merge().added == 0


def test_a_thing_put_somewhere_on_both_sides_is_a_conflict(kb: KnowledgeBase) -> None:
    branch = kb.branch("moved")
    place = (
        "INSERT DATA {{ <urn:p{0}> a rt:Placement ; rt:placementOf <urn:c0> ; "
        "rt:placedOn <urn:t{0}> }}"
    )
    write(branch.graph, place.format(1))
    write(kb, place.format(2))
    [conflict] = branch.compare().conflicts
    assert (conflict.kind, conflict.subject) == ("place", "urn:c0")
    write(kb, "INSERT DATA { <urn:p2> time:hasEnd <urn:p2/end> }")
    assert branch.compare().conflicts == ()
    branch.drop()


def test_what_the_trunk_withdrew_is_not_built_on(kb: KnowledgeBase) -> None:
    branch = kb.branch("late")
    write(branch.graph, "INSERT DATA { <urn:c0> <urn:on> <urn:t1> }")
    write(kb, "DELETE WHERE { GRAPH <urn:lab/graph/shared> { <urn:c0> ?p ?o } }")
    [conflict] = branch.compare().conflicts
    assert (conflict.kind, conflict.subject) == ("withdrawn", "urn:c0")
    assert len(conflict.branch) == 1


def test_a_contradiction_of_both_is_named_with_its_cause(kb: KnowledgeBase) -> None:
    branch = kb.branch("clash")
    write(branch.graph, "INSERT DATA { <urn:c1> a <urn:Cup> }")
    write(kb, "INSERT DATA { <urn:c1> a <urn:Box> }")
    compared = branch.compare()
    assert {conflict.kind for conflict in compared.conflicts} == {"contradiction"}
    assert any("urn:c1" in c.message for c in compared.conflicts)
    assert compared.derived is None
    with pytest.raises(InconsistentError, match="urn:c1"):
        branch.merge()
    assert [record.name for record in kb.branches()] == ["clash"]


def test_a_contradiction_in_the_branch_is_refused_there(kb: KnowledgeBase) -> None:
    with kb.branch() as branch:
        with pytest.raises(InconsistentError, match="urn:c0"):
            write(branch.graph, "INSERT DATA { <urn:c0> a <urn:Box> }")
        assert not holds(branch.graph, "<urn:c0> a <urn:Box>")


def test_what_the_trunk_repaired_since_contradicts_nothing_in_the_branch(kb: KnowledgeBase) -> None:
    write(kb, "INSERT DATA { <urn:c5> a <urn:Box> }")
    with kb.branch() as branch:
        write(kb, "DELETE WHERE { GRAPH <urn:lab/graph/shared> { <urn:c5> ?p ?o } }")
        write(kb, "INSERT DATA { <urn:c5> a <urn:Cup> }")
        write(branch.graph, "INSERT DATA { <urn:c5> <urn:on> <urn:t1> }")
        with pytest.raises(InconsistentError):
            write(branch.graph, "INSERT DATA { <urn:c5> a <urn:Cup> }")


def test_more_may_not_follow_in_a_branch_than_on_the_trunk(kb: KnowledgeBase) -> None:
    chain = " . ".join(f"<urn:n{i}> <urn:in> <urn:n{i + 1}>" for i in range(60))
    limits = UpdateLimits(30.0, reasoning=ReasoningLimits(derived=50, derived_each=1))
    with kb.branch() as branch:
        for graph in (kb, branch.graph):
            with pytest.raises(TooMuchFollowsError):
                write(graph, f"INSERT DATA {{ {chain} }}", agent="nao-1", limits=limits)


def test_a_branch_begins_at_an_earlier_commit(kb: KnowledgeBase) -> None:
    at = kb.seq
    write(kb, "INSERT DATA { <urn:c1> a <urn:Cup> . <urn:c0> a <urn:Vessel> }")
    with kb.branch("before", at=at) as branch:
        assert branch.base == at
        assert not holds(branch.graph, "<urn:c1> ?p ?o")
        write(branch.graph, "INSERT DATA { <urn:c2> a <urn:Cup> }")
        assert [f for f in branch.graph.verify() if f.severity == "error"] == []
        assert branch.compare().trunk_commits == 1
        branch.merge()
    assert holds(kb, "<urn:c1> a <urn:Vessel> . <urn:c2> a <urn:Vessel>")
    with pytest.raises(UsageError, match="no commit 99"):
        kb.branch("never", at=99)


def test_rights_in_a_branch_are_those_on_the_trunk(kb: KnowledgeBase) -> None:
    with pytest.raises(ForbiddenError):
        kb.branch("r", access=Access("guest", "reader"))
    branch = kb.branch("mine", agent="nao-1")
    with pytest.raises(ForbiddenError):
        write(
            branch.graph,
            "INSERT DATA { GRAPH <urn:lab/graph/agent/nao-2> { <urn:a> <urn:b> 1 } }",
            agent="nao-1",
        )
    write(branch.graph, "INSERT DATA { <urn:c1> a <urn:Cup> }", agent="nao-1")
    with pytest.raises(ForbiddenError, match="of nao-1"):
        branch.drop(agent="nao-2")
    with pytest.raises(ForbiddenError):
        branch.merge(agent="nao-2")
    assert [c.kind for c in branch.compare(agent="nao-2").conflicts] == ["refused"]
    assert [record.author for record in kb.branches()] == ["nao-1"]
    branch.merge(agent="nao-1")
    assert holds(kb, "<urn:c1> a <urn:Vessel>")


def test_as_many_branches_as_may_be_and_no_more(kb: KnowledgeBase) -> None:
    for number in range(MAX_OPEN):
        kb.branch(f"b{number}").close()
    with pytest.raises(QueueFullError, match="'b0'"):
        kb.branch("more")
    kb.drop_branch("b3")
    kb.branch("more")
    with pytest.raises(ConflictError, match="'more' already"):
        kb.branch("more")
    with pytest.raises(UnknownTermError, match="b3"):
        kb.open_branch("b3")
    with pytest.raises(UsageError, match="no name"):
        kb.branch("../x")


def test_no_robot_takes_the_branches_of_the_others(kb: KnowledgeBase) -> None:
    first, second = (Access(f"nao-{number}", "robot") for number in (1, 2))
    for number in range(MAX_OPEN_EACH):
        kb.branch(f"b{number}", access=first).close()
    with pytest.raises(QueueFullError, match=r"nao-1 has 4 branches open.*'b0'"):
        kb.branch("more", access=first)
    kb.branch("other", access=second).close()
    kb.drop_branch("b2", access=first)
    kb.branch("more", access=first)


def test_a_branch_expires(kb: KnowledgeBase) -> None:
    branch = kb.branch("short", lifetime=dt.timedelta(hours=1))
    folder = branch.graph.folder
    assert folder is not None
    kb.branch("long", lifetime=dt.timedelta(days=9))
    now = dt.datetime.now(dt.UTC)
    kb.branch_register.clock = lambda: now + dt.timedelta(hours=2)
    assert [record.name for record in kb.branches()] == ["long"]
    assert not folder.exists()
    kb.branch_register.clock = lambda: now + dt.timedelta(hours=25)
    assert kb.branches() == []


def test_a_branch_costs_no_copy(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        for number in range(20_000):
            tx.add(f"urn:n{number // 10}", f"urn:p{number % 10}", number)
    kb.checkpoint()
    with kb.branch() as branch:
        assert branch.graph.folder is not None
        files = [path.stat() for path in branch.graph.folder.rglob("*") if path.is_file()]
        shared = sum(file.st_size for file in files if file.st_nlink > 1)
        own = sum(file.st_size for file in files if file.st_nlink == 1)
        assert branch.graph.query("SELECT (COUNT(*) AS ?n) { ?s <urn:p3> ?o }")
    assert shared > own
    assert own <= 1_000_000


def test_a_branch_is_there_after_opening_again(kb: KnowledgeBase, tmp_path: Path) -> None:
    branch = kb.branch("kept", note="for tomorrow")
    write(branch.graph, "INSERT DATA { <urn:c1> a <urn:Cup> }")
    kb.close()
    with rtask.open(tmp_path / "kb", ontologies=False) as again:
        [record] = again.branches()
        assert (record.name, record.note) == ("kept", "for tomorrow")
        opened = again.open_branch("kept")
        write(opened.graph, "INSERT DATA { <urn:c2> a <urn:Cup> }")
        assert holds(opened.graph, "<urn:c1> a <urn:Vessel> . <urn:c2> a <urn:Vessel>")
        assert opened.compare().commits == 2
        opened.merge()
        assert holds(again, "<urn:c1> a <urn:Vessel>")


@pytest.mark.slow
def test_a_killed_process_loses_nothing_of_a_branch(kb: KnowledgeBase, tmp_path: Path) -> None:
    kb.close()
    script = (
        "import os, signal, sys, rtask\n"
        "kb = rtask.open(sys.argv[1], ontologies=False)\n"
        "branch = kb.branch('killed')\n"
        "branch.graph.update('INSERT DATA { <urn:c1> a <urn:Cup> }')\n"
        "kb.update('INSERT DATA { <urn:c2> a <urn:Cup> }')\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = run_program(script, str(tmp_path / "kb"))
    assert done.returncode == -signal.SIGKILL
    with rtask.open(tmp_path / "kb", ontologies=False) as again:
        branch = again.open_branch("killed")
        assert holds(branch.graph, "<urn:c1> a <urn:Vessel>")
        assert not holds(branch.graph, "<urn:c2> ?p ?o")
        branch.merge()
        assert holds(again, "<urn:c1> a <urn:Vessel> . <urn:c2> a <urn:Vessel>")
        assert [f for f in again.verify() if f.severity == "error"] == []


def test_a_bulk_load_of_the_trunk_ends_what_a_branch_can_follow(
    kb: KnowledgeBase,
) -> None:
    branch = kb.branch("loaded")
    graph = iri("urn:lab/graph/import/large")
    quads = [Quad(iri(f"urn:n{i}"), iri("urn:p"), iri(f"urn:m{i}"), graph) for i in range(20)]
    kb.bulk_add(quads, graph, Request(kb.access()))
    assert not holds(branch.graph, "<urn:n7> ?p ?o")
    with pytest.raises(UnsupportedError, match="loaded in bulk"):
        write(branch.graph, "INSERT DATA { <urn:c1> a <urn:Cup> }")
    with pytest.raises(UnsupportedError, match="loaded in bulk"):
        branch.compare()


def test_blobs_of_a_branch_are_kept(kb: KnowledgeBase) -> None:
    branch = kb.branch("photo")
    with branch.graph.transaction() as tx:
        named = tx.blob(b"of the branch", "text/plain")
    idle = kb.blobs.put(b"of nobody", "text/plain").iri
    with pytest.raises(UnsupportedError):
        branch.graph.collect_blobs(0.0)
    kb.collect_blobs(0.0)
    assert kb.blobs.has(named)
    assert not kb.blobs.has(idle)
    branch.merge()
    assert kb.blobs.has(named)


def test_no_blob_goes_while_a_branch_cannot_be_read(
    kb: KnowledgeBase, caplog: pytest.LogCaptureFixture
) -> None:
    with kb.branch("torn") as branch, branch.graph.transaction() as tx:
        named = tx.blob(b"of the branch", "text/plain")
    kb.branch("whole").close()
    assert kb.folder is not None
    (kb.folder / "branches" / "torn" / "branch.json").write_text("{", "utf-8")
    assert [record.name for record in kb.branches()] == ["whole"]
    assert "torn" in caplog.text
    with pytest.raises(StoreFormatError, match="torn"):
        kb.collect_blobs(0.0)
    assert kb.blobs.has(named)


def _change_rules(graph: KnowledgeBase) -> None:
    graph.add_rules("# rule: r\nCONSTRUCT { ?x <urn:q> ?y } WHERE { ?x <urn:p> ?y }")


def _branch_again(graph: KnowledgeBase) -> None:
    graph.branch("second")


def _load_in_bulk(graph: KnowledgeBase) -> None:
    graph.bulk_add([], iri("urn:g"), Request(graph.access()))


@pytest.mark.parametrize("change", [_change_rules, _branch_again, _load_in_bulk])
def test_what_a_branch_does_not_take_is_refused_with_words(
    kb: KnowledgeBase, change: Callable[[KnowledgeBase], None]
) -> None:
    with kb.branch() as branch, pytest.raises(UnsupportedError, match="branch"):
        change(branch.graph)


def test_a_graph_in_memory_has_no_branches() -> None:
    with (
        rtask.open(":memory:", ontologies=False, reason=False) as kb,
        pytest.raises(UnsupportedError, match="folder"),
    ):
        kb.branch("x")


def test_a_backup_holds_no_branches(kb: KnowledgeBase, tmp_path: Path) -> None:
    kb.branch("here")
    kb.backup(tmp_path / "backup")
    assert not (tmp_path / "backup" / "branches").exists()


def test_an_ontology_of_a_branch_is_one_after_merging(kb: KnowledgeBase) -> None:
    branch = kb.branch("terms")
    branch.graph.load(
        b"@prefix owl: <http://www.w3.org/2002/07/owl#> . "
        b"<urn:lab/new> a owl:Ontology . <urn:New> a owl:Class .",
        format="turtle",
        graph="urn:lab/new",
    )
    branch.merge()
    assert kb.catalogue.is_ontology(iri("urn:lab/new"))
