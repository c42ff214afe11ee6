"""Plans on the workers of a server, shard by shard (Kehoe 2014, 3.6 and 3.8)."""

from __future__ import annotations

import base64
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TYPE_CHECKING, Any, Self, cast

from grasp.pieces import handed_out
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
    another where one dies. A shard that takes much longer than the others is sent once more.
    Results equal those of a serial run bit for bit.

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
        self._lock = threading.Lock()
        self._users = 1  # this object, and each call that is going on

    def finished(
        self, task: Task[T], ranges: Sequence[Range]
    ) -> Generator[tuple[int, T], None, None]:
        """Yield results as they come; a shard that takes long is sent once more.

        Raises
        ------
        UsageError
            The task is none of those that a server carries out.
        """
        call = self._caller(task)

        def carry_out(done: Future[Any], range_: Range) -> None:
            try:
                done.set_result(call(range_))
            except BaseException as error:  # noqa: BLE001 - whoever waits for it hears of it
                done.set_exception(error)
            finally:
                self._leave()

        def begin(number: int) -> Future[Any]:
            done: Future[Any] = Future()
            with self._lock:
                self._users += 1
            # A thread that ends with the program: what is not wanted any more is not waited for.
            threading.Thread(target=carry_out, args=(done, ranges[number]), daemon=True).start()
            return done

        for number, job in handed_out(len(ranges), self.workers, begin, _ended, _let_go):
            yield number, cast("T", job.result())

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
            return lambda range_: [
                self._planned(task, mesh) for mesh in task.meshes[range_[0] : range_[0] + range_[1]]
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

        def call(range_: Range) -> Any:
            given = {"shard": shard, "first": range_[0], "count": range_[1], **more}
            answer = self._call(PUSH_TRIALS, method, given)
            return codes_of(base64.b64decode(answer["codes"]), grasps)

        return call

    def _counts(self, trials: Any) -> Callable[[Range], Any]:
        shard, grasps = request_of(trials), len(trials.rows)

        def call(range_: Range) -> Any:
            given = {"shard": shard, "first": range_[0], "count": range_[1]}
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
        self._leave()

    def _leave(self) -> None:
        """Close the connection when nobody uses it any more."""
        with self._lock:
            self._users -= 1
            is_last = self._users == 0
        if is_last:
            self._client.close()


def _ended(jobs: list[Future[Any]], seconds: float) -> list[Future[Any]]:
    return list(wait(jobs, seconds, FIRST_COMPLETED).done)


def _let_go(_: Future[Any]) -> None:
    """Let a call go on: the server ends it when the client leaves."""
