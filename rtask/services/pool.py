"""The queue of one service with one choice of data, and the workers that share it.

Each worker carries out one call at a time on an instance of its own (Kehoe 2014, 5.6). Workers are
started when more calls wait than workers are idle, and leave when they had nothing to do for a
while.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from rtask.errors import (
    ClosedError,
    QueueFullError,
    RtaskError,
    ServiceFailedError,
    StartupFailedError,
    StateChangedError,
    UnusableServiceError,
    WorkerDiedError,
)
from rtask.services.executors.setup import Carried, Commit
from rtask.services.task import Task

__all__ = ["Pool", "Runner", "Sizes", "load_of"]

_log = logging.getLogger(__name__)
_CLOSE_S, _GRACE_S = 10.0, 4.0
_FIRST_PAUSE_S, _LONGEST_PAUSE_S, _MAX_DOUBLINGS = 1.0, 60.0, 10


class Runner(Protocol):
    """One instance of a service, wherever it lives; used by one thread."""

    @property
    def is_spent(self) -> bool:
        """Whether the next call needs a new instance, because the data have changed."""

    def carry_out(self, task: Task) -> Carried:
        """Carry out a call, and return its answer with what is to be stored.

        Raises
        ------
        WorkerDiedError, StateChangedError
            The runner cannot be used any more.
        """

    def close(self) -> None:
        """Shut the instance down."""


@dataclass(frozen=True)
class Sizes:
    """Limits of a queue.

    Parameters
    ----------
    workers
        Largest number of workers.
    waiting
        Largest number of calls that wait for one.
    idle_s
        Time after which a worker without work leaves.
    """

    workers: int
    waiting: int = 100
    idle_s: float = 300.0


class Pool:
    """A queue of calls and its workers.

    Parameters
    ----------
    name
        For threads and errors.
    start
        Makes a runner ready; called in the thread of its worker.
    sizes
        Limits.
    commit
        Stores what a call wrote to its data resources; None = calls write nothing.
    on_drop
        Called when a call was carried out whose end had been settled before: nothing is stored.
    """

    def __init__(
        self,
        name: str,
        start: Callable[[], Runner],
        sizes: Sizes,
        commit: Commit | None = None,
        on_drop: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = name
        self.sizes = sizes
        self._start = start
        self._commit, self._on_drop = commit, on_drop
        self._changed = threading.Condition()
        self._waiting: deque[Task] = deque()
        self._threads: set[threading.Thread] = set()
        self._idle = self._starting = 0
        self._running: set[Task] = set()
        self._closed = False
        self._failures = 0
        self._problem: StartupFailedError | None = None
        self._try_again_s = 0.0
        self._has_started = False

    def submit(self, task: Task) -> None:
        """Queue a call.

        Raises
        ------
        QueueFullError
            As many calls wait as may.
        StartupFailedError
            The service could not be made ready a moment ago; UnusableServiceError if that will not
            change by itself.
        ClosedError
            The pool is closed.
        """
        with self._changed:
            if self._closed:
                raise ClosedError(f"{self.name} is being shut down")
            pause_s = self._try_again_s - time.monotonic()
            if self._problem is not None and not self._threads and pause_s > 0:
                if not self._problem.is_transient:
                    raise self._problem
                raise StartupFailedError(str(self._problem), retry_after_s=round(pause_s, 1))
            if len(self._waiting) - self._idle >= self.sizes.waiting:
                raise QueueFullError(
                    f"{self.name}: {len(self._waiting)} calls are waiting; try again later",
                    retry_after_s=1,
                )
            self._waiting.append(task)
            self._add_worker()
            self._changed.notify()

    def resize(self, workers: int) -> None:
        """Change the largest number of workers, and forget that a start failed."""
        with self._changed:
            self.sizes = replace(self.sizes, workers=workers)
            self._failures, self._problem = 0, None
            for _ in range(len(self._waiting)):
                self._add_worker()
            self._changed.notify_all()  # those whose instance is gone leave

    @property
    def is_idle(self) -> bool:
        """Whether no call waits or runs."""
        with self._changed:
            return not self._waiting and len(self._threads) == self._idle

    @property
    def load(self) -> tuple[int, int]:
        """Numbers of calls that wait, and that run."""
        with self._changed:
            return sum(not task.is_over for task in self._waiting), len(self._running)

    @property
    def state(self) -> str:
        """``ready``, ``untried``, or ``failed``: the last start failed and no worker is left."""
        if self._problem is not None and not self._threads:
            return "failed"
        return "ready" if self._has_started else "untried"

    @property
    def problem(self) -> StartupFailedError | None:
        """Reason why the service cannot be used at present; None if there is none."""
        return self._problem if self.state == "failed" else None

    def try_start(self, timeout_s: float) -> None:
        """Start a worker if there is none yet, and wait until it is ready or has failed."""
        with self._changed:
            if not (self._threads or self._closed or self._problem):
                self._spawn()
            self._changed.wait_for(lambda: not self._starting, timeout_s)

    def close(self) -> None:
        """Drop the waiting calls, and give the running ones some seconds to end.

        A thread that goes on is left to the end of the process.
        """
        with self._changed:
            self._closed = True
            running = list(self._running)
            dropped = list(self._waiting)
            self._waiting.clear()
            threads = list(self._threads)
            self._changed.notify_all()
        for task in dropped:
            task.fail(ClosedError(f"{self.name} is being shut down"))
        until = time.monotonic() + _CLOSE_S
        for thread in threads:
            thread.join(max(until - time.monotonic() - _GRACE_S, 0.0))
        for task in running:
            task.cancel()
        for thread in threads:
            thread.join(max(until - time.monotonic(), 0.0))

    def _add_worker(self) -> None:
        """Start a worker if more calls wait than workers are free or on their way."""
        if len(self._waiting) <= self._idle + self._starting:
            return
        if self._closed or len(self._threads) >= self.sizes.workers:
            return
        self._spawn()

    def _spawn(self) -> None:
        thread = threading.Thread(target=self._work, name=self.name, daemon=True)
        self._threads.add(thread)
        self._starting += 1
        thread.start()

    def _work(self) -> None:
        """Make an instance ready and carry out calls until there are none for long."""
        try:
            runner = self._start()
        except BaseException as error:  # noqa: BLE001 - the author's; callers hear of it
            self._start_failed(error)
            return
        with self._changed:
            self._starting -= 1
            self._failures, self._problem = 0, None
            self._has_started = True
            self._changed.notify_all()
        try:
            while (task := self._next(runner)) is not None:
                if not self._carry_out(runner, task):
                    break
        finally:
            try:
                runner.close()
            except Exception:  # noqa: BLE001 - the author's code; nobody waits for it any more
                _log.warning("%s could not be shut down", self.name, exc_info=True)
            self._leave()

    def _next(self, runner: Runner) -> Task | None:
        """Wait for a call and return it; none when the worker is to leave."""
        with self._changed:
            while True:
                while self._waiting:
                    if runner.is_spent:  # another worker, with a new instance, takes the call
                        return None
                    task = self._waiting.popleft()
                    if not task.is_over:
                        return task
                if self._closed:
                    return None
                self._idle += 1
                is_notified = self._changed.wait(self.sizes.idle_s)
                self._idle -= 1
                if (not is_notified and not self._waiting) or runner.is_spent:
                    return None

    def _carry_out(self, runner: Runner, task: Task) -> bool:
        """Answer a call; tell whether the runner can go on."""
        task.started_s = time.monotonic()
        can_go_on = True
        self._running.add(task)
        try:
            self._settle(task, runner.carry_out(task))
        except WorkerDiedError as error:
            can_go_on = False
            if not self._repeat(task, error.details.get("was_sent", True)):
                task.fail(error)
        except RtaskError as error:
            can_go_on = not isinstance(error, StateChangedError)
            task.fail(error)
        except BaseException as error:  # noqa: BLE001 - the author's; callers hear of it
            _log.warning("%s: %s failed", self.name, task.method.name, exc_info=error)
            task.fail(_failed(task, error))
        finally:
            self._running.discard(task)
        return can_go_on

    def _settle(self, task: Task, carried: Carried) -> None:
        """Store what a call wrote and answer it, both or neither."""
        commit = self._commit

        def store() -> None:
            if commit is not None:
                commit(carried.written, task.call.caller)

        if not task.succeed(carried.answer, store):
            _log.info("%s: %s was done after the call had ended", self.name, task.method.name)
            self._on_drop()

    def _repeat(self, task: Task, was_sent: bool) -> bool:
        """Give a call to another worker, once, if carrying it out twice does no harm."""
        with self._changed:
            if (was_sent and not task.may_repeat) or task.tries or self._closed or task.is_over:
                return False
            task.tries += 1
            self._waiting.appendleft(task)
            self._add_worker()
            self._changed.notify()
        return True

    def _start_failed(self, error: BaseException) -> None:
        """Refuse what waits, unless other workers are there, and pause before the next try."""
        words = str(error) if isinstance(error, RtaskError) else f"{type(error).__name__}: {error}"
        if not isinstance(error, RtaskError):
            _log.warning("%s could not be made ready", self.name, exc_info=error)
        with self._changed:
            self._starting -= 1
            self._threads.discard(threading.current_thread())
            pause_s = min(_FIRST_PAUSE_S * 2**self._failures, _LONGEST_PAUSE_S)
            self._failures = min(self._failures + 1, _MAX_DOUBLINGS)
            problem: StartupFailedError
            if _may_pass(error):
                words = f"{self.name} could not be made ready: {words}"
                problem = StartupFailedError(words, retry_after_s=round(pause_s, 1))
            else:
                problem = UnusableServiceError(f"{self.name} cannot be made ready: {words}")
                pause_s = _LONGEST_PAUSE_S  # its operator may mend it without a restart
            self._problem, self._try_again_s = problem, time.monotonic() + pause_s
            self._changed.notify_all()
            refused = [] if self._threads else list(self._waiting)
            if refused:
                self._waiting.clear()
        for task in refused:
            task.fail(problem)

    def _leave(self) -> None:
        with self._changed:
            self._threads.discard(threading.current_thread())
            self._add_worker()
            self._changed.notify()  # what woke this worker may be for another one


def load_of(pools: Iterable[Pool]) -> dict[str, int]:
    """Return how many calls of some queues are ``waiting`` and ``running``, as JSON."""
    loads = [pool.load for pool in pools]
    return {"waiting": sum(own[0] for own in loads), "running": sum(own[1] for own in loads)}


def _may_pass(error: BaseException) -> bool:
    """Return whether a start that failed may succeed later though nobody changes anything.

    Devices and machines may be away for a while; a missing file, module or argument is not.
    """
    if isinstance(error, WorkerDiedError):  # it was killed, or there was no room for it
        return True
    if isinstance(error, RtaskError):
        return error.is_transient
    lasting = FileNotFoundError | FileExistsError | NotADirectoryError | IsADirectoryError
    if isinstance(error, lasting | PermissionError):
        return False
    return isinstance(error, OSError | MemoryError)


def _failed(task: Task, error: BaseException) -> ServiceFailedError:
    """Return the error that callers see: class and words, never a traceback (5.4, 1.4)."""
    words = f"{type(error).__name__}: {error}"[:500]
    return ServiceFailedError(f"{task.service} {task.method.name} failed: {words}")
