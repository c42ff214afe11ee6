"""Drives of a robot with a camera: messages of its topics, recorded as MCAP."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from features.imaging.recordings import first_view

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
