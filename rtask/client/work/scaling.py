"""More workers while calls wait, and fewer when there is little to do (Kehoe 2014, 5.6)."""

from __future__ import annotations

import ctypes
import logging
import math
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rtask.client.http import HttpClient
from rtask.errors import RtaskError

__all__ = ["Scaling", "wanted"]

_log = logging.getLogger(__name__)
_LOOK_S = 1.0
_START_S = 5.0
"""Time that a worker is given to connect before another one is started."""
_PR_SET_PDEATHSIG = 1


def wanted(calls: Mapping[str, Mapping[str, int]], slots: Mapping[str, int]) -> int:
    """Return how many workers the calls of some services would keep busy; calls share no slots.

    Parameters
    ----------
    calls
        ``waiting`` and ``running`` by service.
    slots
        Calls of each service that a worker carries out at a time.

    Examples
    --------
    >>> wanted({"farm/Field@1": {"waiting": 3, "running": 2}}, {"farm/Field@1": 2})
    3
    >>> wanted({"farm/Field@1": {"waiting": 0, "running": 0}}, {"farm/Field@1": 2})
    0
    """
    return max(
        (math.ceil((own["waiting"] + own["running"]) / slots[name]) for name, own in calls.items()),
        default=0,
    )


class Scaling:
    """Starts further workers of some services by load, and ends them.

    One is started while calls wait, every five seconds at most, so that it can take some before the
    next one is. The last one is ended by SIGTERM, after which it finishes the calls that it has,
    when fewer would have done for ``idle_s``.

    Parameters
    ----------
    server, token
        As of the workers.
    slots
        Calls at a time of each service, by its exact name, of one worker.
    command
        Starts another worker. It ends with this process, where the system is Linux.
    most
        Workers in all, with the one that is there.
    idle_s
        How long fewer must be enough before one is ended.
    on_change
        Told how many workers there are, and why.
    """

    def __init__(
        self,
        server: str,
        token: str | None,
        slots: Mapping[str, int],
        command: Sequence[str],
        most: int,
        idle_s: float = 60.0,
        on_change: Callable[[int, str], None] = lambda workers, words: None,
    ) -> None:
        self._http = _Described(server, token)
        self._slots = dict(slots)
        self._command = list(command)
        self._most = most
        self._idle_s = idle_s
        self._on_change = on_change
        self._others: list[subprocess.Popen[bytes]] = []
        self._stopping = threading.Event()
        self._last_start_s = -math.inf
        self._needed_s = 0.0
        """When as many workers as there are were last needed"""

    def run(self) -> None:
        """Look once a second until :meth:`stop`, then end the workers that were started."""
        self._needed_s = time.monotonic()
        try:
            while not self._stopping.wait(_LOOK_S):
                try:
                    self._look(self._http.calls(self._slots), time.monotonic())
                except RtaskError as error:  # the server is away; its workers come back as well
                    _log.info("the load is not known: %s", error)
        finally:
            for other in self._others:
                other.terminate()
            for other in self._others:
                other.wait()
            self._http.close()

    def stop(self) -> None:
        """End; may be called from any thread, or by a signal."""
        self._stopping.set()

    def _look(self, calls: Mapping[str, Mapping[str, int]], now_s: float) -> None:
        """Start or end at most one worker."""
        self._reap()
        workers, busy = 1 + len(self._others), wanted(calls, self._slots)
        if busy >= workers:
            self._needed_s = now_s
        waiting = sum(own["waiting"] for own in calls.values())
        if waiting and workers < self._most and now_s - self._last_start_s >= _START_S:
            self._last_start_s = self._needed_s = now_s
            self._others.append(_started(self._command))
            self._on_change(workers + 1, f"{waiting} calls wait")
        elif self._others and now_s - self._needed_s >= self._idle_s:
            self._needed_s = now_s
            last = self._others.pop()
            last.terminate()
            threading.Thread(target=last.wait, daemon=True).start()  # it finishes its calls first
            self._on_change(workers - 1, f"fewer were enough for {self._idle_s:g} s")

    def _reap(self) -> None:
        """Forget the workers that have ended by themselves."""
        ended = [other for other in self._others if other.poll() is not None]
        self._others = [other for other in self._others if other.returncode is None]
        for other in ended:
            self._on_change(1 + len(self._others), f"one ended with {other.returncode}")


class _Described(HttpClient):
    """What a server says of its services."""

    def calls(self, services: Mapping[str, Any]) -> dict[str, dict[str, int]]:
        """Return the calls that wait and run, by exact name of the service."""
        return {name: self._send("GET", f"/services/{name}").json()["calls"] for name in services}


def _started(command: list[str]) -> subprocess.Popen[bytes]:
    """Start a worker whose output is ours, and which the kernel ends with us (Linux)."""
    at_birth = None
    if sys.platform == "linux":
        at_birth = partial(ctypes.CDLL(None).prctl, _PR_SET_PDEATHSIG, signal.SIGTERM)
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=at_birth)
