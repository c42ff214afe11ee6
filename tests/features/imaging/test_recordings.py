"""Recordings of real cameras: what a topic carries is read, and one bad topic spoils nothing."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from features.codec.limits import CloudFormatError
from features.geometry import Frame
from features.imaging.photo import Photo
from features.imaging.recordings import first_view

pytest.importorskip("rosbags")

HEIGHT, WIDTH = 48, 64
BENT = [-0.3, 0.1, 0.0, 0.0, 0.0]
K = [60.0, 0, 31.5, 0, 61, 23.5, 0, 0, 1]
P = [50.0, 0, 30.0, 0, 0, 52, 22.0, 0, 0, 0, 1, 0]


class Drive:
    """Messages to be recorded: topic, message and time, ms."""

    def __init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self.messages: list[tuple[str, Any, int]] = []

    def add(self, topic: str, kind: str, time_ms: int, *values: Any) -> None:
        types = self.store.types
        stamp = types["builtin_interfaces/msg/Time"](1, 0)
        header = types["std_msgs/msg/Header"](stamp, "optical")
        head = () if kind.startswith("std_msgs") else (header,)
        self.messages.append((topic, types[kind](*head, *values), time_ms))

    def camera(
        self,
        topic: str,
        time_ms: int = 1000,
        k: Any = K,
        d: Any = (0.0,) * 5,
        p: Any = (0.0,) * 12,
        model: str = "plumb_bob",
    ) -> None:
        region = self.store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        arrays = [np.array(values, float) for values in (d, k, np.eye(3).ravel(), p)]
        self.add(
            topic,
            "sensor_msgs/msg/CameraInfo",
            time_ms,
            HEIGHT,
            WIDTH,
            model,
            *arrays,
            0,
            0,
            region,
        )

    def image(self, topic: str, time_ms: int, encoding: str, pixels: np.ndarray) -> None:
        rows = pixels.reshape(len(pixels), -1).view("u1")
        self.add(
            topic, "sensor_msgs/msg/Image", time_ms, *pixels.shape[:2], encoding, 0, rows.shape[1],
            rows.ravel(),
        )  # fmt: skip

    def compressed(self, topic: str, time_ms: int, form: str, data: bytes) -> None:
        kind = "sensor_msgs/msg/CompressedImage"
        self.add(topic, kind, time_ms, form, np.frombuffer(data, "u1"))

    def save(self, folder: Path) -> Path:
        from rosbags.rosbag2 import StoragePlugin, Writer

        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            made: dict[str, Any] = {}
            for topic, message, time_ms in self.messages:
                kind = message.__msgtype__
                if topic not in made:
                    made[topic] = writer.add_connection(topic, kind, typestore=self.store)
                stored = self.store.serialize_cdr(message, kind)
                writer.write(made[topic], time_ms * 10**6, stored)
        return folder


def depth_mm(value: int = 700) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), value, "<u2")


def good_topics(drive: Drive) -> None:
    drive.camera("/camera/depth/camera_info")
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm())
    drive.image("/camera/color/image_raw", 1015, "rgb8", np.full((HEIGHT, WIDTH, 3), 80, "u1"))


def seen(drive: Drive, tmp_path: Path) -> tuple[Any, list[str]]:
    warnings: list[str] = []
    return first_view(drive.save(tmp_path / "drive"), warn=warnings.append), warnings


@pytest.mark.parametrize("name", ["junk.bag", "junk.mcap", "junk.db3"])
@pytest.mark.parametrize("start", [b"", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
def test_bytes_that_are_no_recording_are_told_in_one_line(
    tmp_path: Path, name: str, start: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(start + np.random.default_rng(3).bytes(400))
    with pytest.raises(CloudFormatError, match="no recording of ROS"):
        first_view(path)


def test_a_rectified_image_is_described_by_p_and_not_straightened_again(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", d=BENT, p=P)
    # A step of depth that undistortion would bend.
    depth = depth_mm()
    depth[:, 57:] = 900
    drive.image("/camera/depth/image_rect", 1005, "16UC1", depth)
    view, warnings = seen(drive, tmp_path)
    assert np.allclose(view.depth_m * 1000, depth, atol=0.01)
    assert (view.intrinsics.fx, view.intrinsics.cy) == (50.0, 22.0)
    assert not warnings


def test_a_raw_image_is_straightened_by_k_and_d(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", d=BENT, p=P)
    depth = depth_mm()
    depth[:, 57:] = 900
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth)
    view, _ = seen(drive, tmp_path)
    assert view.intrinsics.fx == 60.0
    assert not np.allclose(view.depth_m * 1000, depth, atol=0.01)


def _infrared(drive: Drive) -> None:
    drive.image("/camera/infra1/image_rect_raw", 1001, "mono8", np.full((HEIGHT, WIDTH), 9, "u1"))


def _thermal(drive: Drive) -> None:
    drive.image("/thermal/image_raw", 1001, "16UC1", depth_mm(29_500))


def _grey16(drive: Drive) -> None:
    drive.image("/flir/image", 1001, "mono16", depth_mm(29_500))


def _unknown_encoding(drive: Drive) -> None:
    drive.image("/side/image_raw", 1001, "16SC3", np.zeros((HEIGHT, WIDTH, 3), "<i2"))


def _video(drive: Drive) -> None:
    drive.compressed("/side/image_raw/ffmpeg", 1001, "h264", b"\0\0\0\1")


def _no_camera(drive: Drive) -> None:
    drive.camera("/webcam/camera_info", 1001, k=[0.0] * 9)


def _other_depth(drive: Drive) -> None:
    drive.image("/side/depth/image_raw", 1001, "16UC1", depth_mm())  # nobody describes it


@pytest.mark.parametrize(
    ("spoil", "warning"),
    [
        (_infrared, "infrared"), (_thermal, "infrared"), (_grey16, "mono16 on a topic"),
        (_unknown_encoding, "16SC3"), (_video, "h264"), (_no_camera, ""),
        (_other_depth, "CameraInfo"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)  # fmt: skip
def test_a_topic_that_cannot_be_used_is_left_out_and_named(
    tmp_path: Path, spoil: Callable[[Drive], None], warning: str
) -> None:
    drive = Drive()
    spoil(drive)
    good_topics(drive)
    view, warnings = seen(drive, tmp_path)
    assert isinstance(view, Frame)
    assert view.depth_m[20, 20] == pytest.approx(0.7)
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert any(warning in one for one in warnings) is bool(warning)


def test_the_reasons_are_told_where_nothing_is_left(tmp_path: Path) -> None:
    drive = Drive()
    _grey16(drive)
    with pytest.raises(CloudFormatError, match="/flir/image: left out: mono16"):
        seen(drive, tmp_path)


def test_depth_may_come_before_its_camera_is_described(tmp_path: Path) -> None:
    drive = Drive()
    drive.image("/camera/depth/image_raw", 1000, "16UC1", depth_mm())
    drive.camera("/camera/depth/camera_info", 1500)
    view, _ = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(0.7)


def test_a_fisheye_is_straightened(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", d=[0.1, 0.0, 0.0, 0.0], model="equidistant")
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm())
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[24, 32] == pytest.approx(0.7)
    assert not warnings


def test_recordings_of_the_realsense_sdk_are_read_with_their_unit(tmp_path: Path) -> None:
    drive = Drive()
    sensor = "/device_0/sensor_0"
    drive.add(f"{sensor}/option/Depth_Units/value", "std_msgs/msg/Float32", 1000, 0.0005)
    drive.camera(f"{sensor}/Depth_0/info/camera_info", 1001)
    drive.image(f"{sensor}/Depth_0/image/data", 1002, "mono16", depth_mm(1400))
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(0.7)
    assert not warnings


def test_compressed_depth_of_floats_is_read_and_a_doubtful_unit_is_said(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info")
    # value = a / depth + b: 101 is 100 / 1 m + 1
    header = struct.pack("<iff", 0, 100.0, 1.0)
    stored = cv2.imencode(".png", np.full((HEIGHT, WIDTH), 101, np.uint16))[1].tobytes()
    form = "32FC1; compressedDepth"
    drive.compressed("/camera/depth/image_raw/compressedDepth", 1005, form, header + stored)
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(1.0)
    assert not warnings
    far = Drive()
    far.camera("/camera/depth/camera_info")
    far.image("/camera/depth/image_raw", 1005, "32FC1", np.full((HEIGHT, WIDTH), 70, "<f4"))
    _, warnings = seen(far, tmp_path / "far")
    assert ["in another unit?" in one for one in warnings] == [True]


def test_a_recording_without_depth_gives_its_photographs(tmp_path: Path) -> None:
    drive = Drive()
    drive.image("/webcam/image_raw", 1001, "yuv422_yuy2", np.full((HEIGHT, WIDTH, 2), 128, "u1"))
    view, warnings = seen(drive, tmp_path)
    assert isinstance(view, Photo)
    assert not warnings
