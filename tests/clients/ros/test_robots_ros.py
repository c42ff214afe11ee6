"""Two robots that talk through the server: roslibpy and npm roslib, unmodified."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import roslibpy
from websockets.sync.client import connect

from tests.servers import RunningServer

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
ROBOT = {
    "name": "js-1",
    "model": "nao-h25-v5",
    "end_effectors": [
        {"name": "hand", "gripper_type": "nao", "max_opening": 0.08, "max_payload": 0.1}
    ],
}


@pytest.fixture(scope="module")
def pair(server: RunningServer) -> Iterator[tuple[roslibpy.Ros, roslibpy.Ros]]:
    """Two robot programs of one process; the reactor of their library starts once."""
    robots = []
    for _ in range(2):
        robot = roslibpy.Ros(host="127.0.0.1", port=server.port)
        robot.run(timeout=60)
        robots.append(robot)
    yield robots[0], robots[1]
    for robot in robots:
        robot.close()


def until(test: Callable[[], Any]) -> Any:
    deadline = time.monotonic() + 60
    while not (found := test()):
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.02)
    return found


def test_roslibpy_calls_a_service_that_another_robot_provides(
    pair: tuple[roslibpy.Ros, roslibpy.Ros],
) -> None:
    provider, caller = pair
    service = roslibpy.Service(provider, "/add_two_ints_py", "demo/AddTwoInts")

    def add(request: Any, response: Any) -> bool:
        response["sum"] = request["a"] + request["b"]
        return bool(request["a"])

    service.advertise(add)
    until(lambda: "/add_two_ints_py" in caller.get_services())
    ask = roslibpy.Service(caller, "/add_two_ints_py", "demo/AddTwoInts")
    assert ask.call(roslibpy.ServiceRequest({"a": 2, "b": 40}), timeout=60)["sum"] == 42
    with pytest.raises(roslibpy.core.ServiceException):
        ask.call(roslibpy.ServiceRequest({"a": 0, "b": 1}), timeout=60)
    service.unadvertise()
    until(lambda: "/add_two_ints_py" not in caller.get_services())


def test_roslibpy_sends_a_goal_to_another_robot(
    pair: tuple[roslibpy.Ros, roslibpy.Ros], server: RunningServer
) -> None:
    _, caller = pair
    with connect(server.websocket) as robot:
        robot.send(json.dumps({"op": "advertise_action", "action": "/walk", "type": "nao/Walk"}))
        robot.send(json.dumps({"op": "call_service", "service": "/rosapi/get_time"}))
        robot.recv(timeout=60)
        walk = roslibpy.ActionClient(caller, "/walk", "nao/Walk")
        done, feedback = threading.Event(), []
        results: list[Any] = []
        id_ = walk.send_goal(
            roslibpy.Goal({"x": 1.0}),
            lambda result: (results.append(result), done.set()),
            feedback.append,
            lambda error: (results.append(error), done.set()),
        )
        assert id_
        goal = json.loads(robot.recv(timeout=60))
        about = {"id": goal["id"], "action": "/walk"}
        robot.send(json.dumps({"op": "action_feedback", **about, "values": {"walked": 0.5}}))
        robot.send(
            json.dumps({"op": "action_result", **about, "values": {"at": 1.0}, "status": 4,
                        "result": True})
        )  # fmt: skip
        assert done.wait(60)
    assert feedback[0]["walked"] == 0.5
    assert results[0]["status"] == roslibpy.GoalStatus.SUCCEEDED
    assert results[0]["values"] == {"at": 1.0}


def test_roslibpy_hears_why_a_plan_failed(pair: tuple[roslibpy.Ros, roslibpy.Ros]) -> None:
    plan = roslibpy.ActionClient(pair[0], "/rtask/plan_grasps", "rtask/PlanGrasps")
    done, results = threading.Event(), []

    def take(result: Any) -> None:
        results.append(result)
        done.set()

    goal = roslibpy.Goal({"data": "eA==", "gripper_id": "none"})
    plan.send_goal(goal, take, lambda feedback: None, take)
    assert done.wait(60)
    assert results[0]["status"] == roslibpy.GoalStatus.ABORTED
    assert "gripper" in results[0]["values"]


def test_roslibpy_keeps_parameters_and_hears_a_latched_topic(
    pair: tuple[roslibpy.Ros, roslibpy.Ros],
) -> None:
    first, second = pair
    roslibpy.Param(first, "/speed").set(0.25)
    assert until(lambda: roslibpy.Param(second, "/speed").get()) == 0.25
    said = roslibpy.Topic(first, "/map_py", "std_msgs/String", latch=True)
    said.publish(roslibpy.Message({"data": "kitchen"}))
    until(lambda: "/map_py" in second.get_topics())
    heard: list[Any] = []
    roslibpy.Topic(second, "/map_py", "std_msgs/String").subscribe(heard.append)
    assert until(lambda: heard)[0] == {"data": "kitchen"}


OVER_ASYNCIO = """
import sys, time
import roslibpy

robots = []
for _ in range(2):
    robot = roslibpy.Ros(host=sys.argv[1], port=None, transport="asyncio")
    robot.run(timeout=60)
    robots.append(robot)
provider, caller = robots
service = roslibpy.Service(provider, "/double", "demo/Double")

def double(request, response):
    response["twice"] = 2 * request["n"]
    return True

service.advertise(double)
deadline = time.monotonic() + 60
while "/double" not in caller.get_services():
    assert time.monotonic() < deadline
answer = roslibpy.Service(caller, "/double", "demo/Double").call(
    roslibpy.ServiceRequest({"n": 21}), timeout=60)
heard = []
roslibpy.Topic(caller, "/said_asyncio", "std_msgs/String").subscribe(heard.append)
said = roslibpy.Topic(provider, "/said_asyncio", "std_msgs/String", latch=True)
while not heard:
    assert time.monotonic() < deadline
    said.publish(roslibpy.Message({"data": "hello"}))
    time.sleep(0.05)
print(answer["twice"], heard[0]["data"])
for robot in robots:
    robot.close()
"""


def test_roslibpy_over_its_asyncio_transport(server: RunningServer) -> None:
    """One process can use one transport only, so this one has a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", OVER_ASYNCIO, server.websocket],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    assert done.stdout.split() == ["42", "hello"], done.stderr[-2_000:]


@pytest.fixture(scope="module")
def roslib(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with npm roslib."""
    if not shutil.which("node") or not shutil.which("npm"):
        pytest.skip("Node.js is not installed")
    major = subprocess.run(["node", "--version"], capture_output=True, text=True, check=True)
    if int(major.stdout.strip().lstrip("v").split(".")[0]) < 20:
        pytest.skip(f"roslib needs Node.js 20, there is {major.stdout.strip()}")
    folder = tmp_path_factory.mktemp("node")
    (folder / "package.json").write_text('{"private": true, "type": "module"}')
    command = ["npm", "install", "--no-audit", "--no-fund", "roslib@2.1.0"]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode:
        pytest.skip(f"roslib cannot be installed: {done.stderr.strip()[-200:]}")
    return folder


def test_npm_roslib_does_all_of_it(server: RunningServer, roslib: Path) -> None:
    done = subprocess.run(
        ["node", str(HERE / "roslib_scenario.mjs"), server.websocket, str(roslib)],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
        env={**os.environ, "ROBOT": json.dumps(ROBOT)},
    )
    assert done.returncode == 0, done.stderr[-2_000:]
    seen = json.loads(done.stdout)
    assert seen["robot"].endswith("robot/js-1")
    assert "did you mean /rtask/register_robot?" in seen["error"]
    assert "/rtask/recognise_for_grasp" in seen["services"]
    assert seen["serviceType"] == "rtask/SearchObject"
    assert [seen[c] for c in ("none", "png", "cbor")] == [
        f"grüß dich, {c}" for c in ("none", "png", "cbor")
    ]
    assert (seen["sum"], seen["refused"]) == (42, "refused")
    assert (seen["feedback"][0], seen["feedback"][-1], seen["counted"]) == (1, 3, 3)
    assert (seen["cancelled"], seen["cancelReached"]) == ("cancelled", 1)
    assert seen["param"] == 10
    assert "does not exist" in seen["gone"] or "left" in seen["gone"]
    assert seen["errors"] == []  # nothing that its library does not understand
