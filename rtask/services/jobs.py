"""Jobs: calls whose callers come back for the answer."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rtask.errors import (
    CancelledError,
    DeadlineError,
    QueueFullError,
    RtaskError,
    UnknownTermError,
)
from rtask.services.task import Task

__all__ = ["ENDED", "Job", "Jobs"]

ENDED = frozenset(("succeeded", "failed", "cancelled", "timed_out"))
RETENTION_S = 3600.0
MAX_JOBS = 1000
MAX_OWN_JOBS = 100
MAX_ANSWER_BYTES = 256 * 2**20
"""Size of all answers that are kept for who comes back; estimated."""
_EVENTS = 200


class Job:
    """One call and its history.

    Parameters
    ----------
    task
        The call.
    owner
        Key of the caller; others do not learn that the job exists.
    """

    def __init__(self, task: Task, owner: str) -> None:
        self.id = task.call.id
        self.owner = owner
        self.task = task
        self._changed = threading.Condition()
        self._events: deque[tuple[int, dict[str, Any]]] = deque(maxlen=_EVENTS)
        self._count = 0
        self._listeners: list[Callable[[], None]] = []
        self.answer_bytes = 0
        task.call.on_progress(self._progressed)
        # In whatever thread it ends, since nobody may be waiting.
        task.done.add_done_callback(lambda _: self._ended())

    @property
    def state(self) -> str:
        """queued, running, succeeded, failed, cancelled or timed_out."""
        if not self.task.is_over:
            return "running" if self.task.started_s else "queued"
        error = self.task.done.exception()
        if isinstance(error, CancelledError):
            return "cancelled"
        if isinstance(error, DeadlineError):
            return "timed_out"
        return "succeeded" if error is None else "failed"

    @property
    def error(self) -> RtaskError | None:
        """Reason why the call was not answered; none if it was, or still may be."""
        error = self.task.done.exception() if self.state in ENDED else None
        return error if isinstance(error, RtaskError) else None

    def facts(self) -> dict[str, Any]:
        """Return what callers see of the job, its answer or its problem left out."""
        task = self.task
        return {
            "id": self.id,
            "service": task.service,
            "method": task.method.name,
            "state": self.state,
            "progress": 1.0 if self.state == "succeeded" else task.call.fraction,
            "message": task.call.text,
            "queued_ms": round(task.queued_ms, 3),
            "run_ms": round(task.run_ms, 3),
        }

    def answer(self) -> dict[str, Any] | None:
        """Return the answer, once there is one."""
        return self.task.done.result().as_json() if self.state == "succeeded" else None

    def wait(self, timeout_s: float, after: int | None = None) -> int:
        """Wait until the job has ended, or for the first event after a number.

        Returns
        -------
        Number of the last event.
        """
        until = time.monotonic() + timeout_s
        with self._changed:
            while self.state not in ENDED and (after is None or self._count <= after):
                # Beyond its deadline nothing more happens, and a waiter must not stay.
                left_s = min(until - time.monotonic(), self.task.call.left_s)
                if left_s <= 0:
                    break
                self._changed.wait(left_s)
            return self._count

    def events(self, after: int) -> list[tuple[int, dict[str, Any]]]:
        """Return the events after a number, with their numbers."""
        with self._changed:
            return [(number, facts) for number, facts in self._events if number > after]

    def listen(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call back, in any thread, at each new event; return a function that ends it."""
        with self._changed:
            self._listeners.append(listener)

        def stop() -> None:
            with self._changed:
                self._listeners.remove(listener)

        return stop

    def cancel(self) -> None:
        """Cancel the call unless it has ended or is being stored; what runs is asked to stop."""
        self.task.cancel()

    def _ended(self) -> None:
        answer = self.answer()
        self.answer_bytes = 0 if answer is None else _size(answer)
        self._note({"state": self.state})

    def _progressed(self, fraction: float, text: str) -> None:
        self._note({"state": "running", "progress": fraction, "message": text})

    def _note(self, facts: dict[str, Any]) -> None:
        with self._changed:
            self._count += 1
            self._events.append((self._count, facts))
            self._changed.notify_all()
            listeners = list(self._listeners)
        # Outside of the lock: a listener may ask for the job's state.
        for listener in listeners:
            listener()


class Jobs:
    """All jobs of a host; each is kept for an hour after it was made or ended.

    The oldest go earlier when their answers take more than 256 MiB together.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._jobs: dict[str, Job] = {}

    def add(self, task: Task, owner: str) -> Job:
        """Keep a call as a job.

        Raises
        ------
        QueueFullError
            Too many jobs have not ended yet.
        """
        with self._lock:
            # Made at each call, so that no thread is needed for it.
            self._forget()
            own = [other for other in self._jobs.values() if other.owner == owner]
            unended = sum(other.state not in ENDED for other in own)
            if len(self._jobs) >= MAX_JOBS or unended >= MAX_OWN_JOBS:
                raise QueueFullError(
                    f"{unended} of your jobs have not ended; at most {MAX_OWN_JOBS}, and "
                    f"{MAX_JOBS} of all callers are kept",
                    retry_after_s=10,
                )
            job = self._jobs[task.call.id] = Job(task, owner)
        return job

    def find(self, job_id: str, owner: str) -> Job:
        """Return a job of a caller.

        Raises
        ------
        UnknownTermError
            It does not exist, is another's, or was forgotten.
        """
        with self._lock:
            job = self._jobs.get(job_id)
        # A job of somebody else is answered as one that is not there.
        if job is None or job.owner != owner:
            raise UnknownTermError(
                f"no job {job_id}; jobs are kept for an hour, or until later answers need the room"
            )
        return job

    def has(self, job_id: str, owner: str) -> bool:
        """Whether there is such a job of a caller."""
        with self._lock:
            job = self._jobs.get(job_id)
        return job is not None and job.owner == owner

    def forget(self, job: Job) -> None:
        """Forget a job that could not be started."""
        with self._lock:
            self._jobs.pop(job.id, None)

    def of(self, owner: str) -> list[Job]:
        """Return the jobs of a caller, the newest first."""
        with self._lock:
            return [job for job in reversed(self._jobs.values()) if job.owner == owner]

    def close(self) -> None:
        """Cancel what has not ended."""
        with self._lock:
            jobs = list(self._jobs.values())
        for job in jobs:
            if job.state not in ENDED:
                job.cancel()

    def _forget(self) -> None:
        """Forget the jobs that ended long ago, and the oldest that ended if there are too many."""
        now = time.monotonic()
        ended = [job for job in self._jobs.values() if job.state in ENDED]
        surplus = len(self._jobs) - MAX_JOBS + 1
        held = sum(job.answer_bytes for job in ended)
        for number, job in enumerate(ended):
            # What never started counts from its deadline.
            since = job.task.ended_s or job.task.call.deadline
            if number < surplus or held > MAX_ANSWER_BYTES or now - since > RETENTION_S:
                held -= job.answer_bytes
                del self._jobs[job.id]


def _size(value: Any) -> int:
    """Return about how many bytes a JSON value takes as text."""
    if isinstance(value, str | bytes):
        return len(value)
    if isinstance(value, dict):
        return sum(len(key) + _size(part) for key, part in value.items())
    if isinstance(value, list | tuple):
        return sum(map(_size, value))
    return 8
