"""A robot that sees a can in physics, has grasps in space planned, tries one and asks again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import connect as open_websocket

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import Frame, look_at
from grasp.messages import matrix_from_message, pose_message
from grasp.spatial.gripper import panda_hand
from simulate.grasping.floating.execution import execute, settle
from simulate.world.camera import Camera
from simulate.world.objects import product, write_assets
from simulate.world.world import World
from tests.servers import RunningServer

PLACE = (0.34, 0.0)
HAND = {
    "name": "panda_hand",
    "gripper_type": "panda_hand",
    "kind": "ParallelJawGripper",
    "max_opening": 0.08,
    "jaw_width": 0.02,
    "finger_length": 0.054,
    "max_payload": 3.0,
}


def look(world: World, body: int, azimuth: float) -> dict[str, Any]:
    """Return what a robot sends about a body that it sees from one side."""
    x, y = PLACE
    eye = np.array([x + 0.35 * np.cos(azimuth), y + 0.35 * np.sin(azimuth), 0.3])
    pose = look_at(eye, np.array([x, y, 0.04]))
    frame, bodies = Camera(world.client).capture(pose)
    seen = Frame(frame.depth_m, frame.intrinsics, frame.rgb, bodies == body, frame_id="camera")
    return {
        "data": to_wire(encode_frame(seen.crop(bodies == body))),
        "sensor_pose": pose_message(pose),
        "frame_id": "world",
        "support_height": 0.0,
    }


def ask(server: RunningServer, service: str, **args: Any) -> dict[str, Any]:
    """Call a service over rosbridge."""
    with open_websocket(server.websocket, max_size=None) as socket:
        socket.send(json.dumps({"op": "call_service", "id": "1", "service": service, "args": args}))
        answer = json.loads(socket.recv(timeout=120))
    assert answer["result"], answer
    values: dict[str, Any] = answer["values"]
    return values


@pytest.mark.slow
def test_a_grasp_in_space_goes_from_views_to_physics_and_back(
    server: RunningServer, tmp_path: Path
) -> None:
    spec = product("can", 1)
    with World() as world, rtask.connect(server.url, timeout_s=120) as client:
        world.add_table(0.0)
        body = world.spawn(spec, PLACE, assets=write_assets(spec, tmp_path))
        rest = settle(world, body)
        client.register_robot(name="panda-7", model="panda", end_effectors=[HAND])
        told = client.insert_object(objects=[{**look(world, body, 0.4), "name": "soup can"}])
        thing = told["objects"][0]["object"]
        mine: dict[str, Any] = {"object": thing, "gripper_id": "panda_hand"}
        plan = client.plan_in_space(**mine, mass=spec.mass, samples=50)
        assert (plan["shape"], plan["reason"]) == ("mesh", "")

        sight = look(world, body, 0.9)
        answer = ask(
            server, "/rtask/recognise_for_grasp", **sight, **mine, in_space=True, decide=True
        )
        assert answer["decision"]["answer"] == "grasp"
        best = next(grasp for grasp in answer["grasps"] if grasp["kind"] == "spatial")
        pose = matrix_from_message(best["grasp_pose"]["pose"]).astype(np.float64)
        done = execute(world, body, panda_hand(), pose, best["opening"], rest)
        assert done.held

        client.report_outcome(
            task_id=answer["task_id"], object=thing, grasp=best, gripper_id="panda_hand",
            outcome={"success": done.held, "reason": "ok", "lifted_m": done.lifted_m,
                     "preset": "faithful"},
        )  # fmt: skip
        again = ask(server, "/rtask/recognise_for_grasp", **sight, **mine, in_space=True)
        tried = next(grasp for grasp in again["grasps"] if grasp["id"] == best["id"])
        assert tried["statistics"]["successes"] == 1
        assert tried["mean"] > best["mean"]
        recalled = ask(server, "/rtask/recall_grasps", **mine)["grasps"]
        assert recalled[0]["id"] == best["id"]
        assert recalled[0]["grasp_pose"]["header"]["frame_id"].startswith("object/")
