"""Classify failed answers, and decide how long to wait before a call is sent again."""

from __future__ import annotations

import random
import time
from typing import TYPE_CHECKING

from rtask.errors import (
    TRANSIENT_STATUSES,
    AuthenticationError,
    CallFailedError,
    ForbiddenError,
    RtaskError,
)
from rtask.wire.dataset_words import in_words_of

if TYPE_CHECKING:
    import httpx

__all__ = ["Patience", "error_of", "failure_of", "is_transient"]

_FIRST_S = 0.1
_MAX_S = 2.0


def failure_of(answer: httpx.Response) -> RtaskError:
    """Return the error of an answer, with the words of its problem details (RFC 9457)."""
    resource: object = None
    kind = ""
    proposals: object = None
    try:
        problem = answer.json()
        words = str(problem.get("detail") or problem.get("title") or answer.text[:500])
        resource = problem.get("resource")
        kind = str(problem.get("type", "")).rpartition("/")[2]
        proposals = problem.get("proposals")
    except (ValueError, AttributeError):
        words = answer.text[:500] or answer.reason_phrase
    error = error_of(answer.status_code, words, is_transient(answer), resource, kind)
    if isinstance(proposals, list):
        error.details["proposals"] = proposals
    return error


def error_of(
    status: int, words: str, may_pass: bool, resource: object = None, kind: str = ""
) -> RtaskError:
    """Return the error of a failed call, the same one over HTTP, rosbridge and websocket.

    Parameters
    ----------
    status
        That the answer has, or would have, over HTTP.
    words
        Of the server.
    may_pass
        Whether the same call may succeed later.
    resource
        Name of the data resource that the call lacked, if that was it.
    kind
        Slug of the error at the server, where the answer has it.
    """
    if status == 401:
        return AuthenticationError(words)
    if status == 403:
        return ForbiddenError(words)
    if isinstance(resource, str):
        words = in_words_of(words, resource, "data=")
    return CallFailedError(
        words, http_status=status, transient=may_pass, resource=resource, problem=kind or None
    )


def is_transient(answer: httpx.Response) -> bool:
    """Return whether the same request may succeed later: as the answer says, or by its status."""
    try:
        declared = answer.json().get("transient")
    except (ValueError, AttributeError):
        declared = None
    return declared if isinstance(declared, bool) else answer.status_code in TRANSIENT_STATUSES


class Patience:
    """Pauses that grow until a deadline.

    Each pause is drawn between half and the whole of what is due, so that robots which lost one
    server do not all come back at the same moment.

    Parameters
    ----------
    timeout_s
        From now until the deadline.

    Examples
    --------
    >>> Patience(0.0).wait()
    False
    """

    def __init__(self, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s
        self._pause_s = _FIRST_S

    @property
    def left_s(self) -> float:
        """Time until the deadline, s; negative afterwards."""
        return self._deadline - time.monotonic()

    def wait(self) -> bool:
        """Pause before another try; tell whether there is time for one."""
        pause_s = self._pause_s * random.uniform(0.5, 1.0)
        self._pause_s = min(2 * self._pause_s, _MAX_S)
        if self.left_s <= pause_s:
            return False
        time.sleep(pause_s)
        return True
