"""Workers that are actors of a Ray cluster, for services that ask for one (Kehoe 2014, 5.6).

The machines of the cluster need the module or file of the service, as worker processes do. The
files of its data resources are sent there.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from pathlib import Path
from typing import Any

from grasp.ray_cluster import join
from rtask.errors import RtaskError, UsageError, WorkerDiedError
from rtask.scratch import ScratchFolder
from rtask.services.call import Call
from rtask.services.executors.apart import (
    Sent,
    definition_from,
    receive,
    send,
    sendable,
    values_of,
)
from rtask.services.executors.in_process import InProcess
from rtask.services.executors.setup import Carried, InstanceSetup
from rtask.services.resources import Files, WritableFiles
from rtask.services.task import Task

__all__ = ["RayActor"]

_GRACE_S = 2.0
_START_S = 120.0
_LOOK_S = 0.05
"""How often a wait for an answer looks whether the call was cancelled."""
_REPORT_S = 1.0
"""How long the actor waits for progress to tell of."""

Shipped = dict[str, tuple[str, bool, dict[str, bytes]]]
"""Data resources: name of the dataset, whether it is written to, and bytes by path."""


class RayActor:
    """One instance in an actor of a Ray cluster.

    Raises
    ------
    UsageError
        Ray is not installed, or there is no cluster: this program is connected to none, and the
        environment variable RAY_ADDRESS names none.
    WorkerDiedError
        The cluster had no room for the actor in time, or the actor died.
    """

    def __init__(self, setup: InstanceSetup) -> None:
        self._setup = setup
        source, exact = setup.definition.source, setup.definition.exact
        try:
            self._ray, _ = join(os.environ.get("RAY_ADDRESS"))
        except ValueError as error:
            raise UsageError(f"{error}; set RAY_ADDRESS") from None
        # One thread carries out the call, one tells of progress, one takes cancellations.
        kind = self._ray.remote(_Instance).options(max_concurrency=3, num_cpus=1)
        self._actor = kind.remote()
        every = setup.resources.items()
        shipped = {name: _packed(files) for name, files in every if isinstance(files, Files)}
        made = self._actor.make_ready.remote(source, exact, shipped, setup.check_every)
        try:
            if not self._ray.wait([made], timeout=_START_S)[0]:
                raise WorkerDiedError(f"{exact}: the cluster had no room within {_START_S:g} s")
            problem = self._got(exact, made)
            if problem is not None:
                raise problem
        except BaseException:
            self._kill()
            raise

    @property
    def is_spent(self) -> bool:
        """Whether the next call needs a new instance, because the data have changed."""
        return self._setup.is_outdated()

    def carry_out(self, task: Task) -> Carried:
        """Carry out a call.

        Raises
        ------
        WorkerDiedError
            The actor died, or was killed because the call was cancelled or late.
        """
        call = task.call
        done = self._actor.carry_out.remote(send(task))
        reported = self._follow(done, call)
        values, written, reports = self._got(task.service, done)
        for report in reports[reported:]:
            call.report(*report)
        if isinstance(values, RtaskError):
            raise values
        return Carried(task.method.answer.model_validate(values), written)

    def _follow(self, done: Any, call: Call) -> int:
        """Wait for the end of a call, passing progress on; kill the actor if nobody waits for it.

        Returns
        -------
        The number of reports of progress that were passed on.
        """
        reported, is_cancelled, deadline = 0, False, call.deadline + _GRACE_S
        pending_reports = self._actor.reports.remote(reported)
        while True:
            ended, _ = self._ray.wait([done, pending_reports], timeout=_LOOK_S)
            if done in ended:
                return reported
            if pending_reports in ended:
                with contextlib.suppress(self._ray.exceptions.RayError):  # the call tells of it
                    for report in self._ray.get(pending_reports):
                        call.report(*report)
                        reported += 1
                pending_reports = self._actor.reports.remote(reported)
            if call.is_cancelled and not is_cancelled:
                self._actor.cancel.remote()
                is_cancelled, deadline = True, min(deadline, time.monotonic() + _GRACE_S)
            if time.monotonic() > deadline:
                self._kill()

    def _got(self, service: str, reference: Any) -> Any:
        try:
            return self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            words = str(error).strip().partition("\n")[0]
            raise WorkerDiedError(f"{service}: its Ray actor is gone: {words}"[:500]) from None

    def _kill(self) -> None:
        self._ray.kill(self._actor)

    def close(self) -> None:
        """Have the actor run its shut-down methods and end; kill it if it does not."""
        self._ray.wait([self._actor.close.remote()], timeout=_GRACE_S)
        self._kill()


class _Instance:
    """The instance in its actor."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._reports: list[tuple[float, str]] = []
        self._call: Call | None = None
        self._folder = ScratchFolder("ray")

    def make_ready(
        self, source: str, exact: str, shipped: Shipped, check_every: int
    ) -> RtaskError | None:
        """Start the service up; return what went wrong."""
        try:
            self._definition = definition_from(source, exact)
            resources = {
                name: _unpacked(self._folder.path / name, *contents)
                for name, contents in shipped.items()
            }
            self._runner = InProcess(InstanceSetup(self._definition, resources, check_every))
        except Exception as error:  # noqa: BLE001 - the author's code; the server hears of it
            return sendable(error)
        return None

    def carry_out(self, sent: Sent) -> tuple[Any, Any, list[tuple[float, str]]]:
        """Return the answer's values or the error, what was written, and all progress."""
        self._reports = []
        try:
            task = receive(sent, self._definition, self._report)
            self._call = task.call
            carried = self._runner.carry_out(task)
        except Exception as error:  # noqa: BLE001 - the author's code; the caller hears of it
            return sendable(error), {}, self._reports
        finally:
            self._call = None
        return values_of(carried.answer), carried.written, self._reports

    def _report(self, fraction: float, text: str) -> None:
        with self._changed:
            self._reports.append((fraction, text))
            self._changed.notify_all()

    def reports(self, after: int) -> list[tuple[float, str]]:
        """Wait for progress beyond some reports, and return it."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._reports) > after, _REPORT_S)
            return self._reports[after:]

    def cancel(self) -> None:
        """Ask the method that runs to stop."""
        if (call := self._call) is not None:
            call.cancel()

    def close(self) -> None:
        """Shut the service down."""
        self._runner.close()
        self._folder.close()


def _packed(files: Files) -> tuple[str, bool, dict[str, bytes]]:
    paths = [path for path in files.folder.rglob("*") if path.is_file()]
    contents = {path.relative_to(files.folder).as_posix(): path.read_bytes() for path in paths}
    return files.name, isinstance(files, WritableFiles), contents


def _unpacked(folder: Path, name: str, is_writable: bool, contents: dict[str, bytes]) -> Files:
    folder.mkdir(parents=True)
    for path, data in contents.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(data)
    return WritableFiles(name, folder) if is_writable else Files(name, folder)
