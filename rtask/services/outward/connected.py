"""A seat of a worker as the queue sees it: one instance of a service, on another machine."""

from __future__ import annotations

import base64
import binascii
from typing import Any

from pydantic import ValidationError

import rtask.errors
from rtask.errors import RtaskError, ServiceError, ServiceFailedError
from rtask.services.executors.setup import Carried
from rtask.services.outward.seats import Outward, Seat
from rtask.services.task import Task

__all__ = ["Connected"]

_KINDS = {
    error_class.slug: error_class
    for error_class in vars(rtask.errors).values()
    if isinstance(error_class, type) and issubclass(error_class, ServiceError)
}


class Connected:
    """A seat as the queue sees it: one instance of the service, on another machine.

    Parameters
    ----------
    outward
        All workers.
    seat
        Of one of them.
    """

    def __init__(self, outward: Outward, seat: Seat) -> None:
        self._outward, self._seat = outward, seat

    @property
    def is_spent(self) -> bool:
        """Whether the worker has left, or is still busy with a call that nobody waits for."""
        return self._seat.is_gone or self._seat.is_late

    def carry_out(self, task: Task) -> Carried:
        """Carry out a call.

        Raises
        ------
        WorkerDiedError
            The worker left before it answered.
        ServiceFailedError
            It answered something else than it declares.
        """
        reply = self._outward.ask(self._seat, task)
        values = reply.get("values")
        if reply.get("result") is not True:
            raise _failure(values, reply.get("error"), reply.get("transient"))
        try:
            answer = task.method.answer.model_validate(values if isinstance(values, dict) else {})
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            place = ".".join(str(part) for part in first["loc"])
            raise ServiceFailedError(
                f"{task.service} {task.method.name} answered what it does not declare: "
                f"{place}: {first['msg']}"
            ) from None
        return Carried(answer, _written(reply.get("written"), task))

    def close(self) -> None:
        """Leave the seat to others."""
        self._outward.release(self._seat)


def _failure(words: Any, slug: Any, transient: Any) -> RtaskError:
    """Return the error of a call that failed; without the name of its kind, the author's own."""
    reason = words[:500] if isinstance(words, str) and words else "the worker gave no reason"
    kind = _KINDS.get(slug) if isinstance(slug, str) else ServiceError
    details = {"transient": transient} if isinstance(transient, bool) else {}
    return (kind or ServiceFailedError)(reason, **details)


def _written(given: Any, task: Task) -> dict[str, dict[str, bytes]]:
    """Return what a call wrote, by data resource and path.

    Raises
    ------
    ServiceFailedError
        It is not contents of files of data resources that the call has.
    """
    if not given:
        return {}
    writable = {name for name, _, digest in task.data if not digest}  # the writable ones
    written: dict[str, dict[str, bytes]] = {}
    for name, files in given.items() if isinstance(given, dict) else [("", None)]:
        if name not in writable or not isinstance(files, dict):
            raise ServiceFailedError(f"{task.service} wrote to {name!r}, which it may not")
        written[name] = {path: _contents(data) for path, data in files.items()}
    return written


def _contents(data: Any) -> bytes:
    if isinstance(data, bytes):
        return data
    try:
        return base64.b64decode(data, validate=True)
    except (binascii.Error, ValueError, TypeError):
        raise ServiceFailedError("a worker wrote a file that is not base64") from None
