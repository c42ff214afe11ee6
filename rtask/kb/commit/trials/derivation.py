"""Derivations that may be long, made in a forked copy of this process while others write.

What follows from a commit is derived under the writers' lock. If a first look, bounded to less than
.1 s, does not suffice, the lock is released and a copy of this process has the whole budget; its
memory goes with it::

    writer                              copy                     other writers
    first look, released  -- fork -->   derives                  commit
    waits                 <- outcome -  refused: raised
    sends their commits   ------------> takes them as well
    takes the lock        <- report --  all that has changed     wait
    the last commits      ------------>
    stores the change, adopts           (ended)                  commit

A change that is refused is refused as if it had been sent when the copy was made. What the copy
derived is adopted only if the asserted statements that come and go are the very ones that it knows
of; otherwise the change is tried once more, and then derived under the lock.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any

from rtask.errors import BusyError, RtaskError
from rtask.kb.commit.budget import Guard, ReasoningLimits, stopping
from rtask.kb.commit.foreign.supports import Support
from rtask.kb.commit.inference import Inference, Staged, too_much_follows
from rtask.kb.commit.trials.process import (
    CAN_FORK,
    EndedError,
    LateError,
    Receive,
    Send,
    StoppedError,
    TrialProcess,
)
from rtask.kb.store.overlay import Holders
from rtask.rdf.terms import TripleKey

__all__ = [
    "CAN_FORK", "MAX_TRIED", "ContradictedTrialError", "LongDerivationError", "Trial",
    "TrialDerivations",
]  # fmt: skip

MAX_TRIED = 20_000
"""Larger changes take long to store as well, so that a trial would double their time for little."""

_AT_ONCE = 2
_LOOK_S = 0.02
_GRACE_S = 0.3
_RETRY_S = 10
_ROUNDS = 4
"""How often the copy is sent what others commit before the lock is taken."""
_CATCH_UP_S = 5.0
_LOCKED_S = 0.5
"""For so long others wait at most for what the copy does about the last commits."""


class LongDerivationError(Exception):
    """A first look did not show whether more follows from a change than may.

    It is to be tried by :meth:`TrialDerivations.tried`, and made again with what follows.

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
    holders
        What has been looked up of the change.
    supports
        What statements of others have been set aside for.
    """

    def __init__(
        self,
        gained: Sequence[TripleKey],
        lost: Sequence[TripleKey],
        rules: Sequence[Any] | None,
        statements: int,
        limits: ReasoningLimits,
        cause_ms: float | None,
        holders: Holders,
        supports: Sequence[Support] = (),
    ) -> None:
        super().__init__("it is not known whether too much follows from the change")
        self.gained = gained
        self.lost = lost
        self.rules = rules
        self.statements = statements
        self.limits = limits
        self.cause_ms = cause_ms
        self.holders = holders
        self.supports = tuple(supports)


class ContradictedTrialError(Exception):
    """A trial found contradictions.

    Parameters
    ----------
    contradictions, causes
        :class:`reasoner.Contradiction` and :class:`reasoner.Cause`.
    supports
        What statements have been set aside for before.
    """

    def __init__(
        self, contradictions: Sequence[Any], causes: Sequence[Any], supports: tuple[Support, ...]
    ) -> None:
        super().__init__("the change contradicts what is stored")
        self.contradictions = contradictions
        self.causes = causes
        self.supports = supports


@dataclass(frozen=True)
class _Outcome:
    """What a trial found; neither an error nor contradictions if the change fits."""

    error: type[RtaskError] | None = None
    message: str = ""
    details: dict[str, Any] = field(default_factory=dict)
    contradictions: tuple[Any, ...] = ()
    causes: tuple[Any, ...] = ()
    is_derived: bool = False
    """Whether the copy has what follows; otherwise the commit finds that out, or refuses itself."""

    @classmethod
    def of(cls, error: RtaskError) -> _Outcome:
        return cls(type(error), str(error), error.details)


class TrialDerivations:
    """Tries derivations in copies of this process, a few at once.

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
        self._authors: Counter[str | None] = Counter()
        self._choosing = threading.Lock()

    @contextlib.contextmanager
    def tried(self, change: LongDerivationError, who: str | None = None) -> Iterator[Trial]:
        """Derive what follows from a change, for the commit to adopt; needs no lock.

        Parameters
        ----------
        who
            The author, who leaves a place to others; ``None`` for callers without a name.

        Raises
        ------
        TooMuchFollowsError, ContradictedTrialError
            Where the commit would be refused.
        BusyError
            It was not found out within the time, or the server stops.
        """
        seconds = change.limits.seconds
        until = None if seconds is None else time.monotonic() + seconds + _GRACE_S
        with self._slot(until, who):
            with self._lock():
                trial = Trial(self._inference, self._lock, change, self._stop)
            try:
                self._raise_refusal(trial.outcome(until), change)
                trial.catch_up()
                yield trial
            finally:
                trial.end()

    @staticmethod
    def _raise_refusal(outcome: _Outcome, change: LongDerivationError) -> None:
        if outcome.error is not None:
            raise outcome.error(outcome.message, **outcome.details)
        if outcome.contradictions:
            raise ContradictedTrialError(outcome.contradictions, outcome.causes, change.supports)

    @contextlib.contextmanager
    def _slot(self, until: float | None, who: str | None) -> Iterator[None]:
        while not self._take(who):
            time.sleep(_LOOK_S)
            if self._stop.is_set():
                raise stopping()
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
            with self._choosing:
                self._authors -= Counter([who])  # which leaves out who has none

    def _take(self, who: str | None) -> bool:
        """Take a place if there is one for an author; tell whether it was taken."""
        most = _AT_ONCE if who is None else _AT_ONCE - 1
        with self._choosing:
            if self._authors[who] >= most or self._authors.total() >= _AT_ONCE:
                return False
            self._authors[who] += 1
            return True


class Trial:
    """A change that is derived in a copy of this process; made while nobody writes.

    Attributes
    ----------
    is_of_use : bool
        Whether the copy has, or may have, what follows from the change and from all that others
        committed since it was made.
    holders : Holders
        What has been looked up of the change, kept true from commit to commit.
    """

    def __init__(
        self,
        inference: Inference,
        lock: Callable[[], AbstractContextManager[object]],
        change: LongDerivationError,
        stop: threading.Event,
    ) -> None:
        self._inference = inference
        self._lock = lock
        self._change = change
        self._closure = closure = inference.closure()
        self._handover = handover = closure.hand_over()
        self.is_of_use = True
        self.holders = change.holders

        def work(receive: Receive, send: Send) -> None:
            closure.end_handover(handover)
            _serve(closure, change, receive, send)

        try:
            self._process = TrialProcess(work, stop)
        except BaseException:
            closure.end_handover(handover)
            raise
        self.holders.follow()

    def outcome(self, until: float | None) -> _Outcome:
        """Wait for what the copy finds.

        Raises
        ------
        BusyError
            It does not find it out.
        """
        try:
            outcome: _Outcome = self._process.receive(until)
        except StoppedError:
            raise stopping() from None
        except LateError:
            raise _unknown("within its time") from None
        except EndedError:
            raise _unknown("because the process that did so was ended") from None
        self.is_of_use = outcome.is_derived
        return outcome

    def catch_up(self) -> None:
        """Let the copy take what others committed, before the lock is taken."""
        until = time.monotonic() + _CATCH_UP_S
        for _ in range(_ROUNDS):
            report = self._report(until)
            if report is None:
                return
            with self._lock():
                self._handover.encode(report)
            self._handover.receive(report)
            if not self._handover.has_steps:
                break
        self.holders.find_meanwhile(list(self._handover.leaving()), self._lock)

    def adopt(
        self,
        gained: Sequence[TripleKey],
        lost: Sequence[TripleKey],
        rules: Sequence[Any] | None,
    ) -> Staged | None:
        """Return what the copy derived from a change, under the lock; ``None`` if it is no use."""
        if not self.is_of_use or self._inference.closure() is not self._closure:
            return None
        if rules is not None and rules != self._change.rules:
            return None
        if self._handover.has_steps:
            report = self._report(time.monotonic() + _LOCKED_S)
            if report is None:
                return None
            self._handover.encode(report)
            self._handover.receive(report)
        allowed = self._change.limits.derived_from(self._change.statements)
        staged: Staged | None = self._closure.adopt(self._handover, gained, lost, rules, allowed)
        return staged

    def _report(self, until: float) -> Any:
        """Return all that has changed in the copy; ``None`` if it is of no use any more."""
        if not self.is_of_use:
            return None
        steps = self._handover.take_steps()
        report = None
        if not self._handover.is_broken:
            with contextlib.suppress(EndedError, LateError, StoppedError):
                report = self._process.ask(steps, until)
        self.is_of_use = report is not None
        return report

    def end(self) -> None:
        """End the copy."""
        self.holders.unfollow()
        self._closure.end_handover(self._handover)
        self._process.end()


def _serve(closure: Any, change: LongDerivationError, receive: Receive, send: Send) -> None:
    """Derive what follows from a change, and then from each that others make; in the copy."""
    from reasoner import Follower

    server, guard = os.getppid(), Guard(change.limits, threading.Event())

    def watch() -> None:
        if os.getppid() != server:
            os._exit(0)
        guard()

    follower = Follower(closure, watch)
    budget = replace(change.limits.budget(change.statements, guard), watch=watch)
    outcome, staged = _tried(closure, change, budget)
    if staged is not None:
        follower.apply(staged)
    send(outcome)
    while staged is not None:
        send(_followed(follower, receive()))


def _followed(follower: Any, steps: Sequence[Any]) -> Any:
    """Return a report after further changes; ``None`` if they do not go together."""
    from reasoner import ClosureTooLargeError, RuleError, StratificationError

    try:
        return follower.report() if all(map(follower.take, steps)) else None
    except (ClosureTooLargeError, RuleError, StratificationError, BusyError):
        return None


def _tried(closure: Any, change: LongDerivationError, budget: Any) -> tuple[_Outcome, Any]:
    """Derive what follows from a change; in the copy, which has no store."""
    from reasoner import ClosureTooLargeError

    try:
        staged = closure.stage(
            add=change.gained, remove=change.lost, rules=change.rules, budget=budget
        )
    except ClosureTooLargeError as error:
        return _Outcome.of(too_much_follows(error)), None
    except BusyError as error:
        return _Outcome.of(error), None
    except (RtaskError, RuntimeError, ValueError):
        return _Outcome(), None  # the commit itself says so better, with what the store holds
    if not staged.contradictions:
        return _Outcome(is_derived=True), staged
    if change.cause_ms is None:
        return _Outcome(), None
    causes = staged.causes(budget_ms=change.cause_ms)
    outcome = _Outcome(contradictions=tuple(staged.contradictions), causes=tuple(causes))
    return outcome, None


def _unknown(why: str) -> BusyError:
    return BusyError(
        f"what follows from the change was not derived {why}; nothing was stored; try again "
        "later, or split the change",
        retry_after_s=_RETRY_S,
        limit="reasoning time",
    )
