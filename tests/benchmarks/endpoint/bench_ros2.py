"""The node for ROS 2 beside the server's own rosbridge: a call, a cloud of 2 MB, the best grasp.

All ways lead to one server and are used in turn, so that a busy machine slows each of them. Needs
a sourced ROS 2 with the packages of `rtask ros messages` and `rtask ros2 package`; every process is
on this machine. The rosbridge client is the websocket library of the node.

Run with the Python of ROS 2:
    python3 tests/benchmarks/endpoint/bench_ros2.py [--calls 100] [--clouds 40] [--grasps 20]
"""

from __future__ import annotations

import argparse
import array
import base64
import json
import multiprocessing
import os
import queue
import statistics
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.09, "max_payload": 0.5}
CLOUD = (256, 512)  # of 16 bytes: 2 MiB
MAX_BYTES = 64 * 2**20


def hear_ros(out):
    """Subscribe in ROS 2; put the size of each cloud and the time at which it was there."""
    import rclpy
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import PointCloud2

    rclpy.init()
    node = rclpy.create_node("hears")
    node.create_subscription(
        PointCloud2, "/cloud", lambda m: out.put((len(m.data), time.time())),
        qos_profile_sensor_data,
    )  # fmt: skip
    out.put("ready")
    rclpy.spin(node)


def hear_rosbridge(address, out):
    """Subscribe over rosbridge; put the size of each cloud and the time at which it was there."""
    from websockets.sync.client import connect

    with connect(address, max_size=MAX_BYTES, compression=None, ping_interval=None) as socket:
        socket.send(json.dumps({"op": "subscribe", "topic": "/cloud"}))
        out.put("ready")
        while True:
            message = json.loads(socket.recv())
            out.put((len(base64.b64decode(message["msg"]["data"])), time.time()))


class Bridge:
    """A client of rosbridge."""

    def __init__(self, url):
        from websockets.sync.client import connect

        self.address = url.replace("http", "ws", 1) + "/rosbridge"
        self.socket = connect(
            self.address, max_size=MAX_BYTES, compression=None, ping_interval=None
        )
        self.count = 0

    def call(self, operation, **fields):
        self.count += 1
        asked = {"op": "call_service", "id": str(self.count), "service": f"/rtask/{operation}",
                 "args": fields}  # fmt: skip
        self.socket.send(json.dumps(asked))
        while True:
            answer = json.loads(self.socket.recv(timeout=60))
            if answer.get("id") == str(self.count):
                assert answer["result"], answer
                return answer["values"]


def in_turn(ways, count):
    """Return median and 95th percentile of each way, s; the first tenth of the runs warms up."""
    taken = {name: [] for name in ways}
    for _ in range(count + count // 10):
        for name, way in ways.items():
            taken[name].append(way())
    measured = {name: sorted(each[count // 10 :]) for name, each in taken.items()}
    return {
        name: (statistics.median(each), each[round(0.95 * (len(each) - 1))])
        for name, each in measured.items()
    }


def timed(action):
    """Return an action that returns how long it took, s."""

    def run():
        started = time.perf_counter()
        action()
        return time.perf_counter() - started

    return run


def call_ways(shell, bridge):
    asked = {"wanted": "cup", "gripper_id": shell.gripper}
    return {
        "rosbridge": timed(lambda: bridge.call("resolve_request", **asked)),
        "ROS 2": timed(lambda: shell.robot.operation("resolve_request", **asked)),
    }


def cloud_ways(shell, bridge):
    """Return the ways of one cloud from a publisher to a subscriber in another process."""
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import PointCloud2

    height, width = CLOUD
    size = 16 * height * width
    data = array.array("B", bytes(range(256)) * (size // 256))
    message = PointCloud2(height=height, width=width, point_step=16, row_step=16 * width)
    message.data = data
    spawn = multiprocessing.get_context("spawn")
    by_ros, by_bridge = spawn.Queue(), spawn.Queue()
    for target, args in ((hear_ros, (by_ros,)), (hear_rosbridge, (bridge.address, by_bridge))):
        process = spawn.Process(target=target, args=args, daemon=True)
        process.start()
        shell.stack.callback(process.kill)
        assert args[-1].get(timeout=60) == "ready"
    publisher = shell.robot.node.create_publisher(PointCloud2, "/cloud", qos_profile_sensor_data)
    shell.wait_for(lambda: publisher.get_subscription_count() > 0, "a subscriber in ROS 2")
    advertise = {"op": "advertise", "topic": "/cloud", "type": "sensor_msgs/PointCloud2"}
    bridge.socket.send(json.dumps(advertise))
    lost = {"ROS 2 topic": 0}

    def ros():
        while True:  # best effort may lose one
            started = time.time()
            publisher.publish(message)
            try:
                came_size, came = by_ros.get(timeout=0.5)
            except queue.Empty:
                lost["ROS 2 topic"] += 1
                continue
            assert came_size == size
            return came - started

    def over_bridge():
        started = time.time()
        text = base64.b64encode(data).decode()
        sent = {"height": height, "width": width, "point_step": 16, "data": text}
        bridge.socket.send(json.dumps({"op": "publish", "topic": "/cloud", "msg": sent}))
        came_size, came = by_bridge.get(timeout=60)
        assert came_size == size
        return came - started

    return {"rosbridge topic": over_bridge, "ROS 2 topic": ros}, lost


def grasp_ways(shell, bridge):
    """Return the ways from the points of a taught object to its best grasp."""
    from moveit_msgs.msg import Grasp

    from tests.clients.ros2.programs import NAMESPACE
    from tests.clients.ros2.robot import latched

    crop = teach(shell)
    asked = {"gripper_id": shell.gripper, "propose": True}
    heard = shell.robot.hear(f"{NAMESPACE}/rtask/grasps", Grasp, latched())

    def over_bridge():
        answer = bridge.call("recognise_for_grasp", data=crop, **asked)
        assert answer["grasps"]

    def ros():
        answer = shell.robot.operation("recognise_for_grasp", data=base64.b64decode(crop), **asked)
        assert answer.grasps, answer.refused

    def ros_topic():
        while not heard.empty():
            heard.get()
        started = time.perf_counter()
        answered = shell.robot.operation(
            "recognise_for_grasp", data=base64.b64decode(crop), **asked
        )
        assert heard.get(timeout=30).id == answered.grasps[0].id
        return time.perf_counter() - started

    return {
        "rosbridge, response": timed(over_bridge),
        "ROS 2, response": timed(ros),
        "ROS 2, response and topic": ros_topic,
    }


def teach(shell):
    """Teach the objects of the view; return the points of one of them, base64."""
    message = shell.view.cloud(100.0)
    cloud = {
        "height": message.height, "width": message.width, "point_step": message.point_step,
        "row_step": message.row_step, "is_bigendian": False, "is_dense": True,
        "fields": [{"name": f.name, "offset": f.offset, "datatype": f.datatype, "count": f.count}
                   for f in message.fields],
        "data": base64.b64encode(bytes(message.data)).decode(),
    }  # fmt: skip
    seen = shell.perceive({"sensor_pose": shell.view.pose, "cloud": cloud})["objects"]
    for name, entry in zip(("soap", "tea"), seen, strict=True):
        stored = shell.robot.operation("insert_object", objects=[{
            "data": base64.b64decode(entry["cloud"]), "name": name, "gripper_id": shell.gripper,
            "class_description": "box", "task_id": f"task-{name}"}])  # fmt: skip
        assert stored.stored == 1, stored.refused
    return seen[0]["cloud"]


def show(title, measured):
    """Print one table; the first row is the measure of the others."""
    base = next(iter(measured.values()))[0]
    print(f"\n{title}\n{'':28} {'median':>10} {'95 %':>10} {'ratio':>7}")
    for name, (median, high) in measured.items():
        print(f"{name:28} {median * 1e3:7.2f} ms {high * 1e3:7.2f} ms {median / base:7.2f}")
    print(f"load {os.getloadavg()[0]:.1f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--calls", type=int, default=100)
    parser.add_argument("--clouds", type=int, default=40)
    parser.add_argument("--grasps", type=int, default=20)
    parser.add_argument("--rtask", default="", help="command of RTASK, in its own Python")
    parser.add_argument("--node", default="ros2 run rtask_ros2 node", help="command of the node")
    options = parser.parse_args()
    try:
        from tests.clients.ros2.contract import about

        with_what = about()
    except ImportError as error:
        print(f"not run: no ROS 2 in this Python ({error}); source one")
        return 0
    from tests.clients.ros2.programs import ROOT, Shell, own_python
    from tests.clients.ros2.robot import Robot
    from tests.clients.ros2.views import View

    own = ROOT / ".venv/bin/rtask"
    options.rtask = options.rtask or (str(own) if own.exists() else "rtask")
    shell = Shell(options)
    try:
        file = shell.folder / "view.npz"
        python = str(Path(options.rtask.split()[0]).with_name("python"))
        command = [python, "-m", "tests.rtask.ros2.view_file", str(file)]
        subprocess.run(command, cwd=ROOT, check=True, env=own_python(), capture_output=True)
        shell.view = View(file)
        shell.start_server()
        shell.start_node("--gripper", "hand")
        shell.robot = Robot()
        answer = shell.robot.operation("register_robot", name="nao-1", model="nao",
                                       end_effectors=[HAND])  # fmt: skip
        shell.gripper = f"{answer.robot}/hand"
        bridge = Bridge(shell.url)
        print(f"run with {with_what}, load {os.getloadavg()[0]:.1f}")
        show("one call of resolve_request", in_turn(call_ways(shell, bridge), options.calls))
        ways, lost = cloud_ways(shell, bridge)
        show("one cloud of 2 MiB, process to process", in_turn(ways, options.clouds))
        print(f"lost by best effort: {lost['ROS 2 topic']}")
        grasps = grasp_ways(shell, bridge)
        show("best grasp for the points of an object", in_turn(grasps, options.grasps))
    finally:
        shell.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
