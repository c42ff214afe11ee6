"""The node of ROS 1 beside the server's own rosbridge: one call, and one raw cloud of a camera.

Both paths lead to the same server and are used in turn, so that a busy machine slows both. Needs
ROS 1 (Debian's packages); every process is on this machine.

Run: python tests/benchmarks/endpoint/bench_ros.py [--calls 200] [--clouds 20]
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import json
import multiprocessing
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import connect

import rtask
from rtask.cli.ros.schema import engine_schema
from rtask.interop.ros.find import use_ros
from rtask.interop.ros.package import load_messages
from tests.rtask.interop.ros.conftest import Child, RosMaster, running
from tests.servers import running_server

HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.05, "max_payload": 0.3}
SHAPE = (480, 640)
TARGET_CALL, TARGET_CLOUD = 1.5, 0.2
_MAX_BYTES = 64 * 2**20


def hear_ros(environment: dict[str, str], out: Any) -> None:
    """Subscribe in ROS; put the time at which each cloud was there as a message."""
    os.environ.update(environment)
    use_ros()
    import rospy
    from sensor_msgs.msg import PointCloud2

    rospy.init_node("hears", disable_signals=True, argv=["hears"])
    options = {"queue_size": 1, "buff_size": 2**24, "tcp_nodelay": True}
    rospy.Subscriber("cloud", PointCloud2, lambda m: out.put((len(m.data), time.time())), **options)
    out.put("ready")
    rospy.spin()


def hear_rosbridge(address: str, out: Any) -> None:
    """Subscribe over rosbridge; put the time at which each cloud was there as bytes."""
    with connect(address, max_size=_MAX_BYTES, compression=None, ping_interval=None) as socket:
        socket.send(json.dumps({"op": "subscribe", "topic": "/cloud"}))
        out.put("ready")
        while True:
            message = json.loads(socket.recv())
            data = base64.b64decode(message["msg"]["data"])
            out.put((len(data), time.time()))


def in_turn(ways: dict[str, Callable[[], float]], count: int) -> dict[str, float]:
    """Return the median of each way, s; the first tenth of the runs warms up."""
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(count + count // 10):
        for name, way in ways.items():
            taken[name].append(way())
    return {name: statistics.median(all_[count // 10 :]) for name, all_ in taken.items()}


def timed(action: Callable[[], Any]) -> Callable[[], float]:
    """Return an action that returns how long it took, s."""

    def run() -> float:
        started = time.perf_counter()
        action()
        return time.perf_counter() - started

    return run


def call_ways(
    url: str, gripper: str, client: Any, opened: contextlib.ExitStack
) -> dict[str, Callable[[], float]]:
    """Return the ways of one call of ``resolve_request``."""
    import roslibpy
    import rospy
    from rtask_msgs.srv import ResolveRequest

    asked = {"wanted": "cup", "gripper_id": gripper}
    rospy.wait_for_service("/rtask/resolve_request", 30)
    held = rospy.ServiceProxy("/rtask/resolve_request", ResolveRequest, persistent=True)
    once = rospy.ServiceProxy("/rtask/resolve_request", ResolveRequest)
    ros = roslibpy.Ros(host=url.replace("http", "ws", 1), port=None)
    ros.run(timeout=30)
    opened.callback(ros.terminate)
    opened.callback(held.close)
    service = roslibpy.Service(ros, "/rtask/resolve_request", "rtask/ResolveRequest")
    request = roslibpy.ServiceRequest(asked)
    return {
        "rosbridge, rtask.connect": timed(lambda: client.call("resolve_request", **asked)),
        "rosbridge, roslibpy": timed(lambda: service.call(request, timeout=30)),
        "ROS, held connection": timed(lambda: held(**asked)),
        "ROS, new connection": timed(lambda: once(**asked)),
    }


def cloud_ways(
    url: str, environment: dict[str, str], opened: contextlib.ExitStack
) -> dict[str, Callable[[], float]]:
    """Return the ways of one cloud from a publisher to a subscriber in another process."""
    import rospy
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Header

    from rtask.interop.ros.clouds import cloud_message

    rng = np.random.default_rng(0)
    points = rng.normal(size=(*SHAPE, 3)).astype(np.float32)
    rgb = rng.integers(0, 255, (*SHAPE, 3), np.uint8)
    message = cloud_message(points, rgb, Header(frame_id="camera"))
    spawn = multiprocessing.get_context("spawn")
    by_ros, by_bridge = spawn.Queue(), spawn.Queue()
    address = url.replace("http", "ws", 1) + "/rosbridge"
    for target, args in ((hear_ros, (environment, by_ros)), (hear_rosbridge, (address, by_bridge))):
        process = spawn.Process(target=target, args=args, daemon=True)
        process.start()
        opened.callback(process.kill)
        assert args[1].get(timeout=60) == "ready"
    publisher = rospy.Publisher("cloud", PointCloud2, queue_size=1)
    deadline = time.monotonic() + 30
    while publisher.get_num_connections() == 0:
        assert time.monotonic() < deadline, "nobody subscribed"
        time.sleep(0.05)
    options = {"max_size": _MAX_BYTES, "compression": None, "ping_interval": None}
    socket = opened.enter_context(connect(address, **options))
    advertise = {"op": "advertise", "topic": "/cloud", "type": "sensor_msgs/PointCloud2"}
    socket.send(json.dumps(advertise))
    time.sleep(0.5)

    def ros() -> float:
        started = time.time()
        publisher.publish(message)
        size, came = by_ros.get(timeout=30)
        assert size == len(message.data)
        return float(came - started)

    def bridge() -> float:
        started = time.time()
        data = base64.b64encode(message.data).decode()
        told = {"height": message.height, "width": message.width, "data": data}
        socket.send(json.dumps({"op": "publish", "topic": "/cloud", "msg": told}))
        size, came = by_bridge.get(timeout=30)
        assert size == len(message.data)
        return float(came - started)

    return {"rosbridge topic": bridge, "ROS topic": ros}


def show(title: str, medians: dict[str, float], target: float) -> None:
    """Print one table; the first row is the measure of the others."""
    base = next(iter(medians.values()))
    print(f"\n{title}\n{'':28} {'median':>10} {'ratio':>7}   load {os.getloadavg()[0]:.1f}")
    for name, seconds in medians.items():
        print(f"{name:28} {seconds * 1e3:7.2f} ms {seconds / base:7.2f}")
    print(f"target of the ROS row: <= {target:g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=200)
    parser.add_argument("--clouds", type=int, default=20)
    options = parser.parse_args()
    master = RosMaster(Path(tempfile.mkdtemp(prefix="rtask-ros-")))
    master.start()
    wanted = {"ROS_MASTER_URI", "ROS_HOME", "ROS_IP", "XDG_CACHE_HOME"}
    environment = {k: v for k, v in master.environment.items() if k in wanted}
    os.environ.update(environment)
    load_messages(engine_schema(), use_ros())
    import rospy

    with contextlib.ExitStack() as opened:
        opened.callback(master.kill)
        server = opened.enter_context(running_server(None))
        client = opened.enter_context(rtask.connect(server.url))
        robot = client.register_robot(name="nao-1", model="nao", end_effectors=[HAND])
        command = [sys.executable, "-m", "rtask", "ros", "node", "--server", server.url]
        node = opened.enter_context(running(Child(command, master.environment)))
        node.expect("ready")
        rospy.init_node("asks", disable_signals=True, argv=["asks"])
        opened.callback(rospy.signal_shutdown, "measured")
        calls = call_ways(server.url, f"{robot['robot']}/hand", client, opened)
        show("one call of resolve_request", in_turn(calls, options.calls), TARGET_CALL)
        clouds = cloud_ways(server.url, environment, opened)
        show("one raw cloud, 640 x 480", in_turn(clouds, options.clouds), TARGET_CLOUD)


if __name__ == "__main__":
    main()
