"""Pictures and clouds as messages of ROS, sent to a server by the rosbridge protocol."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from websockets.sync.client import connect

from tests.servers import RunningServer

pytestmark = pytest.mark.slow

Ask = Callable[..., dict[str, Any]]
Picture = NDArray[np.uint8]


@pytest.fixture
def ask(server: RunningServer) -> Any:
    """Return what calls a service of the server and waits for its answer."""
    with connect(server.websocket, max_size=None) as robot:

        def call(service: str, **args: Any) -> dict[str, Any]:
            request = {"op": "call_service", "service": f"/rtask/{service}", "id": service}
            robot.send(json.dumps({**request, "args": args}))
            answer = json.loads(robot.recv(timeout=60))
            assert answer["result"], answer
            values: dict[str, Any] = answer["values"]
            return values

        yield call


def print_of(seed: int) -> Picture:
    """Return the front of a carton with a print of its own, (160, 200, 3) RGB."""
    grain = np.random.default_rng(seed).integers(0, 255, (160, 200, 3)).astype(np.uint8)
    soft = cv2.GaussianBlur(grain, (0, 0), 3).astype(np.float64)
    return np.clip(128 + 6 * (soft - soft.mean()), 0, 255).astype(np.uint8)


def from_aside(image: Picture) -> Picture:
    """Return the same front seen a little from one side, and nearer."""
    height, width = image.shape[:2]
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = np.array([[4, 12], [250, 0], [244, 196], [0, 180]], np.float32)
    moved = cv2.warpPerspective(image, cv2.getPerspectiveTransform(corners, seen), (250, 196))
    return np.asarray(moved, np.uint8)


def encoded(data: bytes) -> str:
    return base64.b64encode(data).decode()


def compressed_image(image: Picture) -> dict[str, Any]:
    """Return a sensor_msgs/CompressedImage."""
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()
    header = {"stamp": {"sec": 4, "nanosec": 0}, "frame_id": "camera_optical"}
    return {"header": header, "format": "bgr8; jpeg compressed bgr8", "data": encoded(data)}


def raw_image(image: Picture) -> dict[str, Any]:
    """Return a sensor_msgs/Image."""
    height, width = image.shape[:2]
    sides = {"height": height, "width": width, "step": 3 * width}
    return {**sides, "encoding": "rgb8", "is_bigendian": 0, "data": encoded(image.tobytes())}


def point_cloud(image: Picture) -> dict[str, Any]:
    """Return a sensor_msgs/PointCloud2 of a front 40 cm from the camera, in the image's grid."""
    height, width = image.shape[:2]
    kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])
    rows = np.zeros((height, width), kind)
    v, u = np.indices((height, width))
    rows["x"], rows["y"] = 0.0008 * (u - width / 2), 0.0008 * (v - height / 2)
    rows["z"] = 0.4
    ink = image.astype(np.uint32)
    rows["rgb"] = ink[..., 0] << 16 | ink[..., 1] << 8 | ink[..., 2]
    kinds = {"x": 7, "y": 7, "z": 7, "rgb": 6}
    fields = [
        {"name": name, "offset": 4 * k, "datatype": of, "count": 1}
        for k, (name, of) in enumerate(kinds.items())
    ]
    return {
        "header": {"frame_id": "camera_optical", "stamp": {"sec": 4, "nanosec": 0}},
        "height": height, "width": width, "fields": fields, "is_bigendian": False,
        "point_step": 16, "row_step": 16 * width, "is_dense": True,
        "data": encoded(rows.tobytes()),
    }  # fmt: skip


def test_a_compressed_image_is_stored_and_recognised_from_aside(ask: Ask) -> None:
    tea, coffee = print_of(1), print_of(2)
    for image, name in ((tea, "tea carton"), (coffee, "coffee carton")):
        ask("insert_object", objects=[{"image": compressed_image(image), "name": name}])
    whole = [0.0, 0.0, 250.0, 196.0]
    for message in (compressed_image(from_aside(tea)), raw_image(from_aside(tea))):
        found = ask("search_object", image=message, box=whole)
        assert found["accepted"]
        assert found["similar_objects"][0]["label"] == "tea carton"
    assert not ask("search_object", image=raw_image(from_aside(print_of(3))), box=whole)["accepted"]


def test_a_point_cloud_is_stored_and_recognised_with_its_size(ask: Ask) -> None:
    soup = print_of(4)
    told = ask("insert_object", objects=[{"data": point_cloud(soup), "name": "soup carton"}])
    assert told["objects"][0]["features"] > 20
    found = ask("search_object", data=point_cloud(soup))
    assert found["accepted"]
    assert found["similar_objects"][0]["label"] == "soup carton"
