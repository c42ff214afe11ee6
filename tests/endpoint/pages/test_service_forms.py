"""Every method of every built-in service is called through its form, with values that work."""

from __future__ import annotations

import base64
import html
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing
from typing import Any

import httpx
import numpy as np
import pytest

from features.codec import encode_cloud
from grasp.push import PushTest, Tolerance, as_part, sample_grasps
from grasp.push.parts import stand_in
from grasp.push.trials import Trials
from rtask.services.builtin.push_trials import request_of
from simulate.robots import describe
from tests.clients.test_closed_loop import HAND, LOOKING_DOWN, SIGHT, seen_from_above
from tests.rtask.tasks.conftest import BASE, LAB
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

CUBE = b"".join(
    b"v %d %d %d\n" % (x, y, z) for x in (0, 30) for y in (0, 30) for z in (0, 30)
) + b"".join(
    b"f %d %d %d\n" % face
    for face in ((1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2), (3, 4, 8),
                 (3, 8, 7), (1, 3, 7), (1, 7, 5), (2, 6, 8), (2, 8, 4))
)  # fmt: skip
_TYPED = {"position", "$ref", "vertex_pushes"}
"""Members of values that are typed as JSON: poses, references, parameters of a test."""
ARM = {"$data.robot": "robots/PlanarArm", "manipulator": "arm"}


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


class Forms:
    """The forms of a server's services, filled in and sent as a browser does."""

    def __init__(self, server: RunningServer) -> None:
        self.url = server.url
        self.commits: Counter[str] = Counter()
        self.page = ""
        self.client = httpx.Client(headers={"Accept": "text/html"}, timeout=120)

    def close(self) -> None:
        self.client.close()

    def call(self, name: str, files: Mapping[str, bytes] | None = None, /, **values: Any) -> Any:
        """Call a method ``namespace/Service/method`` and return the answer that its page shows."""
        service, _, method = name.rpartition("/")
        address = f"{self.url}/services/{service}"
        shown = self.client.get(address, params={"$method": method}).text
        fields = set(re.findall(r'name="([^"]+)"', shown))
        data = dict(_flat("", values))
        # What a list repeats has one field on the page until one asks for more.
        assert {re.sub(r"\.\d+\.", ".0.", one) for one in (*data, *(files or ()))} <= fields
        sent = {one: (one, content) for one, content in (files or {}).items()}
        before = self._last_commit()
        answer = self.client.post(address, data={"$method": method, **data}, files=sent or None)
        assert answer.status_code == 200, (name, _words(answer.text))
        self.commits[name] += self._last_commit() - before
        self.page = answer.text
        found = re.search(r"data-json[^>]*>(.*?)</", answer.text, re.DOTALL)
        assert found, name
        return json.loads(html.unescape(found[1]))

    def refused(self, name: str, status: int, /, **values: str) -> list[str]:
        """Call a method that this server cannot carry out; return what its page says."""
        service, _, method = name.rpartition("/")
        address, before = f"{self.url}/services/{service}", self._last_commit()
        answer = self.client.post(address, data={"$method": method, **values})
        assert answer.status_code == status
        self.commits[name] += self._last_commit() - before
        return _words(answer.text)

    def _last_commit(self) -> int:
        return int(self.client.get(f"{self.url}/health").json()["seq"])


def _flat(place: str, value: Any) -> Iterator[tuple[str, str]]:
    """Name each value as its field in a form is named; what has no fields is typed as JSON."""
    if isinstance(value, dict) and not (place and _TYPED & value.keys()):
        for name, one in value.items():
            yield from _flat(f"{place}.{name}".lstrip("."), one)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for number, one in enumerate(value):
            yield from _flat(f"{place}.{number}", one)
    else:
        yield place, value if isinstance(value, str) else json.dumps(value)


def _words(page: str) -> list[str]:
    return [html.unescape(one) for one in re.findall(r'role="alert">([^<]*)', page)]


def _plan_and_move(forms: Forms) -> None:
    """Call the services that compute: grasps, postures, paths, clouds, meshes."""
    square = [[0, 0], [0.06, 0], [0.06, 0.03], [0, 0.03]]
    assert len(forms.call("example/Grasping/plan", polygon=square, grasps=3)["grasps"]) == 3
    kinematics = "example/Kinematics"
    pose = forms.call(f"{kinematics}/forwardKinematics", joints=[0.4, 0.9, -0.6], **ARM)["pose"]
    assert forms.call(f"{kinematics}/inverseKinematics", pose=pose, **ARM)["solutions"]
    assert forms.call(f"{kinematics}/linkPoses", joints=[0.4, 0.9, -0.6], **ARM)
    assert forms.call(f"{kinematics}/describe", **{"$data.robot": "robots/Point"})
    model = httpx.get(f"{forms.url}/datasets/robots/PlanarArm@1/files/model").content
    assert forms.call(f"{kinematics}/read", {"urdf": model})
    ways = {"start": [-2, 0, 0], "goal": [1, 0, 0]}
    path = forms.call("example/Trajopt/plan", **ways, **ARM)["path"]
    for method in ("check", "smooth", "time", "trace"):
        assert forms.call(f"example/Trajopt/{method}", path=path, **ARM)
    cloud = encode_cloud(np.random.default_rng(0).uniform(-0.1, 0.1, (500, 3)).astype(np.float32))
    found = forms.call("rtask/Segmentation/segment", {"cloud": cloud})
    assert found["status"] == "no_table"
    view = {"cloud": base64.b64decode(seen_from_above(seed=7, noise_seed=1))}
    assert forms.call("rtask/Segmentation/perceive", view, sensor_pose=LOOKING_DOWN)["status"]
    placed = {"views.0.cloud": view["cloud"]}
    views = [{"sensor_pose": LOOKING_DOWN}]
    assert forms.call("rtask/Segmentation/segment_views", placed, views=views)["status"]
    joints = [one.name for one in describe("panda").joints if one.kind != "fixed"]
    body = {"$data.robot": "robots/Panda", "joint_names": "\n".join(joints)}
    place = {"joint_positions": [0.0] * len(joints), "root_from_camera": LOOKING_DOWN}
    assert forms.call("rtask/SelfFilter/remove", {"cloud": cloud}, **body, **place)
    mesh = {"kind": "obj", "samples": 5, "grasps": 2}
    assert forms.call("rtask/SpacePlans/plan", {"mesh": CUBE}, **mesh)
    shard = {"shard": request_of(_trials()), "first": 0, "count": 2}
    assert forms.call("rtask/PushTrials/run", **shard)["codes"]
    assert forms.call("rtask/PushTrials/count", **shard)
    shard["shard"]["rows"] = shard["shard"]["rows"][:1]
    spread = {"position_std": [0.1], "rotation_std": [0.1], "samples": 3}
    assert forms.call("rtask/PushTrials/pose", **shard, **spread)
    steps = [{"id": "hand", "call": f"{kinematics}/describe"}]
    assert forms.call("rtask/Pipeline/run", steps=steps, output={"$ref": "hand"})
    robot = {"name": "piped", "model": "nao", "end_effectors": [HAND]}
    writing = [{"id": "robot", "call": "rtask/Engine/register_robot", "inputs": json.dumps(robot)}]
    assert forms.call("rtask/Pipeline/run", steps=writing, output={"$ref": "robot"})
    saved = {"pipeline": "lab/Described", "steps": steps, "output": '{"told": {"$ref": "hand"}}'}
    version = forms.call("rtask/Pipeline/save", **saved)["version"]
    assert "lab/Described" in json.dumps(forms.call("rtask/Pipeline/saved_pipelines"))
    forms.call("rtask/Pipeline/remove", pipeline="lab/Described", version=version)


def _trials() -> Trials:
    part = as_part(stand_in("A"))
    tolerance = Tolerance(0.045 * part.radius, 0.08 * part.radius, (0.01, 0.1))
    test = PushTest(0.25 * part.diameter)
    return Trials.of(part, sample_grasps(part), test, tolerance, 3)


def _remember(forms: Forms) -> None:
    """Call the operations of the shared memory, in the order in which a robot and people do."""

    def ask(method: str, files: Mapping[str, bytes] | None = None, /, **values: Any) -> Any:
        return forms.call(f"rtask/Engine/{method}", files, **values)

    ask("register_robot", name="nao-1", model="nao", end_effectors=[HAND])
    seen = base64.b64decode(seen_from_above(seed=7, noise_seed=1))
    met = {"gripper_id": "right_hand", "name": "tea tin", "X": 0.2, "Y": 0, "Z": 0.32, "rad": 0.1}
    known = {**met, **SIGHT, "success": True, "confirmed_by": "physics"}
    (stored,) = ask("insert_object", {"objects.0.data": seen}, objects=[known])["objects"]
    again = {"data": base64.b64decode(seen_from_above(seed=7, noise_seed=2, shift_px=9))}
    similar = ask("search_object", again, **SIGHT)["similar_objects"][0]
    assert f'src="/api/blobs/{similar["picture"]}"' in forms.page
    assert ask("recognise_for_grasp", again, gripper_id="right_hand", **SIGHT)
    thing = stored["object"]
    (grasp,) = ask("recall_grasps", object=thing)["grasps"]
    assert ask("recall_motions", object=thing, gripper_id="right_hand")["motions"] == []
    ask("report_outcome", object=thing, grasp=grasp["id"], gripper_id="right_hand", success="false")
    asked = {"gripper_id": "right_hand", "min_grasp": 1, **SIGHT}
    refused = ask("recognise_for_grasp", again, **asked)["decision"]["refusal"]
    assert ask("report_refusal", refusal=refused, response="left_alone")["stored"] == 1
    assert ask("plan_in_space", object=thing, gripper_id="right_hand") is not None
    assert ask("plan_on_scene", again, gripper_id="right_hand", **SIGHT) is not None
    assert ask("reconstruct_mesh", object=thing)["mesh"]
    assert ask("resolve_request", wanted="tin", gripper_id="right_hand") is not None
    assert ask("where_is", name="tea tin") is not None
    said = {"verdict": "confirm", "object": thing, "grasp": grasp["id"], "operator": "ann"}
    ask("give_feedback", **said)
    ask("teach_object", again, operation="search", class_description="tin", **SIGHT)
    ask("curate_object", operation="forget", object=thing, operator="ann")
    assert ask("compare_contributors")["contributors"]
    ask("withdraw_contributor", contributor="nao-1")
    httpx.post(
        f"{forms.url}/update", data={"update": LAB.replace(BASE, "urn:lab/")}, timeout=60
    ).raise_for_status()
    plan = ask("plan_goal", goal="every cup into the left box")
    prices = {"asking_price": 1, "failing_price": 60}
    stored = ask("store_plan", goal=plan["goal"], digest=plan["digest"], **prices)["task"]
    panda = {"robot": "urn:lab/robot/panda-1"}
    step = ask("claim_step", **panda)["task"]
    choices = [{"code": code, "text": code} for code in ("try", "leave")]
    unsure = {"kind": "act", "text": "shall I?", "choices": choices, "chance": 0.0}
    asked = ask("ask_person", task=step, **unsure, **panda)["question"]
    assert [one["question"] for one in ask("list_questions")["questions"]] == [asked]
    assert ask("answer_question", question=asked, choice=1)["commit"]
    assert ask("claim_step", **panda)["answer"]["code"] == "try"
    assert ask("end_step", task=step, result="done", **panda)
    assert ask("explain_failure", subject=stored)["text"]
    for method, more in (("try_changes", {}), ("keep_change", {"branch": "best"})):
        said = forms.refused(f"rtask/FailureTrials/{method}", 501, subject=stored, **more)
        assert said == ["a branch needs a graph in a folder; this one is not in any"]
    assert ask("state_place", thing="urn:lab/thing/3", place="urn:lab/place/right")["commit"]
    assert ask("state_reach", place="urn:lab/place/left", **panda)["commit"]
    assert ask("state_frame", frame="table")["commit"]
    pose = {"position": dict.fromkeys("xyz", 0.5), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    seen = [{"object": "urn:lab/object/1", "pose": pose}]
    (cup,) = ask("report_sightings", frame="table", seen=seen)["things"]
    assert ask("trace_thing", name=cup)["places"]
    assert ask("show_world")["nodes"]
    assert ask("locate_frame", frame="table")["known"]
    assert [one["state"] for one in ask("list_plans")["plans"]] == ["running"]
    assert ask("cancel_plan", plan=stored, reason="enough")["commit"]


def test_every_method_of_every_service_is_called_by_its_form_and_does_what_it_declares(
    server: RunningServer,
) -> None:
    with closing(Forms(server)) as forms:
        _plan_and_move(forms)
        _remember(forms)
    listed = httpx.get(f"{server.url}/services", timeout=60).json()["services"]
    effects = {
        f"{one['name']}/{name}": method["effect"]
        for one in listed
        for name, method in httpx.get(f"{server.url}/services/{one['name']}")
        .json()["methods"]
        .items()
    }
    assert forms.commits.keys() == effects.keys(), "a method is not called; call it here"
    reading = {name for name, effect in effects.items() if effect == "reads"}
    committing = {name for name, count in forms.commits.items() if count}
    assert not reading & committing
    assert committing >= {name for name in effects.keys() - reading if _is_watched_here(name)}


def _is_watched_here(name: str) -> bool:
    """Whether a method that writes must commit when it is called above.

    Each operation of the engine is shown to commit in ``tests/rtask/engine/test_effects.py``; what
    keeps pipelines writes datasets, which are beside the graph, and trials write branches alone.
    """
    is_beside = name in (
        "rtask/Pipeline/save", "rtask/Pipeline/remove", "rtask/FailureTrials/keep_change",
    )  # fmt: skip
    return not is_beside and not name.startswith("rtask/Engine/")
