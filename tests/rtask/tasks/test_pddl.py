"""Problems go out as PDDL, and plans of others are believed only if each step is possible."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

import pytest

from rtask.tasks.planning.pddl import write_pddl
from rtask.tasks.planning.problem import Parameter, Problem
from tests.rtask.tasks.lab import PICK, PLACE, lab

PLAN = """; cost = 24000
(PICK robot0 thing0 place0)
(place robot0 thing0 place1)

(pick robot1 thing0 place1)
(place robot1 thing0 place2) ; done
"""


def test_parentheses_balance_and_every_fact_and_goal_is_written():
    problem = lab(2, 2)
    pddl = write_pddl(problem)
    for text in (pddl.domain, pddl.problem):
        assert text.count("(") == text.count(")")
    for fact in problem.facts:
        assert f"({' '.join(fact)})" in pddl.problem
    assert "(:goal (and (at thing0 place2) (at thing1 place0)))" in pddl.problem
    assert "(= (pick-cost robot0 thing0 place0) 14322)" in pddl.problem


def test_a_plan_is_read_with_its_arguments_and_chances():
    steps = write_pddl(lab(1, 2)).read_plan(PLAN)
    assert [str(step) for step in steps][-1] == "place(robot1, thing0, place2)"
    assert steps[0].chance == 0.9


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ("(fly robot0 thing0)", "line 1: .* is no step of the problem"),
        ("(pick robot1 thing0 place0)", "is no step of the problem"),
        ("(place robot0 thing0 place1)", "needs holding"),
        ("(pick robot0 thing0 place0)", "at the end of the plan at.thing0, place2. does not hold"),
    ],
)
def test_a_plan_that_does_not_work_is_refused_with_the_reason(plan, message):
    with pytest.raises(ValueError, match=message):
        write_pddl(lab(1, 2)).read_plan(plan)


def test_iris_that_differ_in_case_or_signs_alone_keep_different_names():
    objects = {"robot": ("urn:R",), "thing": ("urn:a/b", "urn:A-b", "1"), "place": ("p", "q")}
    facts = {("free", "urn:R"), *(("reaches", "urn:R", place) for place in ("p", "q"))}
    facts |= {("can_grasp", "urn:R", thing) for thing in objects["thing"]}
    facts |= {("at", thing, "p") for thing in objects["thing"]}
    problem = Problem(objects, (PICK, PLACE), frozenset(facts), ((("at", "urn:A-b", "q"),),))
    pddl = write_pddl(problem)
    assert "urn-a-b - thing" in pddl.problem
    assert "urn-a-b-2 - thing" in pddl.problem
    assert "o-1 - thing" in pddl.problem
    steps = pddl.read_plan("(pick urn-r urn-a-b-2 p)\n(place urn-r urn-a-b-2 q)")
    assert dict(steps[0].arguments)["o"] == "urn:A-b"


def test_an_action_without_parameters_has_a_cost_of_its_own():
    wait = replace(PICK, name="wait", parameters=(), preconditions=(), adds=(), deletes=())
    assert "(= (wait-cost) 14322)" in write_pddl(replace(lab(1, 1), actions=(wait,))).problem


def declared(pddl):
    """Return the type of each object, and how often it is declared."""
    objects = re.search(r"\(:objects(.*?)\)\s*\(:init", pddl.problem, re.DOTALL)[1]
    rows = [line.strip().split(" - ") for line in objects.strip().splitlines()]
    return dict(rows), Counter(name for name, _ in rows)


def test_objects_of_several_classes_are_declared_once_and_a_predicate_says_the_wider_class():
    problem = lab(2, 2)
    # As in the graph: all are objects, and a tray is a thing on which others can be put down.
    wide = tuple(sorted(member for members in problem.objects.values() for member in members))
    tray = (*problem.objects["place"], "thing0")
    objects = {"everything": wide, **problem.objects, "place": tray}
    scan = replace(
        PICK, name="scan", parameters=(*PICK.parameters[:2], Parameter("l", "everything"))
    )
    pddl = write_pddl(replace(problem, objects=objects, actions=(PICK, PLACE, scan)))
    types, times = declared(pddl)
    assert set(times.values()) == {1}
    assert sorted(types) == list(wide)
    assert types["thing0"] == types["thing1"] == "thing"
    names = re.findall(r"\((a-place|a-everything) ([a-z0-9]+)\)", pddl.problem)
    assert sorted(n for kind, n in names if kind == "a-place") == sorted(tray)
    assert sorted(n for kind, n in names if kind == "a-everything") == list(wide)
    assert ":parameters (?r - robot ?o - thing ?l - object)" in pddl.domain
    assert ":precondition (and (a-place ?l) (can_grasp ?r ?o)" in pddl.domain


def test_types_predicates_and_actions_have_different_names():
    domain = write_pddl(lab(1, 1)).domain
    assert "(:action place\n" in domain
    assert "(:types robot thing place-2 - object)" in domain
