"""Clauses on depth and colour as images: compressed, and of two cameras."""

from __future__ import annotations

import array
import struct
import zlib

import numpy as np

from tests.clients.ros2.programs import NAMESPACE
from tests.clients.ros2.registry import ABORTED, SUCCEEDED, clause
from tests.clients.ros2.robot import sensor
from tests.clients.ros2.views import keep_publishing, since

# As compressed_depth_image_transport has them: nearest step at 100, farthest depth 10 m.
QUANTISATION, FARTHEST_M = 100.0, 10.0


def png(image):
    """Return an image of 8 bits and three channels, or of 16 bits and one, as a PNG."""
    height, width = image.shape[:2]
    bits, colour = (16, 0) if image.dtype == np.uint16 else (8, 2)
    rows = np.ascontiguousarray(image.astype(">u2") if bits == 16 else image)
    raw = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(kind, data):
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    head = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    return b"".join((
        b"\x89PNG\r\n\x1a\n", chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(raw, 1)),
        chunk(b"IEND", b""),
    ))  # fmt: skip


def compressed_depth(depth, encoding):
    """Return the data of a depth image, m, as its transport writes it for an encoding."""
    if encoding == "16UC1":
        return bytes(12) + png(np.round(depth * 1000).astype(np.uint16))
    a = QUANTISATION * (QUANTISATION + 1)
    b = 1 - a / FARTHEST_M
    steps = np.zeros(depth.shape, np.uint16)
    is_seen = (depth > 0) & (depth < FARTHEST_M)
    steps[is_seen] = np.round(a / depth[is_seen] + b)
    return struct.pack("<iff", 0, a, b) + png(steps)


@clause("compressed depth, as whole mm and as inverse depth, with compressed colour is a view")
def _(shell):
    from sensor_msgs.msg import CompressedImage

    tops = []
    for stamp, encoding in ((260.0, "16UC1"), (261.0, "32FC1")):
        header = shell.view.header(stamp)
        depth = CompressedImage(header=header, format=f"{encoding}; compressedDepth png")
        depth.data = array.array("B", compressed_depth(shell.view.depth, encoding))
        image = CompressedImage(header=header, format="rgb8; png compressed bgr8")
        image.data = array.array("B", png(shell.view.rgb))
        keep_publishing(
            shell, ("/tf", shell.view.transform(stamp), 100),
            ("/camera/camera_info", shell.view.images(stamp)[2], sensor()),
            (f"{NAMESPACE}/rtask_node/depth_compressed", depth, sensor()),
            (f"{NAMESPACE}/rtask_node/image_compressed", image, sensor()),
        )  # fmt: skip
        status, result, _ = shell.robot.see_again(header=since(stamp), gripper_id=shell.gripper)
        assert status == SUCCEEDED, result.refused
        assert {entry.header.stamp.sec for entry in result.objects} == {int(stamp)}
        names = sorted(entry.name for entry in result.objects)
        assert names == ["soap", "tea"], (encoding, names)
        tops.append([entry.pose.position.z + entry.size.z / 2 for entry in result.objects])
    # Depth in whole mm may be off by half a mm, and what is made of it by little more.
    assert np.allclose(np.sort(tops[0]), np.sort(tops[1]), atol=0.003), tops


@clause("depth and colour of two cameras are not joined, and both frames are named")
def _(shell):
    depth, image, info = shell.view.images(270.0)
    image.header.frame_id = "wrist_optical"
    keep_publishing(
        shell, ("/tf", shell.view.transform(270.0), 100), ("/camera/camera_info", info, sensor()),
        ("/camera/depth", depth, sensor()), ("/camera/image", image, sensor()),
    )  # fmt: skip
    status, result, _ = shell.robot.see(header=since(270.0), gripper_id=shell.gripper)
    assert status == ABORTED, result.objects
    for frame in ("camera_optical", "wrist_optical"):
        assert frame in result.refused, result.refused
    return result.refused
