"""MoveIt's planning scene and the Task Constructor in the node, with a stand-in for rclpy."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp.messages import pose_message
from rtask.cli.ros.schema import engine_schema
from rtask.client.base import RULES
from rtask.interop.ros.convert import fill, make_message
from rtask.interop.ros.looking import Look, ViewedObject
from rtask.interop.ros.operations import OperationHandler
from rtask.ros2.contract import Contract
from rtask.ros2.node import GraphNode, NodeOptions
from tests.rtask.ros2.standin import World, install

pytest.importorskip("rosbags")
CONTRACT = Contract(engine_schema(), RULES)
WAIT_S = 60.0
SIDES = (0.05, 0.05, 0.08)
HAND = ["l_finger", "r_finger"]


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> World:
    made = World(engine_schema())
    install(made, lambda name, module: monkeypatch.setitem(sys.modules, name, module))
    return made


class Server:
    """Answers as a server does that knows two objects; notes what it was asked."""

    waiting = 0

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []

    def call(self, operation: str, /, **request: Any) -> dict[str, Any]:
        self.asked.append(request)
        name = f"thing-{len(self.asked) % 2}"
        grasps = [
            {"id": str(k), "grasp_quality": quality, "grasp_pose": {
                "header": {"frame_id": "base_footprint", "stamp": {"secs": 0, "nsecs": 0}},
                "pose": pose_message(np.eye(4))}}
            for k, quality in enumerate((0.4, 0.9))
        ]  # fmt: skip
        return {
            "task_response": "grasp", "task_id": "t", "object": f"https://example.org/{name}",
            "label": name, "class": "box", "class_iri": "https://example.org/Box",
            "confidence": 0.9, "recognition": {"matches": []}, "grasps": grasps,
        }  # fmt: skip

    def close(self) -> None:
        pass


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Server:
    made = Server()
    monkeypatch.setattr(GraphNode, "open_client", lambda node: made)
    monkeypatch.setattr(OperationHandler, "__init__", lambda *args: None)
    return made


def view(count: int) -> Look:
    """Return a look at so many objects in a row, 0.3 m apart."""
    middles = [np.eye(4) for _ in range(count)]
    for place, middle in enumerate(middles):
        middle[:3, 3] = 0.3, 0.3 * place, 0.29
    seen = tuple(ViewedObject(pose_message(middle), SIDES, "", []) for middle in middles)
    stamp = make_message("builtin_interfaces/Time")
    return Look(stamp, pose_message(np.eye(4)), "ok", 0.25, None, seen)


@pytest.fixture
def start(world: World, server: Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Return what starts a node that sees so many objects."""
    nodes = []

    def begin(count: int = 1, **parameters: Any) -> GraphNode:
        world.parameters.update(parameters)
        monkeypatch.setattr("rtask.ros2.seeing.Eyes.look", lambda eyes, since: view(count))
        # Messages of the stand-in have no constants, which markers are made of.
        monkeypatch.setattr("rtask.ros2.seeing.markers", lambda *given: None)
        node = GraphNode(NodeOptions("rtask_node", "http://nowhere", timeout_s=1.0), CONTRACT)
        nodes.append(node)
        assert node.node.trigger_configure() == "success", node.trouble
        assert node.node.trigger_activate() == "success"
        return node

    yield begin
    for node in nodes:
        node.close()


def scene(*objects: Any, **fields: Any) -> Any:
    given = {"world": {"collision_objects": list(objects)}, **fields}
    return fill(make_message("moveit_msgs/PlanningScene"), given, make_message)


def board(name: str = "shelf", frame: str = "base_footprint") -> dict[str, Any]:
    middle = np.eye(4)
    middle[:3, 3] = 0.3, 0.0, 0.36
    return {
        "header": {"frame_id": frame}, "id": name, "pose": pose_message(middle),
        "primitives": [{"type": 1, "dimensions": [0.2, 0.2, 0.01]}],
    }  # fmt: skip


def goal(world: World, action: str, **fields: Any) -> Any:
    handle = world.actions[action].send(**fields)
    assert handle is not None
    assert handle.ended.wait(WAIT_S)
    return handle


def test_without_a_move_group_nothing_is_added(world, server, start):
    start()
    handle = goal(world, "rtask/see")
    assert (handle.status, server.asked[0]["neighbours"]) == ("succeeded", [])
    assert list(handle.result.scene_notes) == []


def test_what_the_scene_holds_is_asked_about_and_what_is_heard_serves_where_nobody_offers_it(
    world, server, start
):
    start()
    world.planning_scene = scene(board())
    goal(world, "rtask/see")
    points = np.array(server.asked[-1]["neighbours"])
    assert len(points) <= 500
    assert np.abs(points[:, 2] - 0.36).max() < 0.012
    world.planning_scene = None
    change = scene(board())
    change.is_diff = True
    world.publish("monitored_planning_scene", change)
    handle = goal(world, "rtask/see")
    assert server.asked[-1]["neighbours"]
    assert "only changes" in handle.result.scene_notes[0]


def test_the_scene_can_be_left_aside(world, server, start):
    world.planning_scene = scene(board())
    start(use_planning_scene=False)
    goal(world, "rtask/see")
    assert server.asked[0]["neighbours"] == []


def test_a_scene_that_cannot_be_read_and_one_that_does_not_come_start_nothing(
    world, server, start, monkeypatch
):
    monkeypatch.setattr("rtask.ros2.transforms._WAIT_S", 0.1)
    start()
    for given, words in (
        (scene(board(frame="cell")), "shelf: no transform from cell to base_footprint"),
        (scene({**board(), "primitives": []}), "shelf: it has no shapes"),
        ("silent", "get_planning_scene is offered and did not answer within 0.1 s"),
    ):
        answer_s = 0.1 if given == "silent" else WAIT_S  # only for what never comes
        monkeypatch.setattr("rtask.ros2.scene._ANSWER_S", answer_s)
        world.planning_scene = given
        handle = goal(world, "rtask/see")
        assert (handle.status, server.asked) == ("aborted", [])
        assert words in handle.result.refused


def matrix(names: list[str], allowed: list[tuple[str, str]]) -> dict[str, Any]:
    rows = [[(a, b) in allowed or (b, a) in allowed for b in names] for a in names]
    return {"entry_names": names, "entry_values": [{"enabled": row} for row in rows]}


def entries(message: Any) -> set[frozenset[str]]:
    names = list(message.entry_names)
    rows = [list(row.enabled) for row in message.entry_values]
    return {
        frozenset((a, b)) for a, row in zip(names, rows, strict=True)
        for b, is_allowed in zip(names, row, strict=True) if is_allowed
    }  # fmt: skip


def test_the_whole_matrix_goes_back_with_what_the_hand_is_to_touch(world, server, start):
    own = matrix(["arm", "base", "thing-0"], [("arm", "base")])
    world.planning_scene = scene(allowed_collision_matrix=own)
    start(2, hand_links=HAND)
    changes = world.publishers["rtask/planning_scene"].messages
    goal(world, "rtask/see")
    former = {frozenset(("arm", "base"))}
    assert entries(changes.get().allowed_collision_matrix) == former, "which of two is not known"
    for target in ("thing-1", "thing-0"):
        sampled = goal(world, "rtask/sample_grasp_poses", action_name=target)
        assert sampled.status == "succeeded", sampled.result
        told = entries(changes.get().allowed_collision_matrix)
        touched = {frozenset((link, f"https://example.org/{target}")) for link in HAND}
        assert told == former | touched
        world.planning_scene = scene(allowed_collision_matrix=changes_of(told))


def changes_of(pairs: set[frozenset[str]]) -> dict[str, Any]:
    """Return the matrix that MoveIt has after a change."""
    names = sorted({name for pair in pairs for name in pair})
    return matrix(names, [tuple(sorted(pair)) for pair in pairs])


@pytest.mark.parametrize("known", [False, True])
def test_no_matrix_goes_out_where_the_former_or_the_hand_is_not_known(world, server, start, known):
    if known:
        world.planning_scene = scene(allowed_collision_matrix=matrix(["arm", "base"], []))
    start(hand_links=[""] if known else HAND)
    goal(world, "rtask/see")
    change = world.publishers["rtask/planning_scene"].messages.get()
    assert list(change.allowed_collision_matrix.entry_names) == []


def test_sampled_grasps_come_best_first_each_with_its_cost(world, server, start):
    start()
    handle = goal(world, "rtask/sample_grasp_poses", action_name="rtask/sample_grasp_poses")
    assert (handle.status, handle.result.grasp_state) == ("succeeded", "2 grasps of thing-1")
    first, again = handle.feedback
    assert first is again, "the stage takes them from feedback alone"
    assert [round(float(cost), 6) for cost in first.costs] == [0.1, 0.6]
    assert len(first.grasp_candidates) == 2
    assert server.asked[0]["propose"]


def test_sampling_says_which_objects_there_are_where_none_is_named(world, server, start):
    start(2)
    handle = goal(world, "rtask/sample_grasp_poses")
    assert handle.status == "aborted"
    assert "2 objects in view (thing-1, thing-0); name one" in handle.result.grasp_state
    world.parameters["grasp_target"] = "https://example.org/thing-0"
    handle = goal(world, "rtask/sample_grasp_poses")
    assert (handle.status, handle.result.grasp_state) == ("succeeded", "2 grasps of thing-0")
    wrong = goal(world, "rtask/sample_grasp_poses", action_name="spoon")
    assert "nothing in view is called 'spoon'" in wrong.result.grasp_state


def test_a_goal_of_the_other_action_ends_the_former(world, server, start, monkeypatch):
    start()
    may_look = threading.Event()
    see = world.actions["rtask/see"]

    def look(eyes: Any, since: Any) -> Look:
        may_look.wait(WAIT_S)
        return view(1)

    monkeypatch.setattr("rtask.ros2.seeing.Eyes.look", look)
    first = see.send()
    second = world.actions["rtask/sample_grasp_poses"].send()
    assert first.ended.wait(WAIT_S)
    assert first.status == "aborted"
    may_look.set()
    assert second.ended.wait(WAIT_S)
    assert second.status == "succeeded"
