"""Plans on the workers of a server, shard by shard (Kehoe 2014, 3.6 and 3.8)."""

from __future__ import annotations

import base64
import concurrent.futures
from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING, Any, Self, cast

from grasp.push.shards import Range, T, Task
from rtask.client.remote import RemoteClient
from rtask.errors import UsageError
from rtask.services.builtin.push_trials import NAME as PUSH_TRIALS
from rtask.services.builtin.push_trials import codes_of, counts_of, request_of
from rtask.services.builtin.space_plans import NAME as SPACE_PLANS
from rtask.services.builtin.space_plans import planned_from, request_for

if TYPE_CHECKING:
    from grasp.batch import BatchPlan, MeshFile, Planned

__all__ = ["ServerExecutor"]

_CALLS, _REACH_S = 8, 30.0


class ServerExecutor:
    """Executor whose shards are calls of ``rtask/PushTrials`` and ``rtask/SpacePlans``.

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

    Raises
    ------
    RemoteUnavailableError
        On entering the context: the server does not answer.
    """

    def __init__(
        self, url: str, token: str | None = None, workers: int = 0, timeout_s: float = 300.0
    ) -> None:
        self.workers = workers or _CALLS
        self._timeout_s = timeout_s
        self._client = RemoteClient(url, token, min(timeout_s, _REACH_S))
        self._threads = concurrent.futures.ThreadPoolExecutor(self.workers)

    def finished(
        self, task: Task[T], ranges: Sequence[Range]
    ) -> Generator[tuple[int, T], None, None]:
        """Yield results as they come; shards that have not begun are then not wanted any more.

        Raises
        ------
        UsageError
            The task is none of those that a server carries out.
        """
        call = self._caller(task)
        jobs = {self._threads.submit(call, one): i for i, one in enumerate(ranges)}
        try:
            for job in concurrent.futures.as_completed(jobs):
                yield jobs[job], cast("T", job.result())
        finally:
            for job in jobs:
                job.cancel()

    def _caller(self, task: Any) -> Callable[[Range], Any]:
        """Return what carries out a range of a task by calls."""
        from grasp.batch import BatchPlan
        from grasp.push.pose import PoseTrials
        from grasp.push.trials import Counting, Trials

        if isinstance(task, Trials):
            return self._codes("run", task, {})
        if isinstance(task, Counting):
            return self._counts(task.trials)
        if isinstance(task, PoseTrials):
            grid = {
                "position_std": task.position_std.tolist(),
                "rotation_std": task.rotation_std.tolist(),
                "samples": task.samples,
            }
            return self._codes("pose", task.trials, grid)
        if isinstance(task, BatchPlan):
            return lambda one: [
                self._planned(task, mesh) for mesh in task.meshes[one[0] : one[0] + one[1]]
            ]
        raise UsageError(
            "a server carries out trials of push grasps and plans of meshes, not "
            f"{type(task).__name__}"
        )

    def _planned(self, batch: BatchPlan, mesh: MeshFile) -> Planned:
        from grasp.spatial.meshes.mesh_files import MESH_ENDINGS

        if f".{mesh.kind}" not in MESH_ENDINGS:  # no request can carry it
            return batch.plan(mesh)
        return planned_from(self._call(SPACE_PLANS, "plan", request_for(batch, mesh)), mesh.name)

    def _codes(self, method: str, trials: Any, more: dict[str, Any]) -> Callable[[Range], Any]:
        shard, grasps = request_of(trials), len(trials.rows)

        def call(one: Range) -> Any:
            given = {"shard": shard, "first": one[0], "count": one[1], **more}
            answer = self._call(PUSH_TRIALS, method, given)
            return codes_of(base64.b64decode(answer["codes"]), grasps)

        return call

    def _counts(self, trials: Any) -> Callable[[Range], Any]:
        shard, grasps = request_of(trials), len(trials.rows)

        def call(one: Range) -> Any:
            given = {"shard": shard, "first": one[0], "count": one[1]}
            answer = self._call(PUSH_TRIALS, "count", given)
            return counts_of(base64.b64decode(answer["counts"]), grasps)

        return call

    def _call(self, service: str, method: str, given: dict[str, Any]) -> dict[str, Any]:
        return self._client.call_service(service, method, given, None, self._timeout_s, True)

    def __enter__(self) -> Self:
        try:
            # Asked at once: a shard, which is repeated, would wait its whole time for no server.
            self._client.services()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=True, cancel_futures=True)
        self._client.close()
