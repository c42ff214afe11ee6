"""Trials of an analysis on the workers of a server (Kehoe 2014, 3.6 and 3.8)."""

from __future__ import annotations

import base64
import concurrent.futures
from collections.abc import Iterator, Sequence
from typing import Any, Self, cast

from grasp.push.shards import Range, T, Task
from grasp.push.trials import Trials
from rtask.client.remote import RemoteClient
from rtask.errors import UsageError
from rtask.services.builtin.push_trials import NAME, codes_of, request_of

__all__ = ["ServerExecutor"]

_CALLS = 8


class ServerExecutor:
    """Executor whose shards are calls of the service ``rtask/PushTrials``.

    The server gives them to its own workers and to those that are connected to it, and once more to
    another where one dies. Results equal those of a serial run bit for bit.

    Parameters
    ----------
    url
        Of the server.
    token
        Of the caller; None for a server without tokens.
    workers
        Calls at a time; 0 = eight.
    timeout_s
        For each shard.
    """

    def __init__(
        self, url: str, token: str | None = None, workers: int = 0, timeout_s: float = 300.0
    ) -> None:
        self.workers = workers or _CALLS
        self._timeout_s = timeout_s
        self._client = RemoteClient(url, token=token)
        self._threads = concurrent.futures.ThreadPoolExecutor(self.workers)

    def map(self, task: Task[T], ranges: Sequence[Range]) -> list[T]:
        """Return the results in the order of the ranges."""
        found = dict(self.finished(task, ranges))
        return [found[i] for i in range(len(ranges))]

    def finished(self, task: Task[T], ranges: Sequence[Range]) -> Iterator[tuple[int, T]]:
        """Yield results as they come; shards that have not begun are then not wanted any more.

        Raises
        ------
        UsageError
            The task is no trials of push grasps.
        """
        if not isinstance(task, Trials):
            raise UsageError(
                f"a server carries out trials of push grasps, not {type(task).__name__}"
            )
        shard = request_of(task)
        jobs = {
            self._threads.submit(self._call, shard, one, len(task.rows)): i
            for i, one in enumerate(ranges)
        }
        try:
            for job in concurrent.futures.as_completed(jobs):
                yield jobs[job], cast("T", job.result())
        finally:
            for job in jobs:
                job.cancel()

    def _call(self, shard: dict[str, Any], one: Range, grasps: int) -> Any:
        given = {"shard": shard, "first": one[0], "count": one[1]}
        answer = self._client.call_service(NAME, "run", given, None, self._timeout_s, True)
        return codes_of(base64.b64decode(answer["codes"]), grasps)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=True, cancel_futures=True)
        self._client.close()
