"""The server and the node under test, as processes."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import urllib.request
from pathlib import Path
from typing import ClassVar

ROOT = Path(__file__).resolve().parents[3]
NAMESPACE = "/nao1"
WAIT_S = 60.0


def own_python():
    """Return the environment without ROS, whose libraries RTASK must not import."""
    left_out = ("PYTHONPATH", "LD_LIBRARY_PATH", "LD_PRELOAD")
    return {name: value for name, value in os.environ.items() if name not in left_out}


class Program:
    """A process whose lines are read as they come."""

    started: ClassVar[list] = []

    def __init__(self, command, environment=None):
        self.process = subprocess.Popen(
            command, env={**(environment or os.environ), "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
            start_new_session=True,
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
        """Send a signal to the program and its children, as a terminal does; return its code.

        `ros2 run` starts the node as a child and hands no signal on.
        """
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, number)
        try:
            return self.process.wait(60)
        except subprocess.TimeoutExpired:
            self.kill()
            raise

    def kill(self):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)

    @classmethod
    def kill_all(cls):
        """Leave no process behind, not even one that takes no signal."""
        for program in cls.started:
            program.kill()


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
            *command, "--server", self.url, "--timeout", "25", *options, "--ros-args",
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
            with contextlib.suppress(subprocess.TimeoutExpired):  # it was killed then
                program.end()
        if self.robot is not None:
            self.robot.close()
        self.stack.close()
