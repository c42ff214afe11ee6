"""Views of a table as a camera publishes them."""

from __future__ import annotations

import json
import threading

import numpy as np

from tests.clients.ros2.robot import sensor, set_fields


class View:
    """The view of a table with two boxes, as messages."""

    def __init__(self, file):
        data = np.load(file)
        self.depth, self.rgb, self.camera = data["depth"], data["rgb"], data["camera"]
        self.pose = json.loads(str(data["pose"]))

    def header(self, stamp):
        from std_msgs.msg import Header

        return set_fields(Header(), {"frame_id": "camera_optical", "stamp": time_fields(stamp)})

    def cloud(self, stamp):
        """Return a PointCloud2 with padding, as drivers have it: 20 bytes a point, 1.5 MB."""
        from sensor_msgs.msg import PointCloud2, PointField

        h, w = self.depth.shape
        fx, fy, cx, cy = self.camera
        v, u = np.mgrid[0:h, 0:w]
        kind = np.dtype({"names": ["x", "y", "z", "rgb"], "formats": ["<f4"] * 3 + ["<u4"],
                         "offsets": [0, 4, 8, 16], "itemsize": 20})  # fmt: skip
        table = np.zeros((h, w), kind)
        table["x"], table["y"] = (u - cx) / fx * self.depth, (v - cy) / fy * self.depth
        table["z"] = self.depth
        red, green, blue = (self.rgb[..., k].astype(np.uint32) for k in range(3))
        table["rgb"] = red << 16 | green << 8 | blue
        cloud = PointCloud2(header=self.header(stamp), height=h, width=w, point_step=20)
        cloud.row_step, cloud.is_dense = 20 * w, True
        for name, offset in (("x", 0), ("y", 4), ("z", 8), ("rgb", 16)):
            cloud.fields.append(PointField(name=name, offset=offset, datatype=7, count=1))
        cloud.data = (
            list(table.tobytes()) if not hasattr(cloud.data, "frombytes") else _array(table)
        )
        return cloud

    def images(self, stamp):
        from sensor_msgs.msg import CameraInfo, Image

        h, w = self.depth.shape
        fx, fy, cx, cy = self.camera
        depth = Image(header=self.header(stamp), height=h, width=w, encoding="32FC1", step=4 * w)
        depth.data = _array(self.depth.astype("<f4"))
        image = Image(header=self.header(stamp), height=h, width=w, encoding="rgb8", step=3 * w)
        image.data = _array(self.rgb)
        info = CameraInfo(header=self.header(stamp), height=h, width=w)
        info.distortion_model = "plumb_bob"
        info.k = [float(x) for x in (fx, 0, cx, 0, fy, cy, 0, 0, 1)]
        return depth, image, info

    def transform(self, stamp):
        from geometry_msgs.msg import TransformStamped
        from tf2_msgs.msg import TFMessage

        made = TransformStamped(child_frame_id="camera_optical")
        set_fields(made.header, {"frame_id": "base_footprint", "stamp": time_fields(stamp)})
        set_fields(made.transform.translation, self.pose["position"])
        set_fields(made.transform.rotation, self.pose["orientation"])
        return TFMessage(transforms=[made])


def _array(values):
    import array

    return array.array("B", np.ascontiguousarray(values).tobytes())


def time_fields(stamp):
    return {"sec": int(stamp), "nanosec": round(stamp % 1 * 1e9)}


def show(shell, stamp, tf_stamp=None, reliable=False):
    """Publish a view from now on."""
    transform = shell.view.transform(stamp if tf_stamp is None else tf_stamp)
    keep_publishing(
        shell,
        ("/tf", transform, 100),
        ("/camera/points", shell.view.cloud(stamp), sensor(reliable)),
    )


def keep_publishing(shell, *messages):
    """Publish messages until the next call, as cameras do: best effort may lose single ones."""
    shell.showing.set()
    showing = shell.showing = threading.Event()

    def run():
        while not showing.wait(0.2):
            for topic, message, qos in messages:
                shell.robot.publish(topic, message, qos)

    shell.camera = threading.Thread(target=run, daemon=True)
    shell.camera.start()


def since(stamp):
    return {"stamp": time_fields(stamp)}
