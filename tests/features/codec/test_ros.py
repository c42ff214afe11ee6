"""Clouds and images of ROS messages, organised clouds, recordings."""

from __future__ import annotations

import base64
from pathlib import Path

import cv2
import numpy as np
import pytest

from features.codec import Cloud, CloudFormatError, decode
from features.codec.ros import image_bytes, pcd_from_point_cloud, pixels_of_image
from features.geometry import Frame
from features.imaging.photo import Photo
from features.imaging.pictures import depth_of_message


def organised(height=12, width=16):
    rng = np.random.default_rng(3)
    points = rng.uniform(0.3, 1, (height, width, 3)).astype(np.float32)
    points[1, 2:] = np.nan
    return points, rng.integers(0, 255, (height, width, 3)).astype(np.uint8)


def message(points, colours, order="<", padding=0):
    """Return a PointCloud2 as a depth camera publishes it: gaps between fields and rows."""
    height, width = points.shape[:2]
    formats = [f"{order}{code}" for code in ("f4", "f4", "f4", "u4")]
    kind = np.dtype({"names": ["x", "y", "z", "rgb"], "formats": formats,
                     "offsets": [0, 4, 8, 16], "itemsize": 32})  # fmt: skip
    rows = np.zeros((height, width), kind)
    for k, axis in enumerate("xyz"):
        rows[axis] = points[..., k]
    wide = colours.astype(np.uint32)
    rows["rgb"] = wide[..., 0] << 16 | wide[..., 1] << 8 | wide[..., 2]
    data = b"".join(row.tobytes() + b"\0" * padding for row in rows)
    fields = [{"name": n, "offset": o, "datatype": d, "count": 1}
              for n, o, d in (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 16, 7))]  # fmt: skip
    return {
        "header": {"frame_id": "camera_optical", "stamp": {"sec": 1, "nanosec": 0}},
        "height": height, "width": width, "fields": fields, "is_bigendian": order == ">",
        "point_step": 32, "row_step": width * 32 + padding, "is_dense": False,
        "data": base64.b64encode(data).decode(),
    }  # fmt: skip


@pytest.mark.parametrize(("order", "padding"), [("<", 0), (">", 0), ("<", 24)])
def test_a_point_cloud_message_keeps_grid_colours_and_frame(order, padding):
    points, colours = organised()
    cloud = decode(pcd_from_point_cloud(message(points, colours, order, padding)))
    assert isinstance(cloud, Cloud)
    assert cloud.is_organised
    assert cloud.frame_id == "camera_optical"
    grid, ink = cloud.grid()
    assert np.array_equal(grid, points, equal_nan=True)
    known = np.isfinite(points[..., 0])
    assert np.array_equal(ink[known], colours[known])


def test_parts_that_do_not_fit_together_are_refused():
    points, colours = organised()
    good = message(points, colours)
    for change, words in (
        ({"width": 17}, "bytes are not"),
        ({"width": 10**9}, "points"),
        ({"fields": good["fields"][:2]}, "no field z"),
        ({"fields": [{"name": "x", "offset": 30, "datatype": 7}]}, "outside the point"),
        ({"data": "!"}, "base64"),
        ({"height": -1}, "whole number"),
    ):
        with pytest.raises(CloudFormatError, match=words):
            pcd_from_point_cloud({**good, **change})


def test_images_of_messages_become_pictures():
    rgb = np.random.default_rng(0).integers(0, 255, (6, 8, 3)).astype(np.uint8)
    raw = {"height": 6, "width": 8, "encoding": "bgr8", "step": 26, "is_bigendian": 0,
           "data": b"".join(row.tobytes() + b"\0\0" for row in rgb[..., ::-1])}  # fmt: skip
    assert np.array_equal(pixels_of_image(raw), rgb)
    stored = np.frombuffer(image_bytes(raw), np.uint8)
    assert np.array_equal(cv2.imdecode(stored, cv2.IMREAD_COLOR)[..., ::-1], rgb)
    png = cv2.imencode(".png", rgb)[1].tobytes()
    assert image_bytes({"format": "png", "data": base64.b64encode(png).decode()}) == png
    deep = np.arange(48, dtype=np.uint16).reshape(6, 8) + 700
    stored = b"\0" * 12 + cv2.imencode(".png", deep)[1].tobytes()
    compressed = {"format": "16UC1; compressedDepth", "data": stored}
    depth = np.frombuffer(image_bytes(compressed), np.uint8)
    assert np.array_equal(cv2.imdecode(depth, cv2.IMREAD_UNCHANGED), deep)
    with pytest.raises(CloudFormatError, match="is no picture"):
        image_bytes({"format": "h264", "data": b"\0\0\0\1"})
    with pytest.raises(CloudFormatError, match="not known"):
        pixels_of_image({**raw, "encoding": "rgb1000"})


def test_depth_beyond_the_range_of_the_camera_is_missing():
    depth = np.array([[0.5, np.inf, -np.inf, np.nan]], "<f4")  # REP 117: too far, too near, unknown
    raw = {"height": 1, "width": 4, "encoding": "32FC1", "step": 16, "data": depth.tobytes()}
    stored = cv2.imdecode(np.frombuffer(image_bytes(raw), np.uint8), cv2.IMREAD_UNCHANGED)
    assert stored.tolist() == [[500, 0, 0, 0]]
    assert depth_of_message(raw, is_depth_topic=True).tolist() == [[0.5, 0, 0, 0]]


def test_ply_of_a_grid_and_of_a_camera_keep_their_rows():
    points, _ = organised(3, 4)
    flat = points.reshape(-1, 3)
    known = np.isfinite(flat).all(axis=1)
    vertex = "property float x\nproperty float y\nproperty float z\n"
    numbers = np.cumsum(known) - 1
    grid = b"".join(
        b"\x01" + np.int32(n).tobytes() if k else b"\0" for k, n in zip(known, numbers, strict=True)
    )
    data = (
        (
            "ply\nformat binary_little_endian 1.0\nobj_info num_cols 4\nobj_info num_rows 3\n"
            f"element vertex {known.sum()}\n{vertex}element range_grid 12\n"
            "property list uchar int vertex_indices\nend_header\n"
        ).encode()
        + flat[known].astype("<f4").tobytes()
        + grid
    )
    found, _ = decode(data).grid()
    assert np.array_equal(found, points, equal_nan=True)
    with pytest.raises(CloudFormatError, match="range grid"):
        decode(data[:-3])
    camera = (
        f"ply\nformat ascii 1.0\nelement vertex 12\n{vertex}element camera 1\n"
        "property int viewportx\nproperty int viewporty\nend_header\n"
        + "".join(f"{x} {y} {z}\n" for x, y, z in flat.tolist()) + "4 3\n"
    ).encode()  # fmt: skip
    found, _ = decode(camera).grid()
    assert np.allclose(found, points, equal_nan=True)


def recording(folder: Path) -> Path:
    """Write a recording of one depth image, its camera, and a compressed colour image."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 0), "optical")
    region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    info = types["sensor_msgs/msg/CameraInfo"](
        header, 48, 64, "plumb_bob", np.zeros(5), np.array([60.0, 0, 31.5, 0, 61, 23.5, 0, 0, 1]),
        np.eye(3).ravel(), np.zeros(12), 0, 0, region,
    )  # fmt: skip
    depth = np.full((48, 64), 700, "<u2")
    image = types["sensor_msgs/msg/Image"](
        header, 48, 64, "16UC1", 0, 128, depth.view("u1").ravel()
    )
    data = cv2.imencode(".png", np.full((96, 128, 3), (10, 20, 200), np.uint8))[1].ravel()
    colour = types["sensor_msgs/msg/CompressedImage"](header, "png", data)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, told, time_ms in (
            ("/camera/depth/camera_info", info, 1000),
            ("/camera/depth/image_raw", image, 1005),
            ("/camera/color/image_raw/compressed", colour, 1015),
        ):
            kind = told.__msgtype__
            connection = writer.add_connection(topic, kind, typestore=store)
            writer.write(connection, time_ms * 10**6, store.serialize_cdr(told, kind))
    return folder


@pytest.mark.slow
def test_a_recording_gives_depth_with_colour(tmp_path):
    from features.imaging.recordings import first_view

    folder = recording(tmp_path / "drive")
    (file,) = folder.glob("*.mcap")
    for path in (folder, file):
        seen = first_view(path)
        assert isinstance(seen, Frame)
        assert seen.depth_m[20, 20] == pytest.approx(0.7)
        assert seen.rgb[20, 20].tolist() == [200, 20, 10]
        assert seen.intrinsics.fy == 61
    assert not isinstance(seen, Photo)
    with pytest.raises(CloudFormatError, match="no image and no cloud from 9"):
        first_view(folder, 9.0)
    notes = tmp_path / "notes.bag"
    notes.write_text("no recording")
    with pytest.raises(CloudFormatError, match="no recording"):
        first_view(notes)


@pytest.mark.parametrize(
    ("names", "datatype", "count", "code"),
    [
        (("red", "green", "blue"), 2, 1, "u1"), (("R", "G", "B"), 2, 1, "u1"),
        (("rgb",), 2, 3, "u1"),
    ],
)  # fmt: skip
def test_colours_of_a_point_cloud_may_be_named_otherwise(names, datatype, count, code):
    kind = np.dtype([("xyz", "<f4", 3), ("colour", code, 3)])
    fields = [{"name": n, "offset": 4 * k, "datatype": 7, "count": 1} for k, n in enumerate("xyz")]
    fields += [
        {"name": name, "offset": 12 + k, "datatype": datatype, "count": count}
        for k, name in enumerate(names)
    ]
    data = np.array([((0.1, 0.2, 0.7), (255, 51, 0))], kind).tobytes()
    cloud = decode(pcd_from_point_cloud({
        "height": 1, "width": 1, "fields": fields, "point_step": 15, "row_step": 15, "data": data,
    }))  # fmt: skip
    assert cloud.colours.tolist() == [[255, 51, 0]]
