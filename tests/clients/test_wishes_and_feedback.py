"""Wishes, decisions and feedback over a real server: near client, HTTP, rosbridge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
import roslibpy

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import Frame, Intrinsics
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

HAND = {"name": "wish_hand", "gripper_type": "nao", "max_opening": 0.05, "max_payload": 0.3}


def sight(seed: int) -> dict[str, Any]:
    """Return a look at a box with a picture of its own, from above."""
    camera = Intrinsics(320, 240, 700.0, 700.0, 159.5, 119.5)
    mask = np.zeros((240, 320), bool)
    mask[100:140, 130:191] = True
    depth = np.where(mask, 0.53, 0.57).astype(np.float32)
    picture = np.random.default_rng(seed).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    return {
        "data": to_wire(encode_frame(Frame(depth, camera, picture, mask).crop(mask))),
        "sensor_pose": {
            "position": {"x": 0.15, "y": 0.0, "z": 0.57},
            "orientation": {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0},
        },
        "frame_id": "base_footprint",
        "support_height": 0.0,
    }


@pytest.fixture(scope="module")
def strict(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """A server that wants grasps to be nearly certain."""
    folder = tmp_path_factory.mktemp("strict") / "store"
    with running_server(folder, "--min-grasp", "0.95") as running:
        yield running


@pytest.fixture(scope="module")
def told(strict: RunningServer) -> dict[str, Any]:
    """Report of a robot: a tin that it held, met as a can."""
    with rtask.connect(strict.url, timeout_s=120) as robot:
        robot.register_robot(name="wish-1", model="nao", end_effectors=[HAND])
        seen = sight(5)
        answer = robot.recognise_for_grasp(gripper_id="wish_hand", propose=True, **seen)
        stored = robot.insert_object(
            objects=[
                {**seen, "gripper_id": "wish_hand", "grasp": answer["grasps"][0],
                 "task_id": answer["task_id"], "name": "tin", "class_description": "can",
                 "outcome": {"success": True, "reason": "ok"}},
            ]
        )  # fmt: skip
        return {**stored["objects"][0], "task_id": answer["task_id"], "seen": seen}


def test_a_wish_is_met_over_http_the_client_and_rosbridge(
    strict: RunningServer, told: dict[str, Any]
) -> None:
    request = {"wanted": "something to drink from", "gripper_id": "wish_hand"}
    over_http = httpx.post(f"{strict.url}/engine/resolve_request", json=request, timeout=120).json()
    with rtask.connect(strict.url, timeout_s=120) as robot:
        near = robot.resolve_request(**request)
    ros = roslibpy.Ros(host="127.0.0.1", port=strict.port)
    ros.run(timeout=60)
    service = roslibpy.Service(ros, "/rtask/resolve_request", "rtask/ResolveRequest")
    over_ros = service.call(roslibpy.ServiceRequest(request), timeout=120)
    unmet = service.call(roslibpy.ServiceRequest({**request, "wanted": "a pen"}), timeout=120)
    ros.close()
    for answer in (over_http, near, over_ros):
        assert answer["object"] == told["object"]
        assert any("hasFunction" in line for line in answer["explanation"]["proof"])
    assert unmet["task_response"] == "unmet"
    assert [one["code"] for one in unmet["reasons"]] == ["not_seen", "none_known"]


def test_the_servers_threshold_decides_unless_the_request_names_one(
    strict: RunningServer, told: dict[str, Any]
) -> None:
    request = {**told["seen"], "gripper_id": "wish_hand"}
    with rtask.connect(strict.url, timeout_s=120) as robot:
        asked = robot.recognise_for_grasp(decide=True, **request)["decision"]
        lenient = robot.recognise_for_grasp(min_grasp=0.5, **request)["decision"]
        silent = robot.recognise_for_grasp(**request)["decision"]
    assert asked is not None
    assert (asked["too_low"], asked["threshold"]) == ("grasp", 0.95)
    assert lenient is not None
    assert lenient["answer"] == "grasp"
    assert silent is None


def test_people_judge_over_every_way_in_and_all_is_kept(
    strict: RunningServer, told: dict[str, Any]
) -> None:
    said = {"task_id": told["task_id"]}
    with rtask.connect(strict.url, timeout_s=120) as person:
        first = person.give_feedback(verdict="refuse", operator="ann", **said)
    assert (first["held"], first["statistics"]["successes"]) == (False, 0)
    request = {**said, "verdict": "confirm", "operator": "bob"}
    tie = httpx.post(f"{strict.url}/engine/give_feedback", json=request, timeout=120).json()
    assert tie["disputed"] is True
    assert [one["by"] for one in tie["verdicts"]] == ["ann", "bob"]
    wrong = {**request, "task_id": told["task_id"][:-1] + "z"}
    refused = httpx.post(f"{strict.url}/engine/give_feedback", json=wrong, timeout=120)
    assert refused.status_code == 422
    assert f"did you mean '{told['task_id']}'" in refused.json()["detail"]


def test_a_robots_token_asks_and_does_not_judge(
    nao_1: httpx.Client, guarded: RunningServer, make_token: Any
) -> None:
    robot = {"name": "nao-1", "model": "nao", "end_effectors": [HAND]}
    assert nao_1.post("/engine/register_robot", json=robot).status_code == 200
    asked = nao_1.post("/engine/resolve_request", json={"wanted": "a can"})
    assert asked.json()["task_response"] == "unmet"
    judged = nao_1.post("/engine/give_feedback", json={"task_id": "urn:x", "verdict": "confirm"})
    assert judged.status_code == 403
    with rtask.connect(guarded.url, token=make_token("--name", "ann", "--role", "teacher")) as ann:
        with pytest.raises(rtask.errors.RtaskError, match="cannot act for 'bob'"):
            ann.give_feedback(verdict="confirm", task_id="urn:x", operator="bob")
        with pytest.raises(rtask.errors.RtaskError, match="nothing to judge"):
            ann.give_feedback(verdict="confirm", task_id="urn:x")
