"""A robot of a crew as a process of its own; the truth of the lab is a file that all share."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

import rtask
from simulate.tasks.body import Deed
from simulate.tasks.executor import Executor
from simulate.tasks.lab import Lab, LabRobot

IDLE_S = 0.02
"""Between two questions for a step, as nothing tells a robot that one has become possible."""


@dataclass(frozen=True)
class CrewRobot:
    """Hands and eyes in the shared lab.

    Parameters
    ----------
    folder
        ``lab.json`` holds where things are and what was done.
    iri
        Of the robot.
    reach, hands
        As of a :class:`Lab`.
    dies_after
        Action after which the process is killed, once; the graph has not heard of it then.
    """

    folder: Path
    iri: str
    reach: Mapping[str, frozenset[str]]
    hands_of: Mapping[str, Mapping[str, str]]
    dies_after: str = ""

    @property
    def hands(self) -> Mapping[str, str]:
        return self.hands_of[self.iri]

    @property
    def physics(self) -> Literal["fast"]:
        return "fast"

    def sees(self, item: str, place: str) -> bool:
        return self._in_lab(lambda robot: robot.sees(item, place))

    def find(self, item: str) -> str | None:
        return self._in_lab(lambda robot: robot.find(item))

    def pick(self, item: str, place: str, hand: str) -> Deed:
        return self._do("pick", lambda robot: robot.pick(item, place, hand))

    def put(self, item: str, place: str, hand: str) -> Deed:
        return self._do("put", lambda robot: robot.put(item, place, hand))

    def give(self, item: str, hand: str, target: str) -> Deed:
        return self._do("give", lambda robot: robot.give(item, hand, target))

    def _do(self, action: str, act: Callable[[LabRobot], Deed]) -> Deed:
        deed = self._in_lab(act)
        if deed.success and action == self.dies_after:
            os.kill(os.getpid(), signal.SIGKILL)
        return deed

    def _in_lab(self, act: Callable[[LabRobot], Any]) -> Any:
        """Act in the lab as it is now, with no other robot in between."""
        with (self.folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            file = self.folder / "lab.json"
            state = json.loads(file.read_text())
            lab = Lab(state["where"], self.reach, self.hands_of, np.random.default_rng(0))
            result = act(lab.robot(self.iri))
            done = state["done"] + [list(deed) for deed in lab.done]
            file.write_text(json.dumps({"where": lab.where, "done": done}))
        return result


def run_robot(url: str, token: str, body: CrewRobot) -> None:
    """Take turns until no plan is open; the last act of the process."""
    with contextlib.suppress(KeyboardInterrupt), rtask.connect(url, token=token) as graph:
        robot = Executor(graph, body)
        while robot.turn().result != "idle" or graph.call("list_plans", state="open")["plans"]:
            time.sleep(IDLE_S)
