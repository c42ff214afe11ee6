"""One robot's conversation, free of sockets: text into `feed`, text out by `send`."""

from __future__ import annotations

import itertools
import json
import logging
import math
from collections.abc import Callable
from typing import Any, Protocol

from endpoint.auth import require_scope
from endpoint.rosbridge import aliases
from endpoint.rosbridge.calls import RUNNING_PER_SESSION, WAITING_PER_SESSION, CallQueue
from endpoint.rosbridge.rosapi import rosapi_services
from endpoint.rosbridge.services import Engine, JsonObject, Service, ServiceTable, engine_services
from endpoint.rosbridge.topics import Topics
from rtask.errors import RtaskError, UsageError
from rtask.kb.access import Access

_log = logging.getLogger(__name__)

MAX_DEPTH = 64
MAX_FAILURE_TEXT = 500
MAX_ANSWER_BYTES = 64 << 20
LEVELS = ("none", "error", "warning", "info")
_numbers = itertools.count(1)


class Send(Protocol):
    """Takes a text for the robot; `topic` is empty for answers, which are never dropped."""

    def __call__(self, text: str, topic: str = "") -> None:
        """Queue the text; must not wait."""


class Bridge:
    """What all sessions share: services, topics, the threads that carry out calls.

    Parameters
    ----------
    engine
        Its operations are the services below ``/rtask/``.
    threads
        How many calls run at the same time.
    """

    def __init__(self, engine: Engine, threads: int = 32) -> None:
        self.engine = engine
        self.topics = Topics()
        self.calls = CallQueue(threads)
        self.services = ServiceTable(engine_services(engine))
        for service in rosapi_services(self.services, self.topics):
            self.services.add(service)

    def close(self) -> None:
        """Let running calls end."""
        self.calls.close()


class Session:
    """One connection of a robot.

    Parameters
    ----------
    bridge
        What it shares with the others.
    send
        Where texts for the robot go; may be called from any thread.
    access
        What the robot may do.
    """

    def __init__(self, bridge: Bridge, send: Send, access: Access) -> None:
        self.bridge = bridge
        self.access = access
        self.number = next(_numbers)
        self._send = send
        self._level = "error"
        self._closed = False
        self._ops: dict[str, Callable[[JsonObject], None]] = {
            "call_service": self._call_service,
            "advertise": self._advertise,
            "unadvertise": self._unadvertise,
            "publish": self._publish,
            "subscribe": self._subscribe,
            "unsubscribe": self._unsubscribe,
            "set_level": self._set_level,
            "auth": self._auth,
            "search_object": self._thesis_op,
            "send_new_object": self._thesis_op,
        }

    def feed(self, text: str) -> None:
        """Take one message; whatever is wrong with it becomes a `status`, never an exception."""
        message: Any = None
        try:
            message = _parse(text)
            op = message.get("op")
            handler = self._ops.get(op) if isinstance(op, str) else None
            if handler is None:
                known = ", ".join(sorted(self._ops))
                raise UsageError(f"unknown op {op!r}; this server takes {known}")
            handler(message)
        except RtaskError as error:
            self._status("error", str(error), message)
        except Exception:  # noqa: BLE001 - the session outlives its messages
            _log.exception("session %d failed on a message", self.number)
            self._status("error", "an unexpected error; the server's log has it", message)

    def close(self) -> None:
        """End the session: its subscriptions, announcements and waiting calls go with it."""
        self._closed = True
        self.bridge.calls.forget(self.number)
        self.bridge.topics.leave(self.number)

    def _emit(self, message: JsonObject, topic: str = "") -> None:
        if not self._closed:
            self._send(encode(message), topic)

    def _status(self, level: str, text: str, message: Any) -> None:
        if LEVELS.index(level) > LEVELS.index(self._level):
            return
        self._emit(_with_id({"op": "status", "level": level, "msg": text}, message))

    def _set_level(self, message: JsonObject) -> None:
        if message.get("level") in LEVELS:
            self._level = message["level"]

    def _auth(self, message: JsonObject) -> None:
        _log.info("session %d sent the old `auth` op; tokens decide instead", self.number)

    def _call_service(self, message: JsonObject) -> None:
        name = message.get("service")
        try:
            if not isinstance(name, str):
                raise UsageError("service: a string is wanted")
            service = self.bridge.services.find(name)
            args = _arguments(message.get("args"))
            require_scope(self.access, service.scope)
        except RtaskError as error:
            self._answer(message, False, str(error))
            return
        if service.inline:
            self._run(message, service, args)
        elif not self._queue(lambda: self._run(message, service, args)):
            self._answer(message, False, _BUSY)

    def _queue(self, job: Callable[[], None]) -> bool:
        return self.bridge.calls.submit(self.number, job)

    def _run(self, message: JsonObject, service: Service, args: JsonObject) -> None:
        try:
            values = service.handler(args, self.access)
            text = encode(_with_id(_service_response(message, True, values), message))
            if len(text) > MAX_ANSWER_BYTES:
                raise UsageError(f"answer of {len(text) >> 20} MB is too large: use HTTP")
        except Exception as error:  # noqa: BLE001 - a failed call is an answer
            self._answer(message, False, failure_text(error))
            return
        if not self._closed:
            self._send(text)

    def _answer(self, message: JsonObject, result: bool, values: Any) -> None:
        self._emit(_with_id(_service_response(message, result, values), message))

    def _thesis_op(self, message: JsonObject) -> None:
        """Carry out an op of Gatto 2016, 3.2.4 that is not of rosbridge."""

        def job() -> None:
            self._emit(_with_id(aliases.answer(message, self.bridge.engine, self.access), message))

        if not self._queue(job):
            self._emit(_with_id(aliases.refusal(message, _BUSY), message))

    def _advertise(self, message: JsonObject) -> None:
        type_ = message.get("type")
        if not isinstance(type_, str):
            raise UsageError("type: a string is wanted")
        self.bridge.topics.advertise(self.number, _topic(message), type_)

    def _unadvertise(self, message: JsonObject) -> None:
        name = _topic(message)
        if not self.bridge.topics.unadvertise(self.number, name):
            self._status("warning", f"{name} was not advertised here", message)

    def _publish(self, message: JsonObject) -> None:
        latch = message.get("latch") is True
        content = message.get("msg", {})
        try:
            self.bridge.topics.publish(self.number, _topic(message), content, latch=latch)
        except ValueError as error:
            raise UsageError(f"msg: {error}; JSON has no NaN or infinity") from None

    def _subscribe(self, message: JsonObject) -> None:
        throttle = message.get("throttle_rate") or 0
        if not isinstance(throttle, int | float) or not math.isfinite(throttle):
            raise UsageError("throttle_rate: a number of milliseconds is wanted")
        self.bridge.topics.subscribe(
            self.number, _topic(message), message.get("id"), throttle, self._deliver
        )

    def _unsubscribe(self, message: JsonObject) -> None:
        self.bridge.topics.unsubscribe(self.number, _topic(message), message.get("id"))

    def _deliver(self, text: str, topic: str) -> None:
        if not self._closed:
            self._send(text, topic)


_BUSY = f"busy: {RUNNING_PER_SESSION} calls running, {WAITING_PER_SESSION} waiting"


def encode(message: JsonObject) -> str:
    """Write strict JSON; NaN in an answer would break every browser that reads it.

    Raises
    ------
    ValueError
        A number is not finite.
    """
    return json.dumps(message, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


def failure_text(error: Exception) -> str:
    """Return one line that says what went wrong; nothing of the inside where it was unforeseen."""
    if isinstance(error, RtaskError):
        return " ".join(str(error).split())[:MAX_FAILURE_TEXT]
    _log.error("a call failed", exc_info=error)
    return "an unexpected error; the server's log has it"


def _parse(text: str) -> JsonObject:
    try:
        message = json.loads(text)
    except json.JSONDecodeError as error:
        raise UsageError(
            f"not JSON: {error.msg} at line {error.lineno}, column {error.colno}"
        ) from (None)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"not JSON that can be read: {str(error)[:100]}") from None
    if text.count("[") + text.count("{") > MAX_DEPTH and _is_deeper(message, MAX_DEPTH):
        raise UsageError(f"JSON nested deeper than {MAX_DEPTH}")
    if not isinstance(message, dict):
        raise UsageError("a message is a JSON object with a field `op`")
    return message


def _is_deeper(value: Any, allowed: int) -> bool:
    level = [value]
    for _ in range(allowed + 1):
        level = [
            child
            for node in level
            if isinstance(node, dict | list)
            for child in (node.values() if isinstance(node, dict) else node)
        ]
        if not level:
            return False
    return True


def _arguments(args: Any) -> JsonObject:
    """Return the arguments as an object: sent so, as a list holding one, or not at all."""
    if args is None or args == []:
        return {}
    if isinstance(args, list) and len(args) == 1:
        args = args[0]
    if not isinstance(args, dict):
        raise UsageError("args: an object is wanted, or a list holding one")
    return args


def _topic(message: JsonObject) -> str:
    name = message.get("topic")
    if not isinstance(name, str) or not name.strip("/"):
        raise UsageError("topic: a name is wanted")
    return "/" + name.lstrip("/")


def _service_response(message: JsonObject, result: bool, values: Any) -> JsonObject:
    return {
        "op": "service_response",
        "service": message.get("service"),
        "values": values,
        "result": result,
    }


def _with_id(answer: JsonObject, message: Any) -> JsonObject:
    """Echo the caller's id exactly; leave it out if none was given."""
    if isinstance(message, dict) and message.get("id") is not None:
        return {**answer, "id": message["id"]}
    return answer
