"""Answers of a race while the link to the server is cut at random, and what becomes of reports.

``python -m tests.benchmarks.endpoint.bench_race [--tasks 200] [--seed 0]``: a server, a robot
with a slice of its graph, and between them a link that is cut in the middle of every task, at a
random moment and for a random time. The robot asks both sides (Kehoe 2014, 6.2), and tells what
came of each task through its outbox. Printed: how long answers took and who gave them, how many
reports reached the server, and whether the two graphs hold the same outcomes in the end.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import random
import socket
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

import rtask
from rtask.client import Client
from rtask.client.race import Contender, race
from rtask.errors import DeadlineError, RtaskError
from tests.servers import running_server

NS = "https://w3id.org/rtask-kg/ns#"
HAND = {"name": "hand", "gripper_type": "nao_hand", "max_opening": 0.05, "max_payload": 0.3}
TOLD = f"""
SELECT ?id ?success {{
    ?attempt a <{NS}GraspAttempt> ; <{NS}requestId> ?id ; ?with ?outcome .
    ?outcome <{NS}success> ?success
    FILTER(STRSTARTS(?id, "urn:bench:"))
}}"""


class Link:
    """Forwards connections to a port, until it is cut."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._is_up = True
        self._open: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Reset all connections and accept no more."""
        self._is_up = False
        for one in self._open:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
        self._open.clear()

    def mend(self) -> None:
        """Let connections through again."""
        self._is_up = True

    def close(self) -> None:
        """Stop listening."""
        self.cut()
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if not self._is_up:
                near.close()
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self._target))
            except OSError:  # the far side is down: so is this one, as through a plain cable
                near.close()
                continue
            self._open += [near, far]
            for source, target in ((near, far), (far, near)):
                threading.Thread(target=_forward, args=(source, target), daemon=True).start()


def _forward(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(1 << 16):
            target.sendall(data)
    for one in (source, target):
        with suppress(OSError):
            one.close()


def taught(robot: Client) -> dict[str, Any]:
    """Teach one object, and return what a report about its grasp names."""
    points = np.random.default_rng(1).uniform(-0.02, 0.02, (300, 3)).round(4)
    rows = "\n".join(" ".join(map(str, point)) for point in points)
    head = "ply\nformat ascii 1.0\nelement vertex 300\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    cloud = base64.b64encode(f"{head}end_header\n{rows}\n".encode()).decode()
    robot.register_robot(name="nao-1", model="nao", end_effectors=[HAND])
    made = robot.insert_object(
        data=cloud, gripper_id="hand", X=0.0, Y=0.0, Z=0.01, rad=0.0, frame_id="base"
    )["objects"][0]
    return {"object": made["object"], "grasp": made["grasp"], "gripper_id": "hand"}


def outcomes(robot: Client) -> set[tuple[str, str]]:
    """Return the reports of the tasks that a graph holds."""
    return {(str(row["id"]), str(row["success"])) for row in robot.query(TOLD)}


def run(tasks: int, seed: int, deadline_s: float = 0.3) -> dict[str, Any]:
    """Carry out tasks over a link that is cut in the middle of each, and return what came of them.

    Parameters
    ----------
    deadline_s
        Of each race.
    """
    chance = random.Random(seed)
    seconds: list[float] = []
    won = {"local": 0, "remote": 0, "nobody": 0}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        server = stack.enter_context(running_server(folder / "store"))
        link = Link(server.port)
        stack.callback(link.close)
        kb = stack.enter_context(rtask.open(folder / "slice"))
        near = stack.enter_context(rtask.connect(kb, agent="nao-1"))
        box = folder / "outbox.jsonl"
        far = stack.enter_context(
            rtask.connect(f"http://127.0.0.1:{link.port}", timeout_s=0.6, outbox=box)
        )
        with rtask.connect(server.url, timeout_s=120) as setup:
            known = taught(setup)
        own = taught(near)

        def local(_: Contender[Any]) -> Any:
            return near.recall_grasps(object=own["object"])

        def remote(_: Contender[Any]) -> Any:
            return far.recall_grasps(object=known["object"])

        local(Contender(threading.Condition()))
        for number in range(tasks):
            cut = threading.Timer(chance.uniform(0, 0.03), link.cut)
            cut.start()
            began = time.perf_counter()
            try:
                won[race(local, remote, patience_s=0.05, deadline_s=deadline_s).won_by] += 1
            except DeadlineError:
                won["nobody"] += 1
            seconds.append(time.perf_counter() - began)
            report = {"task_id": f"urn:bench:{number}", "success": chance.random() < 0.7}
            near.call("report_outcome", **report, **own)
            mend = threading.Timer(chance.uniform(0, 0.3), link.mend)
            mend.start()
            far.tell("report_outcome", **report, **known)
            cut.join()
            mend.join()
        link.mend()
        waiting = far.waiting
        while far.waiting:
            with suppress(RtaskError):
                far.deliver()
        with rtask.connect(server.url, timeout_s=120) as check:
            there, here = outcomes(check), outcomes(near)
    return {
        "tasks": tasks, "won_by": won,
        "p50_ms": round(1e3 * float(np.median(seconds)), 1),
        "p95_ms": round(1e3 * float(np.quantile(seconds, 0.95)), 1),
        "max_ms": round(1e3 * max(seconds), 1), "kept_at_the_end": waiting,
        "reports": len(there), "lost": tasks - len(there), "graphs_agree": there == here,
        "load": os.getloadavg(),
    }  # fmt: skip


def main() -> None:
    """Run the tasks and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    found = run(asked.tasks, asked.seed)
    print(json.dumps(found))
    sys.exit(0 if found["graphs_agree"] and not found["won_by"]["nobody"] else 1)


if __name__ == "__main__":
    main()
