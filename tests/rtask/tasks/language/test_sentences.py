"""Goals in words: which things they are about, how many, and where to; and what is refused."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator

import pytest

import rtask
from rtask.errors import UnknownTermError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.language.reader import read_goal
from tests.rtask.tasks.conftest import BASE, LEFT, RIGHT, TABLE, placed, robot

THINGS = {
    "cup-1": ("Cup", "red", TABLE), "cup-2": ("Cup", "blue", TABLE),
    "cup-3": ("Cup", "green", RIGHT), "can-1": ("Can", "blue", TABLE),
    "pen-1": ("Pen", "black", TABLE), "pen-2": ("Pen", "red", LEFT), "jug": ("Bottle", "", LEFT),
}  # fmt: skip
MASSES = {"cup-2": 0.12, "cup-3": 0.2}
CUPS = {"cup-1", "cup-2", "cup-3"}
PLACES = {TABLE: "table", LEFT: "left box", RIGHT: "right box"}


@pytest.fixture(scope="module")
def lab() -> Iterator[KnowledgeBase]:
    """Three places, two robots and seven things, most of which have a colour."""
    rows = [robot(f"{BASE}robot/{name}", name, "Hand", 0.09, 3.0) for name in ("nao-1", "panda-1")]
    for place, name in PLACES.items():
        rows.append(f'<{place}> a rt:SupportSurface ; rt:name "{name}" .')
        rows.append(f"<{BASE}robot/nao-1> rt:reaches <{place}> .")
    for number, (name, (kind, colour, place)) in enumerate(THINGS.items(), 1):
        has = f"rt:hasColour rt:colour_{colour} ; " if colour else ""
        rows.append(f'<{BASE}object/{number}> a rt:{kind} ; rt:objectId "lab/{number}" ; '
                    f'{has}rt:name "{name}" ; rt:graspWidth 0.04e0 ; '
                    f"rt:mass {MASSES.get(name, 0.1)}e0 . {placed(number, place)}")  # fmt: skip
    # The can stood in the left box before it came to the table.
    rows.append(f'<{BASE}object/2> rt:surfaceMaterial "plastic" .')
    rows.append(
        f"<{BASE}placement/old> a rt:Placement ; rt:placementOf <{BASE}thing/4> ; "
        f"rt:placedOn <{LEFT}> ; time:hasBeginning <{BASE}old/b> ; time:hasEnd <{BASE}old/e> . "
        f'<{BASE}old/b> time:inXSDDateTimeStamp "2025-01-01T10:00:00Z"^^xsd:dateTimeStamp . '
        f'<{BASE}old/e> time:inXSDDateTimeStamp "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp .'
    )
    with rtask.open(":memory:", base=BASE) as graph:
        assert isinstance(graph, KnowledgeBase)
        graph.update(
            f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {' '.join(rows)} }} }}"
        )
        yield graph


def read(lab: KnowledgeBase, goal: str) -> list[tuple[int | None, set[str], set[str]]]:
    """Return number, things and places of each goal of a sentence."""
    names = {f"{BASE}thing/{number}": name for number, name in enumerate(THINGS, 1)}
    read_ = []
    for aim in read_goal(lab.select, goal, BASE).aims:
        rows = lab.select(f"{PREFIXES}{aim.sparql}")
        things = {names[str(row.value("thing"))] for row in rows}
        places = {PLACES.get(str(row.value("place")), "hand") for row in rows}
        read_.append((aim.number, things, places))
    return read_


LEFT_BOX, RIGHT_BOX, ON_TABLE = {"left box"}, {"right box"}, {"table"}


@pytest.mark.parametrize(
    ("goal", "meaning"),
    [
        ("put all cups in the left box except the ones on the table",
         [(None, {"cup-3"}, LEFT_BOX)]),
        ("put in the left box the cups on the table", [(None, {"cup-1", "cup-2"}, LEFT_BOX)]),
        ("put any two cups in the left box", [(2, CUPS, LEFT_BOX)]),
        ("one of the three cups in the left box", [(1, CUPS, LEFT_BOX)]),
        ("everything except the cups and the pens into the left box",
         [(None, {"can-1", "jug"}, LEFT_BOX)]),
        ("put everything in the left box, except cups, pens and the jug",
         [(None, {"can-1"}, LEFT_BOX)]),
        ("cups and pens except cup-1 and pen-1 into the left box",
         [(None, {"cup-2", "cup-3"}, LEFT_BOX), (None, {"pen-2"}, LEFT_BOX)]),
        ("put the cups and the pens from the table into the left box",
         [(None, {"cup-1", "cup-2"}, LEFT_BOX), (None, {"pen-1"}, LEFT_BOX)]),
        ("move everything that is on the table except the can into the right box",
         [(None, {"cup-1", "cup-2", "pen-1"}, RIGHT_BOX)]),
        ("pick up a pen and put cup-2 in the left box",
         [(1, {"pen-1", "pen-2"}, {"hand"}), (None, {"cup-2"}, LEFT_BOX)]),
        ("take the can and put it into the left box", [(1, {"can-1"}, LEFT_BOX)]),
        ("put the blue can in the right box", [(1, {"can-1"}, RIGHT_BOX)]),
        ("the red and the blue cups into the left box",
         [(None, {"cup-1"}, LEFT_BOX), (None, {"cup-2"}, LEFT_BOX)]),
        ("all red things onto the table", [(None, {"cup-1", "pen-2"}, ON_TABLE)]),
        # The colour of the jug is not known, so that nobody can say that it is not red.
        ("put the things that are not red on the table",
         [(None, {"cup-2", "cup-3", "can-1", "pen-1"}, ON_TABLE)]),
        ("put a cup in the left box, but not the red one", [(1, {"cup-2", "cup-3"}, LEFT_BOX)]),
        ("take all cups off the table",
         [(None, {"cup-1", "cup-2"}, {"left box", "right box"})]),
        ("remove the cups from the table",
         [(None, {"cup-1", "cup-2"}, {"left box", "right box"})]),
        ("no cup may stay on the table",
         [(None, {"cup-1", "cup-2"}, {"left box", "right box"})]),
        ("clear the table of pens", [(None, {"pen-1"}, {"left box", "right box"})]),
        ("clear the table except the cups and the can",
         [(None, {"pen-1"}, {"left box", "right box"})]),
        ("empty the left box onto the table", [(None, {"pen-2", "jug"}, ON_TABLE)]),
        ("put what is in the left box on the table", [(None, {"pen-2", "jug"}, ON_TABLE)]),
        ("put cup-3 in the box on the left", [(None, {"cup-3"}, LEFT_BOX)]),
        ("put the can back where it was", [(1, {"can-1"}, LEFT_BOX)]),
        ("exactly one cup in the right box", [(1, CUPS, RIGHT_BOX)]),
        ("exactly two things on the table", [(2, {"cup-1", "cup-2", "can-1", "pen-1"},
                                              {"left box", "right box"})]),
        ("the heaviest of the cups onto the table", [(1, {"cup-3"}, ON_TABLE)]),
        ("things weighing less than 120 g onto the table",
         [(None, {"cup-1", "can-1", "pen-1", "pen-2", "jug"}, ON_TABLE)]),
        ("swap the can and cup-3", [(None, {"can-1"}, RIGHT_BOX), (None, {"cup-3"}, ON_TABLE)]),
        ("half of the pens into the right box", [(1, {"pen-1", "pen-2"}, RIGHT_BOX)]),
        ("one pen into the right box and the other pens onto the table",
         [(1, {"pen-1", "pen-2"}, RIGHT_BOX), (None, {"pen-1", "pen-2"}, ON_TABLE)]),
        ("if there is a can on the table, put it where cup-3 is",
         [(1, {"can-1"}, RIGHT_BOX)]),
        ("unless the table is empty, put the jug on it", [(None, {"jug"}, ON_TABLE)]),
        ("if the right box is empty, put the jug into it; otherwise put it on the table",
         [(None, {"jug"}, ON_TABLE)]),
        ("before you clear the table, could you please put the jug in the right box",
         [(None, {"jug"}, RIGHT_BOX),
          (None, {"cup-1", "cup-2", "can-1", "pen-1"}, {"left box", "right box"})]),
        ("all cups but the green one must in the left box be",
         [(None, {"cup-1", "cup-2"}, LEFT_BOX)]),
        ("all but one cup into the left box", [(2, CUPS, LEFT_BOX)]),
        ("put all cups but two in the left box", [(1, CUPS, LEFT_BOX)]),
        ("a cup or a pen onto the table", [(1, {*CUPS, "pen-1", "pen-2"}, ON_TABLE)]),
        ("cup-1 or the jug into the right box", [(1, {"cup-1", "jug"}, RIGHT_BOX)]),
        ("leave the jug where it is and put the can in the left box",
         [(None, {"jug"}, LEFT_BOX), (1, {"can-1"}, LEFT_BOX)]),
        ("clear the table but leave the cups there",
         [(None, {"can-1", "pen-1"}, {"left box", "right box"})]),
        ("there is a can on the table, put it in the left box", [(1, {"can-1"}, LEFT_BOX)]),
        ("apart from the can, move everything on the table into the left box",
         [(None, {"cup-1", "cup-2", "pen-1"}, LEFT_BOX)]),
        ("nothing but cups may be left on the table",
         [(None, {"can-1", "pen-1"}, {"left box", "right box"})]),
        ("whichever cup is the heaviest goes into the left box", [(1, {"cup-3"}, LEFT_BOX)]),
        ("all cups except the heaviest onto the table", [(None, {"cup-1", "cup-2"}, ON_TABLE)]),
        ("any cups on the table go in the left box", [(None, {"cup-1", "cup-2"}, LEFT_BOX)]),
        ("if there is a can on the table move it into the left box", [(1, {"can-1"}, LEFT_BOX)]),
        ("plastic things to the table", [(None, {"cup-2"}, ON_TABLE)]),
        ("the cups into the left box, then the pens",
         [(None, CUPS, LEFT_BOX), (None, {"pen-1", "pen-2"}, LEFT_BOX)]),
    ],
)  # fmt: skip
def test_each_word_of_a_goal_counts_where_it_stands(lab, goal, meaning):
    assert read(lab, goal) == meaning


@pytest.mark.parametrize(
    "goal",
    [
        "put the left box on the table", "put the table into the left box",
        "only one cup in the left box", "the first cup into the left box",
        "the cup into the left box",
        "put cups 1 and 2 in the left box", "put 3 in the left box", "put it in the left box",
        "put the cup on the table and then put it in the left box", "put that in the left box",
        "put the standing cups in the left box", "put the cups in the left box at five",
        "all but three cups into the left box", "all but a cup into the left box",
        "put a pen in each box", "put a pen on each table", "put nothing in the left box",
        "is the cup in the left box", "the red in the left box", "put the cups in the red box",
        "one of the two cups in the left box", "the red cups and pens onto the table",
        "the cups are in the left box", "put the cups back",
        "the cups are on the table, put the pens in the left box",
        "all cups except the one on the table into the left box", "do not move the jug",
        "all cups except the white one onto the table", "empty cups into the left box",
        "the cups into the left box onto the table", "put the can next to the jug",
    ],
)  # fmt: skip
def test_what_does_not_fit_where_it_stands_is_refused(lab, goal):
    with pytest.raises((UsageError, UnknownTermError)):
        read(lab, goal)


def test_things_are_shared_out_among_goals_and_none_is_to_be_at_two_places(lab):
    goal = "two cups into the left box and one cup onto the table"
    plan = lab.tasks.plan(goal)
    at = {step.arguments["thing"]: step.arguments["place"] for step in plan.steps}
    assert sorted(at.values()).count(LEFT) == 2
    with pytest.raises(UsageError, match="cannot both hold in the end"):
        lab.tasks.plan("all cups into the left box, then cup-1 onto the table")


def test_long_lists_and_many_clauses_are_read_in_one_way(lab):
    names = ", ".join([*THINGS, "cup-1", "cup-2"] * 2)
    assert len(read(lab, f"put {names} and the jug into the left box")) == 2 * len(THINGS) + 5
    goal = " and ".join(f"the {name} into the left box" for name in THINGS)
    assert len(read(lab, goal)) == len(THINGS)


def test_a_relation_that_no_action_brings_about_is_told_as_such(lab):
    with pytest.raises(
        UsageError, match=r"'next to': a goal brings things to places.*where the jug is"
    ):
        read(lab, "put the can next to the jug")


@pytest.mark.parametrize(
    ("goal", "advice"),
    [("my cup onto the table", "name it"), ("put the nearest cup on the table", "nearest to panda"),
     ("do not move the jug", "leave the jug where it is"),
     ("the nearest cup to the jug onto the table", "is not known")],
)  # fmt: skip
def test_what_no_goal_has_is_refused_with_what_to_say_instead(lab, goal, advice):
    with pytest.raises(UsageError, match=advice):
        read(lab, goal)


def test_a_word_with_one_slip_is_corrected_only_where_one_word_can_be_meant(lab):
    understood = read_goal(
        lab.select, "plesae put evrything form the table into the left box", BASE
    )
    assert [aim.text for aim in understood.aims] == [
        "all: everything that has a place from table: at left box"
    ]
    assert "'plesae' is read as 'please'" in understood.remarks
    with pytest.raises(UnknownTermError, match="'pan' means nothing here"):
        read(lab, "put the pan on the table")


def test_a_goal_that_hangs_on_what_does_not_hold_asks_for_nothing(lab):
    plan = lab.tasks.plan("if the table is empty, put all cups on it")
    assert plan.is_complete
    assert not plan.steps
    assert "does not hold" in plan.text


def test_words_that_will_mean_other_things_are_planned_again_from_what_they_meant(lab):
    plan = lab.tasks.plan("a pen from the table into the right box")
    again = lab.tasks.plan(plan.settled)
    assert (again.goal, again.digest, again.settled) == (plan.goal, plan.digest, plan.settled)
    assert f"{BASE}thing/5" in plan.settled
    assert f"{BASE}thing/6" not in plan.settled
    assert not lab.tasks.plan("all pens into the right box").settled


def test_the_time_that_a_goal_names_is_its_deadline(lab):
    now = dt.datetime(2026, 1, 1, 10, tzinfo=dt.UTC)
    for words in ("within 90 minutes", "by 11:30 UTC", "before 12:30 +01:00"):
        understood = read_goal(lab.select, f"all cups onto the table {words}", BASE, now)
        assert understood.deadline == dt.datetime(2026, 1, 1, 11, 30, tzinfo=dt.UTC)
        assert len(understood.aims) == 1
    with pytest.raises(UsageError, match="time zone"):
        read_goal(lab.select, "by noon all cups onto the table", BASE, now)
