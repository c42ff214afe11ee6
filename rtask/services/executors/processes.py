"""Workers that are processes: for services that may hang or crash (Kehoe 2014, 5.6).

A process is spawned, not forked, because the threads of the store do not survive a fork, and it
ends with its parent, however that ends. It is killed when its call is cancelled or late.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from rtask.errors import (
    RtaskError,
    ServiceFailedError,
    StateChangedError,
    WorkerDiedError,
)
from rtask.services.call import Call
from rtask.services.executors.apart import (
    definition_from,
    receive,
    send,
    sendable,
    values_of,
)
from rtask.services.executors.in_process import InProcess
from rtask.services.executors.setup import Carried, InstanceSetup
from rtask.services.resources import Resource
from rtask.services.task import Task

__all__ = ["ChildProcess"]

_GRACE_S = 2.0
_START_S = 120.0
_LOOK_S = 0.05
"""How often a wait for an answer, which comes at once, looks whether the call was cancelled."""


class ChildProcess:
    """One instance in a process of its own.

    Raises
    ------
    WorkerDiedError
        The process ended before it was ready.
    """

    def __init__(self, setup: InstanceSetup) -> None:
        # Kept whole: the process reads the files of its resources as long as it lives.
        self._setup = setup
        definition = setup.definition
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        source, exact, resources = definition.source, definition.exact, dict(setup.resources)
        arguments = (theirs, source, exact, resources, setup.check_every)
        self._process = context.Process(target=_work, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        try:
            self._receive(exact, time.monotonic() + _START_S, None)
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return self._process.pid

    @property
    def is_spent(self) -> bool:
        """Whether the next call needs a new instance, because the data have changed."""
        return self._setup.is_outdated()

    def carry_out(self, task: Task) -> Carried:
        """Carry out a call.

        Raises
        ------
        WorkerDiedError
            The process ended, by itself or because the call was cancelled or late.
        """
        try:
            self._pipe.send(send(task))
        except (OSError, ValueError) as error:
            raise WorkerDiedError(f"{task.service}: its process is gone: {error}") from error
        values, written = self._receive(task.service, task.call.deadline, task.call)
        return Carried(task.method.answer.model_validate(values), written)

    def _receive(self, service: str, deadline: float, call: Call | None) -> Any:
        """Wait for an answer, passing progress on; kill the process when nobody waits for it."""
        is_cancelled = False
        while True:
            try:
                has_message = self._pipe.poll(_LOOK_S)
                message: tuple[str, Any] = self._pipe.recv() if has_message else ("", None)
            except (EOFError, OSError):
                self._process.join(_GRACE_S)
                code = self._process.exitcode
                raise WorkerDiedError(
                    f"{service}: its process ended with exit code {code}", exit_code=code
                ) from None
            kind, value = message
            if kind == "done":
                return value
            if isinstance(value, RtaskError):
                raise value
            if value is not None and call is not None:
                call.report(*value)
            gone = call is not None and call.is_cancelled
            if gone and not is_cancelled:
                with contextlib.suppress(OSError):  # it ended; the next look at the pipe tells how
                    self._pipe.send("cancel")
                is_cancelled, deadline = True, min(deadline, time.monotonic() + _GRACE_S)
            if time.monotonic() > deadline + (0 if is_cancelled else _GRACE_S):
                self._process.kill()

    def close(self) -> None:
        """Have the process run its shut-down methods and end; kill it if it does not."""
        self._pipe.close()
        self._process.join(_GRACE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _work(
    pipe: Connection,
    source: str,
    exact: str,
    resources: dict[str, Resource],
    check_every: int,
) -> None:
    """Carry out calls until the parent closes the pipe or is gone."""
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    try:
        definition = definition_from(source, exact)
        runner = InProcess(InstanceSetup(definition, resources, check_every))
    except Exception as error:  # noqa: BLE001 - the author's code; the parent hears of it
        pipe.send(("error", sendable(error)))
        return
    sending = threading.Lock()

    def tell(kind: str, value: Any) -> None:
        with sending:
            pipe.send((kind, value))

    tell("done", None)
    calls: list[Any] = []
    arrived = threading.Condition()
    current: list[Call] = []

    def listen() -> None:
        """Read calls and cancellations, so that one reaches a method that runs."""
        while True:
            try:
                message = pipe.recv()
            except (EOFError, OSError):
                message = None
            if message == "cancel":
                for call in current:
                    call.cancel()
                continue
            with arrived:
                calls.append(message)
                arrived.notify()
            if message is None:
                return

    threading.Thread(target=listen, daemon=True).start()
    while True:
        with arrived:
            while not calls:
                arrived.wait()
            given = calls.pop(0)
        if given is None:
            runner.close()
            return
        task = receive(given, definition, lambda *progress: tell("progress", progress))
        current[:] = [task.call]
        _carry_out(runner, task, tell)
        current.clear()


def _carry_out(runner: InProcess, task: Task, tell: Callable[[str, Any], None]) -> None:
    try:
        carried = runner.carry_out(task)
    except Exception as error:  # noqa: BLE001 - the author's code; the caller hears of it
        tell("error", sendable(error))
        if isinstance(error, StateChangedError):
            os._exit(0)
        return
    try:
        tell("done", (values_of(carried.answer), carried.written))
    except (OSError, ValueError, TypeError) as error:
        tell("error", ServiceFailedError(f"the answer cannot be sent: {error}"))


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
