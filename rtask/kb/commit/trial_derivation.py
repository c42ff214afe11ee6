"""Derivations that may be long, tried in a forked copy of this process while others write.

What follows from a commit is derived under the writers' lock. A commit that will be refused needs
no lock to find that out: if a first look, bounded to less than .1 s, does not suffice, the
lock is released and the derivation tried in a child. The child has the closure of the last commit
(copy on write) and the whole budget; its memory goes with it. If the change fits, it is made again
under the lock; if not, it is refused as if it had been sent when the child began.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import pickle
import select
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

from rtask.errors import BusyError, RtaskError
from rtask.kb.commit.budget import Guard, ReasoningLimits
from rtask.kb.commit.inference import Inference, too_much_follows
from rtask.rdf.terms import TripleKey

__all__ = ["CAN_FORK", "MAX_TRIED", "LongDerivationError", "TrialDerivations"]

CAN_FORK = sys.platform == "linux"
"""Elsewhere a fork of a process with threads is not safe, and all is derived under the lock."""

MAX_TRIED = 20_000
"""Larger changes take long to store as well, so that a trial would double their time for little."""

_AT_ONCE = 2
_LOOK_S = 0.02
_GRACE_S = 0.3
_NICE = 5
_RETRY_S = 10


class LongDerivationError(Exception):
    """A first look did not show whether more follows from a change than may.

    The change is to be tried by :meth:`TrialDerivations.settle`, and made again if it fits.

    Parameters
    ----------
    gained, lost
        Asserted triples that come and go.
    rules
        All rules from now on, as the reasoner takes them; ``None`` if they stay.
    statements
        Number of statements in the change.
    limits
        Bounds on what may follow.
    cause_ms
        How long to look for the causes of a contradiction, in ms; ``None`` if contradictory
        statements are set aside, which only the commit itself can do.
    """

    def __init__(
        self,
        gained: Sequence[TripleKey],
        lost: Sequence[TripleKey],
        rules: Sequence[Any] | None,
        statements: int,
        limits: ReasoningLimits,
        cause_ms: float | None,
    ) -> None:
        super().__init__("it is not known whether too much follows from the change")
        self.gained = gained
        self.lost = lost
        self.rules = rules
        self.statements = statements
        self.limits = limits
        self.cause_ms = cause_ms


@dataclass(frozen=True)
class _Outcome:
    """What a trial found; neither an error nor contradictions if the change fits."""

    error: type[RtaskError] | None = None
    message: str = ""
    details: dict[str, Any] = field(default_factory=dict)
    contradictions: tuple[Any, ...] = ()
    causes: tuple[Any, ...] = ()

    @classmethod
    def of(cls, error: RtaskError) -> _Outcome:
        return cls(type(error), str(error), error.details)


class TrialDerivations:
    """Tries derivations in children of this process, a few at once.

    Parameters
    ----------
    lock
        Returns a context in which nobody writes.
    stop
        Set to end all trials.
    """

    def __init__(
        self,
        inference: Inference,
        lock: Callable[[], AbstractContextManager[object]],
        stop: threading.Event,
    ) -> None:
        self._inference = inference
        self._lock = lock
        self._stop = stop
        self._slots = threading.BoundedSemaphore(_AT_ONCE)

    def settle(self, change: LongDerivationError) -> None:
        """Return if a change fits within its limits; otherwise raise what its commit would.

        Raises
        ------
        TooMuchFollowsError, InconsistentError
            As the commit would.
        BusyError
            It was not found out within the time, or the server stops.
        """
        seconds = change.limits.seconds
        until = None if seconds is None else time.monotonic() + seconds + _GRACE_S
        with self._slot(until):
            with self._lock():
                child = self._begin(change)
            outcome = child.wait(until, self._stop)
        if outcome.error is not None:
            raise outcome.error(outcome.message, **outcome.details)
        if outcome.contradictions:
            raise self._inference.inconsistent(outcome.contradictions, outcome.causes)

    @contextlib.contextmanager
    def _slot(self, until: float | None) -> Iterator[None]:
        while not self._slots.acquire(timeout=_LOOK_S):
            if self._stop.is_set():
                raise _stopping()
            if until is not None and time.monotonic() > until:
                raise BusyError(
                    "other changes from which much follows were tried all the time; nothing was "
                    "stored; try again later",
                    retry_after_s=_RETRY_S,
                    limit="reasoning time",
                )
        try:
            yield
        finally:
            self._slots.release()

    def _begin(self, change: LongDerivationError) -> _Child:
        closure, server = self._inference.closure(), os.getpid()
        guard = Guard(change.limits, threading.Event())

        def watch() -> None:
            if os.getppid() != server:
                os._exit(0)
            guard()

        budget = replace(change.limits.budget(change.statements, guard), watch=watch)
        return _Child(lambda: _tried(closure, change, budget))


def _tried(closure: Any, change: LongDerivationError, budget: Any) -> _Outcome:
    """Derive what follows from a change; in the child, which has no store."""
    from reasoner import ClosureTooLargeError

    try:
        staged = closure.stage(
            add=change.gained, remove=change.lost, rules=change.rules, budget=budget
        )
    except ClosureTooLargeError as error:
        return _Outcome.of(too_much_follows(error))
    except BusyError as error:
        return _Outcome.of(error)
    except (RtaskError, RuntimeError, ValueError):
        return _Outcome()  # the commit itself says so better, with what the store holds
    if change.cause_ms is None or not staged.contradictions:
        return _Outcome()
    causes = staged.causes(budget_ms=change.cause_ms)
    return _Outcome(contradictions=tuple(staged.contradictions), causes=tuple(causes))


class _Child:
    """A forked copy of this process that computes an outcome and ends."""

    def __init__(self, work: Callable[[], _Outcome]) -> None:
        self._outcome, outcome = os.pipe()
        with warnings.catch_warnings():
            # Python 3.12 warns that other threads may hold locks. The child takes none of theirs:
            # it reads the closure, which is at rest, and uses neither the store nor the log.
            warnings.simplefilter("ignore", DeprecationWarning)
            self._pid = os.fork()
        if self._pid == 0:
            _run(work, outcome)
        os.close(outcome)

    def wait(self, until: float | None, stop: threading.Event) -> _Outcome:
        """Return the outcome; end the child at a time, or if asked to stop.

        Raises
        ------
        BusyError
            The child has no outcome.
        """
        data = bytearray()
        poll = select.poll()
        poll.register(self._outcome, select.POLLIN | select.POLLHUP)
        try:
            while True:
                if stop.is_set():
                    raise _stopping()
                if until is not None and time.monotonic() > until:
                    raise _unknown("within its time")
                if not poll.poll(_LOOK_S * 1e3):
                    continue
                piece = os.read(self._outcome, 1 << 16)
                if not piece:
                    break
                data += piece
        finally:
            os.close(self._outcome)
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):
                os.waitpid(self._pid, 0)
        if not data:
            raise _unknown("because the process that did so was ended")
        outcome: _Outcome = pickle.loads(data)
        return outcome


def _run(work: Callable[[], _Outcome], outcome: int) -> NoReturn:
    """Do the work of a child, write its outcome and end without any clean-up."""
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        # Connections and locks of files belong to the parent, which may end before.
        os.closerange(3, outcome)
        os.closerange(outcome + 1, os.sysconf("SC_OPEN_MAX"))
        logging.disable()
        gc.disable()
        os.nice(_NICE)
        data = memoryview(pickle.dumps(work()))
        while data:
            data = data[os.write(outcome, data) :]
    finally:
        os._exit(0)


def _stopping() -> BusyError:
    return BusyError(
        "the server is stopping; nothing was stored; send the change again later",
        retry_after_s=_RETRY_S,
    )


def _unknown(why: str) -> BusyError:
    return BusyError(
        f"what follows from the change was not derived {why}; nothing was stored; try again "
        "later, or split the change",
        retry_after_s=_RETRY_S,
        limit="reasoning time",
    )
