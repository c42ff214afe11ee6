"""Processes of a demo or a fleet: an endpoint and one process per robot.

Children communicate in lines: the endpoint says when it is ready; a robot prints one JSON event per
line and waits for ``go`` on its standard input. However the parent ends, its children end too: it
stops them on exit, and if it is killed, the kernel stops them (Linux) or their standard input
closes.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtask.errors import RobotError, RtaskError
from simulate.agent.decisions import Thresholds

__all__ = ["Endpoint", "MemberProcess", "Robot", "RobotJob", "run_rtask"]

_PR_SET_PDEATHSIG = 1
_READY_TIMEOUT_S = 600.0
_SILENCE_S = 600.0
_STOP_TIMEOUT_S = 20.0
_WINDOW_GONE = "X connection to"
"""Last message of Xlib, which ends the whole process without notifying the libraries above it."""


def _end_with_parent() -> None:
    """Let the kernel end this process when its parent dies (prctl(2), Linux only)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "rtask", *arguments]


def run_rtask(*arguments: str) -> str:
    """Run one ``rtask`` command and return its output.

    Raises
    ------
    RtaskError
        With the command's own message if it exits with a code other than 0.
    """
    done = subprocess.run(_command(*arguments), capture_output=True, text=True, check=False)
    if done.returncode:
        raise RtaskError(_last_line(done.stderr) or f"rtask {arguments[0]}: exit {done.returncode}")
    return done.stdout


def _last_line(text: str) -> str:
    lines = [line for line in text.strip().splitlines() if line.strip()]
    return lines[-1].removeprefix("rtask: ").removeprefix("Error: ") if lines else ""


@dataclass(frozen=True)
class RobotJob:
    """Task of one robot of a demo.

    Parameters
    ----------
    name
        The robot's name, which is also the agent of its token.
    index
        Number of the robot; together with ``seed`` it fixes its table, light and noise.
    url
        The endpoint; empty = a graph of its own in memory, which nobody else writes to.
    seed, objects, products
        Fix the products, which are the same for every robot of a demo; ``products`` names a set of
        :data:`simulate.world.objects.PRODUCTS`.
    pictures, small_pictures, films
        Folder for the pictures of each grasp, whether these are JPEG, and whether each grasp is
        filmed, too.
    outbox
        File that keeps outcomes not yet delivered.
    robot
        Kind of robot: a name of :func:`simulate.robots.known_robots`.
    min_grasp, cautious
        Of :class:`simulate.agent.decisions.Thresholds`.
    only, mirrored, turned
        Name of the one product on the table, instead of those of ``products``; whether its secret
        is at the other end than the catalogue has it; and whether it lies turned by half a turn.
        Empty = those of ``products``.
    """

    name: str
    index: int
    url: str
    seed: int
    objects: int
    max_attempts: int
    pictures: str
    outbox: str
    gui: bool = False
    preset: str = "faithful"
    robot: str = "nao"
    products: str = "plain"
    min_grasp: float = Thresholds.grasp
    cautious: bool = Thresholds.cautious
    small_pictures: bool = False
    films: bool = False
    only: str = ""
    mirrored: bool = False
    turned: bool = False

    @property
    def thresholds(self) -> Thresholds:
        """Least confidences for a grasp."""
        return Thresholds(grasp=self.min_grasp, cautious=self.cautious)


class _Child:
    """A child process whose standard output is read line by line in a thread."""

    def __init__(self, name: str, command: list[str], log: Path, env: dict[str, str]) -> None:
        self.name = name
        self._log_path = log
        self._log = log.open("w", encoding="utf-8")
        self._lines: queue.Queue[str | None] = queue.Queue()
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            bufsize=1,
            env={**os.environ, **env},
            start_new_session=True,  # Ctrl-C reaches the parent only, which then ends its children
            preexec_fn=_end_with_parent,
        )
        threading.Thread(target=self._pump, name=f"read-{name}", daemon=True).start()

    def _pump(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def next_line(self, timeout_s: float) -> str | None:
        """Return the next line, or None when the child has closed its output.

        Raises
        ------
        RobotError
            If there was no line for ``timeout_s``.
        """
        try:
            return self._lines.get(timeout=timeout_s)
        except queue.Empty:
            raise RobotError(
                f"{self.name} sent nothing for {timeout_s:.0f} s; see {self._log_path}"
            ) from None

    def complaint(self) -> str:
        """Return why the child ended: its last line on standard error, or its exit status."""
        code = self.process.wait()
        self._log.flush()
        complaint = _last_line(self._log_path.read_text(encoding="utf-8", errors="replace"))
        if complaint.startswith(_WINDOW_GONE):
            return "its window was closed"
        if code < 0:
            return f"killed by signal {-code} ({signal.Signals(-code).name})"
        return complaint or f"exit code {code}"

    def stop(self) -> None:
        """Terminate the child; kill it if it does not end in time."""
        if self.process.stdin is not None:
            with contextlib.suppress(OSError):
                self.process.stdin.close()
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(_STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()
        self._log.close()


class Endpoint(_Child):
    """``rtask serve`` on a store, ready to answer.

    Parameters
    ----------
    store
        Folder of the knowledge base.
    port
        0 selects a free one; see :attr:`url`.
    log
        File for the server's log.
    """

    def __init__(self, store: Path, port: int, log: Path) -> None:
        command = _command("serve", "--data", str(store), "-p", str(port))
        super().__init__("the endpoint", command, log, {})
        try:
            self.url = self._wait_ready()
        except BaseException:
            self.stop()  # or it would hold the store's lock
            raise

    def _wait_ready(self) -> str:
        while (line := self.next_line(_READY_TIMEOUT_S)) is not None:
            if line.startswith("ready "):
                return line.split()[1].rstrip("/")
        raise RtaskError(f"the endpoint did not start: {self.complaint()}")


class _Worker(_Child):
    """A robot in its own process: JSON events on its output, ``go`` on its input."""

    def __init__(self, module: str, name: str, job: dict[str, Any], token: str, log: Path) -> None:
        command = [sys.executable, "-m", module, json.dumps(job)]
        super().__init__(name, command, log, {"RTASK_TOKEN": token})

    def go(self) -> None:
        """Let the robot begin."""
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it ended already: events() says why
            self.process.stdin.write("go\n")
            self.process.stdin.flush()

    def events(self, timeout_s: float = _SILENCE_S) -> Iterator[dict[str, Any]]:
        """Yield the robot's events up to and including ``done``.

        Raises
        ------
        RobotError
            If the robot ends before it is done: what it was doing, and its last message.
        """
        doing = "it began"
        while (line := self.next_line(timeout_s)) is not None:
            event: dict[str, Any] = json.loads(line)
            yield event
            if event["event"] == "done":
                return
            doing = event.get("doing", doing)
        why = self.complaint()
        ended = "disappeared" if self.process.returncode < 0 else "stopped"
        raise RobotError(
            f"{self.name} {ended} while {doing}: {why.removeprefix(f'{self.name}: ')}; the store "
            "holds every attempt that was reported before, and nothing of this one"
        )


class Robot(_Worker):
    """One simulated robot of a demo; see :mod:`simulate.demo.robot_process`."""

    def __init__(self, name: str, job: dict[str, Any], token: str, log: Path) -> None:
        super().__init__("simulate.demo.robot_process", name, job, token, log)


class MemberProcess(_Worker):
    """One robot of a fleet; see :mod:`simulate.fleet.member`."""

    def __init__(self, name: str, job: dict[str, Any], token: str, log: Path) -> None:
        super().__init__("simulate.fleet.member", name, job, token, log)
