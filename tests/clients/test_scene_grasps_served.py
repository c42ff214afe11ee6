"""A robot sends one view of things that stand close together and picks one by the answer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import look_at
from grasp.messages import matrix_from_message, pose_message
from grasp.spatial.gripper import panda_hand
from rtask.errors import RtaskError
from simulate.grasping.floating import execute, settle
from simulate.world.camera import Camera
from simulate.world.objects import product
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

        none = client.plan_on_scene(**mine, region=[0.8, 0.9, -0.1, 0.1])
        assert none["grasps"] == []
        assert none["reason"] == "nothing is seen on the table, or within the region"
        many = client.plan_on_scene(**mine, max_grasps=50)["grasps"]
        strict = client.plan_on_scene(**mine, max_grasps=50, min_confidence=0.9)["grasps"]
        assert 0 < len(strict) < len(many)
        assert all(grasp["confidence"] >= 0.9 for grasp in strict)
        with pytest.raises(RtaskError, match="x from < x to"):
            client.plan_on_scene(**mine, region=[0.9, 0.8, -0.1, 0.1])
