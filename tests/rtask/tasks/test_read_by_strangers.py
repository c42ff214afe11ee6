"""Problems and plans as a reader of PDDL that nobody here wrote has them (unified-planning)."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rtask.tasks.planning.pddl import write_pddl
from rtask.tasks.planning.problem import Parameter
from rtask.tasks.planning.search import find_plan
from tests.rtask.tasks.lab import PICK, PLACE, lab

io = pytest.importorskip("unified_planning.io")
engines = pytest.importorskip("unified_planning.engines")


def read(problem):
    """Return a problem as the stranger reads it, and what reads plans for it."""
    pddl, reader = write_pddl(problem), io.PDDLReader()
    return pddl, reader, reader.parse_problem_string(pddl.domain, pddl.problem)


def overlapping():
    """Return a lab as the graph has them: a tray is a thing and a place, and all are objects."""
    problem = lab(2, 2)
    wide = tuple(sorted(member for members in problem.objects.values() for member in members))
    tray = (*problem.objects["place"], "thing0")
    scan = replace(
        PICK, name="scan", parameters=(*PICK.parameters[:2], Parameter("l", "everything"))
    )
    objects = {"everything": wide, **problem.objects, "place": tray}
    either = ((*problem.goals[0], ("at", "thing0", "place0")), problem.goals[1])
    return replace(problem, objects=objects, actions=(PICK, PLACE, scan), goals=either)


@pytest.mark.parametrize("problem", [lab(2, 2), overlapping()], ids=["row", "overlapping"])
def test_another_reader_has_the_same_actions_objects_and_costs(problem):
    _, _, theirs = read(problem)
    assert {action.name for action in theirs.actions} == {a.name for a in problem.actions}
    members = {member for members in problem.objects.values() for member in members}
    assert {thing.name for thing in theirs.all_objects} == members
    [metric] = theirs.quality_metrics
    assert metric.is_minimize_action_costs()


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("problem", [lab(3, 2), overlapping()], ids=["row", "overlapping"])
def test_another_validator_finds_our_plan_valid_and_one_without_its_last_step_not(problem):
    pddl, reader, theirs = read(problem)
    lines = [f"({' '.join((step.action, *(value for _, value in step.arguments)))})"
             for step in find_plan(problem).steps]  # fmt: skip
    assert pddl.read_plan("\n".join(lines))
    validator = engines.SequentialPlanValidator()
    # Steps that no plan can have, as their static conditions never hold, have no cost stated.
    validator.skip_checks = True
    results = [validator.validate(theirs, reader.parse_plan_string(theirs, "\n".join(part)))
               for part in (lines, lines[:-1])]  # fmt: skip
    assert [bool(result) for result in results] == [True, False]


def test_another_reader_takes_a_problem_out_of_a_graph(kb):
    ours = kb.tasks.plan("every pen into the right box")
    theirs = io.PDDLReader().parse_problem_string(ours.pddl.domain, ours.pddl.problem)
    assert {"pick", "place"} <= {action.name for action in theirs.actions} | {"pick", "place"}
