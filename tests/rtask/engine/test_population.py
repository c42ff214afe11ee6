"""What hides in an object is also learned from the attempts at others in the graph."""

from __future__ import annotations

import pytest

import rtask
from grasp.learning.hypotheses import PRIOR
from rtask.kb.commit.access import Access

pytestmark = pytest.mark.slow

ANN = Access("ann", "teacher")


def report(robot, thing, x, held):
    robot.call(
        "report_outcome", object=thing, gripper_id=robot.gripper,
        grasp={"in_object": {"x": x, "y": 0.0, "z": 0.01, "theta": 1.57}, "quality": 0.6,
               "opening": 0.04},
        outcome={"success": held, "reason": "ok" if held else "slip_lift", "preset": "faithful"},
    )  # fmt: skip


@pytest.fixture
def kb():
    """Return a store with a reasoner, so that verdicts count."""
    with rtask.open(":memory:", base="https://example.org/kb/") as opened:
        yield opened


def test_attempts_at_one_object_change_what_is_expected_of_the_next(bench, engine, robots):
    robot = robots("nao-1")
    things = [
        robot.insert(bench.sight(bench.Thing(bench.PEN.size, texture_seed=seed)))["objects"][0]
        for seed in (3, 4)
    ]
    tried, other = (thing["object"] for thing in things)
    size = bench.PEN.size
    population = engine.context.population
    assert len(population.now()) == 0
    for x, held in ((0.0, False), (0.033, False), (-0.033, True)):
        report(robot, tried, x, held)
    prior = population.now().prior_of(size)
    assert prior[0] < PRIOR[0]  # that nothing hides
    # An object is not its own prior.
    assert (population.now().prior_of(size, lambda name: name == tried) == PRIOR).all()
    assert (population.now().prior_of(size, lambda name: name == other) == prior).all()
    done = engine.call("withdraw_contributor", {"contributor": "nao-1"}, ANN).as_json()
    assert len(population.now()) == 0
    engine.call("curate_object", {"operation": "undo", "commit": done["commit"]}, ANN)
    assert (population.now().prior_of(size) == prior).all()


def test_attempts_that_are_no_evidence_are_left_out(bench, engine, robots):
    robot = robots("nao-1")
    thing = robot.insert(bench.sight(bench.PEN))["objects"][0]["object"]
    robot.call(
        "report_outcome", object=thing, gripper_id=robot.gripper,
        grasp={"in_object": {"x": 0.0, "y": 0.0, "z": 0.01, "theta": 1.57}, "quality": 0.6,
               "opening": 0.04},
        outcome={"success": False, "reason": "ik", "preset": "faithful"},
    )  # fmt: skip
    assert len(engine.context.population.now()) == 0
