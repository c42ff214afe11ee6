"""A call on its way through a queue, and its outcome."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field

from rtask.services.call import Call
from rtask.services.definition import Method
from rtask.wire.message import Answer, Message

__all__ = ["Mapped", "Task"]

Mapped = tuple[tuple[str, str, str], ...]
"""Names of data resources, each with the version of its dataset and the digest of that."""


@dataclass(eq=False)
class Task:
    """One call on its way through a queue.

    Parameters
    ----------
    method
        The declaration of what is called.
    request
        The checked request.
    call
        What the method learns of it.
    service
        Exact name and version, ``example/Kinematics@1.2.0``.
    data
        Datasets of the data resources.
    may_repeat
        Whether it may be carried out again after its worker died.
    tries
        How often it was given to another worker after its worker died.
    queued_s, started_s, ended_s
        Times of :func:`time.monotonic`; 0 before.
    """

    method: Method
    request: Message
    call: Call
    service: str
    data: Mapped = ()
    may_repeat: bool = True
    tries: int = 0
    queued_s: float = field(default_factory=time.monotonic)
    started_s: float = 0.0
    ended_s: float = 0.0

    @property
    def done(self) -> Future[Answer]:
        """The answer or the error, once the end of the call is settled."""
        return self.call.ending.done

    @property
    def is_over(self) -> bool:
        """Whether the end of the call is settled; a call whose time is up ends as late."""
        ending = self.call.ending
        return ending.is_over or (self.call.left_s <= 0 and (self.expire() or ending.is_over))

    def cancel(self) -> bool:
        """Cancel the call, whether it waits or runs; return whether this is its end."""
        return self._ended(self.call.cancel())

    def expire(self) -> bool:
        """End the call as late; return whether this is its end."""
        return self._ended(self.call.expire())

    def fail(self, error: Exception) -> bool:
        """End the call with the error of what carries it out; return whether this is its end."""
        return self._ended(self.call.fail(error, is_own=True))

    def succeed(self, answer: Answer, store: Callable[[], None] | None = None) -> bool:
        """End the call with its answer after storing what it wrote, unless it has ended or is late.

        Returns
        -------
        Whether this is its end; where not, nothing was stored.
        """
        if self.call.left_s <= 0 and not self.call.ending.has_written:
            self.expire()
        self.ended_s = self.ended_s or time.monotonic()
        return self.call.ending.succeed(answer, store)

    def _ended(self, is_end: bool) -> bool:
        if is_end:
            self.ended_s = time.monotonic()
        return is_end

    def result(self) -> Answer:
        """Wait for the answer.

        Raises
        ------
        DeadlineError
            None came in time; the method is asked to stop.
        CancelledError
            The call was cancelled.
        """
        try:
            return self.done.result(max(self.call.left_s, 0.0))
        except TimeoutError:
            self.expire()
        return self.done.result()  # late, or being stored at this moment

    @property
    def queued_ms(self) -> float:
        """Time in the queue, ms."""
        return 1e3 * ((self.started_s or self.ended_s or time.monotonic()) - self.queued_s)

    @property
    def run_ms(self) -> float:
        """Time in the method, ms."""
        if not self.started_s:
            return 0.0
        return 1e3 * ((self.ended_s or time.monotonic()) - self.started_s)
