"""Movements that one robot recorded, offered to others that can follow them."""

from __future__ import annotations

import numpy as np
import pytest

from rtask.errors import ForbiddenError, UsageError
from rtask.rdf.namespaces import RT

pytestmark = pytest.mark.slow

JOINTS = ["shoulder", "elbow", "right_hand"]


def motion(samples=5, joints=JOINTS, first=0.0):
    """Return a movement whose first joint goes up by .1 a sample, the second by .2, ..."""
    rows = first + np.arange(samples)[:, None] * 0.1 * (1 + np.arange(len(joints)))
    rows[:, -1] = np.linspace(1, 0, samples)
    flat = rows.ravel().tolist()
    times = (0.5 * np.arange(samples)).tolist()
    return {"joints": list(joints), "times": times, "positions": flat, "commands": flat}


def attempt(bench, robot, **outcome):
    """Let a robot grasp the box and report; return the attempt's grasp."""
    seen = bench.sight(bench.BOX)
    answer = robot.recognise(seen)
    told = {"started": 1e9, "ended": 1e9 + 5, **outcome}
    stored = robot.insert(
        seen, grasp=answer["grasps"][0], outcome=told, task_id=answer["task_id"], name="tea box"
    )
    return stored["objects"][0]


def body(bench, engine, name, gripper, gripper_type="nao_hand", model="nao-h25-v5"):
    """Register a robot of a model with a hand of its own."""
    robot = bench.Robot(name, engine, gripper)
    robot.call(
        "register_robot", **{**bench.registration(name, gripper, gripper_type), "model": model}
    )
    return robot


def fill_store(bench, robots):
    """Two bodies have recorded an attempt each that held, and one that missed."""
    first = robots("nao-1")
    attempt(bench, first, **bench.held(motion=motion()))
    attempt(bench, first, **bench.missed(motion=motion(first=0.5), attempt_number=2))
    other = body(bench, first.engine, "panda-1", "panda_hand", "jaw", "panda")
    attempt(bench, other, **bench.held(motion=motion(joints=["j1", "j2", "j3", "panda_hand"])))


@pytest.fixture
def second(filled, robots):
    """A robot of the first one's body that has recorded nothing."""
    return robots("nao-2")


def recalled(robot, **asked):
    answer = robot.call("recall_motions", **asked)
    return answer["motions"], answer["rejected"], answer["motions_left_out"]


def test_a_robot_of_the_same_body_is_offered_what_held_and_told_what_it_cannot_follow(second):
    (one,), (other,), more = recalled(second, object="tea box")
    assert (one["fit"], one["why_not"], one["held"], more) == ("same_body", "", True, 0)
    assert one["robot"].endswith("nao-1")
    assert (one["model"], one["joints"]) == ("nao-h25-v5", JOINTS)
    assert one["times"] == pytest.approx([0, 0.5, 1, 1.5, 2])
    assert np.reshape(one["positions"], (5, 3))[4].tolist() == pytest.approx([0.4, 0.8, 0.0])
    assert (other["fit"], other["positions"]) == ("other_body", [])
    assert other["why_not"] == "recorded on panda, not on nao-h25-v5"


def test_what_missed_is_offered_on_demand_and_the_rest_is_counted(second):
    motions, refused, more = recalled(second, held=False, max_motions=1)
    assert [one["held"] for one in motions + refused] == [True] or not motions[0]["held"]
    assert more == 2
    motions, refused, more = recalled(second, held=False)
    assert sorted(one["held"] for one in motions) == [False, True]
    assert (len(refused), more) == (1, 0)


def test_samples_lie_between_the_recorded_ones_if_there_are_too_many(second):
    ((one,), _, _) = recalled(second, max_samples=3)
    assert one["times"] == pytest.approx([0, 1, 2])
    assert np.reshape(one["positions"], (3, 3))[1].tolist() == pytest.approx([0.2, 0.4, 0.5])


def test_joints_that_take_the_place_of_others_follow_within_their_limits(filled, bench, engine):
    left = body(bench, engine, "nao-2", "left_hand")
    none, refused, _ = recalled(left)
    assert not none
    assert {one["why_not"] for one in refused} == {
        "recorded on panda, not on nao-h25-v5", "recorded with right_hand, not with left_hand",
    }  # fmt: skip
    joints = [
        {"name": "l_shoulder", "recorded": "shoulder"},
        {"name": "l_elbow", "recorded": "elbow", "scale": -1, "lower": -0.9, "upper": 0},
    ]
    (one,), (panda,), _ = recalled(left, joints=joints)
    assert one["fit"] == "retargeted"
    assert one["joints"] == ["l_shoulder", "l_elbow", "left_hand"]
    assert np.reshape(one["positions"], (5, 3))[4].tolist() == pytest.approx([0.4, -0.8, 0.0])
    assert panda["why_not"].startswith("it has no joint shoulder, elbow; its joints: j1,")
    joints[1]["lower"] = -0.5
    none, refused, _ = recalled(left, joints=joints)
    assert not none
    assert "l_elbow would move from -0.8 to 0, beyond its limits, -0.5 to 0" in {
        one["why_not"] for one in refused
    }
    _, refused, _ = recalled(left, joints=joints[:1])
    assert "no joint takes the place of elbow" in {one["why_not"] for one in refused}


def test_limits_hold_for_the_same_body_too(second):
    joints = [{"name": name} for name in JOINTS]
    assert [one["fit"] for one in recalled(second, joints=joints)[0]] == ["same_body"]
    joints[0]["upper"] = 0.3
    assert not recalled(second, joints=joints)[0]


def test_who_adapts_movements_itself_is_given_those_of_other_bodies(second):
    (own, other), refused, _ = recalled(second, any_body=True)
    assert (own["fit"], other["fit"], refused) == ("same_body", "other_body", [])
    assert other["joints"] == ["j1", "j2", "j3", "panda_hand"]
    assert len(other["positions"]) == 5 * 4
    assert other["why_not"] == "recorded on panda, not on nao-h25-v5"


def test_a_recording_stays_that_of_the_body_which_made_it(second, engine, bench):
    changed = {**bench.registration("nao-1", "right_hand"), "model": "nao-v6", "replace": True}
    engine.call("register_robot", changed)
    assert [one["model"] for one in recalled(second)[0]] == ["nao-h25-v5"]


def test_without_the_stored_body_a_recording_is_of_an_unknown_one(second, kb):
    with kb.transaction() as tx:
        for quad in kb.match(None, RT.ofRobotModel):
            tx.remove(quad.subject, quad.predicate, quad.object, quad.graph_name)
    motions, refused, _ = recalled(second)
    assert not motions
    assert {one["why_not"] for one in refused} == {"the model of the robot was not stored with it"}


def test_the_hand_of_another_robot_is_refused_and_joints_are_checked(second):
    with pytest.raises(ForbiddenError, match=r"panda_hand.* of panda-1"):
        second.call("recall_motions", gripper_id="panda_hand")
    for joints, words in (
        ([{"name": "a"}, {"name": "a", "recorded": "b"}], "joints: a stands there twice"),
        ([{"name": "a", "recorded": "b"}, {"name": "b"}], "joints: b stands there twice"),
        ([{"name": "a", "lower": 1, "upper": 0}], r"joints\[0\].lower is above upper"),
    ):
        with pytest.raises(UsageError, match=words):
            second.call("recall_motions", joints=joints)


def test_what_a_withdrawn_robot_recorded_is_not_offered(second, engine):
    engine.call("withdraw_contributor", {"contributor": "nao-1", "operator": "ann"})
    motions, _, _ = recalled(second)
    assert not motions


def test_that_none_of_the_latest_fits_is_not_that_none_does(second, monkeypatch):
    monkeypatch.setattr("rtask.engine.operations.motions._LATEST", 1)
    offered, rejected, more = recalled(second, object="tea box", held=False)
    assert len(offered) + len(rejected) == 1
    assert more == 2
