"""A robot's session, independent of sockets: text goes into `feed`, frames out by `send`."""

from __future__ import annotations

import itertools
import logging
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

from endpoint.access.auth import require_scope
from endpoint.activity.log import ANONYMOUS, ActivityLog
from endpoint.rosbridge import aliases
from endpoint.rosbridge.actions import Actions, plan_grasps_action
from endpoint.rosbridge.calls import (
    RUNNING_PER_SESSION,
    WAITING_PER_SESSION,
    CallQueue,
    Deadlines,
    Once,
    OwnCall,
)
from endpoint.rosbridge.hosted import hosted_actions, hosted_services
from endpoint.rosbridge.messages import (
    JsonObject,
    arguments,
    encode,
    failure_text,
    is_writable,
    name_of,
    parse,
    refuse_unwritable,
    service_response,
    text_of,
    with_id,
)
from endpoint.rosbridge.packing import Fragments, Frame, Packing
from endpoint.rosbridge.parameters import Parameters
from endpoint.rosbridge.providers import Providers, timeout_of
from endpoint.rosbridge.rosapi import Graph, rosapi_services
from endpoint.rosbridge.services import Engine, Service, ServiceTable, engine_services
from endpoint.rosbridge.topics import Topics
from endpoint.rosbridge.workers import Workers, WorkerSeat
from rtask.errors import RtaskError, UsageError
from rtask.kb.commit.access import Access
from rtask.services import ServiceHost

_log = logging.getLogger(__name__)

MAX_ANSWER_BYTES = 64 << 20
CALL_S = 60.0
LEVELS = ("none", "error", "warning", "info")
SERVICES = "/services/"
CANCEL_ALL = "/_action/cancel_goal"
_numbers = itertools.count(1)


class Send(Protocol):
    """Callback for frames to the robot; `topic` is empty for answers, which are never dropped."""

    def __call__(self, text: Frame, topic: str = "") -> None:
        """Queue the frame without waiting."""


class Bridge:
    """State that all sessions share: services, topics, actions, and threads for calls.

    Parameters
    ----------
    engine
        Offers its operations as services below ``/rtask/``.
    activity
        Receives who connects and what cameras see; none for one of its own.
    host
        Offers the methods of its services as services and actions below ``/services/``.
    """

    def __init__(
        self,
        engine: Engine,
        activity: ActivityLog | None = None,
        host: ServiceHost | None = None,
    ) -> None:
        self.engine = engine
        self.activity = activity or ActivityLog()
        self.deadlines = Deadlines()
        self.topics = Topics(self.deadlines)
        self.calls = CallQueue()
        self.providers = Providers(self.deadlines)
        own_actions = [*plan_grasps_action(engine), *hosted_actions(host)]
        self.actions = Actions(own_actions, self.calls, self.deadlines)
        self.services = ServiceTable([*engine_services(engine), *hosted_services(host)])
        self.workers = Workers(host, self.services, self.deadlines)
        self.sessions: dict[int, Session] = {}
        graph = Graph(
            self.services, self.topics, self.providers, self.actions, Parameters(),
            lambda: list(self.sessions.values()),
        )  # fmt: skip
        for service in rosapi_services(graph):
            self.services.add(service)

    def close(self) -> None:
        """Wait for the running calls to end."""
        self.deadlines.close()
        self.calls.close()


class Session:
    """The session of one connection.

    Parameters
    ----------
    bridge
        State shared with the other sessions.
    send
        Sends a frame to the robot; may be called from any thread.
    access
        Rights of the robot.
    """

    def __init__(self, bridge: Bridge, send: Send, access: Access) -> None:
        self.bridge = bridge
        self.access = access
        self.number = next(_numbers)
        self._send = send
        self._level = "error"
        self._closed = False
        self._fragments = Fragments()
        self._packings: dict[str, Packing] = {}
        self._own_calls: set[OwnCall] = set()
        self._worker = WorkerSeat(bridge.workers, self)
        self._ops: dict[str, Callable[[JsonObject], None]] = {
            "call_service": self._call_service,
            "advertise": self._advertise,
            "unadvertise": self._unadvertise,
            "publish": self._publish,
            "subscribe": self._subscribe,
            "unsubscribe": self._unsubscribe,
            "advertise_service": self._advertise_service,
            "unadvertise_service": self._unadvertise_service,
            "service_response": self._service_response,
            "worker_alive": self._worker.heard,
            "worker_leaves": self._worker.drain,
            "advertise_action": self._advertise_action,
            "unadvertise_action": self._unadvertise_action,
            "send_action_goal": self._send_action_goal,
            "cancel_action_goal": self._cancel_action_goal,
            "action_feedback": self._action_feedback,
            "action_result": lambda m: bridge.actions.relay(self, m),
            "fragment": self._fragment,
            "set_level": self._set_level,
            "auth": self._auth,
            "search_object": self._thesis_op,
            "send_new_object": self._thesis_op,
        }
        bridge.sessions[self.number] = self
        bridge.activity.connected(self.identity)

    @property
    def identity(self) -> str:
        """Name of the robot; the same for all robots without a token."""
        return self.access.agent or ANONYMOUS

    def provides(self) -> list[str]:
        """Return the names of the services that the robot offers over this session."""
        return [
            provider.name for provider in self.bridge.providers.listing() if provider.peer is self
        ]

    def feed(self, frame: Frame) -> None:
        """Handle one message; errors are sent as a `status` message, never raised."""
        message: Any = None
        try:
            message = parse(frame) if isinstance(frame, str) else self._worker.read(frame)
            op = message.get("op")
            handler = self._ops.get(op) if isinstance(op, str) else None
            if handler is None:
                ops = ", ".join(sorted(self._ops))
                raise UsageError(f"unknown op {op!r}; this server takes {ops}")
            id_ = message.get("id")
            if not isinstance(id_, str | int | float | None) or not is_writable(id_):
                raise UsageError("id: expected a string or a number")
            handler(message)
        except RtaskError as error:
            self._status("error", str(error), message)
        except Exception:  # noqa: BLE001 - the session outlives its messages
            _log.exception("session %d failed on a message", self.number)
            self._status("error", "an unexpected error; the server's log has it", message)

    def close(self) -> None:
        """End the session and everything it advertised, subscribed to and waits for."""
        self._closed = True
        bridge = self.bridge
        if bridge.sessions.pop(self.number, None) is not None:
            bridge.activity.left(self.identity)
        bridge.calls.forget(self.number)
        for call in list(self._own_calls):
            call.leave(is_late=False)
        bridge.topics.leave(self.number)
        bridge.actions.leave(self)
        bridge.providers.leave(self)
        self._worker.leave()

    def put(self, frame: Frame) -> None:
        """Queue a frame for the robot without waiting."""
        if not self._closed:
            self._send(frame)

    def emit(self, message: JsonObject) -> None:
        """Queue a message for the robot without waiting."""
        self.put(encode(message))

    def _status(self, level: str, text: str, message: Any) -> None:
        if LEVELS.index(level) > LEVELS.index(self._level):
            return
        self.emit(with_id({"op": "status", "level": level, "msg": text}, message))

    def _set_level(self, message: JsonObject) -> None:
        if message.get("level") in LEVELS:
            self._level = message["level"]

    def _auth(self, message: JsonObject) -> None:
        _log.info("session %d sent the old `auth` op; tokens decide instead", self.number)

    def _fragment(self, message: JsonObject) -> None:
        whole = self._fragments.add(message)
        if whole is not None:
            if parse(whole).get("op") == "fragment":
                raise UsageError("fragment: a piece of a piece is not taken")
            self.feed(whole)

    # Calls

    def _call_service(self, message: JsonObject) -> None:
        once = Once()
        name = message.get("service")
        try:
            if not isinstance(name, str):
                raise UsageError("service: expected a string")
            if message.get("id") is None and name.endswith(CANCEL_ALL):
                # roslib cancels all goals this way, and logs an error for each answer to it.
                self.bridge.actions.cancel(self, "/" + name.removesuffix(CANCEL_ALL).lstrip("/"))
                return
            packing = Packing.from_message(message)
            provider = self.bridge.providers.find("/" + name.lstrip("/"))
            if provider is not None:
                args = arguments(message.get("args"))
                require_scope(self.access, "call")
                refuse_unwritable(args, "args")
                self.bridge.providers.call(
                    provider, args, self.number, timeout_of(message),
                    lambda result, values: self._finish(message, packing, result, values, once),
                )  # fmt: skip
                return
            service = self.bridge.services.find(
                name, [provider.name for provider in self.bridge.providers.listing()]
            )
            args = arguments(message.get("args"), service.parameters)
            require_scope(self.access, service.scope)
        except RtaskError as error:
            self._finish(message, Packing(), False, failure_text(error), once, error.status)
            return
        self._carry_out(message, packing, service, args, once)

    def _carry_out(
        self, message: JsonObject, packing: Packing, service: Service, args: JsonObject,
        once: Once,
    ) -> None:  # fmt: skip
        """Answer a call at once, when a thread has finished it, or when its time is up."""
        if service.inline:
            self._run(message, packing, service, args, once)
            return
        seconds = timeout_of(message, CALL_S)
        call = OwnCall(may_be_left=service.scope in ("read", "call"))

        def expire() -> None:
            if call.leave(is_late=True):
                words = f"no answer within {seconds:g} s"
                self._finish(message, packing, False, words, once, 504)

        late = self.bridge.deadlines.after(seconds, expire)

        def job() -> None:
            self._own_calls.add(call)
            try:
                self._run(message, packing, service, args, once, call, seconds)
            finally:
                self._own_calls.discard(call)
                late.cancel()

        if not self.bridge.calls.submit(self.number, job):
            late.cancel()
            self._finish(message, packing, False, _BUSY, once, 503)

    def _run(
        self, message: JsonObject, packing: Packing, service: Service, args: JsonObject,
        once: Once, call: OwnCall | None = None, seconds: float = CALL_S,
    ) -> None:  # fmt: skip
        try:
            prepare = service.prepare
            prepared = prepare(args, self.access, seconds) if prepare else None
            if call is not None and (self._closed or not call.begin(prepared)):
                return  # its caller was told that its time is up, or has gone
            values = prepared.result() if prepared else service.handler(args, self.access)
            text = encode(service_response(message, True, values))
            if len(text) > MAX_ANSWER_BYTES:
                raise UsageError(f"answer of {len(text) >> 20} MB is too large: use HTTP")
        except Exception as error:  # noqa: BLE001 - a failed call is an answer
            status, transient, slug = 500, False, RtaskError.slug
            if isinstance(error, RtaskError):
                status, transient, slug = error.status, error.is_transient, error.slug
            words = failure_text(error)
            self._finish(message, packing, False, words, once, status, transient, slug)
            return
        if once():
            self._put(text, packing)

    def _finish(
        self,
        message: JsonObject,
        packing: Packing,
        result: bool,
        values: Any,
        once: Once,
        status: int | None = None,
        transient: bool | None = None,
        slug: str | None = None,
    ) -> None:
        if once():
            answer = service_response(message, result, values, status, transient, slug)
            self._put(encode(answer), packing)

    def _put(self, text: str, packing: Packing) -> None:
        if self._closed:
            return
        if packing.is_plain:
            self._send(text)
            return
        for frame in packing.frames(text):
            self._send(frame)

    def _thesis_op(self, message: JsonObject) -> None:
        """Carry out an op of Gatto 2016, 3.2.4, that rosbridge does not define."""

        def job() -> None:
            self.emit(with_id(aliases.answer(message, self.bridge.engine, self.access), message))

        if not self.bridge.calls.submit(self.number, job):
            self.emit(with_id(aliases.refusal(message, _BUSY), message))

    # Services and actions of robots

    def _advertise_service(self, message: JsonObject) -> None:
        name, type_ = name_of(message, "service"), message.get("type") or ""
        if name.startswith(SERVICES) and "description" in message:
            self._worker.advertise(message)
            return
        require_scope(self.access, "call")
        if self.bridge.topics.advertised(self.number, name):
            # roslibpy keeps both in one table of events and would mix them up.
            raise UsageError(f"{name} is a topic of this robot; give the service another name")
        self.bridge.providers.advertise(self, name, type_ if isinstance(type_, str) else "")

    def _unadvertise_service(self, message: JsonObject) -> None:
        name = name_of(message, "service")
        if name.startswith(SERVICES):
            was_there = self._worker.unadvertise(name.removeprefix(SERVICES))
        else:
            was_there = self.bridge.providers.unadvertise(self, name)
        if not was_there:
            self._status("warning", f"{name} was not advertised here", message)

    def _service_response(self, message: JsonObject) -> None:
        if not self._worker.take(message):
            self.bridge.providers.answer(self, message)

    def _action_feedback(self, message: JsonObject) -> None:
        if not self._worker.take(message):
            self.bridge.actions.relay(self, message)

    def _advertise_action(self, message: JsonObject) -> None:
        require_scope(self.access, "call")
        type_ = text_of(message, "type")
        self.bridge.actions.providers.advertise(self, name_of(message, "action"), type_)

    def _unadvertise_action(self, message: JsonObject) -> None:
        name = name_of(message, "action")
        if not self.bridge.actions.unadvertise(self, name):
            self._status("warning", f"{name} was not advertised here", message)

    def _send_action_goal(self, message: JsonObject) -> None:
        self.bridge.actions.send(self, self.access, message, name_of(message, "action"))

    def _cancel_action_goal(self, message: JsonObject) -> None:
        if message.get("id") is not None:
            self.bridge.actions.cancel(self, name_of(message, "action"), message["id"])

    # Topics

    def _advertise(self, message: JsonObject) -> None:
        name, type_ = name_of(message, "topic"), text_of(message, "type")
        provider = self.bridge.providers.find(name)
        if provider is not None and provider.peer.number == self.number:
            raise UsageError(f"{name} is a service of this robot; give the topic another name")
        self.bridge.topics.advertise(self.number, name, type_, latch=message.get("latch") is True)

    def _unadvertise(self, message: JsonObject) -> None:
        name = name_of(message, "topic")
        if not self.bridge.topics.unadvertise(self.number, name):
            self._status("warning", f"{name} was not advertised here", message)

    def _publish(self, message: JsonObject) -> None:
        name, content = name_of(message, "topic"), message.get("msg", {})
        try:
            latch = message.get("latch") is True
            self.bridge.topics.publish(self.number, name, content, latch=latch)
        except ValueError as error:
            raise UsageError(f"msg: {error}; JSON has no NaN or infinity") from None
        type_ = self.bridge.topics.type_of(name)
        self.bridge.activity.picture(self.identity, name, type_, content)

    def _subscribe(self, message: JsonObject) -> None:
        throttle, queue = (message.get(name) or 0 for name in ("throttle_rate", "queue_length"))
        for name, value in (("throttle_rate", throttle), ("queue_length", queue)):
            if not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
                raise UsageError(f"{name}: expected a number")
        name, packing = name_of(message, "topic"), Packing.from_message(message)
        packing = self._smallest(name, packing)
        deliver = self._deliver if packing.is_plain else self._packed(packing)
        self.bridge.topics.subscribe(
            self.number, name, message.get("id"), throttle, deliver, int(queue)
        )

    def _smallest(self, name: str, packing: Packing) -> Packing:
        """Return the packing of this session's subscriptions to a topic; the smallest wins."""
        before = self._packings.get(name)
        if before is not None:
            sizes = [p.fragment_size for p in (before, packing) if p.fragment_size]
            packing = replace(packing, fragment_size=min(sizes, default=0))
        self._packings[name] = packing
        return packing

    def _packed(self, packing: Packing) -> Callable[[str, str], None]:
        def deliver(text: str, topic: str) -> None:
            if not self._closed:
                for frame in packing.frames(text):
                    self._send(frame, topic)

        return deliver

    def _unsubscribe(self, message: JsonObject) -> None:
        name = name_of(message, "topic")
        if message.get("id") is None:
            self._packings.pop(name, None)
        self.bridge.topics.unsubscribe(self.number, name, message.get("id"))

    def _deliver(self, text: str, topic: str) -> None:
        if not self._closed:
            self._send(text, topic)


_BUSY = f"busy: {RUNNING_PER_SESSION} calls running, {WAITING_PER_SESSION} waiting"
