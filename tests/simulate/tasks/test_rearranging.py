"""What a robot finds no way to: other robots move it, or what stands beside it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rtask.rdf.namespaces import PREFIXES
from simulate.tasks.body import Deed
from simulate.tasks.lab import read_lab
from tests.rtask.tasks.conftest import BASE, CUP, JUG, LEFT, NAO, PANDA, PEN, RIGHT, TABLE, placed
from tests.simulate.tasks.test_crew import GOAL, world

__all__ = ["world"]

pytestmark = pytest.mark.slow


class Clumsy:
    """A robot that finds no way to the cup until the other one has put it down anew."""

    def __init__(self, robot, needs):
        self._robot, self._needs = robot, needs

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def pick(self, item, place, hand):
        puts = [deed for deed in self._robot.lab.done if deed == (PANDA, "put", CUP)]
        if len(puts) < self._needs:
            return Deed(False, "ik", was_tried=False)
        return self._robot.pick(item, place, hand)


@pytest.mark.parametrize(("needs", "result", "moved"), [(2, "reached", 1), (99, "given_up", 4)])
def test_what_a_robot_finds_no_way_to_another_one_moves(world, needs, result, moved):
    world.store()
    crew = world.crew()
    crew.robots[NAO].body = Clumsy(world.lab.robot(NAO), needs)
    (ended,) = crew.work()
    assert (ended.goal, ended.result) == (GOAL, result), "plans that only move it are no goals"
    assert world.lab.done.count((PANDA, "put", CUP)) == 1 + 2 * moved
    if result == "given_up":
        assert "nao-1 picks red cup up from table: no way was found 4 times (ik)" in ended.comment
        assert "things were moved 4 times for that" in ended.comment
    assert world.planner.call("list_plans")["plans"] == []


class Missing:
    """A robot that misses what it first picks up from the table, to move it for another one."""

    def __init__(self, robot, reason):
        self._robot, self._reason, self._missed = robot, reason, 0

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def pick(self, item, place, hand):
        if place == TABLE and not self._missed:
            self._missed += 1
            return Deed(False, self._reason, was_tried=self._reason == "missed")
        return self._robot.pick(item, place, hand)


@pytest.mark.parametrize(("reason", "result"), [("missed", "reached"), ("ik", "given_up")])
def test_a_robot_that_missed_what_it_was_to_move_tries_again_and_one_without_a_way_does_not(
    world, reason, result
):
    world.store()
    crew = world.crew()
    crew.robots[NAO].body = Clumsy(world.lab.robot(NAO), 2)
    crew.robots[PANDA].body = Missing(world.lab.robot(PANDA), reason)
    (ended,) = crew.work()
    assert ended.result == result


class Hemmed:
    """A robot that finds no way to a thing, or no room for it, while the pen stands beside it."""

    def __init__(self, robot, reason, item=JUG):
        self._robot, self._reason, self._item = robot, reason, item

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def pick(self, item, place, hand):
        is_hemmed = item == self._item and self._robot.lab.where[PEN] == TABLE
        if is_hemmed and self._reason != "place_plan":
            return Deed(False, self._reason, was_tried=False)
        return self._robot.pick(item, place, hand)

    def put(self, item, place, hand):
        if item == JUG and place == TABLE and self._robot.lab.where[PEN] == TABLE:
            self._robot.lab.where[item] = RIGHT
            return Deed(False, "place_plan")
        return self._robot.put(item, place, hand)


def add_shelf(world):
    """Add a place that both robots get to; return its IRI."""
    shelf = f"{BASE}place/shelf"
    world.kb.update(
        f"{PREFIXES} INSERT DATA {{ <{shelf}> a rt:SupportSurface ; rt:name 'shelf' . "
        f"<{NAO}> rt:reaches <{shelf}> . <{PANDA}> rt:reaches <{shelf}> }}"
    )
    return shelf


def test_what_the_helper_cannot_move_either_is_freed_by_taking_away_its_neighbour(world):
    shelf = add_shelf(world)
    world.planner.call("state_place", thing=CUP, place=TABLE)
    world.planner.call("state_place", thing=JUG, place=RIGHT)
    world.lab = read_lab(world.planner.query, np.random.default_rng(3))
    world.store()
    crew = world.crew()
    for robot in (NAO, PANDA):
        crew.robots[robot].body = Hemmed(world.lab.robot(robot), "grasp_collision", CUP)
    (ended,) = crew.work()
    assert (ended.result, world.lab.where[PEN], world.lab.where[CUP]) == ("reached", shelf, LEFT)


@pytest.mark.parametrize("reason", ["grasp_collision", "no_grasp", "place_plan"])
def test_what_stands_in_the_way_of_a_thing_that_nobody_else_can_move_is_taken_away(world, reason):
    """Both robots get to a shelf, where the pen does not stand in the way of the jug."""
    goal = f"<{JUG}> rt:locatedOn <{RIGHT}>"
    shelf = add_shelf(world)
    if reason == "place_plan":
        goal = f"<{JUG}> rt:locatedOn <{TABLE}>"
        world.planner.call("state_place", thing=JUG, place=RIGHT)
    world.lab = read_lab(world.planner.query, np.random.default_rng(3))
    world.store(goal)
    crew = world.crew()
    crew.robots[PANDA].body = Hemmed(world.lab.robot(PANDA), reason)
    (ended,) = crew.work()
    assert (ended.goal, ended.result) == (goal, "reached")
    assert world.lab.where[PEN] == shelf
    assert world.lab.where[JUG] in goal


@pytest.mark.parametrize("limit", [{"untouched": [PEN]}, {"only_touch": [JUG]}])
def test_what_the_goal_keeps_untouched_is_not_taken_out_of_the_way_either(world, limit):
    add_shelf(world)
    world.lab = read_lab(world.planner.query, np.random.default_rng(3))
    world.store(json.dumps({"achieve": f"<{JUG}> rt:locatedOn <{RIGHT}>", **limit}))
    crew = world.crew()
    crew.robots[PANDA].body = Hemmed(world.lab.robot(PANDA), "grasp_collision")
    (ended,) = crew.work()
    assert ended.result == "given_up"
    assert PEN not in {item for _, _, item in world.lab.done}


@pytest.mark.parametrize(
    ("more", "pen"), [("", TABLE), (f" . <{PEN}> rt:locatedOn <{RIGHT}>", RIGHT)]
)
def test_what_a_lone_robot_puts_aside_comes_back_unless_the_goal_wants_it_there(world, more, pen):
    """No two robots reach any place but the table: each box is of one robot alone."""
    goals = [{"achieve": part.strip(" .")} for part in
             (f"<{JUG}> rt:locatedOn <{RIGHT}>", *filter(None, [more]))]  # fmt: skip
    world.lab = read_lab(world.planner.query, np.random.default_rng(3))
    world.store(json.dumps({"goals": goals}))
    crew = world.crew()
    crew.robots[PANDA].body = Hemmed(world.lab.robot(PANDA), "grasp_collision")
    (ended,) = crew.work()
    assert ended.result == "reached"
    assert (world.lab.where[JUG], world.lab.where[PEN]) == (RIGHT, pen)
    assert "put" in [what for _, what, item in world.lab.done if item == PEN]


@pytest.mark.parametrize(
    ("meanwhile", "failures"),
    [("every can onto the table", 2), ("every pen into the right box", 3)],
)
def test_only_what_is_taken_away_beside_a_thing_puts_help_off(world, meanwhile, failures):
    """Between failures at the cup the Panda puts a can down beside it, or takes the pen away."""
    if "can" in meanwhile:
        world.kb.update(f"""{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
          {placed(4, f"{PANDA}/hand")} <{BASE}object/4> a rt:Can ; rt:objectId "lab/4" ;
            rt:name "can" ; rt:graspWidth 0.03e0 ; rt:mass 0.1e0 . }} }}""")
    world.planner.call("state_place", thing=CUP, place=TABLE)
    world.lab = read_lab(world.planner.query, np.random.default_rng(3))
    world.store(f"{GOAL}; {meanwhile}")
    crew, turns = world.crew(), []
    crew.robots[NAO].body = Clumsy(world.lab.robot(NAO), 2)
    crew.tell = lambda robot, turn: turns.append((robot, turn.result))
    (ended,) = crew.work()
    assert (ended.result, world.lab.where[CUP]) == ("reached", LEFT)
    failed = [number for number, turn in enumerate(turns) if turn == (NAO, "failed")]
    assert (PANDA, "done") in turns[failed[0] : failed[1]]
    assert len(failed) == failures, "then the Panda puts the cup down anew"


class Stumbling:
    """A robot that finds no way to the cup at first."""

    def __init__(self, robot):
        self._robot, self._failed = robot, False

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def pick(self, item, place, hand):
        if item == CUP and not self._failed:
            self._failed = True
            return Deed(False, "ik", was_tried=False)
        return self._robot.pick(item, place, hand)


def test_a_goal_is_planned_again_for_the_things_that_its_words_meant_at_first(world):
    """Once the pen has left the table, "a thing from the table" would be the jug."""
    world.lab = read_lab(world.planner.query, np.random.default_rng(3))
    world.store("something from the table into the right box, then the red cup onto the table")
    crew = world.crew()
    crew.robots[PANDA].body = Stumbling(world.lab.robot(PANDA))
    (ended,) = crew.work()
    assert (ended.result, ended.repairs > 0) == ("reached", True)
    assert [world.lab.where[item] for item in (PEN, JUG)].count(RIGHT) == 1
    assert world.lab.where[CUP] == TABLE
