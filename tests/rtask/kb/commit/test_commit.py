"""Commits: what they record, when they are refused, how they are announced."""

from __future__ import annotations

import datetime as dt
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.cli.doctor import examine_clock
from rtask.errors import (
    ClosedError,
    DataError,
    QuerySyntaxError,
    TooLargeError,
    UsageError,
)
from rtask.kb.commit import commit as commit_module
from rtask.kb.commit.access import Access
from rtask.kb.commit.checks import requirements
from rtask.kb.commit.commit import Change
from rtask.kb.durability.recovery import Checkpoint, boot_id
from rtask.kb.store.embedded import EmbeddedStore
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import BlankNode, NamedNode, Quad, iri, prologue
from tests.processes import end_of_checkpoints

pytestmark = pytest.mark.slow

_PREFIX = prologue({name: ontology.PREFIXES[name] for name in ("rt", "prov", "rdfs")})


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", base="urn:lab/", ontologies=False, reason=False) as opened:
        yield opened


def test_each_commit_leaves_its_activity(kb: KnowledgeBase) -> None:
    before = dt.datetime.now(dt.UTC)
    done = kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", agent="nao-1", note="why")
    [row] = kb.select(
        _PREFIX
        + """SELECT * { GRAPH <urn:lab/graph/provenance> {
            ?activity a rt:WriteActivity, prov:Activity ; rt:commitNumber ?seq ;
                prov:wasAssociatedWith ?agent ; prov:startedAtTime ?started ;
                prov:endedAtTime ?ended ; rt:changedGraph ?graph ; rdfs:comment ?note } }"""
    ).to_dicts()
    assert done.activity is not None
    assert row["activity"] == done.activity.value == "urn:lab/activity/1"
    assert row["seq"] == done.seq == 1
    assert row["agent"] == "urn:lab/robot/nao-1"
    assert row["graph"] == "urn:lab/graph/agent/nao-1"
    assert row["note"] == "why"
    started, ended = (dt.datetime.fromisoformat(str(row[k])) for k in ("started", "ended"))
    assert before <= started <= ended == done.time


def test_the_catalogue_describes_each_graph(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:a> <urn:p> 1, 2 }", agent="nao-1")
    kb.update("INSERT DATA { GRAPH <urn:g> { <urn:a> <urn:p> 1 } }")
    kb.update("DELETE DATA { <urn:a> <urn:p> 1 }", agent="nao-1")
    rows = kb.select(
        _PREFIX
        + """SELECT ?graph ?kind ?owner ?seq ?n { GRAPH <urn:lab/graph/meta> {
            ?graph a ?kind ; rt:commitNumber ?seq ; rt:tripleCount ?n
            OPTIONAL { ?graph rt:graphOwner ?owner } } } ORDER BY ?graph"""
    ).to_dicts()
    assert rows == [
        {"graph": "urn:g", "kind": ontology.NS + "NamedGraph", "owner": None, "seq": 2, "n": 1},
        {
            "graph": "urn:lab/graph/agent/nao-1",
            "kind": ontology.NS + "AgentGraph",
            "owner": "urn:lab/robot/nao-1",
            "seq": 3,
            "n": 1,
        },
    ]
    kb.update("DROP GRAPH <urn:g>")
    assert kb.match("urn:g", graph=kb.graphs.meta) == []
    assert kb.catalogue.revision(NamedNode("urn:g")) is None


def test_nothing_changed_is_no_commit(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    done = kb.update("INSERT DATA { <urn:a> <urn:p> 1 } ; DELETE DATA { <urn:b> <urn:p> 1 }")
    assert (done.seq, done.added, done.removed, done.activity) == (1, 0, 0, None)
    assert kb.seq == 1


def test_literals_that_the_store_normalises_count_once(kb: KnowledgeBase) -> None:
    xsd = "http://www.w3.org/2001/XMLSchema#"
    done = kb.update(f'INSERT DATA {{ <urn:a> <urn:p> 1, 01, "1"^^<{xsd}int> }}')
    assert done.added == 1
    assert kb.update(f'DELETE DATA {{ <urn:a> <urn:p> "01"^^<{xsd}unsignedByte> }}').removed == 1


def test_a_statement_in_two_graphs_counts_once_in_queries(kb: KnowledgeBase) -> None:
    for agent in ("nao-1", "nao-2"):
        kb.update("INSERT DATA { <urn:mug> <urn:mass> 0.3 }", agent=agent)
    count = "SELECT (COUNT(*) AS ?n) { <urn:mug> <urn:mass> ?m }"
    assert kb.select(count)[0].value("n") == 1
    assert len(kb.match("urn:mug")) == 2
    assert kb.stats()["shared"] == 1
    kb.update("DELETE DATA { <urn:mug> <urn:mass> 0.3 }", agent="nao-1")
    assert kb.select(count)[0].value("n") == 1
    kb.update("DELETE DATA { <urn:mug> <urn:mass> 0.3 }", agent="nao-2")
    assert kb.select(count)[0].value("n") == 0


def test_blank_nodes_keep_their_labels_and_can_be_removed(kb: KnowledgeBase) -> None:
    node = BlankNode()
    with kb.transaction() as tx:
        tx.add(node, "urn:p", 1)
    assert kb.match(node) == [Quad(node, iri("urn:p"), kb.match(node)[0].object, kb.graphs.shared)]
    with kb.transaction() as tx:
        tx.remove(node, "urn:p", 1)
        tx.add(node, "urn:p", 2)
    assert [str(q.object) for q in kb.match(node)] == [
        '"2"^^<http://www.w3.org/2001/XMLSchema#integer>'
    ]
    assert kb.verify() == []


def test_one_commit_at_a_wrong_time_does_not_move_those_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The order is that of the numbers; also across a restart."""
    real = dt.datetime

    class Fast(dt.datetime):
        @classmethod
        def now(cls, tz: dt.tzinfo | None = None) -> dt.datetime:  # type: ignore[override]
            return real.now(tz) + dt.timedelta(days=1_000)

    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        first = kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        monkeypatch.setattr("rtask.kb.commit.committer.dt.datetime", Fast)
        wrong = kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
        monkeypatch.undo()
        third = kb.update("INSERT DATA { <urn:a> <urn:p> 3 }")
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        fourth = kb.update("INSERT DATA { <urn:a> <urn:p> 4 }")
        back = [round(entry.clock_back_s / 86_400) for entry in kb.history("urn:a")]
    assert first.time <= third.time <= fourth.time < wrong.time
    assert [c.seq for c in (first, wrong, third, fourth)] == [1, 2, 3, 4]
    assert back == [0, 0, 1_000, 1_000]
    clock = examine_clock(tmp_path)
    assert (clock.state, "at commit 3" in clock.detail) == ("note", True)
    assert "commit 4" not in clock.detail


def test_people_and_robots_are_named_apart(kb: KnowledgeBase) -> None:
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", access=Access("ann", "teacher"))
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", access=Access("nao-1", "anonymous"))
    owners = kb.select(_PREFIX + "SELECT ?o { ?g rt:graphOwner ?o } ORDER BY ?o").to_dicts()
    assert owners == [{"o": "urn:lab/person/ann"}, {"o": "urn:lab/robot/nao-1"}]


def test_writes_inside_a_transaction_go_through_it(kb: KnowledgeBase) -> None:
    with (
        kb.transaction() as tx,
        pytest.raises(UsageError, match="inside a transaction"),
    ):
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    with pytest.raises(ClosedError, match="inside its with block"):
        tx.add("urn:a", "urn:p", 1)


def test_a_commit_beyond_the_limit_is_refused(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert commit_module.MAX_QUADS == 200_000
    request = commit_module.Request(kb.access(), max_quads=2)

    def write(*numbers: int, remove: bool = False) -> None:
        with kb.commit_block(request) as tx:
            for number in numbers:
                (tx.remove if remove else tx.add)("urn:a", "urn:p", number)

    with pytest.raises(TooLargeError, match="adds 3 statements, at most 2 are allowed; load"):
        write(0, 1, 2)
    write(0, 1)
    write(2)
    write(3)
    with pytest.raises(TooLargeError, match="removes 3 statements, at most 2 are allowed; remo"):
        write(0, 1, 2, remove=True)
    write(0, remove=True)
    monkeypatch.setattr(requirements, "MAX_EMPTIED", 2)
    with pytest.raises(TooLargeError, match="removes whole graphs of 3 statements, at most 2 are"):
        write(1, 2, 3, remove=True)
    monkeypatch.setattr(requirements, "MAX_EMPTIED", 3)
    write(1, 2, 3, remove=True)  # nothing is left
    assert not kb.match("urn:a")


def test_errors_of_updates_say_where(kb: KnowledgeBase) -> None:
    with pytest.raises(QuerySyntaxError, match=r"update 2:\d+") as caught:
        kb.update("PREFIX e: <urn:e:>\nINSERT DATA { e:a e:b }")
    assert caught.value.details["line"] == 2
    for text, message in (
        ("INSERT DATA { ?s <urn:p> 1 }", "update 1:"),
        ("DELETE DATA { _:b <urn:p> 1 }", "update 1:"),
        ("CLEAR XYZ", "1:7: expected an IRI"),
        ("PREFIX e <urn:e> CLEAR ALL", "1:8: expected a prefix"),
        ("INSERT DATA { e:a <urn:p> 1 }", "1:15: undeclared prefix 'e:'"),
        ("SELECT * { ?s ?p ?o }", "SELECT begins a query; expected LOAD"),
    ):
        with pytest.raises(QuerySyntaxError, match=message):
            kb.update(text)
    assert kb.seq == 0


def test_graphs_that_exist_or_are_missing_are_errors_and_undo_the_request(
    kb: KnowledgeBase,
) -> None:
    kb.update("CREATE GRAPH <urn:g>")
    with pytest.raises(DataError, match="exists already") as exists:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 } ; CREATE GRAPH <urn:g>")
    assert "exists" in exists.value.details
    with pytest.raises(DataError, match="graph <urn:h> does not exist") as missing:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 } ; DROP GRAPH <urn:h>")
    assert "missing" in missing.value.details
    assert kb.match("urn:a") == []
    kb.update("CREATE SILENT GRAPH <urn:g> ; DROP SILENT GRAPH <urn:h>")


def test_listeners_hear_every_commit_in_order(kb: KnowledgeBase) -> None:
    heard: list[Change] = []

    def deaf(change: Change) -> None:
        raise ValueError("a broken listener")

    stop = kb.on_commit(heard.append)
    kb.on_commit(deaf)

    def write(agent: str) -> None:
        for number in range(20):
            kb.update(f"INSERT DATA {{ <urn:{agent}> <urn:p> {number} }}", agent=agent)

    threads = [threading.Thread(target=write, args=(f"nao-{n}",)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [change.commit.seq for change in heard] == list(range(1, 81))
    first = heard[0]
    assert first.agent in {f"nao-{n}" for n in range(4)}
    assert first.graphs == {kb.graphs.agent(first.agent or "")}
    assert len(first.added) == 1
    stop()
    kb.update("INSERT DATA { <urn:x> <urn:p> 1 }")
    assert len(heard) == 80


def test_a_listener_may_write(kb: KnowledgeBase) -> None:
    def answer(change: Change) -> None:
        if change.agent == "nao-1":
            kb.update("INSERT DATA { <urn:seen> <urn:p> 1 }", agent="nao-2")

    kb.on_commit(answer)
    kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", agent="nao-1")
    assert kb.seq == 2


def test_threads_write_and_read_at_once(tmp_path: Path) -> None:
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        failures: list[BaseException] = []

        def write(agent: str) -> None:
            for number in range(15):
                kb.update(
                    f"INSERT DATA {{ <urn:{agent}> <urn:p> {number} ; <urn:q> {number} }}", agent
                )

        def read() -> None:
            try:
                for _ in range(40):
                    counts = kb.select(
                        "SELECT (COUNT(?p) AS ?a) (COUNT(?q) AS ?b) "
                        "{ { ?s <urn:p> ?p } UNION { ?s <urn:q> ?q } }"
                    )[0]
                    assert counts[0] == counts[1]  # never half of a commit
            except BaseException as error:  # noqa: BLE001 - reported below
                failures.append(error)

        jobs = [threading.Thread(target=write, args=(f"nao-{n}",)) for n in range(4)]
        jobs += [threading.Thread(target=read) for _ in range(2)]
        for job in jobs:
            job.start()
        for job in jobs:
            job.join()
        assert failures == []
        assert kb.seq == 60
        assert kb.verify() == []


def test_commits_go_on_while_a_checkpoint_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, let_go = threading.Event(), threading.Event()
    real = EmbeddedStore.flush

    def slowly(store: EmbeddedStore) -> None:
        if threading.current_thread().name == "rtask-checkpoint":
            begun.set()
            assert let_go.wait(60)
        real(store)

    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        monkeypatch.setattr(EmbeddedStore, "flush", slowly)
        monkeypatch.setattr("rtask.kb.durability.recovery._EVERY_S", 0.0)
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        assert begun.wait(60)
        for number in range(3):
            kb.update(f"INSERT DATA {{ <urn:b> <urn:p> {number} }}")
        assert Checkpoint.load(tmp_path) == Checkpoint(0, clean=False, boot=boot_id())
        let_go.set()
        end_of_checkpoints()
        checkpoint = Checkpoint.load(tmp_path)
        assert checkpoint is not None
        assert checkpoint.seq == 4


def test_a_checkpoint_that_fails_leaves_the_commits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*args: object) -> None:
        raise OSError(28, "No space left on device")

    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        monkeypatch.setattr("rtask.kb.durability.recovery._EVERY_S", 0.0)
        monkeypatch.setattr(Checkpoint, "save", full)
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        end_of_checkpoints()
        monkeypatch.undo()
        kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
    assert "a checkpoint failed" in caplog.text
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        assert len(kb.match("urn:a")) == 2
