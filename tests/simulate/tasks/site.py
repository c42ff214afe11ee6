"""A server whose callers have tokens, and robots that are processes in its lab."""

from __future__ import annotations

import json
import multiprocessing
import signal
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import rtask
from endpoint.access.tokens import TokenStore
from simulate.tasks.lab import read_lab
from tests.servers import RunningServer
from tests.simulate.tasks.crew_robot import CrewRobot, run_robot

_FORK = multiprocessing.get_context("fork")
PATIENCE_S = 240.0
"""Until a process must have ended, on a loaded machine; no test needs nearly as long."""


class Site:
    """A server whose callers all need tokens, and the lab that it describes."""

    def __init__(
        self, server: RunningServer, data: Path, folder: Path, robots: Sequence[str]
    ) -> None:
        with closing(TokenStore(data)) as tokens:
            self.admin = tokens.create("admin")[0]
            self.tokens = {
                robot: tokens.create("robot", agent=robot.rpartition("/")[2])[0] for robot in robots
            }
        self.url, self.folder = server.url, folder
        self.person = rtask.connect(server.url, token=self.admin)
        lab = read_lab(self.person.query, None)
        self.reach, self.hands = lab.reach, lab.hands
        (folder / "lab.json").write_text(json.dumps({"where": lab.where, "done": []}))

    def start(self, robot: str, dies_after: str = "") -> multiprocessing.Process:
        body = CrewRobot(self.folder, robot, self.reach, self.hands, dies_after)
        process = _FORK.Process(target=run_robot, args=(self.url, self.tokens[robot], body))
        process.start()
        return process

    @property
    def truth(self) -> dict:
        return json.loads((self.folder / "lab.json").read_text())


class KillsServer:
    """A robot whose server is killed right after an action, before it can say anything."""

    def __init__(self, body: CrewRobot, server: RunningServer, action: str) -> None:
        self._body, self._server, self._action = body, server, action

    def __getattr__(self, name: str) -> object:
        done = getattr(self._body, name)
        if name != self._action:
            return done

        def act_and_kill(*arguments: str) -> object:
            deed = done(*arguments)
            self._server.stop(signal.SIGKILL)
            return deed

        return act_and_kill


def ended(process: multiprocessing.Process) -> int | None:
    """Wait until a process has ended, and return its exit code."""
    process.join(PATIENCE_S)
    return process.exitcode
