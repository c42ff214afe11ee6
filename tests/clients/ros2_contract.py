"""The contract of the node for ROS 2, run in a sourced ROS 2 shell: one line for each clause.

    python3 tests/clients/ros2_contract.py

ROS 2 and the packages of ``rtask ros2 package`` and ``rtask ros messages`` are those of the shell;
RTASK itself runs in its own Python (``--rtask``), for the server and the view of a table. The last
line says with what all of it was run. Exit code 1 if a clause fails.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import json
import os
import platform
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import urllib.request
from pathlib import Path
from typing import ClassVar

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
NAMESPACE = "/nao1"
WAIT_S = 30.0
HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.09, "max_payload": 0.5}
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
CLAUSES = []
SIGNATURES = ROOT / "tests/rtask/ros2/rclpy_signatures.txt"


def clause(words):
    """Register a clause of the contract; those later in the file build on the earlier ones."""

    def register(check):
        CLAUSES.append((words, check))
        return check

    return register


def own_python():
    """Return the environment without ROS, whose libraries RTASK must not import."""
    left_out = ("PYTHONPATH", "LD_LIBRARY_PATH")
    return {name: value for name, value in os.environ.items() if name not in left_out}


class Program:
    """A process whose lines are read as they come."""

    started: ClassVar[list] = []

    def __init__(self, command, environment=None):
        self.process = subprocess.Popen(
            command, env={**(environment or os.environ), "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
        )  # fmt: skip
        Program.started.append(self)
        self.lines, self.all = queue.Queue(), []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            self.all.append(line)
            self.lines.put(line)
        self.lines.put(None)

    def expect(self, pattern, wait_s=60.0):
        """Return the next match of a pattern in a line."""
        deadline = time.monotonic() + wait_s
        while True:
            try:
                line = self.lines.get(timeout=max(deadline - time.monotonic(), 0.01))
            except queue.Empty:
                line = None
            assert line is not None, f"no line {pattern!r}: {''.join(self.all)[-1500:]}"
            found = re.search(pattern, line)
            if found:
                return found

    def end(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise


class Shell:
    """What the clauses share: the server, the node under test, and the node of a robot."""

    def __init__(self, options):
        self.options = options
        self.folder = Path(tempfile.mkdtemp(prefix="ros2-contract-"))
        self.stack = contextlib.ExitStack()
        self.stack.callback(shutil.rmtree, self.folder, ignore_errors=True)
        self.server = self.node = self.robot = None
        self.showing, self.camera = threading.Event(), None
        self.port = 0

    def start_server(self):
        command = [*self.options.rtask.split(), "serve", "--data", str(self.folder / "kb"), "-p"]
        self.server = Program([*command, str(self.port)], own_python())
        self.port = int(self.server.expect(r"http://127\.0\.0\.1:(\d+)", 120.0)[1])
        self.url = f"http://127.0.0.1:{self.port}"
        self.wait_for(self._answers, "the server")

    def _answers(self):
        with contextlib.suppress(OSError), urllib.request.urlopen(f"{self.url}/health", timeout=5):
            return True
        return False

    def start_node(self, *options, ros=(), ready="ready", namespace=NAMESPACE):
        command = self.options.node.split()
        node = Program([
            *command, "--server", self.url, "--timeout", "20", *options, "--ros-args",
            "-r", f"__ns:={namespace}", "-r", "~/points:=/camera/points",
            "-r", "~/depth:=/camera/depth", "-r", "~/image:=/camera/image",
            "-r", "~/camera_info:=/camera/camera_info", *ros,
        ])  # fmt: skip
        node.expect(ready)
        return node

    def perceive(self, body):
        request = urllib.request.Request(
            f"{self.url}/services/rtask/Segmentation/perceive",
            json.dumps(body).encode(), {"Content-Type": "application/json"},
        )  # fmt: skip
        with urllib.request.urlopen(request, timeout=120) as answer:
            return json.load(answer)

    @staticmethod
    def wait_for(ready, words, wait_s=WAIT_S):
        deadline = time.monotonic() + wait_s
        while not ready():
            assert time.monotonic() < deadline, f"not within {wait_s:g} s: {words}"
            time.sleep(0.05)

    def end_camera(self):
        self.showing.set()
        if self.camera is not None:
            self.camera.join(WAIT_S)

    def close(self):
        self.end_camera()
        for program in Program.started:
            program.end()
        if self.robot is not None:
            self.robot.close()
        self.stack.close()


class Robot:
    """A node of a robot: publishes views and transforms, calls the node under test."""

    def __init__(self):
        import rclpy
        from rclpy.executors import MultiThreadedExecutor
        from rclpy.node import Node

        rclpy.init()
        self.node = Node("contract_robot")
        self.executor = MultiThreadedExecutor(num_threads=4)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()
        self.clients, self.topics, self.publishers = {}, {}, {}

    def _spin(self):
        with contextlib.suppress(Exception):  # the end of the context ends it
            self.executor.spin()

    def close(self):
        import rclpy

        self.executor.shutdown(timeout_sec=5)
        self.node.destroy_node()
        rclpy.try_shutdown()

    def call(self, name, kind, fill=lambda request: None, namespace=NAMESPACE):
        """Call a service and return its response."""
        key = (name, namespace)
        if key not in self.clients:
            full = name if name.startswith("/") else f"{namespace}/{name}"
            self.clients[key] = self.node.create_client(kind, full)
        client = self.clients[key]
        assert client.wait_for_service(timeout_sec=WAIT_S), f"nobody offers {key}"
        request = kind.Request()
        fill(request)
        return self.wait(client.call_async(request), WAIT_S, name)

    @staticmethod
    def wait(future, wait_s, words):
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        assert done.wait(wait_s), f"no answer within {wait_s:g} s: {words}"
        return future.result()

    def operation(self, operation, /, **fields):
        """Call an operation with the fields of its request."""
        import rtask_msgs.srv

        kind = getattr(rtask_msgs.srv, "".join(part.capitalize() for part in operation.split("_")))
        return self.call(f"rtask/{operation}", kind, lambda request: set_fields(request, fields))

    def hear(self, topic, kind, qos):
        """Return a queue of the messages of a topic from now on."""
        heard = queue.Queue()
        self.topics[topic, id(heard)] = self.node.create_subscription(kind, topic, heard.put, qos)
        return heard

    def publish(self, topic, message, qos):
        key = (topic, type(message))
        if key not in self.publishers:
            self.publishers[key] = self.node.create_publisher(type(message), topic, qos)
        Shell.wait_for(
            lambda: self.publishers[key].get_subscription_count() > 0, f"a subscriber of {topic}"
        )
        self.publishers[key].publish(message)

    def see_again(self, **fields):
        """Send a goal until it succeeds, as long as only the newest transform is missing."""
        for _ in range(5):
            status, result, numbers = self.see(**fields)
            if "no transform" not in result.refused:
                break
        return status, result, numbers

    def see(self, cancel_at=0, settle=None, **fields):
        """Send a goal; return its status, its result and the numbers in its feedback."""
        from rclpy.action import ActionClient
        from rtask_msgs.action import See

        client = ActionClient(self.node, See, f"{NAMESPACE}/rtask/see")
        assert client.wait_for_server(timeout_sec=WAIT_S), "nobody offers rtask/see"
        goal, numbers, cancelled = See.Goal(), [], threading.Event()
        set_fields(goal, fields)
        handles = queue.Queue()

        def feedback(message):
            numbers.append(message.feedback.number)
            if message.feedback.number == cancel_at:
                handles.get(timeout=WAIT_S).cancel_goal_async()
                cancelled.set()

        handle = self.wait(client.send_goal_async(goal, feedback), WAIT_S, "the goal")
        assert handle.accepted, "the goal was rejected"
        handles.put(handle)
        if settle is not None:
            settle(handle)
        answer = self.wait(handle.get_result_async(), 90.0, "the result")
        client.destroy()
        return answer.status, answer.result, numbers


def set_fields(message, fields):
    """Set fields of a message from plain values; lists of dictionaries become messages."""
    import importlib

    types = message.get_fields_and_field_types()
    for name, value in fields.items():
        base = re.sub(r"^sequence<([^,>]+).*", r"\1", types[name])
        if isinstance(value, dict):
            set_fields(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            package, _, kind = base.partition("/")
            made = getattr(importlib.import_module(f"{package}.msg"), kind)
            setattr(message, name, [set_fields(made(), part) for part in value])
        elif isinstance(value, bytes):
            setattr(message, name, list(value))
        else:
            setattr(message, name, value)
    return message


def sensor(reliable=False):
    from rclpy.qos import QoSProfile, QoSReliabilityPolicy

    policy = QoSReliabilityPolicy
    return QoSProfile(depth=5, reliability=policy.RELIABLE if reliable else policy.BEST_EFFORT)


def latched():
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile

    return QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


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
        """Return a PointCloud2 as drivers pad it: 32 bytes a point."""
        from sensor_msgs.msg import PointCloud2, PointField

        h, w = self.depth.shape
        fx, fy, cx, cy = self.camera
        v, u = np.mgrid[0:h, 0:w]
        kind = np.dtype({"names": ["x", "y", "z", "rgb"], "formats": ["<f4"] * 3 + ["<u4"],
                         "offsets": [0, 4, 8, 16], "itemsize": 32})  # fmt: skip
        table = np.zeros((h, w), kind)
        table["x"], table["y"] = (u - cx) / fx * self.depth, (v - cy) / fy * self.depth
        table["z"] = self.depth
        red, green, blue = (self.rgb[..., k].astype(np.uint32) for k in range(3))
        table["rgb"] = red << 16 | green << 8 | blue
        cloud = PointCloud2(header=self.header(stamp), height=h, width=w, point_step=32)
        cloud.row_step, cloud.is_dense = 32 * w, True
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


# The clauses, in their order.


@clause("the methods of rclpy that the node calls take what it passes")
def _(shell):
    import importlib
    import inspect

    for line in SIGNATURES.read_text("utf-8").splitlines():
        module, _, rest = line.partition(" ")
        name, _, names = rest.partition("(")
        found = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
        own = list(inspect.signature(found).parameters)
        lacking = [n for n in names.rstrip(")").split(", ") if n and n not in own]
        assert not lacking or "kwargs" in own, f"{line}: {own}"


@clause("the node starts by one command in a namespace and with remaps, and is in the graph")
def _(shell):
    shell.node = shell.start_node("--gripper", "hand", "--outbox", str(shell.folder / "outbox"),
                                  ros=("-p", "table_height:=0.27"))  # fmt: skip
    shell.wait_for(
        lambda: ("rtask_node", NAMESPACE) in shell.robot.node.get_node_names_and_namespaces(),
        "rtask_node in the graph",
    )


@clause("every operation is a service of its type")
def _(shell):
    contract = json.loads(shell.contract)
    expected = {
        f"{NAMESPACE}/rtask/{name}": [f"rtask_msgs/srv/{service['name']}"]
        for name, service in contract["schema"]["services"].items()
    }
    own = shell.robot.node

    def offered():
        return dict(own.get_service_names_and_types_by_node("rtask_node", NAMESPACE))

    shell.wait_for(lambda: expected.items() <= offered().items(), "services of all operations")
    return f"{len(expected)} services"


@clause("an operation is answered")
def _(shell):
    answer = shell.robot.operation(
        "register_robot", name="nao-1", model="nao", end_effectors=[HAND]
    )
    assert (answer.refused, answer.robot.rpartition("/")[2]) == ("", "nao-1")
    shell.gripper = f"{answer.robot}/hand"


@clause("what was refused is answered with its reason on one line")
def _(shell):
    answer = shell.robot.operation("report_outcome")
    assert "missing" in answer.refused, answer.refused
    assert "\n" not in answer.refused


@clause("two values in a field for at most one are refused by the node itself")
def _(shell):
    answer = shell.robot.operation("report_outcome", success=[True, False])
    assert "success: 2 values; expected one" in answer.refused, answer.refused


@clause("commits are messages while somebody subscribes")
def _(shell):
    from rtask_msgs.msg import Change

    heard = shell.robot.hear(f"{NAMESPACE}/rtask/changes", Change, 100)
    for number in range(60):  # until the node follows
        shell.robot.operation("register_robot", name=f"r-{number}", model="m", end_effectors=[HAND])
        with contextlib.suppress(queue.Empty):
            change = heard.get(timeout=0.5)
            break
    assert change.commit > 0
    assert change.added > 0
    assert change.graphs[0].rpartition("/")[2].startswith("r-")


@clause("a goal without a view is aborted, and names the topics after remapping")
def _(shell):
    status, result, _ = shell.robot.see()
    assert status == ABORTED, status
    assert "on /camera/points within 5 s: nobody publishes it" in result.refused, result.refused


@clause("rtask/see recognises what was taught, with feedback for each object")
def _(shell):
    cloud = {"sensor_pose": shell.view.pose}
    message = shell.view.cloud(100.0)
    cloud["cloud"] = {
        "height": message.height, "width": message.width, "point_step": message.point_step,
        "row_step": message.row_step, "is_bigendian": False, "is_dense": True,
        "fields": [{"name": f.name, "offset": f.offset, "datatype": f.datatype, "count": f.count}
                   for f in message.fields],
        "data": base64.b64encode(bytes(message.data)).decode(),
    }  # fmt: skip
    crops = [entry["cloud"] for entry in shell.perceive(cloud)["objects"]]
    assert len(crops) == 2
    for name, crop in zip(("soap", "tea"), crops, strict=True):
        stored = shell.robot.operation("insert_object", objects=[{
            "data": base64.b64decode(crop), "name": name, "gripper_id": shell.gripper,
            "class_description": "box", "task_id": f"task-{name}"}])  # fmt: skip
        assert (stored.refused, stored.stored) == ("", 1), stored.refused
    show(shell, 100.0)
    status, result, numbers = shell.robot.see_again(
        header=since(100.0), gripper_id=shell.gripper, propose=True
    )
    assert (status, result.refused, result.status) == (SUCCEEDED, "", "ok"), result
    shell.seen = result
    assert sorted(entry.name for entry in result.objects) == ["soap", "tea"]
    assert {entry.header.stamp.sec for entry in result.objects} == {100}
    assert {entry.header.frame_id for entry in result.objects} == {"base_footprint"}
    assert all(abs(entry.pose.position.z - 0.30) < 0.02 for entry in result.objects)
    assert numbers in ([1], [2], [1, 2]), numbers


@clause("the best grasp is latched: a late subscriber hears it")
def _(shell):
    from moveit_msgs.msg import Grasp

    grasp = shell.robot.hear(f"{NAMESPACE}/rtask/grasps", Grasp, latched()).get(timeout=WAIT_S)
    assert grasp.grasp_pose.header.frame_id == "base_footprint"
    assert grasp.id in {g.id for entry in shell.seen.objects for g in entry.grasps}


@clause("markers are latched: a box and a name for each object")
def _(shell):
    from visualization_msgs.msg import Marker, MarkerArray

    shown = shell.robot.hear(f"{NAMESPACE}/rtask/objects", MarkerArray, latched())
    markers = shown.get(timeout=WAIT_S).markers
    assert [m.action for m in markers] == [Marker.DELETEALL, *[Marker.ADD] * 4]
    assert {m.text.partition(" ")[0] for m in markers if m.text} == {"soap", "tea"}


@clause("the planning scene is latched: the table, and each object by its IRI")
def _(shell):
    from moveit_msgs.msg import PlanningScene

    heard = shell.robot.hear(f"{NAMESPACE}/rtask/planning_scene", PlanningScene, latched())
    scene = heard.get(timeout=WAIT_S)
    boxes = {box.id: box for box in scene.world.collision_objects}
    assert scene.is_diff
    assert set(boxes) == {*(entry.object for entry in shell.seen.objects), "rtask/table"}
    for entry in shell.seen.objects:
        size = [entry.size.x, entry.size.y, entry.size.z]
        assert list(boxes[entry.object].primitives[0].dimensions) == size


@clause("a cancelled goal ends as cancelled at its first feedback")
def _(shell):
    show(shell, 101.0)
    assert shell.robot.see_again(header=since(101.0), gripper_id=shell.gripper)[0] == SUCCEEDED
    status, _, numbers = shell.robot.see(header=since(101.0), gripper_id=shell.gripper, cancel_at=1)
    assert status == CANCELED, status
    assert numbers[0] == 1


@clause("a newer goal ends its predecessor")
def _(shell):
    statuses = []

    def newer(handle):
        statuses.append(shell.robot.see(header=since(101.0), gripper_id=shell.gripper)[0])

    status, *_ = shell.robot.see(header=since(500.0), settle=newer)
    assert (statuses, status) == ([SUCCEEDED], ABORTED)


@clause("the pose of the camera is that of the view's stamp, never of another time")
def _(shell):
    show(shell, 200.0, tf_stamp=150.0)
    status, result, _ = shell.robot.see(header=since(200.0), gripper_id=shell.gripper)
    assert status == ABORTED, status
    words = "no transform from camera_optical to base_footprint at 200.000 s"
    assert words in result.refused, result.refused


@clause("depth with colour and camera info stand for a cloud; a latched camera info is heard")
def _(shell):
    depth, image, info = shell.view.images(210.0)
    shell.robot.publish("/camera/camera_info", info, latched())
    transform = shell.view.transform(210.0)
    keep_publishing(
        shell, ("/tf", transform, 100), ("/camera/image", image, sensor()),
        ("/camera/depth", depth, sensor()),
    )  # fmt: skip
    status, result, _ = shell.robot.see_again(header=since(210.0), gripper_id=shell.gripper)
    assert status == SUCCEEDED, result.refused
    assert sorted(entry.name for entry in result.objects) == ["soap", "tea"]


@clause("a publisher of clouds may be reliable as well as best effort")
def _(shell):
    shell.robot.publishers = {
        key: made for key, made in shell.robot.publishers.items() if key[0] != "/camera/points"
    }
    show(shell, 220.0, reliable=True)
    status, result, _ = shell.robot.see_again(header=since(220.0), gripper_id=shell.gripper)
    assert status == SUCCEEDED, result.refused


@clause("rtask/segment cuts a cloud into the clouds of its objects")
def _(shell):
    from rtask_msgs.srv import SegmentCloud

    cloud = shell.view.cloud(220.0)
    answer = shell.robot.call(
        "rtask/segment", SegmentCloud, lambda request: setattr(request, "cloud", cloud)
    )
    assert (answer.refused, answer.status, len(answer.segments)) == ("", "ok", 2)
    assert abs(answer.table_height - 0.27) < 0.005
    assert min(segment.cloud.width for segment in answer.segments) > 500
    cloud.header.stamp.sec = 900
    answer = shell.robot.call(
        "rtask/segment", SegmentCloud, lambda request: setattr(request, "cloud", cloud)
    )
    assert "no transform" in answer.refused


@clause("parameters are declared with their meaning; the token is none of them")
def _(shell):
    from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters

    node = f"{NAMESPACE}/rtask_node"
    names = shell.robot.call(f"{node}/list_parameters", ListParameters).result.names
    assert {"url", "frame", "gripper_id", "table_height", "min_confidence"} <= set(names)
    assert not [name for name in names if "token" in name]

    def ask(request):
        request.names = ["table_height"]

    values = shell.robot.call(f"{node}/get_parameters", GetParameters, ask).values
    assert values[0].double_value == 0.27
    described = shell.robot.call(f"{node}/describe_parameters", DescribeParameters, ask)
    assert "m; NaN: as seen" in described.descriptors[0].description


@clause("lifecycle: inactive it refuses, active again it answers")
def _(shell):
    from lifecycle_msgs.srv import ChangeState, GetState

    node = f"{NAMESPACE}/rtask_node"

    def go(transition):
        answer = shell.robot.call(
            f"{node}/change_state", ChangeState,
            lambda request: setattr(request.transition, "id", transition),
        )  # fmt: skip
        return answer.success, shell.robot.call(f"{node}/get_state", GetState).current_state.label

    assert go(4) == (True, "inactive")
    assert shell.robot.operation("where_is", name="soap").refused == "the node is not active"
    assert go(2) == (True, "unconfigured")
    assert go(1) == (True, "inactive")
    assert go(3) == (True, "active")
    answer = shell.robot.operation("recall_grasps", object=shell.seen.objects[0].object)
    assert answer.refused == ""


@clause("another node with the same services refuses to start, and names one")
def _(shell):
    second = Program([
        *shell.options.node.split(), "--server", shell.url, "--name", "second",
        "--ros-args", "-r", f"__ns:={NAMESPACE}",
    ])  # fmt: skip
    second.expect(f"Error: service {NAMESPACE}/rtask/where_is is offered by another node")
    assert second.process.wait(20) == 2


@clause("with use_sim_time it waits for /clock, and says so when none comes")
def _(shell):
    silent = Program([
        *shell.options.node.split(), "--server", shell.url, "--wait", "1", "--ros-args",
        "-r", "__ns:=/sim", "-p", "use_sim_time:=true",
    ])  # fmt: skip
    silent.expect("Error: use_sim_time is set and nobody published /clock within 1 s")
    assert silent.process.wait(20) == 3
    from rosgraph_msgs.msg import Clock

    ended = threading.Event()
    clock = shell.robot.node.create_publisher(Clock, "/clock", 10)

    def tick():
        seconds = 50
        while not ended.wait(0.05):
            seconds += 1
            clock.publish(set_fields(Clock(), {"clock": time_fields(seconds)}))

    threading.Thread(target=tick, daemon=True).start()
    try:
        shell.start_node(ros=("-p", "use_sim_time:=true"), namespace="/sim").end()
    finally:
        ended.set()


@clause("a report waits in the outbox while the server is gone, and is answered once it is back")
def _(shell):
    shell.server.end(signal.SIGKILL)
    entry = shell.seen.objects[0]
    # By its id alone: where the grasp is, only the decision says, which outlasts the server.
    report = {"task_id": entry.task_id, "gripper_id": shell.gripper, "grasp": entry.grasps[0].id,
              "success": [True]}  # fmt: skip
    done = queue.Queue()
    threading.Thread(
        target=lambda: done.put(shell.robot.operation("report_outcome", **report)), daemon=True
    ).start()
    answer = done.get(timeout=60)
    assert "kept in" in answer.refused, answer.refused
    shell.start_server()

    outbox = shell.folder / "outbox"
    shell.wait_for(lambda: not outbox.read_text(), "the answer of the server", 60.0)
    refused = outbox.with_name("outbox.refused")
    assert not refused.exists(), refused.read_text()


@clause("a signal ends it with exit code 0, and leaves the graph")
def _(shell):
    shell.end_camera()
    assert shell.node.end(signal.SIGINT) == 0
    shell.wait_for(
        lambda: ("rtask_node", NAMESPACE) not in shell.robot.node.get_node_names_and_namespaces(),
        "the node out of the graph",
    )


def about():
    """Return with what the contract is run."""
    import importlib.metadata as metadata

    from rclpy.utilities import get_rmw_implementation_identifier

    version = ""
    for name in ("rclpy", "ros-rclpy"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            version = version or metadata.version(name)
    distribution = os.environ.get("ROS_DISTRO", "an unnamed ROS 2")
    return (
        f"rclpy {version or '?'} of {distribution}, {get_rmw_implementation_identifier()}, "
        f"Python {platform.python_version()}"
    )


def main():
    """Run all clauses and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    own = ROOT / ".venv/bin/rtask"
    parser.add_argument("--rtask", default=str(own) if own.exists() else "rtask",
                        help="command of RTASK, in its own Python")  # fmt: skip
    parser.add_argument("--node", default="ros2 run rtask_ros2 node", help="command of the node")
    parser.add_argument("--only", default="", help="regular expression of clauses to run")
    options = parser.parse_args()
    try:
        with_what = about()
    except ImportError as error:
        print(f"not run: no ROS 2 in this shell ({error}); source one")
        return 2
    python = str(Path(options.rtask.split()[0]).with_name("python"))
    shell, failed = Shell(options), 0
    try:
        view = shell.folder / "view.npz"
        made = subprocess.run(
            [python, "-m", "tests.rtask.ros2.view_file", str(view)], cwd=ROOT, check=True,
            env=own_python(), capture_output=True, text=True,
        )  # fmt: skip
        shell.contract, shell.view = made.stdout, View(view)
        shell.start_server()
        shell.robot = Robot()
        for words, check in CLAUSES:
            if options.only and not re.search(options.only, words):
                continue
            began = time.monotonic()
            try:
                note = check(shell) or ""
                state = "not run" if note.startswith("not run") else "ok"
            except Exception as error:  # noqa: BLE001 - the other clauses are run all the same
                failed, state = failed + 1, "FAILED"
                note = (
                    f"{error!r:.300} at line {traceback.extract_tb(error.__traceback__)[1].lineno}"
                )
            note = f" ({note})" if note else ""
            print(f"{state:<8}{words}{note} [{time.monotonic() - began:.1f} s]", flush=True)
    finally:
        shell.close()
    print(f"{len(CLAUSES)} clauses, {failed} failed; run with {with_what}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
