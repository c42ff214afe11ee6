"""One change of a robot has a bound, and large ones let small ones go first: others wait little."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

import rtask
from rtask.errors import TooLargeError, UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.transaction import Transaction
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.kb.store.commit_writes import MAX_LATE
from rtask.knowledge_base import KnowledgeBase

BOUND = 20
LARGE = MAX_LATE + 1
ROBOT = Access("nao-1", "robot")
LIMITS = UpdateLimits(60.0)


@pytest.fixture
def kb() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", ontologies=False) as opened:
        opened.writer.committer.max_change = BOUND
        yield opened


def data(count: int, verb: str = "INSERT", first: int = 0) -> str:
    """Return an update of so many statements."""
    lines = " . ".join(f"<urn:s> <urn:p> {n}" for n in range(first, first + count))
    return f"{verb} DATA {{ {lines} }}"


def fill(kb: KnowledgeBase, count: int) -> None:
    """Let the robot have so many statements."""
    for first in range(0, count, BOUND):
        kb.update(data(min(BOUND, count - first), first=first), access=ROBOT, limits=LIMITS)


@pytest.mark.parametrize(
    "text",
    [
        data(BOUND + 1),
        data(BOUND + 1, "DELETE"),
        "DROP ALL",
        "CLEAR ALL ; INSERT DATA { <urn:s> <urn:p> 1 }",
        "DELETE WHERE { ?s ?p ?o }",
        "INSERT { ?s <urn:q> ?o } WHERE { ?s ?p ?o }",
    ],
)
def test_a_larger_change_of_a_robot_is_refused_whole_and_others_are_not(
    kb: KnowledgeBase, text: str
) -> None:
    fill(kb, 2 * BOUND)
    seq = kb.seq
    with pytest.raises(TooLargeError, match=f"at most {BOUND} statements") as refused:
        kb.update(text, access=ROBOT, limits=LIMITS)
    assert (kb.seq, refused.value.details["limit"]) == (seq, "change")
    kb.update(text.replace("ALL", f"GRAPH {ROBOT.bind(kb.graphs).home()}"), limits=LIMITS)


def test_what_the_refusal_says_removes_a_graph_in_parts(kb: KnowledgeBase) -> None:
    fill(kb, 2 * BOUND + 5)
    with pytest.raises(TooLargeError) as refused:
        kb.update("DROP ALL", access=ROBOT, limits=LIMITS)
    recipe = str(refused.value).partition("parts, with ")[2].partition(" until")[0]
    removed = [kb.update(recipe, access=ROBOT, limits=LIMITS).removed for _ in range(4)]
    assert removed == [BOUND, BOUND, 5, 0]


def test_a_transaction_of_a_robot_is_bounded_and_the_owners_program_is_not(
    kb: KnowledgeBase,
) -> None:
    def many(tx: Transaction) -> None:
        for number in range(BOUND + 1):
            tx.add("urn:s", "urn:p", number)

    with pytest.raises(TooLargeError, match="admin may store more"):
        kb.commit_work(many, access=ROBOT.bind(kb.graphs))
    with kb.transaction(agent="nao-1") as tx:
        many(tx)
    assert tx.commit.added == BOUND + 1


@pytest.mark.parametrize(
    ("text", "is_stored"),
    [
        ("WITH {own} DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o }}", True),
        ("DELETE {{ GRAPH {own} {{ ?s ?p ?o }} }} USING {own} WHERE {{ ?s ?p ?o }}", True),
        ("DELETE WHERE {{ ?s ?p ?o }}", False),
        ("WITH {own} DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o . GRAPH ?g {{ ?s ?p ?o }} }}", False),
    ],
)
def test_an_update_of_named_graphs_is_not_evaluated_again_for_commits_about_others(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch, text: str, is_stored: bool
) -> None:
    fill(kb, 5)
    own = ROBOT.bind(kb.graphs).home()
    evaluate, evaluated = kb.readers.evaluate_update, []

    def beside_another(*order: Any) -> Any:
        answer = evaluate(*order)
        evaluated.append(order)
        if len(evaluated) == 1:  # another robot is quicker
            kb.update("INSERT DATA { <urn:other> <urn:p> 1 }", agent="nao-2")
        return answer

    monkeypatch.setattr(kb.readers, "evaluate_update", beside_another)
    done = kb.update(text.format(own=own), access=ROBOT, limits=LIMITS)
    assert (done.removed, len(evaluated)) == (5, 1 if is_stored else 2)


def test_an_update_of_a_named_graph_sees_what_was_committed_there_meanwhile(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(kb, 5)
    evaluate, evaluated = kb.readers.evaluate_update, []

    def beside_itself(*order: Any) -> Any:
        answer = evaluate(*order)
        evaluated.append(order)
        if len(evaluated) == 1:
            kb.update(data(1, first=100), access=ROBOT, limits=LIMITS)
        return answer

    monkeypatch.setattr(kb.readers, "evaluate_update", beside_itself)
    text = f"WITH {ROBOT.bind(kb.graphs).home()} DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o }}"
    assert kb.update(text, access=ROBOT, limits=LIMITS).removed == 6


def test_a_small_change_waits_for_one_of_many_large_ones() -> None:
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        order: list[str] = []
        threads = [threading.Thread(target=change, args=(kb, f"large {n}", LARGE, order))
                   for n in range(4)]  # fmt: skip
        first = kb.writer.begin(LARGE)
        for thread in threads:
            thread.start()
        while kb.writer.queue()[0] < len(threads):
            pass
        small = threading.Thread(target=change, args=(kb, "small", 1, order))
        small.start()
        while kb.writer.queue()[0] <= len(threads):
            pass
        assert first.is_empty()
        kb.writer.cancel()
        for thread in (*threads, small):
            thread.join(60)
    assert (order[0], len(order)) == ("small", 5)


def change(kb: KnowledgeBase, name: str, size: int, order: list[str]) -> None:
    """Hold the lock for a moment."""
    kb.writer.begin(size)
    order.append(name)
    kb.writer.cancel()


def test_a_large_change_inside_a_transaction_is_refused_and_leaves_the_lock_free() -> None:
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        for outer in (0, LARGE):
            kb.writer.begin(outer)
            with pytest.raises(UsageError, match="inside a transaction"):
                kb.writer.begin(LARGE)
            kb.writer.cancel()
        other = threading.Thread(target=change, args=(kb, "other", LARGE, []))
        other.start()
        other.join(60)
        assert not other.is_alive()
