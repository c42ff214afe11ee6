"""A decision by thresholds: a grasp, or which confidence was too low, with what would help."""

from __future__ import annotations

import pytest

from rtask.engine import Engine, Policy
from rtask.errors import UsageError

pytestmark = pytest.mark.slow  # starts servers or robots


@pytest.fixture
def known(bench, robots):
    """A robot that has held a box and seen a can, and its answer about the box."""
    robot = robots()
    seen = bench.sight(bench.BOX)
    answer = robot.recognise(seen)
    robot.insert(seen, grasp=answer["grasps"][0], outcome=bench.held(), name="tea box")
    robot.insert(bench.sight(bench.CAN), name="soup")
    return robot, seen


def test_who_does_not_ask_gets_the_same_answer_as_before(known):
    robot, seen = known
    plain = robot.recognise(seen)
    asked = robot.recognise(seen, decide=True, min_grasp=0.0)
    assert plain["decision"] is None
    assert [g["id"] for g in plain["grasps"]] == [g["id"] for g in asked["grasps"]]
    assert plain["task_response"] == asked["task_response"] == "grasp"


def test_a_sure_look_is_answered_with_a_grasp_and_all_three_numbers(known):
    robot, seen = known
    decision = robot.recognise(seen, decide=True)["decision"]
    assert decision["answer"] == "grasp"
    assert decision["too_low"] == ""
    assert decision["thresholds"] == {"identity": 0.7, "pose": 0.7, "grasp": 0.3}
    assert min(decision["confidences"].values()) > 0.7


@pytest.mark.parametrize(
    ("name", "request_field", "response"),
    [("identity", "min_identity", "unknown"), ("pose", "min_pose", "no_grasp"),
     ("grasp", "min_grasp", "no_grasp")],
)  # fmt: skip
def test_the_first_confidence_that_is_too_low_ends_the_decision(
    known, name, request_field, response
):
    robot, seen = known
    answer = robot.recognise(seen, **{request_field: 1.0})
    decision = answer["decision"]
    assert decision["too_low"] == name
    assert decision["threshold"] == 1.0
    assert decision["confidence"] == decision["confidences"][name] < 1.0
    assert f"{name}: 0.9" in decision["text"]
    assert decision["advice"]
    assert answer["task_response"] == response
    assert answer["grasps"] == []
    assert (answer["object"] == "") == (name == "identity")
    if name != "pose":  # a box with a picture on each side fits in one way only
        best = decision["alternatives"][0]
        assert best["confidence"] == pytest.approx(decision["confidence"])


def test_identity_comes_before_pose_and_grasp(known):
    robot, seen = known
    answer = robot.recognise(seen, min_identity=1.0, min_pose=1.0, min_grasp=1.0)
    assert answer["decision"]["too_low"] == "identity"
    assert answer["recognition"]["matches"][0]["label"] == "tea box"


def test_grasps_below_the_threshold_are_not_offered(known):
    robot, seen = known
    every = robot.recognise(seen)["grasps"]
    between = sorted(g["mean"] for g in every)[len(every) // 2]
    left = robot.recognise(seen, min_grasp=between)["grasps"]
    assert left
    assert len(left) < len(every)
    assert min(g["mean"] for g in left) >= between


def test_failures_bring_the_confidence_of_a_grasp_below_its_threshold(bench, known):
    robot, seen = known
    first = robot.recognise(seen, propose=False, min_grasp=0.5)
    assert first["decision"]["answer"] == "grasp"
    for k in range(8):
        robot.call(
            "report_outcome", task_id=f"urn:again:{k}", object=first["object"],
            grasp=first["grasps"][0]["id"], gripper_id="right_hand", outcome=bench.missed(),
        )  # fmt: skip
    now = robot.recognise(seen, propose=False, min_grasp=0.5)
    assert now["decision"]["too_low"] == "grasp"
    assert now["decision"]["alternatives"][0]["attempts"] == 9
    assert "propose" in now["decision"]["advice"]


def test_an_object_that_nobody_knows_cannot_be_identified(bench, known):
    robot, _ = known
    answer = robot.recognise(bench.sight(bench.PEN), decide=True)
    assert answer["decision"]["too_low"] == "identity"
    assert answer["decision"]["confidence"] < 0.7


def test_a_server_may_ask_for_more(bench, kb, known):
    _, seen = known
    with Engine(kb, policy=Policy(min_grasp=0.99)) as strict:
        request = {"gripper_id": "right_hand", **seen}
        asked = strict.call("recognise_for_grasp", {**request, "decide": True})
        lenient = strict.call("recognise_for_grasp", {**request, "min_grasp": 0.5})
    assert asked["decision"]["too_low"] == "grasp"
    assert lenient["decision"]["answer"] == "grasp"


def test_a_threshold_outside_of_its_range_is_refused(known):
    robot, seen = known
    with pytest.raises(UsageError, match=r"min_pose: 1\.2 is above 1"):
        robot.recognise(seen, min_pose=1.2)
