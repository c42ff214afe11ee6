"""Idempotency keys: requests that may be repeated (draft-ietf-httpapi-idempotency-key-header).

The key of a report becomes its ``task_id`` in the graph and so survives a restart: the engine
stores each id of an agent once and answers a repetition with what the first request stored. Other
changes have no such id. This process remembers their answers; after a restart a repetition is
refused, because what it would move is no longer there. A key reused with another body is noticed as
long as this process remembers the first.
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

HEADER = "idempotency-key"
MAX_KEYS = 10_000
_KEY = re.compile(r"[A-Za-z0-9._:-]{1,200}")
_KEYED_OPERATIONS = ("insert_object", "report_outcome", "teach_object")


class IdempotencyKeys:
    """Registry of the keys, bodies and answers of requests.

    Examples
    --------
    >>> with_key("report_outcome", {"success": True}, "k-1")
    {'success': True, 'task_id': 'k-1'}
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._bodies: OrderedDict[tuple[str, str, str], bytes] = OrderedDict()
        self._answers: OrderedDict[tuple[str, str, str], Future[Answer]] = OrderedDict()

    def read(
        self, request: Request, operation: str, agent: str, args: dict[str, Any]
    ) -> dict[str, Any]:
        """Return the arguments of an operation that writes, with the request's key if it has one.

        Raises
        ------
        UsageError
            The key is malformed.
        RefusedError
            422 if the key was used with another body before.
        """
        key = request.headers.get(HEADER)
        if key is None:
            return args
        key = key.strip().strip('"')
        if not _KEY.fullmatch(key):
            raise UsageError("Idempotency-Key: expected 1 to 200 letters, digits and . _ : -")
        digest = hashlib.sha256(request.body).digest()
        with self._lock:
            first = self._bodies.setdefault((agent, operation, key), digest)
            while len(self._bodies) > MAX_KEYS:
                self._bodies.popitem(last=False)
        if first != digest:
            raise RefusedError(
                422, "idempotency-key-reused", f"the key {key} was used with another body before"
            )
        return with_key(operation, args, key) if operation in _KEYED_OPERATIONS else args

    def once(
        self, request: Request, operation: str, agent: str, run: Callable[[], Answer]
    ) -> Answer:
        """Return the answer to the first request with this key that did not fail.

        A repetition waits while the first request is still being carried out.
        """
        key = request.headers.get(HEADER)
        if key is None or operation in _KEYED_OPERATIONS:
            return run()
        mine: Future[Answer] = Future()
        name = (agent, operation, key.strip().strip('"'))
        with self._lock:
            first = self._answers.setdefault(name, mine)
            while len(self._answers) > MAX_KEYS:
                self._answers.popitem(last=False)
        if first is not mine:
            return first.result()
        try:
            mine.set_result(run())
        except BaseException as error:
            with self._lock:
                self._answers.pop(name, None)
            mine.set_exception(error)
            raise
        return mine.result()


def with_key(operation: str, args: dict[str, Any], key: str) -> dict[str, Any]:
    """Return arguments in which every reported thing has an id; given ids stay."""
    if operation != "insert_object" or "objects" not in args:
        return {**args, "task_id": args.get("task_id") or key}
    objects = args["objects"]
    if not isinstance(objects, list):
        return args
    return {
        **args,
        "objects": [
            {**item, "task_id": item.get("task_id") or (key if len(objects) == 1 else f"{key}.{k}")}
            if isinstance(item, dict)
            else item
            for k, item in enumerate(objects)
        ],
    }
