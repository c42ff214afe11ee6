"""A fleet from start to end: endpoints, robots working side by side, results.

With sharing, all robots use one endpoint. Without, each has its own endpoint and store, so that no
grasps, views or counts of another robot reach it.
"""

from __future__ import annotations

import json
import logging
import shutil
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import rtask
from rtask.errors import RtaskError, UsageError
from rtask.kb.durability.settings import write_durably
from simulate.demo.processes import Endpoint, MemberProcess, run_rtask
from simulate.fleet.assignment import FleetPlan, MemberJob, plan_fleet
from simulate.robots import check_robot

__all__ = ["Fleet", "FleetSettings"]

log = logging.getLogger(__name__)

_MARK = "fleet.json"
_RESTARTS = 3

Tell = Callable[[str, dict[str, Any]], None]


@dataclass(frozen=True)
class FleetSettings:
    """Settings of a fleet.

    Parameters
    ----------
    folder
        Folder for stores, logs, outboxes and the report.
    robots, objects, on_table
        See :func:`simulate.fleet.assignment.plan_fleet`.
    sharing
        Whether there is one endpoint for all robots, or one for each.
    prior
        Whether grasps are proposed from geometry; otherwise unknown objects are grasped blindly.
    in_line
        Whether a robot starts a table only when the one before it has cleared its own table of the
        same number, so that it benefits from what the others have learned. The robots still work
        at the same time.
    patience_s
        Time that a robot waits for an answer before it gives up.
    silence_s
        Time without any event after which a robot counts as lost and is terminated.
    kinds
        Kinds of the robots, in turn, a name of :func:`simulate.robots.known_robots`.
    """

    folder: Path
    robots: int = 3
    objects: int = 20
    on_table: int = 4
    seed: int = 0
    sharing: bool = True
    prior: bool = True
    in_line: bool = True
    max_attempts: int = 6
    preset: str = "faithful"
    patience_s: float = 900.0
    silence_s: float = 1800.0
    kinds: tuple[str, ...] = ("nao",)

    def __post_init__(self) -> None:
        for kind in self.kinds:
            check_robot(kind)


class Fleet:
    """Runs a fleet once.

    Parameters
    ----------
    settings
        Settings of the fleet.
    tell
        Called with a robot's name and each of its events; from several threads, one at a time.
    """

    def __init__(self, settings: FleetSettings, tell: Tell = lambda robot, event: None) -> None:
        self.settings = settings
        self.plan: FleetPlan = plan_fleet(
            settings.robots, settings.objects, settings.on_table, settings.seed
        )
        self.endpoints: list[_Supervised] = []
        self.robots: list[MemberProcess] = []
        self._tell = tell
        self._jobs: list[tuple[MemberJob, str]] = []
        self._turn = threading.Condition()
        self._cleared = [0] * settings.robots
        self._out: set[int] = set()

    def run(self) -> dict[str, Any]:
        """Let all robots work; return the encounters of each.

        Returns
        -------
        ``settings``, and ``robots`` with ``name``, ``tables`` (encounters of each), ``lost`` (why
                    it ended early; empty if it did not) and ``undelivered``.
        """
        folder = self.settings.folder
        self._prepare(folder)
        with ExitStack() as stack:
            for number in range(1 if self.settings.sharing else self.settings.robots):
                store, log = folder / f"store-{number + 1}", folder / f"endpoint-{number + 1}.log"
                self.endpoints.append(_Supervised(store, log, self._tell))
                stack.callback(self.endpoints[-1].stop)
            for index in range(self.settings.robots):
                self.robots.append(self._start(index))
                stack.callback(self.robots[-1].stop)
            done: list[dict[str, Any]] = [{} for _ in self.robots]
            watchers = [
                threading.Thread(target=self._watch, args=(i, done), name=f"watch-{i}")
                for i in range(len(self.robots))
            ]
            for watcher in watchers:
                watcher.start()
            try:
                for watcher in watchers:
                    watcher.join()
            finally:  # interrupted: without their robots the watchers end at once
                for robot in self.robots:
                    robot.stop()
        settings = {**asdict(self.settings), "folder": str(folder)}
        return {"settings": settings, "plan": asdict(self.plan), "robots": done}

    def _prepare(self, folder: Path) -> None:
        """Empty the folder, which must be new, empty or that of an earlier fleet."""
        if folder.exists() and any(folder.iterdir()) and not (folder / _MARK).exists():
            raise UsageError(
                f"{folder} exists and is not a fleet's folder; name another with --data"
            )
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        settings = {**asdict(self.settings), "folder": str(folder)}
        write_durably(folder / _MARK, json.dumps(settings, indent=1) + "\n")

    def _start(self, index: int) -> MemberProcess:
        settings = self.settings
        endpoint = self.endpoints[0 if settings.sharing else index]
        name = f"robot-{index + 1}"
        answer = run_rtask(
            "token", "create", "--data", str(endpoint.store), "--robot", name, "--json"
        )
        job = MemberJob(
            name=name,
            index=index,
            url=endpoint.url,
            seed=settings.seed,
            tables=self.plan.tables(index),
            max_attempts=settings.max_attempts,
            prior=settings.prior,
            outbox=str(settings.folder / f"{name}.outbox.jsonl"),
            patience_s=settings.patience_s,
            preset=settings.preset,
            robot=settings.kinds[index % len(settings.kinds)],
        )
        token = str(json.loads(answer)["token"])
        self._jobs.append((job, token))
        return MemberProcess(name, job.to_json(), token, settings.folder / f"{name}.log")

    def _watch(self, index: int, done: list[dict[str, Any]]) -> None:
        """Follow one robot to its end without disturbing the others."""
        robot = self.robots[index]
        result: dict[str, Any] = {"name": robot.name, "tables": [], "lost": "", "undelivered": 0}
        done[index] = result
        try:
            for event in robot.events(self.settings.silence_s):
                with self._turn:
                    self._tell(robot.name, event)
                if event["event"] == "ready":
                    self._await_turn(index, int(event["table"]))
                    robot.go()
                elif event["event"] == "table":
                    result["tables"].append(event["encounters"])
                    with self._turn:
                        self._cleared[index] += 1
                        self._turn.notify_all()
                elif event["event"] == "done":
                    result["undelivered"] = event["undelivered"]
        except RtaskError as error:
            robot.stop()  # a robot that only fell silent must not continue unnoticed
            result["lost"] = str(error)
            result["undelivered"] = self._deliver_for(index)
            with self._turn:
                self._tell(robot.name, {"event": "lost", "why": str(error)})
        finally:
            with self._turn:
                self._out.add(index)
                self._turn.notify_all()

    def _deliver_for(self, index: int) -> int:
        """Deliver the outbox of a lost robot; return how many reports remain in it."""
        job, token = self._jobs[index]
        with rtask.connect(job.url, token=token, outbox=Path(job.outbox)) as client:
            try:
                client.deliver()
            except RtaskError:
                log.warning("%s: its outbox cannot be delivered", job.name, exc_info=True)
            return client.waiting

    def _await_turn(self, index: int, table: int) -> None:
        """Wait until the previous robot has cleared that table or is gone."""
        if index == 0 or not self.settings.in_line:
            return
        with self._turn:
            self._turn.wait_for(
                lambda: self._cleared[index - 1] > table or (index - 1) in self._out
            )


class _Supervised:
    """An endpoint that is restarted on its port when it ends unexpectedly."""

    def __init__(self, store: Path, log: Path, tell: Tell) -> None:
        self.store = store
        self._log, self._tell = log, tell
        self._stopping = threading.Event()
        self.endpoint = Endpoint(store, 0, log)
        self.url = self.endpoint.url
        self._watcher = threading.Thread(target=self._watch, name="endpoint", daemon=True)
        self._watcher.start()

    def _watch(self) -> None:
        why = ""
        for again in range(1, _RESTARTS + 1):
            self.endpoint.process.wait()
            if self._stopping.is_set():
                return
            why = why or self.endpoint.complaint()
            self._tell("the endpoint", {"event": "restart", "why": why, "times": again})
            port = int(self.url.rpartition(":")[2])
            self.endpoint.stop()
            try:
                self.endpoint, why = Endpoint(self.store, port, self._log), ""
            except RtaskError as error:  # too slow, or it ended again: the robots go on waiting
                why = str(error)

    def stop(self) -> None:
        """Stop the endpoint and do not restart it."""
        self._stopping.set()
        self.endpoint.stop()
        self._watcher.join(timeout=30.0)
