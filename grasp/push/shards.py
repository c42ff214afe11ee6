"""Executors for the trials of an analysis: serial, threads, processes or a Ray cluster.

The kernels release the interpreter's lock, so threads serve one machine best. Every trial is a
function of its number, so all ways give the same results bit for bit.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import functools
import itertools
import time
from collections.abc import Callable, Generator, Sequence
from typing import Any, Literal, Protocol, Self, TypeVar

from grasp.pieces import handed_out
from grasp.ray_cluster import join
from grasp.workers import Processes

__all__ = [
    "Apart", "Executor", "Progress", "Ray", "Serial", "Threads", "Watch", "open_executor", "shard",
]  # fmt: skip

T = TypeVar("T")
Task = Callable[[int, int], T]
Range = tuple[int, int]
Progress = Callable[[int, int], None]
"""Receives the number of trials judged so far, and the number wanted."""

_PIECES, _LONGEST = 8, 5_000
"""Into how many ranges a worker's share is split at least where somebody watches, and the most
trials of one."""


class Executor(Protocol):
    """Runs ``task(first, count)`` over ranges of trial numbers."""

    @property
    def workers(self) -> int:
        """Number of shards that run at once."""
        ...

    def finished(
        self, task: Task[T], ranges: Sequence[Range]
    ) -> Generator[tuple[int, T], None, None]:
        """Yield the number of each range and its result as they finish."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


def shard(first: int, count: int, parts: int) -> list[Range]:
    """Split ``count`` trials from ``first`` on evenly.

    >>> shard(10, 7, 3)
    [(10, 3), (13, 2), (15, 2)]
    """
    parts = max(1, min(parts, count))
    size, left = divmod(count, parts)
    out, at = [], first
    for i in range(parts):
        # The first ranges take the rest, one each, so that no range is longer than another by more
        # than one.
        step = size + (i < left)
        out.append((at, step))
        at += step
    return out


class Watch:
    """Runs ranges of trials under a time limit, and tells how far they are.

    Parameters
    ----------
    total
        Number of trials in all, for ``progress``.
    progress
        Called in this thread after each range.
    deadline_s
        From now on. The first range is always awaited; a range that a thread or this process has
        begun ends first.
    """

    def __init__(
        self,
        executor: Executor | None = None,
        total: int = 0,
        progress: Progress | None = None,
        deadline_s: float | None = None,
    ) -> None:
        if deadline_s is not None and not deadline_s > 0:
            raise ValueError(f"deadline_s must be positive, got {deadline_s}")
        self._executor = Serial() if executor is None else executor
        self._total = total
        self._progress = progress
        self._until = None if deadline_s is None else time.monotonic() + deadline_s
        self._is_watched = progress is not None or deadline_s is not None
        self._done = 0

    @property
    def is_over(self) -> bool:
        """Whether the time is up."""
        return self._until is not None and time.monotonic() >= self._until

    def run(self, task: Task[T], first: int, count: int) -> list[tuple[Range, T]]:
        """Return ranges with their results, in order.

        When the time is up, those before the first one that has not ended are returned: what they
        amount to does not depend on which ranges happened to be quick.
        """
        parts = self._executor.workers
        if self._is_watched:
            # More, smaller ranges cost a little, but without them nothing could be told, or
            # stopped, before the end.
            parts = max(parts * _PIECES, -(-count // _LONGEST))
        ranges = shard(first, count, parts)
        results: dict[int, T] = {}
        with contextlib.closing(self._executor.finished(task, ranges)) as running:
            for number, result in running:
                results[number] = result
                self._done += ranges[number][1]
                if self._progress is not None:
                    self._progress(self._done, self._total)
                # The first range is waited for even then: what counts is an unbroken run of trials
                # from the first one on, whose draws do not depend on how they were split.
                if self.is_over and 0 in results:
                    break
        # Ranges behind a gap are dropped: with them the trials would not be the first so many.
        whole = itertools.takewhile(results.__contains__, range(len(ranges)))
        return [(ranges[number], results[number]) for number in whole]


class Serial:
    """Runs in the calling thread."""

    workers = 1

    def finished(
        self, task: Task[T], ranges: Sequence[Range]
    ) -> Generator[tuple[int, T], None, None]:
        """Yield results in order."""
        for i, span in enumerate(ranges):
            yield i, task(*span)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None


class Threads:
    """Runs in threads of this process."""

    def __init__(self, workers: int) -> None:
        if workers < 1:
            raise ValueError(f"workers must be at least 1, got {workers}")
        self.workers = workers
        self._pool = concurrent.futures.ThreadPoolExecutor(workers)

    def finished(
        self, task: Task[T], ranges: Sequence[Range]
    ) -> Generator[tuple[int, T], None, None]:
        """Yield results as they come; what is not wanted any more is cancelled."""
        jobs = {self._pool.submit(task, *span): i for i, span in enumerate(ranges)}
        try:
            for job in concurrent.futures.as_completed(jobs):
                yield jobs[job], job.result()
        finally:
            for job in jobs:
                job.cancel()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)


class Apart:
    """Runs in fresh processes of this machine; a range whose process is killed is run again."""

    def __init__(self, workers: int) -> None:
        self._pool = Processes(workers)
        self.workers = workers

    def finished(
        self, task: Task[T], ranges: Sequence[Range]
    ) -> Generator[tuple[int, T], None, None]:
        """Yield results as they come; what is not wanted any more is stopped."""
        for i, done in self._pool.finished(functools.partial(_on_range, task), ranges):
            yield i, done.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.close()


def _on_range(task: Task[T], span: Range) -> T:
    return task(*span)


class Ray:
    """Runs on a Ray cluster that is running.

    Parameters
    ----------
    address
        Of the cluster; None = the one that this program is connected to. None is ever started
        here, because a cluster listens on all interfaces.

    Raises
    ------
    ValueError
        Ray is not installed, or there is no cluster.
    """

    def __init__(self, address: str | None = None, workers: int = 0) -> None:
        self._ray, self._connected = join(address)
        self.workers = workers or int(self._ray.cluster_resources().get("CPU", 1))

    def finished(
        self, task: Task[T], ranges: Sequence[Range]
    ) -> Generator[tuple[int, T], None, None]:
        """Yield results as they come; Ray runs again what a dead node was doing."""
        remote = self._ray.remote(_call)
        # Once for all ranges: the part and its arrays go over the network with it.
        shared = self._ray.put(task)

        def begin(number: int) -> Any:
            return remote.remote(shared, *ranges[number])

        def wait(jobs: list[Any], seconds: float) -> Any:
            return self._ray.wait(jobs, num_returns=1, timeout=seconds)[0]

        for number, job in handed_out(len(ranges), self.workers, begin, wait, self._ray.cancel):
            yield number, self._ray.get(job)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # A cluster that the caller had joined before stays joined.
        if self._connected:
            self._ray.shutdown()


def _call(task: Task[T], first: int, count: int) -> T:
    return task(first, count)


def open_executor(
    kind: Literal["serial", "threads", "processes", "ray"] = "serial",
    workers: int = 0,
    address: str | None = None,
) -> Executor:
    """Return an executor by name; a context manager.

    Parameters
    ----------
    workers
        0 = one for each core that this process may use.
    address
        Of a running Ray cluster; None = the one that this program is connected to.

    Raises
    ------
    ValueError
        When the kind is unknown, or there are fewer than 0 workers.
    """
    import os

    if workers < 0:
        raise ValueError(f"workers must be 0 or more, got {workers}")
    if kind == "serial":
        return Serial()
    if kind == "ray":
        return Ray(address, workers)
    if kind not in ("threads", "processes"):
        raise ValueError(f"unknown executor {kind!r}; serial, threads, processes or ray")
    # What this process may use, not what the machine has: containers get a share.
    count = workers or len(os.sched_getaffinity(0))
    return Threads(count) if kind == "threads" else Apart(count)
