"""Goals in words: which things they are about, how many, and where to; and what is refused."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import rtask
from rtask.errors import UnknownTermError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.sentences import aims_in_words
from tests.rtask.tasks.conftest import BASE, LEFT, RIGHT, TABLE, placed, robot

THINGS = {
    "cup-1": ("Cup", "red", TABLE), "cup-2": ("Cup", "blue", TABLE),
    "cup-3": ("Cup", "green", RIGHT), "can-1": ("Can", "blue", TABLE),
    "pen-1": ("Pen", "black", TABLE), "pen-2": ("Pen", "red", LEFT), "jug": ("Bottle", "", LEFT),
}  # fmt: skip
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
                    f'{has}rt:name "{name}" ; rt:graspWidth 0.04e0 ; rt:mass 0.1e0 . '
                    f"{placed(number, place)}")  # fmt: skip
    # The can stood in the left box before it came to the table.
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
    for aim in aims_in_words(lab.select, goal, BASE):
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
        ("one of the two cups in the left box", [(1, CUPS, LEFT_BOX)]),
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
        ("pick up the pen and put cup-2 in the left box",
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
        ("put what is in the left box on the table", [(None, {"pen-2", "jug"}, ON_TABLE)]),
        ("put cup-3 in the box on the left", [(None, {"cup-3"}, LEFT_BOX)]),
        ("put the can back where it was", [(1, {"can-1"}, LEFT_BOX)]),
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
        "put cups 1 and 2 in the left box", "put 3 in the left box", "put it in the left box",
        "put the cup on the table and then put it in the left box", "put that in the left box",
        "put the standing cups in the left box", "put the cups in the left box at five",
        "all except two cups into the left box", "all but a cup into the left box",
        "put a pen in each box", "put a pen on each table", "put nothing in the left box",
        "is the cup in the left box", "the red in the left box", "put the cups in the red box",
        "everything on the table except the can in the right box", "empty cups into the left box",
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
