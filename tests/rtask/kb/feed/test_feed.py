"""The change feed: every commit once, in order, also to those who were away."""

from __future__ import annotations

import asyncio
import datetime as dt
import random
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import rtask
from rtask.errors import (
    ClosedError,
    EpochChangedError,
    GoneError,
    Lagged,
    QuerySyntaxError,
    QueryTimeout,
    TooLargeError,
    UsageError,
)
from rtask.kb.commit.commit import Change, Commit
from rtask.kb.feed.live_queries import LiveQueries, predicates_of
from rtask.kb.maintenance.backup import restore
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Quad, iri, literal
from rtask.sparql.results import Solutions

_RT = "https://w3id.org/rtask-kg/ns#"
_ENOUGH_S = 60.0


@pytest.fixture(params=["memory", "folder"])
def kb(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[KnowledgeBase]:
    target = ":memory:" if request.param == "memory" else tmp_path / "kb"
    with rtask.open(target, reason=False, ontologies=False, flush="os") as opened:
        yield opened


def _insert(kb: KnowledgeBase, number: int, predicate: str = "urn:p") -> int:
    with kb.transaction() as tx:
        tx.add(f"urn:{number}", predicate, number)
    return tx.commit.seq


def _numbers(changes: list[Change]) -> list[int]:
    return [change.commit.seq for change in changes]


def test_commits_come_in_order_with_their_statements(kb: KnowledgeBase) -> None:
    with kb.subscribe() as changes:
        seqs = [_insert(kb, number) for number in range(5)]
        kb.update("DELETE WHERE { <urn:1> <urn:p> 1 }")
        found = changes.drain()
    assert _numbers(found) == [*seqs, seqs[-1] + 1]
    assert [str(change.added[0].subject) for change in found[:5]] == [
        f"<urn:{n}>" for n in range(5)
    ]
    assert str(found[5].removed[0].subject) == "<urn:1>"
    assert found[5].added == ()


def test_only_what_was_asked_for_comes(kb: KnowledgeBase) -> None:
    wanted = {
        "subject": kb.subscribe(subject="urn:1"),
        "predicate": kb.subscribe(predicate="urn:q"),
        "value": kb.subscribe(value=2),
        "graph": kb.subscribe(graph=kb.graphs.agent("nao-1")),
        "both": kb.subscribe(subject="urn:1", predicate="urn:q"),
        "none": kb.subscribe(subject="urn:nobody"),
    }
    kb.update("INSERT DATA { <urn:1> <urn:p> 2 ; <urn:q> 3 . <urn:2> <urn:q> 2 }")
    kb.update("INSERT DATA { <urn:3> <urn:r> 4 }", agent="nao-1")
    found = {
        name: [len(change.added) for change in changes.drain()] for name, changes in wanted.items()
    }
    assert found == {
        "subject": [2], "predicate": [2], "value": [2], "graph": [1], "both": [1], "none": []
    }  # fmt: skip


@pytest.mark.slow
def test_instances_of_a_class_are_followed_derived_ones_too() -> None:
    with rtask.open(":memory:") as kb:
        changes = kb.subscribe(cls=_RT + "Container")
        asserted = kb.subscribe(cls=_RT + "Container", inferred=False)
        kb.update(f"INSERT DATA {{ <urn:mug> a <{_RT}Mug> . <urn:other> <urn:p> 1 }}")
        [change] = changes.drain()
        assert {str(quad.subject) for quad in change.added} == {"<urn:mug>"}
        assert iri(_RT + "Container") in {quad.object for quad in change.inferred_added}
        assert asserted.drain()[0].inferred_added == ()
        kb.update("DELETE WHERE { <urn:mug> a ?c }")
        [change] = changes.drain()  # what is no longer an instance was one before
        assert {str(quad.subject) for quad in change.removed} == {"<urn:mug>"}


def test_once_ends_after_the_first(kb: KnowledgeBase) -> None:
    changes = kb.subscribe(predicate="urn:q", once=True)
    for number in range(3):
        _insert(kb, number, "urn:q")
    assert len(list(changes)) == 1
    assert changes.closed


def test_who_was_away_catches_up_without_gap_or_repetition(kb: KnowledgeBase) -> None:
    first = _insert(kb, 0)
    for number in range(1, 10):
        _insert(kb, number)
    changes = kb.subscribe(since=first)
    later = [_insert(kb, number) for number in range(10, 15)]
    assert _numbers(changes.drain()) == list(range(first + 1, later[-1] + 1))
    again = kb.subscribe(since=kb.feed.position(later[-2]))
    assert _numbers(again.drain()) == [later[-1]]
    assert kb.subscribe(since=kb.seq).drain() == []


@pytest.mark.slow
def test_the_past_is_told_as_the_present_was(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", flush="os") as kb:
        start = kb.seq
        changes = kb.subscribe()
        kb.update(f"INSERT DATA {{ <urn:mug> a <{_RT}Mug> ; <urn:says> 'a\\nb'@en, [] }}", "nao-1")
        kb.update("DELETE WHERE { <urn:mug> <urn:says> ?x }", "nao-1", note="hush")
        live = changes.drain()
        past = kb.subscribe(since=start).drain()
    assert len(live) == 2
    for one, other in zip(live, past, strict=True):
        assert set(one.added) == set(other.added)
        assert set(one.removed) == set(other.removed)
        assert set(one.inferred_added) == set(other.inferred_added)
        assert (one.agent, one.note, one.commit) == (other.agent, other.note, other.commit)


def test_commits_of_many_threads_arrive_once_and_in_order(kb: KnowledgeBase) -> None:
    start = kb.seq
    found: list[int] = []
    changes = kb.subscribe(since=start)

    def follow() -> None:
        found.extend(change.commit.seq for change in changes)

    reader = threading.Thread(target=follow)
    reader.start()
    writers = [threading.Thread(target=lambda: [_insert(kb, n) for n in range(20)]) for _ in "123"]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    while not found or found[-1] < kb.seq:
        reader.join(timeout=0.01)
    changes.close()
    reader.join()
    assert found == list(range(start + 1, kb.seq + 1))


def test_a_slow_subscriber_is_told_and_can_resume(kb: KnowledgeBase) -> None:
    changes = kb.subscribe(size=3)
    for number in range(8):
        _insert(kb, number)
    read = changes.drain()
    assert len(read) == 3
    with pytest.raises(Lagged) as caught:
        changes.get(0.0)
    resumed = kb.subscribe(since=caught.value.details["since"])
    assert _numbers(read + resumed.drain()) == list(range(read[0].commit.seq, kb.seq + 1))


def test_what_is_no_longer_kept_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rtask.kb.feed.feed._REMEMBERED", 5)
    with rtask.open(":memory:", reason=False, ontologies=False) as kb:
        for number in range(10):
            _insert(kb, number)
        assert len(kb.subscribe(since=kb.seq - 5).drain()) == 5
        with pytest.raises(GoneError) as caught:
            kb.subscribe(since=1)
        assert caught.value.details["oldest"] == kb.seq - 4
        with pytest.raises(UsageError, match="no commit"):
            kb.subscribe(since=kb.seq + 1)
    monkeypatch.setattr("rtask.kb.durability.journal.SEGMENT_BYTES", 1_000)
    monkeypatch.setattr("rtask.kb.durability.journal._RETAINED_BYTES", 2_000)
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False, flush="os") as kb:
        for number in range(10):
            _insert(kb, number)
        kb.checkpoint()
        with pytest.raises(GoneError):
            kb.subscribe(since=0)
        assert _numbers(kb.subscribe(since=kb.seq - 1).drain()) == [kb.seq]


def test_a_restored_backup_numbers_anew(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        _insert(kb, 1)
        position = kb.feed.position(kb.seq)
        kb.backup(tmp_path / "copy")
    restore(tmp_path / "copy", tmp_path / "restored")
    with (
        rtask.open(tmp_path / "restored", reason=False, ontologies=False) as kb,
        pytest.raises(EpochChangedError),
    ):
        kb.subscribe(since=position)


def test_an_event_loop_can_follow(kb: KnowledgeBase) -> None:
    start = kb.seq
    _insert(kb, 0)

    async def follow() -> list[int]:
        changes = kb.subscribe(since=start)
        found = []
        async for change in changes:
            found.append(change.commit.seq)
            if len(found) < 4:
                await asyncio.to_thread(_insert, kb, len(found))
            else:
                changes.close()
        return found

    found = asyncio.run(asyncio.wait_for(follow(), _ENOUGH_S))
    assert found == list(range(start + 1, start + 5))


def test_closing_ends_subscriptions(kb: KnowledgeBase) -> None:
    changes = kb.subscribe()
    ended: list[bool] = []
    reader = threading.Thread(target=lambda: ended.append(list(changes) == []))
    reader.start()
    kb.close()
    reader.join(timeout=_ENOUGH_S)
    assert ended == [True]
    with pytest.raises(ClosedError):
        changes.get(0.0)


def test_a_closed_graph_takes_no_subscription(kb: KnowledgeBase) -> None:
    kb.close()
    with pytest.raises(ClosedError, match="is closed"):
        kb.subscribe()


@pytest.mark.parametrize("since", ["²", "9" * 5_000, "one", -1])
def test_what_is_no_number_of_a_commit_is_refused(kb: KnowledgeBase, since: int | str) -> None:
    with pytest.raises(UsageError, match="expected a commit's number"):
        kb.subscribe(since=since)


def test_the_past_can_be_read_while_others_commit() -> None:
    """A commit in the midst of reading those kept in memory, as another thread may make it."""

    class Interrupted:
        @property
        def seq(self) -> int:
            _insert(kb, 100 + len(inserted))
            inserted.append(kb.seq)
            return start + 1

    inserted: list[int] = []
    with rtask.open(":memory:", reason=False, ontologies=False) as kb:
        start = kb.seq
        _insert(kb, 0)
        _insert(kb, 1)
        kept = kb.feed._remembered
        place = next(at for at, change in enumerate(kept) if change.commit.seq == start + 1)
        kept[place] = replace(kept[place], commit=Interrupted())  # type: ignore[arg-type] # a stand-in
        assert len(list(kb.feed.changes(start, start + 2))) == 2
        assert inserted


def test_subscribers_see_what_a_replay_of_the_journal_gives(tmp_path: Path) -> None:
    """Applying the feed to nothing gives the graph, whatever was committed (seeded)."""
    chance = random.Random(5)
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False, flush="os") as kb:
        start = kb.seq
        for _ in range(60):
            name, number = chance.randrange(6), chance.randrange(3)
            verb = chance.choice(["INSERT DATA", "INSERT DATA", "DELETE WHERE"])
            term = "?o" if verb == "DELETE WHERE" else str(number)
            kb.update(f"{verb} {{ <urn:{name}> <urn:p> {term} }}")
        state: set[object] = set()
        for change in kb.subscribe(since=start).drain():
            assert state.isdisjoint(change.added)
            assert state.issuperset(change.removed)
            state = (state - set(change.removed)) | set(change.added)
        assert state == set(kb.match(graph=kb.graphs.shared))


def test_a_commit_during_the_first_evaluation_of_a_live_query_is_told_once() -> None:
    """The rows put one after the other add up to the last answer."""
    again = threading.Event()
    answers = iter((1, 2))

    def ask() -> Solutions:
        number = next(answers)
        if number == 1:
            added = (Quad(iri("urn:s"), iri("urn:p"), literal(2)),)
            commit = Commit(2, 1, 0, 0, dt.datetime.now(dt.UTC), None)
            queries.announce(Change(commit, None, None, added, (), (), ()))
            again.wait(0.3)  # as long as another evaluation could overtake this one
        else:
            again.set()
        return Solutions(["o"], [(literal(number),)])

    queries = LiveQueries(lambda: 1, str)
    first = queries.add("SELECT ?o { ?s <urn:q> ?o }", lambda: Solutions(["o"], []))
    rows = queries.add("SELECT ?o { ?s <urn:p> ?o }", ask)
    told: Counter[object] = Counter()
    while told != Counter([2]):
        change = rows.get(_ENOUGH_S)
        assert change is not None
        told.update(row.value("o") for row in change.added)
        told.subtract(row.value("o") for row in change.removed)
        told = +told
    assert rows.get(0.0) is None
    queries.close()
    assert first.closed


@pytest.mark.slow
def test_rows_of_a_query_are_followed(kb: KnowledgeBase) -> None:
    _insert(kb, 1)
    rows = kb.subscribe_query("SELECT ?s ?o { ?s <urn:p> ?o }", timeout_s=_ENOUGH_S)
    first = rows.get(_ENOUGH_S)
    assert first is not None
    assert [row.value("o") for row in first.added] == [1]
    _insert(kb, 9, "urn:other")  # does not concern it
    kb.update("DELETE { ?s <urn:p> 1 } INSERT { ?s <urn:p> 2 } WHERE { ?s <urn:p> 1 }")
    second = rows.get(_ENOUGH_S)
    assert second is not None
    assert [row.value("o") for row in second.added] == [2]
    assert [row.value("o") for row in second.removed] == [1]
    assert second.seq == kb.seq
    assert rows.get(0.2) is None
    rows.close()


def test_a_standing_query_may_not_grow_without_bound(kb: KnowledgeBase) -> None:
    rows = kb.subscribe_query("SELECT ?o { ?s <urn:p> ?o }", timeout_s=_ENOUGH_S)
    rows.get(_ENOUGH_S)
    with kb.transaction() as tx:
        for number in range(1_001):
            tx.add("urn:s", "urn:p", number)
    with pytest.raises(TooLargeError, match="1000 rows"):
        rows.get(_ENOUGH_S)
    with pytest.raises(TooLargeError):
        kb.subscribe_query("SELECT ?o { ?s <urn:p> ?o }", timeout_s=_ENOUGH_S)
    with pytest.raises(QuerySyntaxError, match="SELECT"):
        kb.subscribe_query("ASK { ?s ?p ?o }")


@pytest.mark.slow
def test_a_standing_query_that_takes_too_long_is_refused(kb: KnowledgeBase) -> None:
    with kb.transaction() as tx:
        for number in range(2_000):
            tx.add("urn:s", "urn:p", number)
    with pytest.raises(QueryTimeout):
        kb.subscribe_query(
            "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }", timeout_s=0.5
        )


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("SELECT ?a ?b { ?a <urn:p> ?b ; <urn:q> 1, ?c . ?b a <urn:C> }", "p q C type"),
        ("PREFIX x: <urn:> SELECT * { ?a x:p/x:q* ?b FILTER(?b > 1) ?c x:r ?d }", "p q r"),
        (
            "SELECT * { ?a (<urn:p>|<urn:q>) ?b . GRAPH ?g { ?b <urn:r> [ <urn:s> ?x ] } }",
            "p q r s",
        ),
        (
            "SELECT * { VALUES ?a { 1 } ?a <urn:p> true OPTIONAL { ?a <urn:q> ?b } } ORDER BY ?b",
            "p q",
        ),
        ("SELECT * { ?a ?p ?b }", None),
        ("SELECT * { ?a !<urn:p> ?b }", None),
        ("SELECT * { ?a <urn:p> 1 ; ?q 2 }", None),
        ("SELECT * { FILTER <urn:f>(1) ?a ?p ?b }", None),
        ("SELECT * { ?a <urn:p> [ ?q 2 ] }", None),
    ],
)
def test_predicates_that_a_query_reads_are_found(text: str, names: str | None) -> None:
    found = predicates_of(text)
    if names is None:
        assert found is None
    else:
        assert found is not None
        assert {p.value.rpartition(":")[2].rpartition("#")[2] for p in found} == set(names.split())
