"""A client that asks its own slice of the graph and the server at once (Kehoe 2014, 6.2)."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from rtask.client.base import Client
from rtask.client.following import FollowedChange
from rtask.client.local import LocalClient
from rtask.client.race import Contender, Raced, race
from rtask.client.remote import RemoteClient
from rtask.errors import BusyError, CallFailedError, RtaskError, UnknownTermError, UsageError

__all__ = ["RacingClient"]

T = TypeVar("T")
MAX_HANGING = 8


class RacingClient(Client):
    """Races each read between a slice of the graph here and the server.

    The server's answer counts if it comes within ``patience_s``, afterwards the first one does.
    That the slice holds nothing is no answer, because the server may know more: it counts at
    ``deadline_s``. What the robot tells, updates, services and following go to the server only;
    with an outbox, what is told waits for it. A read that both refuse is refused with the server's
    words.

    Parameters
    ----------
    url, token, timeout_s, outbox
        Of the server, see :class:`rtask.client.remote.RemoteClient`.
    near
        The slice.
    patience_s, deadline_s
        See :func:`rtask.client.race.race`.

    Attributes
    ----------
    last
        The latest answer that was raced, by whichever thread, with who gave it; None before.
    """

    def __init__(
        self,
        url: str,
        near: LocalClient,
        token: str | None = None,
        timeout_s: float = 30.0,
        outbox: Path | str | None = None,
        *,
        patience_s: float = 0.05,
        deadline_s: float = 1.0,
    ) -> None:
        super().__init__(outbox)
        if not 0 <= patience_s <= deadline_s:
            raise UsageError(f"patience_s={patience_s} must be from 0 to deadline_s={deadline_s}")
        self._near = near
        self._far = RemoteClient(url, token, timeout_s)
        self._patience_s, self._deadline_s = patience_s, deadline_s
        # A call that lost its race may hang until its time is up, and a connection makes one call
        # at a time; so each race has a connection of its own, which is used again once it is free.
        self._address = url, token, max(deadline_s, 0.001)
        self._idle: list[RemoteClient] = []
        self._out = 0
        self._lock = threading.Lock()
        self._is_closed = False
        self.last: Raced[Any] | None = None

    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        declared = self._near.engine.operations.get(operation)
        if declared is None or declared.effect == "writes":
            return self._far._call(operation, args, timeout_s)
        return self._raced(lambda client: client._call(operation, args), _is_nothing)

    def _deliver_waiting(self, timeout_s: float | None = None) -> None:
        """Send nothing after a read: the near side may have answered, with the link still cut."""

    def query(self, sparql: str) -> list[dict[str, Any]]:
        """Return the rows of a SELECT; see :meth:`Client.query`."""
        return self._raced(lambda client: client.query(sparql), lambda rows: not rows)

    def ask(self, sparql: str) -> bool:
        """Return the answer of an ASK."""
        return self._raced(lambda client: client.ask(sparql), lambda answer: not answer)

    def update(self, sparql: str) -> None:
        """Carry out a SPARQL update on the server."""
        self._far.update(sparql)

    def follow(
        self,
        s: str | None = None,
        p: str | None = None,
        o: str | None = None,
        graph: str | None = None,
        *,
        cls: str | None = None,
        inferred: bool = True,
        since: str | None = None,
    ) -> Iterator[FollowedChange]:
        """Yield commits of the server as they come; see :meth:`Client.follow`."""
        return self._far.follow(s, p, o, graph, cls=cls, inferred=inferred, since=since)

    def services(self) -> list[dict[str, Any]]:
        """Return the services of the server; see :meth:`Client.services`."""
        return self._far.services()

    def describe_service(self, name: str) -> dict[str, Any]:
        """Return the description of a service; see :meth:`Client.describe_service`."""
        return self._far.describe_service(name)

    def call_service(
        self,
        name: str,
        method: str,
        args: Mapping[str, Any] | None = None,
        data: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
        may_repeat: bool = False,
    ) -> dict[str, Any]:
        """Call a method of a service of the server; see :meth:`Client.call_service`."""
        return self._far.call_service(name, method, args, data, timeout_s, may_repeat)

    def _raced(self, ask: Callable[[Client], T], is_nothing: Callable[[T], bool]) -> T:
        def near(contender: Contender[T]) -> T:
            answer = ask(self._near)
            if is_nothing(answer):
                contender.offer(answer)
                raise UnknownTermError("the slice of the graph here holds nothing of it")
            return answer

        def far(contender: Contender[T]) -> T:
            with self._connection() as client:
                return ask(client)

        try:
            outcome = race(near, far, patience_s=self._patience_s, deadline_s=self._deadline_s)
        except RtaskError as error:
            if isinstance(error.__cause__, CallFailedError):
                raise error.__cause__ from None
            raise
        self.last = outcome
        return outcome.value

    @contextmanager
    def _connection(self) -> Iterator[RemoteClient]:
        """Yield a connection that nobody else uses.

        Raises
        ------
        BusyError
            So many calls hang that another would, too.
        """
        with self._lock:
            if self._out >= MAX_HANGING:
                raise BusyError(f"{self._out} calls wait for {self._far.url} already")
            self._out += 1
            client = self._idle.pop() if self._idle else RemoteClient(*self._address)
        try:
            yield client
        finally:
            with self._lock:
                self._out -= 1
                is_reusable = not self._is_closed
                if is_reusable:
                    self._idle.append(client)
            if not is_reusable:
                client.close()

    def close(self) -> None:
        """End the connections, and the engine if it was made for this client."""
        with self._lock:
            self._is_closed = True
            idle, self._idle = self._idle, []
        for client in (*idle, self._far, self._near):
            client.close()


def _is_nothing(answer: Mapping[str, Any]) -> bool:
    """Tell whether an answer lists things and has none."""
    lists = [value for value in answer.values() if isinstance(value, list)]
    return bool(lists) and not any(lists)
