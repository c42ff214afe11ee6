"""The node with a real master, a real server and a robot's node, each in its own process."""

from __future__ import annotations

import re

import pytest

from features.codec import encode_frame
from features.perception import perceive
from rtask.engine.operations.table import OPERATIONS
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA, view

pytestmark = [pytest.mark.ros, pytest.mark.slow]

HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.09, "max_payload": 0.5}
SUCCEEDED, ABORTED, PREEMPTED = 3, 4, 2


def test_every_operation_is_a_service_that_answers_or_says_why(robot):
    said = {name: robot.call(f"/rtask/{name}") for name in OPERATIONS}
    # Of what is missing nothing is guessed; four operations need nothing.
    assert isinstance(said.pop("compare_contributors")["contributors"], list)
    assert said.pop("list_plans")["plans"] == []
    assert said.pop("list_questions")["questions"] == []
    assert isinstance(said.pop("show_world")["nodes"], list)
    assert all(isinstance(one, str) for one in said.values()), said
    assert "name: expected a text" in said["register_robot"]
    assert "objects" in said["insert_object"]
    # All defaults: nothing is stored by a call that says nothing.
    assert "success" in said["report_outcome"] or "gripper_id" in said["report_outcome"]


@pytest.fixture(scope="module")
def registered(robot):
    answer = robot.call("/rtask/register_robot", name="nao-1", model="nao", end_effectors=[HAND])
    assert answer["robot"].endswith("/nao-1")
    return answer["robot"]


@pytest.fixture(scope="module")
def gripper(registered):
    return f"{registered}/hand"


@pytest.fixture(scope="module")
def taught(robot, gripper):
    """Objects of the view by name, stored over ROS with what came of grasping them."""
    names = ("soap", "tea")
    seen = perceive(view(), BASE_FROM_CAMERA).objects
    assert len(seen) == len(names)
    for name, one in zip(names, seen, strict=True):
        entry = {"data": encode_frame(one.crop).hex(), "name": name, "gripper_id": gripper,
                 "class_description": "box", "task_id": f"task-{name}"}  # fmt: skip
        answer = robot.call("/rtask/insert_object", objects=[entry])
        assert not isinstance(answer, str), answer
        assert answer["stored"] == 1, answer
    return answer["objects"][0]["object"]


def test_a_pose_without_rotation_is_an_error_and_not_identity(robot, taught, gripper):
    answer = robot.call(
        "/rtask/search_object", data=encode_frame(view()).hex(), sensor_pose=[{}]
    )  # fmt: skip
    assert "sensor_pose" in answer
    assert "quaternion" in answer


@pytest.fixture
def seen(robot, taught, gripper, stamp):
    """Result of a goal that looks at both objects."""
    robot("show", stamp=stamp, tf_stamp=stamp)
    return robot("see", goal={"gripper_id": gripper, "propose": True}, since=stamp)


def test_see_recognises_what_was_taught_with_feedback_and_latched_grasps(robot, seen, stamp):
    assert seen["state"] == SUCCEEDED, seen["text"]
    # The last feedback and the result come on two connections: either may be first.
    assert seen["feedback"] in ([1], [1, 2])
    found = seen["result"]["objects"]
    assert sorted(one["name"] for one in found) == ["soap", "tea"]
    assert all(one["header"]["stamp"]["secs"] == stamp for one in found)
    assert all(one["view"] and re.fullmatch("[0-9a-f]{64}", one["picture"]) for one in found)
    by_name = {one["name"]: one for one in found}
    position = by_name["soap"]["pose"]["position"]
    assert position["y"] > 0 > by_name["tea"]["pose"]["position"]["y"] or position["y"] < 0
    assert abs(position["z"] - 0.30) < 0.02  # half of a height of 6 or 8 cm over the table
    # Latched: a subscriber that comes late hears it.
    robot("listen", topic="/rtask/grasps", type="moveit_msgs/Grasp")
    grasp = robot("hear", topic="/rtask/grasps")
    assert grasp["grasp_pose"]["header"]["frame_id"] == "base_footprint"
    robot("listen", topic="/rtask/objects", type="visualization_msgs/MarkerArray")
    markers = robot("hear", topic="/rtask/objects")["markers"]
    assert len(markers) == 1 + 2 * len(found)
    assert {m["text"].partition(" ")[0] for m in markers if m["text"]} == {"soap", "tea"}


def test_moveit_hears_of_the_table_and_of_each_object_by_its_iri(robot, seen, stamp):
    robot("listen", topic="/rtask/planning_scene", type="moveit_msgs/PlanningScene")
    scene = robot("hear", topic="/rtask/planning_scene")
    assert scene["is_diff"]
    assert scene["robot_state"]["is_diff"]
    found = {one["object"]: one for one in seen["result"]["objects"]}
    boxes = {one["id"]: one for one in scene["world"]["collision_objects"]}
    assert set(boxes) == {*found, "rtask/table"}
    for name, one in found.items():
        box = boxes[name]
        assert box["header"] == {**box["header"], "frame_id": "base_footprint"}
        assert box["header"]["stamp"]["secs"] == stamp
        assert (box["operation"], box["primitives"][0]["type"]) == (0, 1)
        assert box["primitives"][0]["dimensions"] == [one["size"][axis] for axis in "xyz"]
        assert box["pose"] == one["pose"]
        assert box["primitive_poses"][0]["orientation"]["w"] == 1
        assert box["type"]["key"] == one["class_iri"]
    table, height = boxes["rtask/table"], perceive(view(), BASE_FROM_CAMERA).table_height
    length, width, thick = table["primitives"][0]["dimensions"]
    assert table["pose"]["position"]["z"] + thick / 2 == pytest.approx(height)
    assert min(length, width) > 0.3  # it is seen under both objects and between them


def test_a_forgotten_success_stores_nothing(robot, seen, gripper):
    one = seen["result"]["objects"][0]
    told = {"task_id": one["task_id"], "object": one["object"], "grasp": one["grasps"][0]["id"]}
    told["gripper_id"] = gripper
    before = robot.call("/rtask/recall_grasps", object=one["object"])["grasps"]
    assert "success" in robot.call("/rtask/report_outcome", **told)
    assert "outcome.success is missing" in robot.call("/rtask/report_outcome", **told, outcome=[{}])
    assert robot.call("/rtask/recall_grasps", object=one["object"])["grasps"] == before == []
    stored = robot.call("/rtask/report_outcome", **told, success=[False])
    assert not isinstance(stored, str), stored
    counted = stored["statistics"]
    assert (stored["stored"], counted["attempts"], counted["successes"]) == (1, 1, 0)
    again = robot.call("/rtask/report_outcome", **told, success=[True])
    assert "under an id of its own" in again
    grasps = robot.call("/rtask/recall_grasps", object=one["object"])["grasps"]
    assert len(grasps) == 1
    assert set(grasps[0]["grasp_posture"]) == {"header", "joint_names", "points"}
    assert grasps[0]["statistics"]["attempts"] == 1


def test_a_cancelled_goal_ends_at_its_first_feedback(robot, taught, gripper, stamp):
    robot("show", stamp=stamp, tf_stamp=stamp)
    for _ in range(10):  # a robot that gets no processor cancels what has succeeded meanwhile
        seen = robot("see", goal={"gripper_id": gripper}, since=stamp, cancel=True)
        if seen["state"] != SUCCEEDED:
            break
    assert (seen["state"], seen["feedback"]) == (PREEMPTED, [1])
    assert robot("see", goal={"gripper_id": gripper})["state"] == SUCCEEDED


def test_an_error_of_the_server_is_told_with_the_object(robot, registered, stamp):
    robot("show", stamp=stamp, tf_stamp=stamp)
    seen = robot("see", goal={"gripper_id": "no-such-hand"}, since=stamp)
    assert seen["state"] == SUCCEEDED
    assert {one["task_response"] for one in seen["result"]["objects"]} == {"error"}
    assert "no-such-hand" in seen["result"]["objects"][0]["error"]


def test_what_is_no_longer_seen_leaves_the_scene_of_moveit(robot, taught, gripper, stamp):
    """Of an unknown hand nothing is asked, so that the same things are unknown afterwards."""
    robot("show", stamp=stamp, tf_stamp=stamp)
    known = robot("see", goal={"gripper_id": gripper}, since=stamp)["result"]["objects"]
    robot("listen", topic="/rtask/planning_scene", type="moveit_msgs/PlanningScene")
    robot("see", goal={"gripper_id": "no-such-hand"}, since=stamp)
    expected = sorted([
        *((one["object"], 1) for one in known),
        ("rtask/unknown-1", 0), ("rtask/unknown-2", 0), ("rtask/table", 0),
    ])  # fmt: skip
    told: list[tuple[str, int]] = []
    for count in (1, 2, 3):  # scenes follow results: the latched one may be of an earlier look
        scene = robot("hear", topic="/rtask/planning_scene", count=count)
        told = sorted((one["id"], one["operation"]) for one in scene["world"]["collision_objects"])
        if told == expected:
            break
    assert told == expected


def test_the_camera_is_never_taken_from_another_time(robot, gripper, stamp):
    robot("show", stamp=stamp)
    seen = robot("see", goal={"gripper_id": gripper}, since=stamp)
    assert seen["state"] == ABORTED
    missing = f"no transform from camera_optical to base_footprint at {stamp:.3f} s"
    assert missing in seen["text"]


def test_a_cloud_without_colours_is_refused_with_what_to_publish(robot, gripper, stamp):
    robot("show", stamp=stamp, tf_stamp=stamp, colour=False)
    seen = robot("see", goal={"gripper_id": gripper}, since=stamp)
    assert seen["state"] == ABORTED
    assert "has no colours" in seen["text"]


def test_a_cloud_that_does_not_come_is_an_error_that_names_the_topic(robot, gripper, stamp):
    seen = robot("see", goal={"gripper_id": gripper}, since=stamp)
    assert seen["state"] == ABORTED
    expected = f"no cloud since {stamp:.3f} s came on /camera/points within 5 s"
    assert expected in seen["text"]


def test_the_segmentation_service_cuts_a_cloud(robot, stamp):
    found = robot("segment", stamp=stamp, tf_stamp=stamp)
    assert (found["status"], found["frame"], len(found["points"])) == ("ok", "base_footprint", 2)
    assert abs(found["table"] - 0.27) < 0.005
    assert min(found["points"]) > 500


def test_changes_of_the_graph_are_a_topic(robot, node):
    robot("listen", topic="/rtask/changes", type="rtask_msgs/Change")
    robot("connect", topic="/rtask/changes")
    # The node starts to follow with the first subscriber, on a connection of its own.
    for number in range(20):
        robot.call("/rtask/register_robot", name=f"r-{number}", model="nao", end_effectors=[HAND])
        change = robot("hear", topic="/rtask/changes", wait_s=1.0)
        if change is not None:
            break
    assert change is not None
    assert change["added"] > 0
    assert change["graphs"][0].rpartition("/")[2].startswith("r-")


def test_a_cloud_message_is_searched_for_as_it_is(robot, taught):
    answer = robot("search", stamp=1.0)
    assert "similar_objects" in answer, answer


def shelf_over(box, name="shelf"):
    """Return a board over an object, as MoveIt has it: no hand comes from above."""
    place = {**box["pose"]["position"], "z": 0.27 + box["size"]["z"] + 0.03}
    return {
        "header": {"frame_id": "base_footprint"}, "id": name,
        "pose": {"position": place, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        "primitives": [{"type": 1, "dimensions": [0.16, 0.16, 0.01]}],
    }  # fmt: skip


def test_grasps_keep_clear_of_what_moveit_knows_and_touch_what_its_matrix_allows(
    robot, taught, gripper, stamp
):
    asked = {"goal": {"gripper_id": gripper, "propose": True}, "since": stamp}
    robot("show", stamp=stamp, tf_stamp=stamp)
    free = robot("see", **asked)["result"]["objects"]
    assert all(one["grasps"] for one in free)
    for one in free:
        assert one["grasps"][0]["allowed_touch_objects"] == [one["object"], "rtask/table"]
    shelf = shelf_over(next(one for one in free if one["name"] == "soap"))
    robot("move_group", scene={"world": {"collision_objects": [shelf]}})
    hemmed = {one["name"]: one for one in robot("see", **asked)["result"]["objects"]}
    assert hemmed["soap"]["grasps"] == [], "there is no room for a hand over it"
    assert hemmed["tea"]["grasps"]
    defaults = {"default_entry_names": ["shelf"], "default_entry_values": [True]}
    world = {"collision_objects": [shelf]}
    robot("move_group", scene={"world": world, "allowed_collision_matrix": defaults})
    again = {one["name"]: one for one in robot("see", **asked)["result"]["objects"]}
    assert again["soap"]["grasps"], "what may be touched is no obstacle"
    bad = {**shelf, "primitives": [{"type": 1, "dimensions": [0.0, 1.0, 1.0]}]}
    lost = {**shelf, "id": "rack", "header": {"frame_id": "cell"}}
    robot("move_group", scene={"world": {"collision_objects": [bad, lost]}})
    seen = robot("see", **asked)
    assert (seen["state"], seen["feedback"]) == (ABORTED, [])
    assert "shelf: a box of [0.0, 1.0, 1.0]; expected 3 positive dimensions" in seen["text"]
    assert "rack: no transform from cell to base_footprint" in seen["text"]
    robot("move_group", scene={})


def test_the_task_constructor_gets_poses_with_costs_and_may_touch_that_object(
    robot, taught, gripper, stamp
):
    robot("show", stamp=stamp, tf_stamp=stamp)
    several = robot("sample", name="/rtask/sample_grasp_poses")
    assert several["state"] == ABORTED
    assert several["grasp_state"].startswith("2 objects in view (")
    assert "is called 'spoon'" in robot("sample", name="spoon")["grasp_state"]
    sampled = robot("sample", name="tea")
    assert sampled["state"] == SUCCEEDED, sampled
    told, *again = sampled["feedback"]  # the first may have come before the goal was accepted
    assert again in ([], [told])
    assert len(told["grasp_candidates"]) == len(told["costs"]) > 0
    assert sampled["grasp_state"].startswith(f"{len(told['costs'])} grasps of tea")
    assert told["costs"] == sorted(told["costs"])
    assert all(0 <= cost <= 1 for cost in told["costs"])
    assert {pose["header"]["frame_id"] for pose in told["grasp_candidates"]} == {"base_footprint"}
