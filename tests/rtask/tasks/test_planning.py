"""Plans are valid and short, and a goal out of reach is explained by the facts that it lacks."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from rtask.errors import SearchLimit
from rtask.tasks.planning.mutexes import crowded_goals
from rtask.tasks.planning.problem import Action, Parameter, Problem
from rtask.tasks.planning.search import find_plan, goal_costs
from rtask.tasks.planning.unsolvable import explain_unsolvable
from tests.rtask.tasks.lab import PICK, PLACE, fixed_estimate, lab

LID = tuple(
    Action(name, (Parameter("o", "thing"),), needs, adds, deletes, fixed_estimate(1.0))
    for name, needs, adds, deletes in (
        ("cover", (), (("covered", "o"),), (("open", "o"),)),
        ("uncover", (), (("open", "o"),), (("covered", "o"),)),
        ("fill", (("open", "o"),), (("full", "o"),), ()),
    )
)  # fmt: skip


def carried_out(problem: Problem, steps) -> set:
    facts = set(problem.facts)
    for step in steps:
        assert set(step.preconditions) <= facts, step
        facts = facts - set(step.deletes) | set(step.adds)
    return facts


def all_hold(problem: Problem, facts: set) -> bool:
    return all(not facts.isdisjoint(goal) for goal in problem.goals)


def test_each_step_of_a_plan_is_possible_when_its_turn_comes_and_all_goals_hold_at_the_end():
    problem = lab(12, 3)
    plan = find_plan(problem)
    assert plan is not None
    assert all_hold(problem, carried_out(problem, plan.steps))


def test_a_thing_that_one_robot_cannot_bring_all_the_way_is_handed_over_at_a_shared_place():
    plan = find_plan(lab(1, 2))
    assert plan is not None
    assert [str(step) for step in plan.steps] == [
        "pick(robot0, thing0, place0)", "place(robot0, thing0, place1)",
        "pick(robot1, thing0, place1)", "place(robot1, thing0, place2)",
    ]  # fmt: skip


def test_what_holds_already_takes_no_step():
    problem = lab(1, 2)
    plan = find_plan(replace(problem, goals=((("at", "thing0", "place0"),),)))
    assert plan is not None
    assert plan.steps == ()


@pytest.mark.parametrize("better", ["a", "b"])
def test_the_robot_with_the_better_chance_is_chosen_if_both_are_as_quick(better):
    def estimate(arguments):
        return 8.0, 0.95 if arguments["r"] == better else 0.5

    facts = {("at", "cup", "table"), ("free", "a"), ("free", "b")}
    facts |= {("can_grasp", r, "cup") for r in "ab"}
    facts |= {("reaches", r, place) for r in "ab" for place in ("table", "box")}
    objects = {"robot": ("a", "b"), "thing": ("cup",), "place": ("table", "box")}
    actions = (replace(PICK, estimate=estimate), PLACE)
    plan = find_plan(Problem(objects, actions, frozenset(facts), ((("at", "cup", "box"),),)))
    assert plan is not None
    assert {dict(step.arguments)["r"] for step in plan.steps} == {better}


def test_things_are_shared_out_among_robots_that_can_do_all_alike():
    things = tuple(f"cup{number}" for number in range(6))
    facts = {("at", thing, "table") for thing in things} | {("free", r) for r in "abc"}
    facts |= {("can_grasp", r, thing) for r in "ab" for thing in things}
    facts |= {("reaches", r, place) for r in "abc" for place in ("table", "box")}
    objects = {"robot": ("a", "b", "c"), "thing": things, "place": ("table", "box")}
    goals = tuple((("at", thing, "box"),) for thing in things)
    problem = Problem(objects, (PICK, PLACE), frozenset(facts), goals, workers=frozenset("abc"))
    plan = find_plan(problem)
    assert plan is not None
    assert all_hold(problem, carried_out(problem, plan.steps))
    assert Counter(dict(step.arguments)["r"] for step in plan.steps) == {"a": 6, "b": 6}
    alone = find_plan(replace(problem, workers=frozenset()))
    assert alone is not None
    assert plan.cost_s == pytest.approx(alone.cost_s), "what is dearer for busy robots is no cost"


def test_goals_whose_order_matters_are_reached_together():
    cover = Action("cover", (Parameter("o", "thing"),), (), (("covered", "o"),), (("open", "o"),),
                   fixed_estimate(1.0))  # fmt: skip
    fill = Action("fill", (Parameter("o", "thing"),), (("open", "o"),), (("full", "o"),), (),
                  fixed_estimate(1.0))  # fmt: skip
    problem = Problem(
        {"thing": ("pot",)}, (cover, fill), frozenset({("open", "pot")}),
        ((("covered", "pot"),), (("full", "pot"),)),
    )  # fmt: skip
    plan = find_plan(problem)
    assert plan is not None
    assert [step.action for step in plan.steps] == ["fill", "cover"]


def test_a_goal_that_the_next_one_undoes_is_restored():
    goals = ((("covered", "pot"),), (("full", "pot"),))
    pot = Problem({"thing": ("pot",)}, LID, frozenset(), goals)
    plan = find_plan(pot)
    assert plan is not None
    assert all_hold(pot, carried_out(pot, plan.steps))


def test_of_several_facts_that_would_do_the_cheapest_is_made_true():
    problem = lab(2, 2)
    way = (("at", "thing0", "place2"), ("at", "thing0", "place1"), ("at", "thing1", "place9"))
    plan = find_plan(replace(problem, goals=(way,)))
    assert plan is not None
    assert [str(step) for step in plan.steps] == [
        "pick(robot0, thing0, place0)", "place(robot0, thing0, place1)",
    ]  # fmt: skip
    assert goal_costs(replace(problem, goals=(way, (("at", "thing1", "place9"),)))) == [
        pytest.approx(plan.cost_s), None,
    ]  # fmt: skip


def test_no_plan_is_an_answer_and_an_ended_search_is_none():
    problem = lab(1, 2)
    unheld = replace(problem, facts=problem.facts - {("can_grasp", "robot1", "thing0")})
    assert find_plan(unheld) is None
    with pytest.raises(SearchLimit):
        find_plan(problem, max_states=1)


def test_a_goal_out_of_reach_names_the_fact_it_lacks_and_the_step_that_would_be_possible():
    problem = lab(1, 2)
    problem = replace(problem, facts=problem.facts - {("can_grasp", "robot1", "thing0")})
    (obstacle,) = explain_unsolvable(problem, {"can_grasp": 1.0, "reaches": 5.0})
    assert obstacle.missing == (("can_grasp", "robot1", "thing0"),)
    assert [str(step) for step in obstacle.steps] == ["pick(robot1, thing0, place1)"]


def test_the_cheaper_of_two_remedies_is_given():
    problem = lab(1, 2)
    problem = replace(problem, facts=problem.facts - {("can_grasp", "robot1", "thing0")})
    (obstacle,) = explain_unsolvable(problem, {"can_grasp": 5.0, "reaches": 1.0})
    assert obstacle.missing == (("reaches", "robot0", "place2"),)


def test_a_goal_that_no_permitted_fact_would_mend_says_so():
    problem = lab(1, 2)
    problem = replace(problem, facts=problem.facts - {("at", "thing0", "place0")})
    (obstacle,) = explain_unsolvable(problem, {"can_grasp": 1.0})
    assert obstacle.missing == ()


def test_an_action_over_an_undeclared_name_is_refused():
    with pytest.raises(ValueError, match="names x, which is no parameter"):
        Action("look", (), (("seen", "x"),), (), (), fixed_estimate(1.0))


def _held(things: int, *robots: str) -> tuple:
    return tuple(tuple(("holding", r, f"thing{n}") for r in robots) for n in range(things))


def test_no_more_goals_than_hands_find_room_and_those_that_hold_already_keep_theirs():
    problem = lab(3, 2)
    assert not crowded_goals(problem), "any number of things stands at one place"
    assert not crowded_goals(replace(problem, goals=_held(2, "robot0", "robot1")))
    (left,) = crowded_goals(replace(problem, goals=_held(3, "robot0", "robot1")))
    assert sorted(left.takers) == ["robot0", "robot1"]
    holds = (problem.facts - {("free", "robot0"), ("at", "thing2", "place2")}) | {
        ("holding", "robot0", "thing2")
    }
    goals = _held(3, "robot0")
    left_out = crowded_goals(replace(problem, facts=holds, goals=goals))
    assert [item.goal for item in left_out] == list(goals[:2])


def test_goals_that_one_fact_fulfils_do_not_crowd_each_other():
    either = (("holding", "robot0", "thing0"), ("at", "thing0", "place0"))
    goals = (either, (("holding", "robot0", "thing0"),))
    assert not crowded_goals(replace(lab(1, 1), goals=goals))


def test_hands_that_hold_several_things_are_not_taken_for_full():
    both = Action(
        "scoop", (Parameter("r", "robot"), Parameter("o", "thing"), Parameter("l", "place")),
        (("at", "o", "l"), ("reaches", "r", "l")), (("holding", "r", "o"),), (("at", "o", "l"),),
        fixed_estimate(1.0),
    )  # fmt: skip
    problem = replace(lab(2, 1), goals=_held(2, "robot0"))
    problem = replace(problem, actions=(*problem.actions, both))
    assert not crowded_goals(problem)
    assert find_plan(problem) is not None
