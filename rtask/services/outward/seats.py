"""Workers that are connected, and the calls that they carry out.

A worker has a number of seats for each service it offers; each carries out one call at a time. A
call whose worker leaves or falls silent ends at once with an error; the queue gives it to another
worker if that does no harm.
"""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from pydantic import BaseModel

from rtask.errors import (
    CancelledError,
    RtaskError,
    StartupFailedError,
    UsageError,
    WorkerDiedError,
)
from rtask.services.definition import Definition
from rtask.services.description import ros_service
from rtask.services.outward.announced import announced, contract, contract_of
from rtask.services.registry import Registry
from rtask.services.task import Task

__all__ = ["MAX_SEATS", "PREFIX", "SILENCE_S", "Link", "Outward", "Seat"]

PREFIX = "work:"
"""Beginning of the ids of calls that workers carry out."""
MAX_SEATS = 256
SILENCE_S = 30.0
_COMEBACK_S = 5.0
"""How long a call waits for a worker when the last one has left."""
_GRACE_S = 2.0


class Link(Protocol):
    """The connection of a worker."""

    @property
    def name(self) -> str:
        """Of the worker, for errors."""

    def send(self, message: Mapping[str, Any], args: BaseModel | None) -> None:
        """Queue a message, with its ``args`` if there are any, without waiting."""

    def refuse(self, words: str) -> None:
        """Tell the worker that it is not served any more."""


@dataclass(eq=False)
class _Pending:
    """A call that a worker carries out."""

    seat: Seat
    task: Task
    stirred: threading.Event = field(default_factory=threading.Event)
    """Set when it ended or was cancelled."""
    over: threading.Event = field(default_factory=threading.Event)
    reply: Mapping[str, Any] | None = None
    error: RtaskError | None = None

    def end(self, reply: Mapping[str, Any] | None, error: RtaskError | None = None) -> None:
        """Give the call its end."""
        self.reply, self.error = reply, error
        self.over.set()
        self.stirred.set()


@dataclass(eq=False)
class Seat:
    """Room for one call at a worker."""

    link: Link
    is_held: bool = False
    is_gone: bool = False
    is_late: bool = False
    """Whether a call that nobody waits for any more is still running there."""

    @property
    def is_free(self) -> bool:
        """Whether it can be given a call."""
        return not (self.is_held or self.is_gone or self.is_late)


@dataclass(eq=False)
class _Offered:
    """The seats for one version of a service, on all workers."""

    contract: str
    seats: list[Seat] = field(default_factory=list)


class Outward:
    """The workers of a host.

    Parameters
    ----------
    registry
        Receives the services that only workers have.
    on_change
        Called with the exact name of a service whose number of seats changed.
    clock
        Returns seconds; tests pass their own.
    """

    def __init__(
        self,
        registry: Registry,
        on_change: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._registry = registry
        self._on_change = on_change
        self._clock = clock
        self._changed = threading.Condition()
        self._offered: dict[str, _Offered] = {}
        self._heard: dict[Link, float] = {}
        self._pending: dict[str, _Pending] = {}
        self._numbers = itertools.count(1)
        self.dropped = 0
        """Answers that came after their calls had ended."""

    def join(self, link: Link, description: Any, seats: Any) -> Definition:
        """Add a worker for one version of a service, and return its definition.

        Parameters
        ----------
        description
            As :func:`~rtask.services.outward.announced.announced` takes it.
        seats
            How many calls it carries out at a time.

        Raises
        ------
        UsageError
            The description cannot be read, or is not that of the others under this version.
        """
        made = announced(description)
        if type(seats) is not int or not 1 <= seats <= MAX_SEATS:
            raise UsageError(f"slots: expected a whole number from 1 to {MAX_SEATS}")
        announced_contract = contract(description)
        with self._changed:
            self._withdraw(link, made.exact)
            definition = self._agreed(made, announced_contract)
            offered = self._offered.setdefault(made.exact, _Offered(announced_contract))
            offered.contract = announced_contract
            offered.seats += [Seat(link) for _ in range(seats)]
            self._heard[link] = self._clock()
            self._changed.notify_all()
        self._on_change(made.exact)
        return definition

    def _agreed(self, made: Definition, announced_contract: str) -> Definition:
        """Return the definition to serve: the server's own where it has this version."""
        own = self._registry.exact(made.exact)
        if own is None:
            self._registry.add(made)
            return made
        offered = self._offered.get(made.exact)
        is_free = own.executor == "outward" and not (offered and offered.seats)
        agreed = offered.contract if offered else contract_of(own)
        if agreed != announced_contract and not is_free:
            raise UsageError(
                f"{made.exact} is served with other requests, answers or data; give this one a "
                "new version"
            )
        if any(need.type == "graph" for need in own.resources.values()):
            raise UsageError(f"{made.exact} needs the graph, which is at the server only")
        if is_free:
            self._registry.replace(made)
            return made
        return own

    def leave(self, link: Link, exact: str | None = None) -> None:
        """Remove a worker, from one service or from all; its calls end with an error."""
        with self._changed:
            names = list(self._offered) if exact is None else [exact]
            left = [name for name in names if self._withdraw(link, name)]
            if exact is None:
                self._heard.pop(link, None)
        for name in left:
            self._on_change(name)

    def withdraw(self, link: Link, name: str) -> bool:
        """Remove a worker from one service, ``name@1.2.3``, or all its versions, ``name``.

        Returns
        -------
        Whether it offered that.
        """
        with self._changed:
            named = [
                offered_exact
                for offered_exact in self._offered
                if name in (offered_exact, offered_exact.partition("@")[0])
            ]
            seats = [seat for exact in named for seat in self._offered[exact].seats]
            was_there = any(seat.link is link for seat in seats)
        for exact in named:
            self.leave(link, exact)
        return was_there

    def _withdraw(self, link: Link, exact: str) -> bool:
        offered = self._offered.get(exact)
        gone = [entry for entry in offered.seats if entry.link is link] if offered else []
        for seat in gone:
            assert offered is not None
            offered.seats.remove(seat)
            seat.is_gone = True
        for key, entry in list(self._pending.items()):
            if entry.seat.link is link and entry.task.service == exact:
                del self._pending[key]
                entry.end(None, WorkerDiedError(f"{link.name} left before it answered"))
        return bool(gone)

    def drain(self, link: Link) -> None:
        """Give a worker no further calls; it still answers those that it has."""
        left = []
        with self._changed:
            for name, offered in self._offered.items():
                gone = [free_seat for free_seat in offered.seats if free_seat.link is link]
                for seat in gone:
                    offered.seats.remove(seat)
                    seat.is_gone = True
                left += [name] if gone else []
        for name in left:
            self._on_change(name)

    def heard(self, link: Link) -> None:
        """Note that a worker is there."""
        if link in self._heard:
            self._heard[link] = self._clock()

    def drop_silent(self) -> None:
        """Remove the workers that were not heard for :data:`SILENCE_S`."""
        now = self._clock()
        for link, since in list(self._heard.items()):
            if now - since > SILENCE_S:
                self.leave(link)
                link.refuse(f"nothing heard for {SILENCE_S:g} s; advertise the services again")

    @property
    def is_empty(self) -> bool:
        """Whether no worker is connected."""
        return not self._heard

    def count(self, exact: str) -> int:
        """Return the number of seats for a version of a service."""
        offered = self._offered.get(exact)
        return len(offered.seats) if offered else 0

    def seat(self, definition: Definition) -> Seat | None:
        """Take a free seat; none where there is none and this process can do the work itself.

        Raises
        ------
        StartupFailedError
            Only workers have the service, and none came within some seconds.
        """
        until = self._clock() + _COMEBACK_S
        with self._changed:
            while True:
                offered = self._offered.get(definition.exact)
                free = [seat for seat in offered.seats if seat.is_free] if offered else []
                if free:
                    taken = self._emptiest(free)
                    taken.is_held = True
                    return taken
                if definition.executor != "outward":
                    return None
                left_s = until - self._clock()
                if left_s <= 0:
                    raise StartupFailedError("no worker that offers it is connected and free")
                self._changed.wait(left_s)

    def _emptiest(self, free: Iterable[Seat]) -> Seat:
        """Return a seat of the worker with the most free ones, so that machines share the work."""
        seats = list(free)
        return max(seats, key=lambda seat: sum(other.link is seat.link for other in seats))

    def release(self, seat: Seat) -> None:
        """Give a seat back."""
        with self._changed:
            seat.is_held = False
            self._changed.notify_all()

    def ask(self, seat: Seat, task: Task) -> Mapping[str, Any]:
        """Have a worker carry out a call and return its reply.

        Raises
        ------
        WorkerDiedError
            It left, or fell silent.
        DeadlineError, CancelledError
            Nobody waits for the answer any more; the worker was told.
        """
        call = task.call
        with self._changed:
            if seat.is_gone:
                raise WorkerDiedError(f"{seat.link.name} has left", was_sent=False)
            key = f"{PREFIX}{next(self._numbers)}"
            pending = self._pending[key] = _Pending(seat, task)
        service = ros_service(task.service.partition("@")[0], task.method.name)
        message = {
            "op": "call_service", "id": key, "service": service, "exact": task.service,
            "timeout": max(call.left_s, 0.0),
            "caller": {"agent": call.caller.agent, "role": call.caller.role},
            "data": {name: dataset for name, dataset, _ in task.data},
        }  # fmt: skip

        def cancel() -> None:
            if not pending.over.is_set():
                seat.link.send({"op": "cancel_action_goal", "id": key, "action": service}, None)
                pending.stirred.set()

        seat.link.send(message, task.request)
        call.on_cancel(cancel)
        if not pending.stirred.wait(max(call.left_s, 0.0)):
            call.expire()
        pending.over.wait(_GRACE_S)
        return self._reply(key, pending)

    def _reply(self, key: str, pending: _Pending) -> Mapping[str, Any]:
        with self._changed:
            if pending.error is not None:
                raise pending.error
            if pending.reply is None:  # still running: its answer, when it comes, frees the seat
                pending.seat.is_late = True
            else:
                self._pending.pop(key, None)
        if pending.reply is None:
            call = pending.task.call
            raise call.late() if call.left_s <= 0 else CancelledError("the call was cancelled")
        return pending.reply

    def take(self, link: Link, message: Mapping[str, Any]) -> bool:
        """Accept an answer or a report of progress; tell whether it was one of these."""
        key = message.get("id")
        if not isinstance(key, str) or not key.startswith(PREFIX):
            return False
        self.heard(link)
        with self._changed:
            pending = self._pending.get(key)
            if pending is None or pending.seat.link is not link:
                return True  # too late
            if message.get("op") != "action_feedback":
                if pending.seat.is_late:
                    del self._pending[key]
                    pending.seat.is_late = False
                    self.dropped += 1
                    self._changed.notify_all()
                pending.end(message)
                return True
        given = message.get("values")
        if isinstance(given, dict):
            fraction, text = given.get("progress", 0.0), given.get("message", "")
            if isinstance(fraction, int | float) and math.isfinite(fraction):
                pending.task.call.report(fraction, str(text)[:500])
        return True
