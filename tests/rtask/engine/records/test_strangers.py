"""The token says who acts, and one task has one outcome."""

from __future__ import annotations

import pytest

from rtask.engine.operations.outcome import ReportOutcome
from rtask.errors import ConflictError, ForbiddenError
from tests.rtask.engine.conftest import Robot


def hand(engine, robot: str) -> str:
    return next(one.iri.value for one in engine.grippers.all() if one.robot_name == robot)


@pytest.mark.parametrize("is_registered", [True, False])
@pytest.mark.parametrize("by_name", [True, False])
def test_a_robot_cannot_name_the_hand_of_another(engine, bench, robots, is_registered, by_name):
    robots("nao-1")
    stranger = Robot("nao-2", engine)
    if is_registered:
        stranger.gripper = "left_hand"
        stranger.register()
    named = "right_hand" if by_name else hand(engine, "nao-1")
    missed = {"success": False, "reason": "missed"}
    asked = {
        "report_outcome": {"object": "urn:x", **missed},
        "recognise_for_grasp": bench.sight(bench.BOX),
        "insert_object": {"objects": [{**bench.sight(bench.BOX), "gripper_id": named}]},
    }
    for operation, args in asked.items():
        given = args if "objects" in args else {**args, "gripper_id": named}
        with pytest.raises(ForbiddenError) as caught:
            stranger.call(operation, **given)
        assert hand(engine, "nao-1") in str(caught.value), "the refusal names the hand in full"
    assert "gripper_id" in ReportOutcome.model_fields


def test_a_name_that_two_robots_use_is_the_callers_own(engine, robots):
    robots("nao-1"), robots("nao-2")
    for name in ("nao-1", "nao-2"):
        found = engine.grippers.find("right_hand", Robot(name, engine).access)
        assert found.robot_name == name


def test_a_second_outcome_of_a_task_that_disagrees_is_a_conflict(bench, robots):
    robot = robots("nao-1")
    seen = bench.sight(bench.BOX)
    asked = robot.recognise(seen)
    told = {"task_id": asked["task_id"], "grasp": asked["grasps"][0]}
    robot.insert(seen, outcome=bench.held(), name="tea box", **told)
    repeated = robot.insert(seen, outcome=bench.held(), name="tea box", **told)
    with pytest.raises(ConflictError, match="stored as succeeded, and this report says that it"):
        robot.insert(seen, outcome=bench.missed(), name="tea box", **told)
    thing = str(repeated["objects"][0]["object"])
    common = {"object": thing, "gripper_id": "right_hand", **told}
    assert robot.call("report_outcome", outcome=bench.held(), **common)["stored"] == 0
    with pytest.raises(ConflictError, match="failed"):
        robot.call("report_outcome", outcome=bench.missed(), **common)
