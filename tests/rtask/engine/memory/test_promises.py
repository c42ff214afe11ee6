"""What is promised of planned grasps follows the outcomes of the same hand in the graph."""

from __future__ import annotations

from typing import Any

import pytest

from rtask.engine.memory.promises import grown_promises, hands_of_type
from rtask.kb.commit.access import Access

pytestmark = pytest.mark.slow

PLAN = {"samples": 30, "max_grasps": 8}
LOST = {"success": False, "placed": False, "reason": "slip_transport"}


def panda(bench: Any, engine: Any, name: str) -> Any:
    robot = bench.Robot(name, engine, gripper=f"{name}_hand")
    message = bench.registration(name, f"{name}_hand", "panda_hand")
    message["end_effectors"][0].update(
        kind="ParallelJawGripper", max_opening=0.08, jaw_width=0.02, finger_length=0.054
    )
    robot.call("register_robot", **message)
    return robot


@pytest.fixture
def robot(bench: Any, engine: Any) -> Any:
    return panda(bench, engine, "panda-1")


@pytest.fixture
def can(robot: Any, bench: Any) -> str:
    """Return an object whose mesh is swept about its axis."""
    seen = bench.sight(bench.CAN)
    return str(robot.insert(seen, name="can")["objects"][0]["object"])


def tried(robot: Any, thing: str, grasp: Any, times: int, outcome: dict[str, Any]) -> None:
    for k in range(times):
        robot.call(
            "report_outcome", task_id=f"urn:{outcome['reason']}:{k}", object=thing,
            gripper_id=robot.gripper, grasp=grasp["id"], outcome=outcome,
        )  # fmt: skip


def promise(robot: Any, thing: str, grasp: Any) -> dict[str, Any]:
    told = robot.call("recall_grasps", object=thing, gripper_id=robot.gripper, max_grasps=50)
    (mine,) = [one for one in told["grasps"] if one["id"] == grasp["id"]]
    return dict(mine["promise"])


def test_what_is_planned_is_promised_and_outcomes_move_all_that_is_promised(
    robot: Any, can: str, bench: Any
) -> None:
    plan = robot.call("plan_in_space", object=can, **PLAN)
    assert len(plan["grasps"]) == PLAN["max_grasps"]
    assert plan["grasps_left_out"] > 0
    first, other = plan["grasps"][0], plan["grasps"][-1]
    before = first["promise"]
    assert before["outcomes"] == 0
    assert before["lift_at_least"] < before["lift_chance"]
    assert promise(robot, can, first) == before
    tried(robot, can, first, 6, bench.missed())
    for grasp in (first, other):  # the hand is worse than thought, so its other grasps are, too
        after = promise(robot, can, grasp)
        assert after["outcomes"] == 6
        assert after["lift_chance"] < grasp["promise"]["lift_chance"]
        assert after["carry_at_least"] <= grasp["promise"]["carry_at_least"]
    again = robot.call("plan_in_space", object=can, **PLAN)["grasps"]
    assert {g["promise"]["outcomes"] for g in again} == {6}


def test_what_is_lost_on_the_way_was_lifted_and_not_carried(
    robot: Any, can: str, bench: Any
) -> None:
    grasp = robot.call("plan_in_space", object=can, **PLAN)["grasps"][0]
    before = grasp["promise"]
    tried(robot, can, grasp, 6, bench.missed(**LOST))
    after = promise(robot, can, grasp)
    assert after["lift_chance"] > before["lift_chance"]
    assert after["carry_chance"] < before["carry_chance"]


def test_a_grasp_that_was_held_and_not_placed_says_nothing_of_carrying(
    robot: Any, can: str, bench: Any
) -> None:
    grasp = robot.call("plan_in_space", object=can, **PLAN)["grasps"][0]
    tried(robot, can, grasp, 4, bench.held(placed=False))
    after = promise(robot, can, grasp)
    assert after["lift_chance"] > grasp["promise"]["lift_chance"]
    assert after["carry_chance"] == grasp["promise"]["carry_chance"]


def test_another_hand_keeps_its_promises_and_a_whole_type_has_all_outcomes(
    robot: Any, can: str, bench: Any, engine: Any
) -> None:
    grasp = robot.call("plan_in_space", object=can, **PLAN)["grasps"][0]
    tried(robot, can, grasp, 3, bench.missed())
    second = panda(bench, engine, "panda-2")
    assert promise(second, can, grasp) == grasp["promise"]
    tried(second, can, grasp, 2, bench.held())
    hand = engine.context.grippers.find("panda-2_hand", Access("panda-2", "robot")).gripper
    of_all = grown_promises(engine.context, hand, hands_of_type(engine.context, "panda_hand"))
    assert of_all is not None
    assert of_all.outcomes == 5


def test_what_says_nothing_of_the_grasp_does_not_count(robot: Any, can: str, bench: Any) -> None:
    grasp = robot.call("plan_in_space", object=can, **PLAN)["grasps"][0]
    tried(robot, can, grasp, 3, bench.missed(reason="ik"))
    assert promise(robot, can, grasp) == grasp["promise"]


def test_nothing_is_promised_without_a_hand_or_of_what_was_only_seen(
    robot: Any, can: str, bench: Any
) -> None:
    nothing = {
        "lift_chance": None, "lift_at_least": None, "carry_chance": None, "carry_at_least": None,
        "outcomes": 0,
    }  # fmt: skip
    robot.call("plan_in_space", object=can, **PLAN)
    told = robot.call("recall_grasps", object=can)["grasps"]
    assert all(grasp["promise"] == nothing for grasp in told)
    box = robot.insert(bench.sight(bench.BOX), name="tea box")["objects"][0]["object"]
    planned = robot.call("plan_in_space", object=box, **PLAN)
    assert planned["shape"] != "mesh"
    assert all(grasp["promise"] == nothing for grasp in planned["grasps"])
