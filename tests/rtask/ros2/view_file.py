"""Writes the view of a table for the contract of ROS 2, and prints the contract of the node."""

from __future__ import annotations

import json
import sys

import numpy as np

from grasp.messages import pose_message
from rtask.cli.ros.schema import engine_schema
from rtask.client.base import RULES
from rtask.ros2.contract import Contract
from tests.rtask.interop.ros.scene import BASE_FROM_CAMERA, INTRINSICS, view

if __name__ == "__main__":
    frame, camera = view(), INTRINSICS
    np.savez(
        sys.argv[1],
        depth=frame.depth_m,
        rgb=frame.rgb,
        camera=np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
        pose=np.array(json.dumps(pose_message(BASE_FROM_CAMERA))),
    )
    print(json.dumps(Contract(engine_schema(), RULES).as_json()))
