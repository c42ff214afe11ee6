"""Plans as readers have them that nobody here wrote: unified-planning, and py_trees."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import pytest

from rtask.rdf.namespaces import local_name
from rtask.tasks.behaviour_tree import behaviour_tree
from rtask.tasks.planning.pddl import write_pddl
from rtask.tasks.planning.problem import Parameter
from rtask.tasks.planning.search import find_plan
from tests.rtask.tasks.conftest import PEN
from tests.rtask.tasks.lab import PICK, PLACE, lab


def read(problem):
    """Return a problem as the stranger reads it, and what reads plans for it."""
    io = pytest.importorskip("unified_planning.io")
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
    validator = pytest.importorskip("unified_planning.engines").SequentialPlanValidator()
    # Steps that no plan can have, as their static conditions never hold, have no cost stated.
    validator.skip_checks = True
    results = [validator.validate(theirs, reader.parse_plan_string(theirs, "\n".join(part)))
               for part in (lines, lines[:-1])]  # fmt: skip
    assert [bool(result) for result in results] == [True, False]


def test_another_reader_takes_a_problem_out_of_a_graph(kb):
    io = pytest.importorskip("unified_planning.io")
    ours = kb.tasks.plan("every pen into the right box")
    theirs = io.PDDLReader().parse_problem_string(ours.domain, ours.problem)
    names = [action.name.rpartition("ns-")[2] for action in theirs.actions]
    assert sorted(names) == ["grasp", "handover", "place"]
    [goal] = theirs.goals
    assert PEN.replace("://", "-").replace("/", "-").replace(".", "-") in str(goal)


def ticked(xml, names, folder):
    """Return the nodes that py_trees ticks, each with the values of its ports."""
    ports = pytest.importorskip("py_trees.ports")
    parser = pytest.importorskip("py_trees.parsers.behaviour_tree_xml")
    text = ports.PortInformation(data_type=str, required=True)
    done = []

    def node(action, arguments):
        class Node(ports.BehaviourWithPorts, tag=f"test_{action}"):
            INPUT_PORTS: ClassVar = dict.fromkeys(arguments, text)
            OUTPUT_PORTS: ClassVar = {}

            def update(self):
                done.append((action, {name: self.get_input(name) for name in arguments}))
                return status.SUCCESS

        return Node

    status = pytest.importorskip("py_trees.common").Status
    (folder / "plan.xml").write_text(xml, encoding="utf-8")
    registry = {action: node(action, arguments) for action, arguments in names.items()}
    root = parser.parse_behaviour_tree_xml(str(folder / "plan.xml"), node_registry=registry)
    root.tick_once()
    assert root.status == status.SUCCESS
    return done


def test_another_library_ticks_the_tree_of_a_plan_with_all_its_ports(kb, tmp_path):
    plan = kb.tasks.plan("every cup into the left box; the pen into the right box")
    steps = (*plan.steps, plan.steps[0])  # a thing that is picked up twice from one place
    names = {local_name(step.action): list(step.arguments) for step in steps}
    done = ticked(behaviour_tree(plan.goal, steps), names, tmp_path)
    assert done == [(local_name(step.action), dict(step.arguments)) for step in steps]
