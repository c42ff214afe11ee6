"""Worker processes for many pieces of work; what a killed one was doing is done again.

They are spawned, not forked, because physics, threads and stores do not survive a fork. A worker
ends with its parent, however that ends. An executor of :mod:`concurrent.futures` does neither: one
killed worker fails all of its work, and workers outlive a parent that was killed.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, Self, TypeVar, cast

from grasp.pieces import LOOK_S, Pieces

__all__ = ["Done", "Processes"]

T = TypeVar("T")
R = TypeVar("R")

_TRIES = 3
_STOP_S = 10.0


@dataclass(frozen=True)
class Done(Generic[R]):
    """Result of one piece of work.

    Parameters
    ----------
    value
        The result; None where there is none.
    error
        The exception that the task raised, or a RuntimeError where workers died of it.
    trace
        Its traceback in the worker, as text.
    """

    value: R | None
    error: Exception | None = None
    trace: str = ""

    def result(self) -> R:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error
        return cast("R", self.value)


class _Child:
    """One worker process and what it is doing."""

    def __init__(self, quiet: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs, quiet), daemon=True)
        self.process.start()
        theirs.close()
        self.run = -1
        self.doing: int | None = None
        self.since = 0.0

    def give(self, run: int, task: Any, number: int, item: Any) -> None:
        """Send a piece of work, after its task where that is new.

        Raises
        ------
        OSError
            The process is gone.
        """
        if self.run != run:
            self.pipe.send(("task", task))
            self.run = run
        self.pipe.send(("item", item))
        self.doing, self.since = number, time.monotonic()

    def stop(self) -> None:
        self.pipe.close()
        self.process.terminate()
        self.process.join(_STOP_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


class Processes:
    """Processes of this machine that carry out pieces of work.

    A piece whose worker is killed is given to another, up to three times. A piece that takes much
    longer than the others is given to an idle worker as well, and the first result counts, so
    results must depend on the piece alone.

    Parameters
    ----------
    workers
        Largest number of processes; they are started when there is work for them.
    quiet
        Whether what libraries write to standard output is thrown away.
    """

    def __init__(self, workers: int, *, quiet: bool = False) -> None:
        if workers < 1:
            raise ValueError(f"workers must be at least 1, got {workers}")
        self.workers = workers
        self._quiet = quiet
        self._children: list[_Child] = []
        self._runs = 0

    def finished(self, task: Callable[[T], R], items: Sequence[T]) -> Iterator[tuple[int, Done[R]]]:
        """Yield the number of each piece and what became of it, as they end.

        Parameters
        ----------
        task
            Carried out in a worker for each of ``items``; both are pickled.
        """
        self._runs += 1
        run = _Run(task, items)
        try:
            while run.is_going:
                self._give(run)
                busy = {
                    worker.pipe: worker for worker in self._children if worker.doing is not None
                }
                for pipe in wait(list(busy), LOOK_S):
                    assert isinstance(pipe, Connection)
                    ending = self._take(run, busy[pipe])
                    if ending is not None:
                        yield ending
        finally:
            for child in [worker for worker in self._children if worker.doing is not None]:
                self._drop(child)  # what it does is wanted no more

    def _give(self, run: _Run) -> None:
        """Give work to every idle worker, and start workers as long as there is more."""
        idle = [worker for worker in self._children if worker.doing is None]
        while (number := run.next(self._doing())) is not None:
            if idle:
                child = idle.pop()
            elif len(self._children) < self.workers:
                child = _Child(self._quiet)
                self._children.append(child)
            else:
                run.put_back(number)
                return
            try:
                child.give(self._runs, run.task, number, run.items[number])
            except (OSError, EOFError):
                self._drop(child)
                run.put_back(number)

    def _doing(self) -> list[tuple[int, float]]:
        every = self._children
        return [(worker.doing, worker.since) for worker in every if worker.doing is not None]

    def _take(self, run: _Run, child: _Child) -> tuple[int, Done[Any]] | None:
        """Read what a worker says; None where that is known already, or is tried again."""
        number, child.doing = child.doing, None
        assert number is not None
        try:
            done = child.pipe.recv()
        except (EOFError, OSError):
            child.process.join(_STOP_S)
            code = child.process.exitcode
            self._drop(child)
            return run.died(number, code, self._children)
        if not run.ended(number, time.monotonic() - child.since):
            return None
        return number, done

    def _drop(self, child: _Child) -> None:
        self._children.remove(child)
        child.stop()

    def close(self) -> None:
        """End the processes."""
        for child in list(self._children):
            self._drop(child)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Run(Pieces):
    """The pieces of one task, and how often workers died of each."""

    def __init__(self, task: Any, items: Sequence[Any]) -> None:
        super().__init__(len(items))
        self.task, self.items = task, items
        self._deaths: Counter[int] = Counter()

    def died(
        self, number: int, code: int | None, children: Sequence[_Child]
    ) -> tuple[int, Done[Any]] | None:
        """Note that a worker died of a piece; return its end if it is not tried again."""
        if not self.is_open(number):
            return None
        self._deaths[number] += 1
        if self._deaths[number] < _TRIES:
            if not any(worker.doing == number for worker in children):
                self.put_back(number)
            return None
        self.ended(number)
        words = f"its worker process ended with exit code {code}, {self._deaths[number]} times"
        return number, Done(None, RuntimeError(words), words)


def _work(pipe: Connection, quiet: bool) -> None:
    """Carry out pieces of work until the parent closes the pipe or is gone."""
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    if quiet:  # Bullet and Mesa write to file descriptor 1, which is the parent's for its results
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    task: Any = None
    while True:
        try:
            kind, given = pipe.recv()
        except EOFError:
            return
        if kind == "task":
            task = given
            continue
        try:
            pipe.send(Done(task(given)))
        except Exception as error:  # noqa: BLE001 - a task may break in any way; the parent says how
            trace = traceback.format_exc(limit=-4).strip()
            pipe.send(Done(None, _portable(error), trace))


def _portable(error: Exception) -> Exception:
    """Return an exception that the parent can read: many cannot be made again from their pickle."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001 - pickling runs the exception's own code
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
