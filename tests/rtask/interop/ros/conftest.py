"""A real ROS master, the node under test, and a robot: each in a process of its own."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import queue
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from rtask.interop.ros.find import INSTALL, find_ros
from rtask.interop.ros.master import Master
from tests.commands import start_command
from tests.servers import RunningServer, running_server

READY_S = 60.0
_FOLDER = Path(__file__).parent
# A program that imports rospy as it starts; the search for doctests would import it here.
collect_ignore = [] if find_ros() else ["robot.py"]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests that are marked ``ros`` where there is none; fail where it was installed."""
    if item.get_closest_marker("ros") is None or find_ros() is not None:
        return
    if os.environ.get("RTASK_ROS_INSTALLED"):
        pytest.fail(f"ROS was to be installed and rospy is not there: {INSTALL}")
    pytest.skip(f"no rospy: {INSTALL}")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass
class RosMaster:
    """A master on a port of its own, and the environment of its nodes."""

    home: Path
    port: int = field(default_factory=free_port)
    process: subprocess.Popen[bytes] | None = None

    @property
    def uri(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def environment(self) -> dict[str, str]:
        inherited = {k: v for k, v in os.environ.items() if not k.startswith("ROS")}
        return {
            **inherited,
            "PYTHONPATH": "",
            "PYTHONUNBUFFERED": "1",
            "ROS_MASTER_URI": self.uri,
            "ROS_HOME": str(self.home),
            "ROS_IP": "127.0.0.1",
            "XDG_CACHE_HOME": str(self.home / "cache"),
        }

    def start(self) -> None:
        """Start it; one that is there already would make tests pass for the wrong reason."""
        with pytest.raises(Exception, match="no ROS master"):
            Master(self.uri).ask("getPid")
        self.process = subprocess.Popen(
            ["/usr/bin/python3", "/usr/bin/rosmaster", "--core", "-p", str(self.port)],
            env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        Master(self.uri).wait(READY_S, threading.Event())

    def kill(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()


@pytest.fixture(scope="session")
def roscore(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RosMaster]:
    master = RosMaster(tmp_path_factory.mktemp("ros-home"))
    master.start()
    try:
        yield master
    finally:
        master.kill()


class Child:
    """A process whose lines of output are read as they come."""

    def __init__(
        self, *arguments: str, environment: Mapping[str, str], module: str = "rtask"
    ) -> None:
        self.process = start_command(
            *arguments, environment=environment, module=module, folder=_FOLDER.parents[3],
            stdin=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self.lines: queue.Queue[str] = queue.Queue()
        self.said: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said.append(line)
            self.lines.put(line)
        self.lines.put("")

    def expect(self, start: str, wait_s: float = READY_S) -> str:
        """Return the next line that starts so."""
        deadline = time.monotonic() + wait_s
        while True:
            try:
                line = self.lines.get(timeout=max(deadline - time.monotonic(), 0.01))
            except queue.Empty:
                line = ""
            if line.startswith(start):
                return line
            assert line, f"no line {start!r}: {''.join(self.said)[-2000:]}"

    def end(self, number: int = signal.SIGTERM) -> int:
        """Send it a signal and return its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.finish()

    def finish(self) -> int:
        """Wait for its own end and return its exit code."""
        try:
            return self.process.wait(60)
        finally:
            self.process.kill()
            self._reader.join(60)
            for pipe in (self.process.stdin, self.process.stdout):
                assert pipe is not None
                pipe.close()


class Robot:
    """A node of a robot, driven by commands: robot.py."""

    def __init__(self, roscore: RosMaster, *options: str) -> None:
        module = "tests.rtask.interop.ros.robot"
        self.child = Child(*options, environment=roscore.environment, module=module)
        self.child.expect("robot ready")

    def __call__(self, do: str, **fields: Any) -> Any:
        assert self.child.process.stdin is not None
        self.child.process.stdin.write(json.dumps({"do": do, **fields}) + "\n")
        self.child.process.stdin.flush()
        return json.loads(self.child.expect("answer ").removeprefix("answer "))

    def call(self, service: str, **fields: Any) -> Any:
        """Call a service; return its answer, or its error as text."""
        return self("call", service=service, fields=fields)


@contextlib.contextmanager
def running(child: Child) -> Iterator[Child]:
    """End a process at the end of a block."""
    try:
        yield child
    finally:
        if child.process.stdout is not None and not child.process.stdout.closed:
            child.end()


StartNode = Callable[..., Any]


@pytest.fixture(scope="session")
def start_node(roscore: RosMaster) -> StartNode:
    """Return what runs a command of ``rtask ros``."""

    def start(*options: str, **environment: str) -> Child:
        return Child(*options, environment={**roscore.environment, **environment})

    return start


@pytest.fixture(scope="module")
def ros_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    with running_server(tmp_path_factory.mktemp("ros-server") / "store") as server:
        yield server


@pytest.fixture(scope="module")
def node(start_node: StartNode, ros_server: RunningServer) -> Iterator[Child]:
    """The node, ready, for a server that nobody else uses."""
    child = start_node(
        "ros", "node", "--server", ros_server.url, "--gripper", "hand", "--timeout", "20",
        "~points:=/camera/points", "_table_height:=0.27",
    )  # fmt: skip
    with running(child):
        child.expect("ready /rtask_node")
        yield child


@pytest.fixture(scope="session")
def stamps() -> Iterator[float]:
    return itertools.count(1000.0, 100.0)


@pytest.fixture
def stamp(stamps: Iterator[float]) -> float:
    """Return a time later than any view of the tests before, in seconds.

    A node keeps 10 s of transforms before the newest one: a test that showed views of an earlier
    time than its predecessor would find the camera nowhere.
    """
    return next(stamps)


@pytest.fixture(scope="module")
def robot(roscore: RosMaster, node: Child) -> Iterator[Robot]:
    made = Robot(roscore)
    with running(made.child):
        yield made
