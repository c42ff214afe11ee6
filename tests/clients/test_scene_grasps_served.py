"""A robot sends one view of things that stand close together and picks one by the answer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import look_at
from features.perception import perceive
from grasp.messages import matrix_from_message, pose_message
from grasp.spatial.gripper import panda_hand
from rtask.errors import RtaskError
from simulate.grasping.floating.execution import execute, settle
from simulate.world.camera import Camera
from simulate.world.objects import product
from simulate.world.scene import Placement, lay
from simulate.world.world import World
from tests.servers import RunningServer

HAND = {
    "name": "panda_hand", "gripper_type": "panda_hand", "kind": "ParallelJawGripper",
    "max_opening": 0.08, "jaw_width": 0.02, "finger_length": 0.054, "max_payload": 3.0,
}  # fmt: skip


def view_of(world: World) -> dict[str, Any]:
    """Return what a robot sends that looks down on the table."""
    pose = look_at(np.array([0.62, 0.0, 0.36]), np.array([0.34, 0.0, 0.02]))
    frame, _ = Camera(world.client).capture(pose)
    return {
        "data": to_wire(encode_frame(frame)),
        "sensor_pose": pose_message(pose),
        "frame_id": "world",
    }


@pytest.mark.slow
def test_a_grasp_from_one_view_of_several_things_holds(server: RunningServer) -> None:
    with World() as world, rtask.connect(server.url, timeout_s=120) as client:
        world.add_table(0.0)
        first = world.spawn(product("can", 1), (0.34, -0.02))
        second = world.spawn(product("box", 2), (0.34, 0.045))
        for body in (first, second):
            settle(world, body)
        client.register_robot(name="panda-8", model="panda", end_effectors=[HAND])
        mine = {**view_of(world), "gripper_id": "panda_hand"}
        told = client.plan_on_scene(**mine)
        assert told["reason"] == ""
        assert abs(told["table_height"]) < 0.004
        assert len(told["segments"]) == 2
        of = {grasp["segment"] for grasp in told["grasps"]}
        assert of <= {one["segment"] for one in told["segments"]}
        best = told["grasps"][0]
        middle = next(s for s in told["segments"] if s["segment"] == best["segment"])["centre"]
        target = min(
            (first, second),
            key=lambda body: np.linalg.norm(world.object_pose(body).position[:2] - middle[:2]),
        )
        assert best["grasp_pose"]["header"]["frame_id"] == "world"
        hand = panda_hand()
        pose = matrix_from_message(best["grasp_pose"]["pose"]).astype(np.float64)
        pose = pose @ hand.parent_from_gripper
        assert execute(world, target, hand, pose, best["opening"], world.object_pose(target)).held

        assert best["object"] == ""
        assert all(one["object"] == "" for one in told["segments"])

        none = client.plan_on_scene(**mine, region=[0.8, 0.9, -0.1, 0.1])
        assert none["grasps"] == []
        assert none["reason"] == "nothing is seen on the table, or within the region"
        whole = client.plan_on_scene(**mine, max_grasps=50)
        many = whole["grasps"]
        total = len(many) + whole["grasps_left_out"]
        assert len(told["grasps"]) + told["grasps_left_out"] == total > len(told["grasps"])
        assert none["grasps_left_out"] == 0
        strict = client.plan_on_scene(**mine, max_grasps=50, min_confidence=0.9)["grasps"]
        assert 0 < len(strict) < len(many)
        assert all(grasp["confidence"] >= 0.9 for grasp in strict)
        with pytest.raises(RtaskError, match="x from < x to"):
            client.plan_on_scene(**mine, region=[0.9, 0.8, -0.1, 0.1])


@pytest.mark.slow
def test_what_is_known_is_named_and_its_grasp_is_taken_back_as_it_was_sent(
    server: RunningServer, tmp_path: Path
) -> None:
    with World() as world, rtask.connect(server.url, timeout_s=120) as client:
        world.add_table(0.0)
        can = Placement(product("can", 1), 0.34, -0.02, 0.0)
        lay(world, [can, Placement(product("box", 2), 0.34, 0.045, 0.0)], tmp_path)
        client.register_robot(name="panda-9", model="panda", end_effectors=[HAND])
        mine = {**view_of(world), "gripper_id": "panda_hand"}
        pose = look_at(np.array([0.62, 0.0, 0.36]), np.array([0.34, 0.0, 0.02]))
        frame, _ = Camera(world.client).capture(pose)
        stored = view = ""
        for seen in perceive(
            frame, pose
        ).objects:  # with a rival, as one object alone proves little
            data = to_wire(encode_frame(seen.crop))
            item = {**mine, "data": data, "support_height": 0.0, "merge": False}
            told = client.insert_object(objects=[item])["objects"][0]["object"]
            if seen.position[1] < 0.01:
                stored, view = told, data

        told = client.plan_on_scene(**mine, recognise=True, max_grasps=50)
        number = next(one["segment"] for one in told["segments"] if one["object"] == stored)
        grasp = next(one for one in told["grasps"] if one["segment"] == number)
        assert grasp["object"] == stored
        outcome = {"success": True, "reason": "ok"}
        client.insert_object(
            objects=[{**mine, "data": view, "object": stored, "grasp": grasp, "outcome": outcome}]
        )
        (known,) = client.recall_grasps(object=stored, gripper_id="panda_hand")["grasps"]
        assert known["kind"] == "spatial"
        assert known["statistics"]["successes"] == 1
        # The can stands at (.34, -.02): there is its frame's origin, to within the seen footprint.
        place = np.array([known[name] for name in "xyz"]) - [grasp[name] for name in "xyz"]
        assert np.linalg.norm(place[2]) < 0.005
        assert np.linalg.norm(place[:2]) == pytest.approx(np.hypot(0.34, 0.02), abs=0.05)
