"""Worker processes that run trials; if one dies, only its trial is lost.

They are spawned, not forked, because physics and the store's threads do not survive a fork. A
worker ends with its parent, however that ends.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import threading
import traceback
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from multiprocessing.connection import Connection, wait
from typing import Any

__all__ = ["run_trials"]

_STOP_S = 10.0


class _Worker:
    """One worker process and its current trial."""

    def __init__(self, trial: str, settings: Mapping[str, Any]) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(
            target=_work, args=(theirs, trial, dict(settings)), daemon=True
        )
        self.process.start()
        theirs.close()
        self.doing: int | None = None

    def give(self, number: int) -> None:
        self.doing = number
        self.pipe.send(number)

    def take(self) -> tuple[str, Any]:
        """Return ``("result", data)``, or ``("error", words)`` also when the process is gone."""
        try:
            kind, data = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(_STOP_S)
            return "error", f"the worker process ended with exit code {self.process.exitcode}"
        return str(kind), data

    @property
    def is_alive(self) -> bool:
        return self.process.is_alive()

    def stop(self) -> None:
        self.pipe.close()
        self.process.terminate()
        self.process.join(_STOP_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


def run_trials(
    trial: str, settings: Mapping[str, Any], numbers: Iterable[int], processes: int
) -> Iterator[tuple[int, dict[str, Any] | None, str]]:
    """Yield (number, result, "") of each trial as it ends, or (number, None, why) if it fails.

    Results depend neither on ``processes`` nor on the order in which trials end: a trial gets only
    its settings and its number.

    Parameters
    ----------
    trial
        Function to run, as ``module:function``: takes settings and a number, returns a JSON-able
        result. The parent does not import it.
    settings
        Settings of all trials.
    numbers
        Numbers of the trials.
    processes
        Number of processes.
    """
    todo = deque(numbers)
    workers = [_Worker(trial, settings) for _ in range(min(processes, len(todo)))]
    try:
        for worker in workers:
            worker.give(todo.popleft())
        while any(worker.doing is not None for worker in workers):
            busy = {w.pipe: w for w in workers if w.doing is not None}
            for pipe in wait(list(busy)):
                assert isinstance(pipe, Connection)
                worker = busy[pipe]
                number, worker.doing = worker.doing, None
                assert number is not None
                kind, data = worker.take()
                if not worker.is_alive:
                    worker.stop()
                    workers.remove(worker)
                    if todo:
                        worker = _Worker(trial, settings)
                        workers.append(worker)
                if todo and worker in workers:
                    worker.give(todo.popleft())
                yield (number, data, "") if kind == "result" else (number, None, str(data))
    finally:
        for worker in workers:
            worker.stop()


def _work(pipe: Connection, trial: str, settings: dict[str, Any]) -> None:
    """Carry out trials until the parent closes the pipe or is gone."""
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    # Bullet and Mesa write to file descriptor 1, which is the parent's for its results.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    module, _, name = trial.partition(":")
    carry_out = getattr(importlib.import_module(module), name)
    while True:
        try:
            number = pipe.recv()
        except EOFError:
            return
        try:
            answer: tuple[str, Any] = ("result", carry_out(settings, number))
        except Exception:  # noqa: BLE001 - a trial may break in any way; the parent says how
            answer = ("error", traceback.format_exc(limit=-4).strip())
        pipe.send(answer)


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
