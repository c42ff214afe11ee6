"""Calls of agents under way: their progress, and how another message cancels them."""

from __future__ import annotations

import threading
import weakref
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from endpoint.http.messages import Request
from endpoint.http.plan import Progress

__all__ = ["SESSION", "AgentCall", "AgentCalls", "program_of"]

SESSION = "Mcp-Session-Id"


def program_of(caller: str, request: Request) -> str:
    """Return a key of the program that sends a request.

    Nothing is kept of a session: its id, which ``initialize`` hands out, only tells the programs
    apart that use one token, as each numbers its requests by itself.
    """
    session = request.header(SESSION.lower())
    return f"{caller} {session}" if session else caller


class AgentCall:
    """One call of a tool.

    Parameters
    ----------
    request_id
        Id of the request.
    token
        Progress token of the request; None where no progress is asked for.
    """

    def __init__(self, request_id: object = None, token: str | int | None = None) -> None:
        self.progress = None if token is None else Progress(request_id)
        self._token = token
        self._lock = threading.Lock()
        self._stops: list[Callable[[], object]] = []
        self._is_stopped = False

    @property
    def is_stopped(self) -> bool:
        """Whether its caller gave it up."""
        return self._is_stopped

    def on_stop(self, stop: Callable[[], object]) -> None:
        """Register how to stop the work; called at once if the call has been given up."""
        with self._lock:
            self._stops.append(stop)
            is_late = self._is_stopped
        if is_late:
            stop()

    def stop(self) -> None:
        """Give the call up."""
        with self._lock:
            self._is_stopped = True
            stops = list(self._stops)
        for stop in stops:
            stop()

    def report(self, share: float, words: str) -> None:
        """Say how much is done, 0..1; words of services and fixed ones only."""
        if self.progress is None:
            return
        params: dict[str, Any] = {"progressToken": self._token, "progress": share, "total": 1.0}
        if words:
            params["message"] = words
        self.progress.add({"jsonrpc": "2.0", "method": "notifications/progress", "params": params})


class AgentCalls:
    """The calls under way, by :func:`program_of` and id of the request.

    An id that two programs without a session use is not cancelled, for it is not known whose call
    is meant.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()  # a call may be collected while it is held
        self._calls: dict[tuple[str, str], list[weakref.ref[AgentCall]]] = defaultdict(list)

    def add(self, caller: str, request_id: object, call: AgentCall) -> Callable[[], None]:
        """Keep a call among those that can be cancelled; return what ends this.

        It ends by itself once nothing refers to the call: one that waits for its turn can be
        cancelled, and leaves nothing behind if its turn never comes.
        """
        key = (caller, repr(request_id))

        def remove() -> None:
            with self._lock:
                calls = self._calls.get(key, [])
                if kept in calls:
                    calls.remove(kept)
                if not calls:
                    self._calls.pop(key, None)

        kept = weakref.ref(call, lambda _: remove())
        with self._lock:
            self._calls[key].append(kept)
        return remove

    def has(self, caller: str, request_id: object) -> bool:
        """Return whether a call of a caller with this id is under way here."""
        with self._lock:
            return (caller, repr(request_id)) in self._calls

    def cancel(self, caller: str, request_id: object) -> None:
        """Give up the call of a caller that a notification names, if it is known which one."""
        with self._lock:
            kept = tuple(self._calls.get((caller, repr(request_id)), ()))
            calls = [call for call in (each() for each in kept) if call is not None]
        if len(calls) == 1:
            calls[0].stop()
