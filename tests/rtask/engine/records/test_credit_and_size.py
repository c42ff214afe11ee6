"""Whose account an outcome goes to, and what a view without a camera pose may say."""

from __future__ import annotations

import pytest

from rtask.errors import UnknownTermError, UsageError
from rtask.rdf.namespaces import PREFIXES

ATTEMPTS = f"{PREFIXES} SELECT ?who {{ ?attempt a rt:GraspAttempt ; rt:performedBy ?who }}"
GRASP = {"X": 0.16, "Y": -0.06, "Z": 0.29, "rad": 0.3}


def without_pose(sight):
    """A message of the thesis's robot: the cloud alone."""
    return {"data": sight["data"]}


def test_a_stranger_without_a_gripper_credits_nobody_elses(bench, robots, engine, kb):
    robots("nao-1")  # the only gripper that the graph knows is this robot's
    stranger = bench.Robot("nao-9", engine)
    answer = stranger.call("insert_object", objects=[{**bench.sight(bench.BOX), **GRASP}])
    assert answer["stored"] == 1
    assert list(kb.select(ATTEMPTS)) == []
    statistics = engine.call("recall_grasps", {"object": answer["objects"][0]["object"]})
    assert [g["statistics"]["attempts"] for g in statistics["grasps"]] == [0]


def test_a_stranger_without_a_name_credits_nobody_either(bench, robots, engine, kb):
    robots("nao-1")
    engine.call("insert_object", {"objects": [{**bench.sight(bench.BOX), **GRASP}]})
    assert list(kb.select(ATTEMPTS)) == []


def test_a_robot_with_one_gripper_need_not_name_it(bench, robots, kb):
    robot = robots("nao-1")
    robots("nao-2")
    robot.call("insert_object", objects=[{**bench.sight(bench.BOX), **GRASP}])
    (row,) = kb.select(ATTEMPTS)
    assert row["who"].value.endswith("robot/nao-1")


def test_an_outcome_without_a_gripper_is_refused_not_dropped(bench, robots, engine):
    robots("nao-1")
    stranger = bench.Robot("nao-9", engine)
    told = {**bench.sight(bench.BOX), **GRASP, "outcome": bench.held()}
    with pytest.raises(UsageError, match=r"objects\[0\]\.gripper_id is missing"):
        stranger.call("insert_object", objects=[told])
    with pytest.raises(UnknownTermError, match="nao-9 has 0 grippers"):
        stranger.call("report_outcome", object="x", grasp="y", success=True)


@pytest.mark.slow
def test_an_object_is_found_by_a_look_without_a_camera_pose(bench, robots):
    """Gatto 2016, 3.2.4: `search_object` carries a cloud and nothing else."""
    robot = robots("nao-1")
    robot.insert(bench.sight(bench.BOX))
    robot.insert(bench.sight(bench.PEN))
    found = robot.call("search_object", **without_pose(bench.sight(bench.BOX)))
    posed = robot.call("search_object", **bench.sight(bench.BOX))
    assert found["similar_objects"][0]["object"] == posed["similar_objects"][0]["object"]


@pytest.mark.slow
def test_a_look_without_a_camera_pose_says_nothing_about_size_or_kind(bench, robots, kb):
    robot = robots("nao-1")
    thing = robot.insert(without_pose(bench.sight(bench.BOX)))["objects"][0]
    assert not kb.query(f"{PREFIXES} ASK {{ <{thing['object']}> rt:extentX ?x }}")
    # A look with a pose is that object all the same: nothing measured stands against it.
    again = robot.insert(bench.sight(bench.BOX))["objects"][0]
    assert (again["object"], again["new"]) == (thing["object"], False)


def test_what_is_taught_twice_under_one_id_is_stored_once(bench, engine, kb):
    from rtask.kb.commit.access import Access

    said = {
        "operation": "teach", "class_description": "blue mug", "task_id": "said-1",
        **bench.sight(bench.CAN),
    }  # fmt: skip
    first = engine.call("teach_object", said, Access("ann", "teacher"))
    again = engine.call("teach_object", said, Access("ann", "teacher"))
    assert (first["stored"], again["stored"]) == (1, 0)
    assert again["objects"][0]["object"] == first["objects"][0]["object"]
