"""Sentences that the grammar refuses: what is proposed for them, and what blocks a proposal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase
from tests.benchmarks.tasks.bench_goals import judged
from tests.benchmarks.tasks.goals_lab import open_lab


@pytest.fixture(scope="module")
def lab() -> Iterator[KnowledgeBase]:
    with open_lab() as graph:
        yield graph


def proposal(lab: KnowledgeBase, sentence: str) -> dict[str, Any] | None:
    with pytest.raises(RtaskError) as caught:
        lab.tasks.plan(sentence)
    proposals = caught.value.details.get("proposals", [])
    assert all(item["sentence"] in str(caught.value) for item in proposals)
    return proposals[0] if proposals else None


@pytest.mark.parametrize(
    ("sentence", "proposed", "left_out"),
    [
        ("I'm going to lay the table, so bring the cup from the shelf to it",
         "the cup from the shelf to the table", ["i'm going to lay"]),
        ("the ball is needed in the left box before the guests come",
         "the ball to the left box", ["is needed", "before the guests come"]),
        ("place the green cup next to the jug", "the green cup to where the jug is",
         []),
        ("wash the cans and put them on the shelf", "the cans to the shelf", ["wash"]),
    ],
)  # fmt: skip
def test_what_is_left_out_is_named_and_nothing_acts(
    lab: KnowledgeBase, sentence: str, proposed: str, left_out: list[str]
) -> None:
    found = proposal(lab, sentence)
    assert found is not None
    assert (found["sentence"], found["left_out"]) == (proposed, left_out)
    assert ("where the jug" in proposed) == bool(found["guessed"] == ["next to the jug"])
    assert lab.tasks.plan(proposed).understood == tuple(found["understood"])


@pytest.mark.parametrize(
    "sentence",
    [
        "the pens would be better off in the right box, but leave them",
        "all the cups should end up on the shelf unless they are dirty",
        "I'm going to put the cups in the left box myself",
        "I took the cups to the left box",
        "the cups are in the left box",
        "should the cups be in the left box?",
        "put my cup on the shelf",
        "put the standing cups in the left box",
        "put the second heaviest cup on the shelf",
        "put the cups that nao-1 saw on the shelf",
        "take the cups off the table and the shelf",
        "stop putting cups in the left box",
        "sort the cups by material: glass left box, the rest right box",
    ],
)
def test_words_that_may_change_the_goal_block_a_proposal(lab: KnowledgeBase, sentence: str) -> None:
    assert proposal(lab, sentence) is None


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("the black pen should be found in the left box", "pen-1 > L"),
        ("I would feel better with the glass things on the shelf", "cup-1 cup-3 bottle-1 > S"),
        ("the heaviest thing on the table should end up sitting on the shelf", "bottle-1 > S"),
        ("move anything lighter than 100 g to the left box", "pen-1 pen-2 ball-1 > L"),
    ],
)
def test_where_each_word_is_accounted_for_the_sentence_is_understood(
    lab: KnowledgeBase, sentence: str, expected: str
) -> None:
    result, why = judged(lab, sentence, expected)
    assert result == "right", why
