"""Services that robots provide: caller, server, provider, and back (rosbridge protocol 2, 3.4).

No thread waits for a provider. A call ends with the provider's answer, at its deadline, or when the
provider withdraws the service or disconnects, whichever comes first; later answers are dropped.
"""

from __future__ import annotations

import itertools
import json
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from endpoint.rosbridge.calls import Deadline, Deadlines
from endpoint.rosbridge.messages import (
    JsonObject,
    is_writable,
    refuse_unwritable,
)
from endpoint.rosbridge.topics import refuse_reserved
from rtask.errors import ForbiddenError, UsageError

DEFAULT_S = 30.0
MAX_TIMEOUT_S = 600.0
MAX_PER_SESSION = 100
_MAX_REASON = 300
"""Most characters of the values that a caller hears of when a provider refuses with an object."""

Done = Callable[[bool, Any], None]


class Peer(Protocol):
    """The part of a session that providers use."""

    @property
    def number(self) -> int:
        """Of the session."""

    @property
    def identity(self) -> str:
        """Name of the robot; all robots without a token are one."""

    def emit(self, message: JsonObject) -> None:
        """Queue a message without waiting."""


@dataclass(frozen=True)
class Provider:
    """A service that a robot advertised."""

    name: str
    type: str
    peer: Peer


@dataclass
class _Call:
    """A call waiting for its provider."""

    id: str
    provider: Provider
    caller: int
    done: Done
    deadline: Deadline | None = None


class Providers:
    """All services that robots provide, and the calls in progress.

    Parameters
    ----------
    deadlines
        Ends calls that nobody answers.
    """

    def __init__(self, deadlines: Deadlines) -> None:
        self._deadlines = deadlines
        self._lock = threading.Lock()
        self._providers: dict[str, Provider] = {}
        self._calls: dict[str, _Call] = {}
        self._numbers = itertools.count(1)

    def advertise(self, peer: Peer, name: str, type_: str) -> None:
        """Advertise a service; a robot's newest advertisement replaces its earlier one.

        Raises
        ------
        UsageError
            The name is reserved, or the session provides too many services.
        ForbiddenError
            Another robot provides the service.
        """
        refuse_reserved(name)
        with self._lock:
            before = self._providers.get(name)
            if before is not None and before.peer.identity != peer.identity:
                raise ForbiddenError(f"{name} is provided by {before.peer.identity}")
            held = sum(provider.peer.number == peer.number for provider in self._providers.values())
            if held >= MAX_PER_SESSION and before is None:
                raise UsageError(f"more than {MAX_PER_SESSION} services provided")
            self._providers[name] = Provider(name, type_, peer)

    def unadvertise(self, peer: Peer, name: str) -> bool:
        """Withdraw an advertisement and fail the calls that wait for it.

        Returns
        -------
        Whether it was this session's.
        """
        with self._lock:
            provider = self._providers.get(name)
            if provider is None or provider.peer.number != peer.number:
                return False
            del self._providers[name]
            waiting = [
                call.id
                for call in self._calls.values()
                if call.provider.peer is peer and call.provider.name == name
            ]
        for id_ in waiting:
            self._end(id_, False, f"{peer.identity} withdrew {name} before it answered")
        return True

    def find(self, name: str) -> Provider | None:
        """Return the provider of a service; none if nobody provides it."""
        return self._providers.get(name)

    def listing(self) -> list[Provider]:
        """Return all providers, sorted by service name."""
        with self._lock:
            return [self._providers[name] for name in sorted(self._providers)]

    def call(
        self, provider: Provider, args: JsonObject, caller: int, timeout_s: float, done: Done
    ) -> None:
        """Forward a call; `done` gets result and values exactly once, from any thread."""
        call = _Call(f"service_request:{next(self._numbers)}", provider, caller, done)
        with self._lock:
            self._calls[call.id] = call
        reason = f"no answer from {provider.peer.identity} after {timeout_s:g} s"
        call.deadline = self._deadlines.after(timeout_s, lambda: self._end(call.id, False, reason))
        provider.peer.emit(
            {"op": "call_service", "id": call.id, "service": provider.name, "args": args}
        )
        if self._providers.get(provider.name) is not provider:  # it left a moment ago
            self._end(call.id, False, f"{provider.peer.identity} no longer offers it")

    def answer(self, peer: Peer, message: JsonObject) -> None:
        """Accept a provider's answer; one that comes too late is dropped.

        Raises
        ------
        ForbiddenError
            The call was sent to another session.
        UsageError
            It holds a number that is none in JSON; the call has failed.
        """
        with self._lock:
            call = self._calls.get(_key(message))
        if call is None:
            return
        if call.provider.peer.number != peer.number:
            raise ForbiddenError(f"service_response: {call.id} was sent to another robot")
        result, values = outcome_of(message)
        if not is_writable(values):
            reason = f"{peer.identity} answered with a number that is none in JSON"
            self._end(call.id, False, reason)
        refuse_unwritable(values, "values")
        self._end(call.id, result, values)

    def leave(self, peer: Peer) -> None:
        """Forget a session, its services, and fail the calls that wait for it."""
        with self._lock:
            for name in [n for n, provider in self._providers.items() if provider.peer is peer]:
                del self._providers[name]
            waiting = [c.id for c in self._calls.values() if c.provider.peer is peer]
            for call in [c for c in self._calls.values() if c.caller == peer.number]:
                self._calls.pop(call.id)
                if call.deadline:
                    call.deadline.cancel()
        for id_ in waiting:
            self._end(id_, False, f"{peer.identity} left before it answered")

    def _end(self, id_: str, result: bool, values: Any) -> None:
        with self._lock:
            call = self._calls.pop(id_, None)
        if call is None:
            return
        if call.deadline is not None:
            call.deadline.cancel()
        call.done(result, values)


def timeout_of(message: JsonObject, default_s: float = DEFAULT_S) -> float:
    """Return the time in s that a caller is willing to wait.

    Examples
    --------
    >>> timeout_of({"timeout": 5}), timeout_of({"timeout": 0}), timeout_of({"timeout": 1e9})
    (5.0, 30.0, 600.0)
    """
    timeout = message.get("timeout")
    if isinstance(timeout, bool) or not isinstance(timeout, int | float) or not timeout > 0:
        return default_s
    return float(min(timeout, MAX_TIMEOUT_S))


def outcome_of(message: JsonObject) -> tuple[bool, Any]:
    """Return the result and values of a provider's answer.

    A handler of roslibpy that returns False sends its response as values, which may say why. If a
    handler returns nothing, roslibpy sends `null` as result, and roslib neither result nor
    values: both are failures.

    Examples
    --------
    >>> outcome_of({"values": {"sum": 3}})
    (True, {'sum': 3})
    >>> outcome_of({"result": None, "values": None})
    (False, 'the provider refused')
    >>> outcome_of({"result": False, "values": {"message": "the arm is busy"}})
    (False, 'the provider refused: {"message": "the arm is busy"}')
    """
    values = message.get("values")
    result = bool(message["result"]) if "result" in message else "values" in message
    if result:
        return True, values if isinstance(values, dict) else {}
    if isinstance(values, str) and values:
        return False, values
    reason = f": {json.dumps(values, ensure_ascii=False)[:_MAX_REASON]}" if values else ""
    return False, f"the provider refused{reason}"


def _key(message: JsonObject) -> str:
    id_ = message.get("id")
    return id_ if isinstance(id_, str) else ""
