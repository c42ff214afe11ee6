"""The bound on one change of a robot, which keeps every other robot's wait short."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

import rtask
from rtask.errors import TooLargeError
from rtask.kb.commit.access import Access
from rtask.kb.commit.update_limits import UpdateLimits
from rtask.knowledge_base import KnowledgeBase

BOUND = 20
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
    with (
        pytest.raises(TooLargeError, match="admin may store more"),
        kb.transaction(access=ROBOT) as tx,
    ):
        for number in range(BOUND + 1):
            tx.add("urn:s", "urn:p", number)
    with kb.transaction(agent="nao-1") as tx:
        for number in range(BOUND + 1):
            tx.add("urn:s", "urn:p", number)
    assert tx.commit.added == BOUND + 1


@pytest.mark.parametrize(
    ("text", "is_stored"),
    [
        ("WITH {own} DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o }}", True),
        ("DELETE {{ GRAPH {own} {{ ?s ?p ?o }} }} USING {own} WHERE {{ ?s ?p ?o }}", True),
        ("DELETE WHERE {{ ?s ?p ?o }}", False),
        ("WITH {own} DELETE {{ ?s ?p ?o }} WHERE {{ ?s ?p ?o MINUS {{ GRAPH ?g {{ ?s ?p 99 }} }} }}",
         False),
    ],
)  # fmt: skip
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
