"""Clauses of the contract of nodes that ROS 2's has as well: body, matrix, newer goal, token."""

from __future__ import annotations

import json

import pytest

from rtask.interop.ros.master import Master
from tests.commands import run_command
from tests.rtask.interop.ros.conftest import running
from tests.rtask.interop.ros.scene import urdf_of
from tests.rtask.interop.ros.test_node import (  # noqa: F401 - fixtures
    HAND,
    PREEMPTED,
    SUCCEEDED,
    gripper,
    registered,
    taught,
)
from tests.servers import running_server

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_a_newer_goal_ends_its_predecessor(robot, stamp):
    robot("show", stamp=stamp, tf_stamp=stamp)
    goal = {"gripper_id": "hand"}
    robot.call("/rtask/register_robot", name="nao-1", model="nao", end_effectors=[HAND])
    # For a view of a later time the first would wait in vain for 5 s.
    ends = robot("see_newer", goal=goal, since=stamp + 50.0, newer_since=stamp)
    assert ends == [PREEMPTED, SUCCEEDED]


def test_what_robot_description_and_tf_say_to_be_the_robot_is_no_object(
    roscore, start_node, robot, ros_server, stamp
):
    Master(roscore.uri).ask("setParam", "/body/robot_description", urdf_of("bin"))
    child = start_node("ros", "node", "__ns:=/body", "--server", ros_server.url)
    with running(child):
        child.expect("ready /body/rtask_node")
        robot("place", link="bin", position=[0.0, 0.0, 2.0])
        seen = robot("segment", stamp=stamp, tf_stamp=stamp, node="/body")
        assert sorted(round(p["y"], 2) for p in seen["positions"]) == [-0.09, 0.09]
        robot("place", link="bin", position=[0.27, 0.09, 0.31])
        for later in range(1, 21):  # nothing tells when the node has the newer transform
            at = stamp + later
            seen = robot("segment", stamp=at, tf_stamp=at, node="/body")
            if len(seen["positions"]) == 1:
                break
        assert [round(p["y"], 2) for p in seen["positions"]] == [-0.09]


@pytest.fixture
def ros_server_without_objects(tmp_path):
    """A server to which no other test has taught the objects of the view."""
    with running_server(tmp_path / "store") as server:
        yield server


def test_the_matrix_of_moveit_returns_with_what_the_hand_may_touch(
    start_node, robot, ros_server_without_objects, stamp
):
    matrix = {"entry_names": ["arm", "base"],
              "entry_values": [{"enabled": [False, True]}, {"enabled": [True, False]}]}  # fmt: skip
    child = start_node(
        "ros", "node", "__ns:=/touch", "--server", ros_server_without_objects.url,
        "--gripper", "hand",
        "~points:=/camera/points", "_hand_links:=[l_finger, r_finger]", "_grasp_target:=unknown-1",
        "get_planning_scene:=/get_planning_scene",
    )  # fmt: skip
    with running(child):
        child.expect("ready /touch/rtask_node")
        about = {"name": "nao-1", "model": "nao", "end_effectors": [HAND]}
        robot.call("/touch/rtask/register_robot", **about)
        robot("move_group", scene={"allowed_collision_matrix": matrix})
        robot("listen", topic="/touch/rtask/planning_scene", type="moveit_msgs/PlanningScene")
        robot("show", stamp=stamp, tf_stamp=stamp)
        asked = {"goal": {"propose": True}, "since": stamp, "node": "/touch"}
        seen = robot("see", **asked)
        assert seen["state"] == SUCCEEDED, seen["text"]
        robot("sample", name="unknown-1", node="/touch")
        told = robot("hear", topic="/touch/rtask/planning_scene", count=2)
        told = told or robot("hear", topic="/touch/rtask/planning_scene")
        robot("move_group", scene={})
    names = told["allowed_collision_matrix"]["entry_names"]
    rows = [row["enabled"] for row in told["allowed_collision_matrix"]["entry_values"]]
    pairs = {
        frozenset((a, b)) for a, row in zip(names, rows, strict=True)
        for b, is_allowed in zip(names, row, strict=True) if is_allowed
    }  # fmt: skip
    assert frozenset(("arm", "base")) in pairs, told
    touched = [pair - {"l_finger"} for pair in pairs if "l_finger" in pair]
    assert len(touched) == 1, pairs
    assert frozenset(("r_finger", *touched[0])) in pairs
    assert touched[0] <= {box["id"] for box in told["world"]["collision_objects"]}


def test_a_token_comes_from_a_file_and_without_one_the_refusal_is_the_answer(
    start_node, robot, tmp_path
):
    folder = tmp_path / "locked"
    made = run_command("token", "create", "--robot", "nao-2", "-d", str(folder), "--json")
    assert made.returncode == 0, made.stderr
    file = tmp_path / "token"
    file.write_text(json.loads(made.stdout)["token"] + "\n")
    about = {"name": "nao-2", "model": "nao", "end_effectors": [HAND]}
    answers = []
    with running_server(folder) as server:
        for space, options in (("/with", ("--token-file", str(file))), ("/without", ())):
            child = start_node("ros", "node", f"__ns:={space}", "--server", server.url, *options)
            with running(child):
                child.expect(f"ready {space}/rtask_node")
                answers.append(robot.call(f"{space}/rtask/register_robot", **about))
    assert answers[0]["robot"].endswith("/nao-2"), answers[0]
    assert "needs scope write" in answers[1]


def test_what_is_where_is_latched_as_markers_with_names(robot, taught, gripper, stamp):  # noqa: F811
    robot("show", stamp=stamp, tf_stamp=stamp)
    seen = robot("see", goal={"gripper_id": gripper}, since=stamp)
    assert seen["state"] == SUCCEEDED, seen["text"]
    robot("listen", topic="/rtask/world", type="visualization_msgs/MarkerArray")
    names = set()
    for count in range(1, 6):  # the first may be of before the things were seen
        shown = robot("hear", topic="/rtask/world", count=count)
        if shown is None:
            break
        names = {marker["text"].partition(" ")[0] for marker in shown["markers"]} - {""}
        if {"soap", "tea"} <= names:
            break
    assert {"soap", "tea"} <= names, names
