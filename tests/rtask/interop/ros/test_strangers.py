"""A ROS 1 node speaks for the robot of its token alone, whichever way a message names another."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from features.codec import encode_frame
from rtask.engine import Engine
from rtask.rdf.namespaces import PREFIXES
from tests.rtask.engine import conftest as bench
from tests.rtask.interop.ros.conftest import Robot, RosMaster, StartNode, running
from tests.rtask.interop.ros.scene import view
from tests.servers import running_server

pytestmark = [pytest.mark.ros, pytest.mark.slow]

HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.09, "max_payload": 0.5}


@dataclass(frozen=True)
class Stranger:
    """The node of one robot, and what belongs to another.

    Parameters
    ----------
    names
        IRIs of the other robot's: ``robot``, ``hand``, ``task``, ``attempt``.
    """

    robot: Robot
    names: dict[str, str]

    def call(self, operation: str, given: dict[str, Any]) -> Any:
        """Call with the names filled in; return the answer, or the refusal as text."""
        return self.robot.call(f"/rtask/{operation}", **self._filled(given))

    def _filled(self, given: Any) -> Any:
        if isinstance(given, str):
            return given.format(**self.names)
        if isinstance(given, dict):
            return {key: self._filled(value) for key, value in given.items()}
        return [self._filled(one) for one in given] if isinstance(given, list) else given


def _fill(folder: Path) -> dict[str, str]:
    """Store what a robot has, by what messages call it."""
    with rtask.open(folder) as kb, Engine(kb) as engine:
        owner = bench.Robot("nao-1", engine)
        bench.Robot("nao-2", engine).register()
        robot = str(owner.register()["robot"])
        seen = bench.sight(bench.BOX)
        refused = owner.recognise(seen, decide=True, min_grasp=1.0)
        asked = owner.recognise(seen)
        stored = owner.insert(
            seen, task_id=asked["task_id"], grasp=asked["grasps"][0], outcome=bench.held(),
            name="tea box",
        )  # fmt: skip
        inserted = stored["objects"][0]
        box = str(inserted["object"])
        kb.update(f"{PREFIXES} INSERT DATA {{ <urn:cup> a rt:Exemplar ; rt:exemplarOf <{box}> }}")
    return {
        "robot": robot,
        "hand": f"{robot}/right_hand",
        "task": str(asked["task_id"]),
        "refusal": str(refused["decision"]["refusal"]),
        "object": box,
        "grasp": str(inserted["grasp"]),
    }


@pytest.fixture(scope="module")
def stranger(
    roscore: RosMaster, start_node: StartNode, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Stranger]:
    folder = tmp_path_factory.mktemp("guarded") / "store"
    names = _fill(folder)
    store = TokenStore(folder)
    token = store.create("robot", agent="nao-2")[0]
    store.close()
    with running_server(folder) as server:
        node = start_node(
            "ros", "node", "--server", server.url, "--gripper", "right_hand", RTASK_TOKEN=token
        )
        with running(node):
            node.expect("ready /rtask_node")
            robot = Robot(roscore)
            with running(robot.child):
                yield Stranger(robot, names)


_VIEW = {"data": encode_frame(view()).hex()}
_MISSED = {"object": "{object}", "success": [False], "reason": "missed"}
_CONFIRMED = {
    "object": "{object}",
    "success": [True],
    "confirmed_by": "human",
    "operator_name": "anna",
}


@pytest.mark.parametrize(
    ("operation", "given"),
    [
        ("register_robot", {"name": "nao-1", "model": "panda", "end_effectors": [HAND]}),
        ("recognise_for_grasp", {**_VIEW, "gripper_id": "{hand}"}),
        ("insert_object", {"objects": [{**_VIEW, "gripper_id": "{hand}"}]}),
        ("insert_object", {"objects": [{**_VIEW, "operator_name": "anna"}]}),
        ("report_outcome", {**_MISSED, "gripper_id": "{hand}"}),
        ("report_outcome", {**_MISSED, "gripper_id": "right_hand", "task_id": "{task}"}),
        ("report_outcome", {**_CONFIRMED, "gripper_id": "right_hand", "grasp": "{grasp}"}),
        ("report_refusal", {"refusal": "{refusal}", "response": "left_alone"}),
        ("state_place", {"thing": "urn:cup", "place": "{hand}"}),
        ("state_place", {"thing": "urn:cup", "lost": True, "agent": "nao-1"}),
        ("state_frame", {"frame": "nao-1/base_footprint", "lost": True}),
        ("state_frame", {"frame": "table", "lost": True, "agent": "nao-1"}),
        ("report_sightings", {"frame": "nao-1/camera_9"}),
        ("report_sightings", {"frame": "table", "agent": "nao-1"}),
        ("claim_step", {"robot": "nao-1"}),
        ("end_step", {"robot": "nao-1", "task": "urn:t", "result": "done"}),
        ("store_plan", {"agent": "nao-1", "goal": "every pen into the left box"}),
        ("cancel_plan", {"operator_name": "nao-1", "plan": "urn:p", "reason": "late"}),
        ("ask_person", {"robot": "nao-1", "task": "urn:t", "kind": "act", "text": "Which?"}),
        ("give_feedback", {"task_id": "{task}", "success": [False], "operator_name": "anna"}),
        ("withdraw_contributor", {"contributor": "nao-1"}),
    ],
)
def test_a_node_speaks_for_the_robot_of_its_token_alone(
    stranger: Stranger, operation: str, given: dict[str, Any]
) -> None:
    refused = stranger.call(operation, given)
    assert isinstance(refused, str), refused
    assert re.search("nao-2.*nao-1|another robot|cannot|may not", refused), refused
