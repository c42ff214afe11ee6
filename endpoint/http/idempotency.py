"""Idempotency keys: requests that may be repeated (draft-ietf-httpapi-idempotency-key-header).

Where a field of the request is declared as its id (:class:`rtask.wire.request_id.StoredOnce`), the
key becomes that id in the graph and so survives a restart: the engine stores each id of an agent
once and answers a repetition with what the first request stored. Other changes have no such id.
This process remembers their answers; after a restart a repetition is carried out again, or refused
where what it would move is no longer there. A key reused with another body is noticed as long as
this process remembers the first.
"""

from __future__ import annotations

import hashlib
import re
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from endpoint.http.messages import RefusedError, Request
from rtask.errors import UsageError
from rtask.wire.message import Answer
from rtask.wire.request_id import RequestId

HEADER = "idempotency-key"
MAX_KEYS = 10_000
_KEY = re.compile(r"[A-Za-z0-9._:-]{1,200}")


class IdempotencyKeys:
    """Registry of the keys, bodies and answers of requests."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._bodies: OrderedDict[tuple[str, str, str], bytes] = OrderedDict()
        self._answers: OrderedDict[tuple[str, str, str], Future[Answer]] = OrderedDict()

    def prepared(
        self,
        request: Request,
        operation: str,
        agent: str,
        ids: RequestId | None,
        args: dict[str, Any],
        carry_out: Callable[[dict[str, Any]], Answer],
    ) -> Callable[[], Answer]:
        """Return an operation that writes, with its arguments, for :class:`Plan` to run.

        Parameters
        ----------
        ids
            Where its requests carry ids by which they are stored once; None if they carry none.
        carry_out
            Takes the arguments.

        Raises
        ------
        UsageError
            The key is malformed.
        RefusedError
            422 if the key was used with another body before.
        """
        key = request.headers.get(HEADER)
        if key is None:
            return lambda: carry_out(args)
        # Clients send it as a structured string, in quotes, or as a plain one.
        key = key.strip().strip('"')
        if not _KEY.fullmatch(key):
            raise UsageError("Idempotency-Key: expected 1 to 200 letters, digits and . _ : -")
        name = (agent, operation, key)
        self._refuse_other_body(name, hashlib.sha256(request.body).digest())
        # Stored with the change itself, the key survives a restart.
        if ids is not None and ids.applies_to(args):
            keyed = ids.filled(args, lambda end: f"{key}{end}")
            return lambda: carry_out(keyed)
        return lambda: self._once(name, lambda: carry_out(args))

    def _refuse_other_body(self, name: tuple[str, str, str], digest: bytes) -> None:
        with self._lock:
            first = self._bodies.setdefault(name, digest)
            while len(self._bodies) > MAX_KEYS:
                self._bodies.popitem(last=False)
        if first != digest:
            raise RefusedError(
                422,
                "idempotency-key-reused",
                f"the key {name[2]} was used with another body before",
            )

    def _once(self, name: tuple[str, str, str], run: Callable[[], Answer]) -> Answer:
        """Return the answer to the first request with this key that did not fail.

        A repetition waits while the first request is still being carried out.
        """
        mine: Future[Answer] = Future()
        with self._lock:
            first = self._answers.setdefault(name, mine)
            while len(self._answers) > MAX_KEYS:
                self._answers.popitem(last=False)
        # The first one may still be at work: both get the same answer.
        if first is not mine:
            return first.result()
        try:
            mine.set_result(run())
        except BaseException as error:
            # A failure is not an answer: the next attempt with this key may succeed.
            with self._lock:
                self._answers.pop(name, None)
            mine.set_exception(error)
            raise
        return mine.result()
