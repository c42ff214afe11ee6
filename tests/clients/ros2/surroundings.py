"""Clauses on what surrounds the objects: MoveIt's planning scene, and the world of the graph."""

from __future__ import annotations

import queue

from tests.clients.ros2.grasping import sample
from tests.clients.ros2.programs import NAMESPACE, WAIT_S
from tests.clients.ros2.registry import ABORTED, SUCCEEDED, clause
from tests.clients.ros2.robot import latched, set_fields
from tests.clients.ros2.views import show, since

SPACE = "/with_moveit"
FINGERS = ["l_finger", "r_finger"]


def pairs_of(matrix):
    """Return the pairs of names that an allowed collision matrix lets touch."""
    names = list(matrix.entry_names)
    return {
        frozenset((a, b))
        for a, row in zip(names, matrix.entry_values, strict=True)
        for b, is_allowed in zip(names, row.enabled, strict=True)
        if is_allowed
    }


def move_group(shell, scene):
    """Offer the planning scene that is now in a list, as a move_group does; return the service."""
    from moveit_msgs.srv import GetPlanningScene

    def answer(request, response):
        response.scene = scene[-1]
        return response

    return shell.robot.node.create_service(GetPlanningScene, f"{SPACE}/get_planning_scene", answer)


@clause("MoveIt's scene is read before a goal; its matrix returns with what the hand may touch")
def _(shell):
    from moveit_msgs.msg import PlanningScene

    show(shell, 280.0)
    unread = set_fields(PlanningScene(), {"world": {"collision_objects": [
        {"id": "shelf", "header": {"frame_id": "base_footprint"}}]}})  # fmt: skip
    matrix = {"entry_names": ["arm", "base"],
              "entry_values": [{"enabled": [False, True]}, {"enabled": [True, False]}]}  # fmt: skip
    known = set_fields(PlanningScene(), {"allowed_collision_matrix": matrix})
    scene = [unread]
    service = move_group(shell, scene)
    node = shell.start_node("--gripper", "hand", namespace=SPACE,
                            ros=("-p", f"hand_links:=[{', '.join(FINGERS)}]"))  # fmt: skip
    try:
        asked = {"header": since(280.0), "gripper_id": shell.gripper, "propose": True}
        status, result, _ = shell.robot.see_again(namespace=SPACE, **asked)
        assert (status, "shelf: it has no shapes" in result.refused) == (ABORTED, True), (
            result.refused
        )
        scene.append(known)
        status, result, _ = shell.robot.see_again(namespace=SPACE, **asked)
        assert status == SUCCEEDED, result.refused
        status, words, _ = sample(shell, "soap", SPACE)
        assert status == SUCCEEDED, words
        told = shell.robot.hear(f"{SPACE}/rtask/planning_scene", PlanningScene, latched())
        pairs = pairs_of(told.get(timeout=WAIT_S).allowed_collision_matrix)
        soap = next(entry.object for entry in result.objects if entry.name == "soap")
        assert frozenset(("arm", "base")) in pairs, pairs
        assert {frozenset((link, soap)) for link in FINGERS} <= pairs, pairs
        tea = next(entry.object for entry in result.objects if entry.name == "tea")
        assert not {frozenset((link, tea)) for link in FINGERS} & pairs, pairs
    finally:
        node.end()
        shell.robot.node.destroy_service(service)


@clause("what is where is latched as markers: each thing with its name")
def _(shell):
    from visualization_msgs.msg import MarkerArray

    heard = shell.robot.hear(f"{NAMESPACE}/rtask/world", MarkerArray, latched())
    names = set()
    for _ in range(5):  # the first may be of before the things were seen
        try:
            markers = heard.get(timeout=WAIT_S / 2).markers
        except queue.Empty:
            break
        names = {marker.text.partition(" ")[0] for marker in markers if marker.text}
        if {"soap", "tea"} <= names:
            break
    assert {"soap", "tea"} <= names, names
