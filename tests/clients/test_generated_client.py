"""A client that a public generator makes of the OpenAPI document calls every operation.

The generator is openapi-python-client, which nobody here wrote: what it cannot read, it skips with
a warning, and other generators would trip over the same places.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx
import pytest
from openapi_spec_validator import validate

from tests.clients.test_closed_loop import ROBOT, SIGHT, seen_from_above
from tests.rtask.tasks.conftest import BASE, LAB
from tests.servers import RunningServer

pytestmark = pytest.mark.slow

PACKAGE = "generated_rtask_client"
METHODS = frozenset(("get", "post", "put", "delete", "patch"))


@pytest.fixture(scope="module")
def document(server: RunningServer) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(f"{server.url}/openapi.json").json()
    return found


@pytest.fixture(scope="module")
def generated(
    document: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> tuple[ModuleType, str]:
    """The generated package, and what the generator said."""
    folder = tmp_path_factory.mktemp("generated")
    (folder / "openapi.json").write_text(json.dumps(document))
    programs = str(Path(sys.executable).parent)
    done = subprocess.run(
        [
            *(f"{programs}/openapi-python-client", "generate", "--meta", "none"),
            *("--path", str(folder / "openapi.json"), "--output-path", str(folder / PACKAGE)),
        ],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
        env={**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"},  # it formats with ruff
    )
    sys.path.insert(0, str(folder))
    try:
        return importlib.import_module(f"{PACKAGE}.client"), done.stdout + done.stderr
    finally:
        sys.path.remove(str(folder))


def test_the_document_is_valid(document: dict[str, Any]) -> None:
    validate(document)  # type: ignore[arg-type]


def test_nothing_of_the_document_is_skipped(
    document: dict[str, Any], generated: tuple[ModuleType, str]
) -> None:
    client, said = generated
    assert "arning" not in said, said
    operations = sum(len(METHODS & set(path)) for path in document["paths"].values())
    assert client.__file__ is not None
    made = [
        file
        for file in (Path(client.__file__).parent / "api").glob("*/*.py")
        if file.name != "__init__.py"
    ]
    assert len(made) == operations


class Caller:
    """Calls operations by their generated functions and request classes."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self.called: set[str] = set()

    def __call__(self, operation: str, fields: dict[str, Any]) -> Any:
        """Return the answer as an object of the generated class."""
        models = importlib.import_module(f"{PACKAGE}.models")
        name = "".join(part.title() for part in operation.split("_")) + "Request"
        function = importlib.import_module(f"{PACKAGE}.api.engine.{operation}")
        request = getattr(models, name).from_dict(fields)
        answer = function.sync_detailed(client=self.client, body=request)
        self.called.add(operation)
        assert answer.status_code == 200, (operation, answer.content)
        assert type(answer.parsed).__name__ != "Problem"
        return answer.parsed


def test_every_operation_of_the_engine_is_called(
    server: RunningServer, document: dict[str, Any], generated: tuple[ModuleType, str]
) -> None:
    httpx.post(
        f"{server.url}/update", data={"update": LAB.replace(BASE, "urn:lab/")}, timeout=60
    ).raise_for_status()
    with generated[0].Client(base_url=server.url, timeout=httpx.Timeout(60)) as connected:
        _call_all(Caller(connected), document)


def _call_all(call: Caller, document: dict[str, Any]) -> None:
    call("register_robot", {"name": "generated-1", **ROBOT})
    taken = {"gripper_id": "right_hand", "X": 0.2, "Y": 0.0, "Z": 0.32, "rad": 0.1}
    view = seen_from_above(seed=41, noise_seed=1)
    new = {"data": view, **SIGHT, "name": "generated tin", **taken, "success": True}
    inserted = call("insert_object", {"objects": [{**new, "confirmed_by": "physics"}]})
    [stored] = inserted.objects
    thing = stored.to_dict()["object"]
    again = {"data": seen_from_above(seed=41, noise_seed=2), **SIGHT, "gripper_id": "right_hand"}
    told = call("recognise_for_grasp", again).to_dict()
    outcome = {"task_id": told["task_id"], "grasp": stored.to_dict()["grasp"]}
    moved = {"joints": ["RElbowYaw"], "times": [0, 1], "positions": [0, 0.5], "commands": [0, 0.5]}
    outcome["outcome"] = {"success": True, "motion": moved}
    call("report_outcome", {**outcome, "gripper_id": "right_hand"})
    refused = call("recognise_for_grasp", {**again, "min_grasp": 1.0}).to_dict()["decision"]
    call("report_refusal", {"refusal": refused["refusal"], "response": "left_alone"})
    assert call("recall_grasps", {"object": thing}).to_dict()["grasps"]
    follows = {"gripper_id": "right_hand", "joints": [{"name": "RElbowYaw", "scale": -1}]}
    (moved,) = call("recall_motions", follows).to_dict()["motions"]
    assert (moved["fit"], moved["positions"]) == ("same_body", [-0.0, -0.5])
    assert thing in json.dumps(call("search_object", again).to_dict())
    call(
        "resolve_request",
        {"wanted": "generated tin", "objects": [thing], "gripper_id": "right_hand"},
    )
    assert call("where_is", {"name": thing}).to_dict()["known"]
    call("plan_in_space", {"object": thing, "gripper_id": "right_hand"})
    assert call("reconstruct_mesh", {"object": thing}).to_dict()["seen_share"] < 1
    scene = {name: SIGHT[name] for name in ("sensor_pose", "frame_id")}
    call("plan_on_scene", {"data": view, **scene, "gripper_id": "right_hand"})
    judged = {"task_id": told["task_id"], "verdict": "confirm", "operator": "ann"}
    call("give_feedback", judged)
    call("teach_object", {"operation": "search", "class_description": "box", "data": view})
    call("curate_object", {"operation": "forget", "object": thing})
    assert call("compare_contributors", {"contributor": "generated-1"}).to_dict()["contributors"]
    call("withdraw_contributor", {"contributor": "generated-1"})
    goal = {"goal": "every cup into the left box"}
    plan = call("plan_goal", goal).to_dict()
    prices = {"asking_price": 1, "failing_price": 60}
    stored = call("store_plan", {**goal, **prices, "digest": plan["digest"]}).to_dict()["task"]
    step = call("claim_step", {"robot": "urn:lab/robot/panda-1"}).to_dict()
    offered = [{"code": "go_on", "text": "try it"}, {"code": "leave", "text": "leave it"}]
    unsure = {"task": step["task"], "kind": "act", "text": "shall I?", "choices": offered}
    asked = call("ask_person", {"robot": "urn:lab/robot/panda-1", **unsure, "chance": 0.0})
    (question,) = call("list_questions", {}).to_dict()["questions"]
    assert question["question"] == asked.to_dict()["question"]
    call("answer_question", {"question": question["question"], "choice": 1})
    call("claim_step", {"robot": "urn:lab/robot/panda-1"})
    call("state_place", {"thing": "urn:lab/thing/1", "place": "urn:lab/robot/panda-1/hand"})
    call("state_reach", {"robot": "urn:lab/robot/panda-1", "place": "left box"})
    pose = {"position": dict.fromkeys("xyz", 0.5), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    for more in ({"frame": "map"}, {"frame": "table", "parent": "map", "pose": pose}):
        call("state_frame", more)
    seen = [{"object": "urn:lab/object/1", "pose": pose}]
    (seen_thing,) = call("report_sightings", {"frame": "table", "seen": seen}).to_dict()["things"]
    assert call("trace_thing", {"name": seen_thing}).to_dict()["places"]
    assert call("show_world", {}).to_dict()["frame_id"]
    assert call("locate_frame", {"frame": "table", "target": "map"}).to_dict()["known"]
    call("end_step", {"robot": "urn:lab/robot/panda-1", "task": step["task"], "result": "done"})
    assert call("explain_failure", {"subject": stored}).to_dict()["text"]
    assert [one["state"] for one in call("list_plans", {}).to_dict()["plans"]] == ["running"]
    call("cancel_plan", {"plan": stored, "reason": "enough"})
    assert call.called == {
        path.removeprefix("/engine/") for path in document["paths"] if "/engine/" in path
    }
