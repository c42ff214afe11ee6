"""A call on its way through a queue, and its outcome."""

from __future__ import annotations

import time
from concurrent.futures import CancelledError as FutureCancelledError
from concurrent.futures import Future
from dataclasses import dataclass, field

from rtask.errors import CancelledError
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
    done
        Receives the answer.
    may_repeat
        Whether it may be carried out again after its worker died.
    tries
        How often it may be given to another worker after its worker died.
    queued_s, started_s, ended_s
        Times of :func:`time.monotonic`; 0 before.
    """

    method: Method
    request: Message
    call: Call
    service: str
    data: Mapped = ()
    done: Future[Answer] = field(default_factory=Future)
    may_repeat: bool = True
    tries: int = 0
    queued_s: float = field(default_factory=time.monotonic)
    started_s: float = 0.0
    ended_s: float = 0.0

    def cancel(self) -> None:
        """Cancel the call, whether it waits or runs."""
        self.call.cancel()
        if self.done.cancel():
            self.ended_s = time.monotonic()

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
        except FutureCancelledError:
            raise CancelledError("the call was cancelled") from None
        except TimeoutError:
            if self.done.done():  # at the last moment
                return self.done.result()
        self.call.cancel()
        self.done.cancel()
        raise self.call.late()

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
