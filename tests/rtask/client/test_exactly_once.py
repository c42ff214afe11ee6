"""A robot that loses the network, and a server that is killed: each outcome is stored once."""

from __future__ import annotations

import base64
import contextlib
import random
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import rtask
from rtask.errors import RemoteUnavailableError
from tests.servers import running_server

NS = "https://w3id.org/rtask-kg/ns#"
HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.05, "max_payload": 0.3}


class BadNetwork:
    """A TCP proxy that cuts connections: before a message, or after it and before the answer."""

    def __init__(self, seed: int) -> None:
        self.target: int | None = None
        self.chance = 0.0
        self.cuts = 0
        self._random = random.Random(seed)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def close(self) -> None:
        """Take no more connections and wait for those that there are."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for thread in self._threads:
            thread.join(60)

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            try:
                if self.target is None:
                    raise ConnectionRefusedError
                far = socket.create_connection(("127.0.0.1", self.target), timeout=60)
            except OSError:
                near.close()
                continue
            far.settimeout(None)
            for source, sink in ((near, far), (far, near)):
                thread = threading.Thread(target=self._pump, args=(source, sink))
                self._threads.append(thread)
                thread.start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                if self._random.random() < self.chance:
                    self.cuts += 1
                    break
                sink.sendall(data)
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()


@pytest.fixture
def network() -> Iterator[BadNetwork]:
    made = BadNetwork(seed=7)
    yield made
    made.close()


def cloud(seed: int) -> str:
    """Return a small ASCII PLY of a lumpy block."""
    points = np.random.default_rng(seed).uniform(-0.02, 0.02, (300, 3)).round(4)
    head = "ply\nformat ascii 1.0\nelement vertex 300\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    rows = "\n".join(" ".join(map(str, point)) for point in points)
    return base64.b64encode(f"{head}end_header\n{rows}\n".encode()).decode()


@pytest.mark.slow
def test_every_outcome_arrives_once_through_cuts_and_kills(
    tmp_path: Path, network: BadNetwork
) -> None:
    box = tmp_path / "outbox.jsonl"
    url = f"http://127.0.0.1:{network.port}"
    told = [f"urn:test:outcome:{k}" for k in range(24)]
    with running_server(tmp_path / "store") as server:
        network.target = server.port
        with rtask.connect(url, timeout_s=20) as robot:
            robot.register_robot(name="nao-1", model="nao", end_effectors=[HAND])
            made = robot.insert_object(
                data=cloud(1), gripper_id="hand", X=0.0, Y=0.0, Z=0.01, rad=0.0, frame_id="base"
            )["objects"][0]
        grasp = {"object": made["object"], "grasp": made["grasp"], "gripper_id": "hand"}

        def report(task_id: str) -> None:
            """A robot program that is started, says one thing, and ends."""
            with rtask.connect(url, timeout_s=0.6, outbox=box) as robot:
                robot.tell("report_outcome", task_id=task_id, success=True, **grasp)

        network.chance = 0.15
        for task_id in told[:10]:
            report(task_id)
        server.stop(signal.SIGKILL)
        for task_id in told[10:13]:
            report(task_id)  # nobody there
        network.target = None
    network.chance = 0.0
    with running_server(tmp_path / "store") as server:
        network.target = server.port
        network.chance = 0.15
        for task_id in told[13:]:
            report(task_id)
        network.chance = 0.0
        with rtask.connect(url, timeout_s=20, outbox=box) as robot:
            robot.deliver()
            assert robot.waiting == 0
            rows = robot.query(
                f"SELECT ?id {{ ?a a <{NS}GraspAttempt> ; <{NS}requestId> ?id "
                'FILTER(STRSTARTS(?id, "urn:test:")) } ORDER BY ?id'
            )
            statistics = robot.recall_grasps(object=made["object"])["grasps"][0]["statistics"]
    assert network.cuts > 3  # the network was bad
    assert [row["id"] for row in rows] == sorted(told)
    assert statistics["attempts"] == len(told) + 1  # with the one that came with the object
    assert not box.with_name(box.name + ".refused").exists()


def test_what_is_told_without_an_outbox_fails_aloud(network: BadNetwork) -> None:
    with (
        rtask.connect(f"http://127.0.0.1:{network.port}", timeout_s=0.3) as robot,
        pytest.raises(RemoteUnavailableError),
    ):
        robot.tell("report_outcome", success=True)
