"""Sentences of people as goals: those that need to know where and when things were seen; lists."""

from __future__ import annotations

import pytest

from rtask.errors import UsageError
from rtask.tasks.language import patterns
from tests.benchmarks.tasks.bench_goals import GOALS, is_wide, judged, sentences
from tests.benchmarks.tasks.goals_lab import open_lab


@pytest.fixture(scope="module")
def lab():
    """Twelve things at six places, each with its position and when it was seen."""
    with open_lab() as graph:
        yield graph


@pytest.fixture(scope="module")
def wide():
    """The same with bowls that one robot alone reaches, and with owners."""
    with open_lab(is_wide=True) as graph:
        yield graph


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("put Anna's cup on the shelf", "cup-3 > S"),
        ("take all the things Ben owns to the left box", "pen-1 bottle-2 > L"),
        ("all cups except Anna's into the left box", "cup-1 cup-2 cup-4 > L"),
        ("put the bowl that panda-1 can reach on the shelf", "bowl-2 > S"),
        ("what is within reach of panda-1 on the tray goes to the table", "bowl-2 > T"),
        ("anything heavier than the white bottle goes into the right box",
         "can-1 can-2 bottle-1 jug > R"),
        ("all but the two heaviest cups into the left box", "cup-1 cup-3 > L"),
        ("put only the red cups into the left box", "cup-1 cup-4 > L; not cup-2 cup-3"),
        ("never touch the glass things; the rest of the table goes into the right box",
         "cup-2 can-1 pen-1 > R; not cup-1 cup-3 bottle-1"),
        ("don't use nao-1: all cans onto the shelf", "can-1 can-2 > S; by panda-1"),
        ("the jug and the ball should change places", "jug > S; ball-1 > L"),
        ("the cans should no longer be in the right box", "can-2 > !R"),
        ("grab the yellow one and drop it in the right box", "ball-1 > R"),
        ("put Carol's cup on the shelf", "X"),
        ("put Anna's pen on the shelf", "X"),
        ("put the red one on the shelf", "X"),
        ("put everything that nao-1 can't reach on the table", "X"),
        ("the cups heavier than the can onto the shelf", "X"),
        ("put the cups on the shelf, but only two at a time", "X"),
        ("put the cups in the left box and take them out again", "X"),
        ("someone put the cups in the left box", "X"),
        ("put the cups on the shelf before three", "X"),
        ("nao-1 said it put the cups on the shelf", "X"),
    ],
)  # fmt: skip
def test_whose_things_are_who_reaches_them_and_what_is_left_alone(wide, sentence, expected):
    result, why = judged(wide, sentence, expected)
    assert result == ("rightly refused" if expected == "X" else "right"), why


def test_only_is_refused_with_both_ways_to_say_it_where_others_are_there(wide):
    with pytest.raises(UsageError, match="nothing but blue things may be left in left box") as no:
        wide.tasks.plan("put only the blue things in the left box")
    (proposal,) = no.value.details["proposals"]
    assert (proposal["sentence"], proposal["left_out"]) == (
        "put the blue things in the left box", ["only"],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("the cup nearest to the jug onto the table", "cup-1 > T"),
        ("the nearest can to panda-1 into the left box", "can-2 > L"),
        ("the two cups closest to the shelf into the left box", "cup-4 cup-3 > L"),
        ("all cups except the one farthest from the shelf into the left box",
         "cup-1 cup-3 cup-4 > L"),
        ("the bottle that was seen last onto the shelf", "bottle-2 > S"),
        ("put the most recently seen cup in the left box", "cup-2 > L"),
        ("unless it is empty, empty the left box into the right box", "pen-2 jug > R"),
        ("put the ball on the table after the table is cleared",
         "cup-1 cup-2 can-1 bottle-1 pen-1 > !T then ball-1 > T"),
    ],
)  # fmt: skip
def test_which_of_several_is_read_from_positions_and_sightings(lab, sentence, expected):
    result, why = judged(lab, sentence, expected)
    assert result == "right", why


def test_what_is_left_of_a_goal_once_a_part_is_done_is_the_same_things(lab):
    plan = lab.tasks.plan("the cup nearest to the jug onto the shelf")
    assert "rt:locatedOn" in plan.settled, "the nearest cup would be another one by then"


def test_of_more_things_than_are_looked_at_none_is_called_the_heaviest(lab, monkeypatch):
    monkeypatch.setattr(patterns, "MAX_EXEMPLARS", 3)
    result, why = judged(lab, "the heaviest cup onto the table", "cup-4 > T")
    assert (result, "more than 3 things fit" in why) == ("refused", True), why


WITH_PROPOSALS = ("goals-10", "goals-12", "goals-16")
"""People talk around the goal here: a proposal that is right counts as well."""


@pytest.mark.deep
@pytest.mark.parametrize("path", sorted(GOALS.glob("*.txt")), ids=lambda path: path.stem)
def test_lists_of_sentences_are_understood_as_well_as_they_were(lab, wide, path):
    graph = wide if is_wide(path) else lab
    results = [judged(graph, *row)[0] for row in sentences(path)]
    goals = [found for found, (_, expected) in zip(results, sentences(path), strict=True)
             if expected != "X"]  # fmt: skip
    if path.stem.startswith("goals"):
        counted = ("right", "right proposal") if path.stem in WITH_PROPOSALS else ("right",)
        assert sum(map(goals.count, counted)) >= 0.7 * len(goals)
        assert "taken for another goal" not in results
    assert results.count("taken for another goal") <= 2
