"""One call of a service, as its method sees it: who asks, until when, and whether still."""

from __future__ import annotations

import itertools
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from rtask.errors import CancelledError, DeadlineError, RtaskError, UnsupportedError
from rtask.kb.commit.access import Access
from rtask.wire.effect import Effect

__all__ = ["Call", "Ending", "Invocation"]

_RUN = secrets.token_hex(4)
_numbers = itertools.count(1)

Listener = Callable[[float, str], None]


class Others(Protocol):
    """The part of a host that calls use to reach other services."""

    def connect_within(self, parent: Call, name: str, data: dict[str, str] | None) -> Any:
        """Return a proxy of a service, whose calls are made within another call."""

    def submit(self, asked: Invocation) -> Any:
        """Queue a call."""

    def find(self, service: str, method: str) -> tuple[Any, Any]:
        """Return the definitions of a service and of one of its methods."""

    def check_data(
        self, service: str, data: Mapping[str, str], access: Access, form: str = "data="
    ) -> None:
        """Refuse a call whose data resources are missing."""


class Ending:
    """The end of a call, settled once: what comes after it, or beside it, changes nothing.

    A call that is being stored cannot be ended by others until that has succeeded or failed, so
    that what its caller learns is what was stored.

    Attributes
    ----------
    done
        Receives the answer or the error, in the thread that settles the end.

    Examples
    --------
    >>> ending = Ending()
    >>> ending.fail(CancelledError("the call was cancelled"))
    True
    >>> ending.succeed("an answer", store=lambda: print("stored"))
    False
    >>> type(ending.done.exception()).__name__
    'CancelledError'
    """

    def __init__(self) -> None:
        self.done: Future[Any] = Future()
        self.done.set_running_or_notify_cancel()  # a future cannot be cancelled from outside then
        self._lock = threading.Lock()
        self._is_over = False
        self._is_storing = False
        self._postponed: RtaskError | None = None
        self._commits: list[int] = []

    @property
    def is_over(self) -> bool:
        """Whether the end is settled."""
        return self._is_over

    @property
    def has_written(self) -> bool:
        """Whether the call has committed to the graph."""
        return bool(self._commits)

    def fail(self, error: Exception, *, is_own: bool = False) -> bool:
        """End the call with an error, and return whether this is its end.

        Parameters
        ----------
        is_own
            Whether it comes from what carries out the call. Others wait while the call writes:
            their error counts afterwards, unless the call is answered.
        """
        with self._lock:
            if self._is_over:
                return False
            if self._is_storing and not is_own:
                self._postponed = error if isinstance(error, RtaskError) else None
                return False
            self._is_over = True
        self.done.set_exception(self._with_commits(error))
        return True

    def succeed(self, answer: Any, store: Callable[[], None] | None = None) -> bool:
        """Store what the call wrote, end it with its answer, and return whether this is its end.

        Parameters
        ----------
        store
            Called only if the call has not ended; an error of its own ends the call.
        """
        with self._lock:
            if self._is_over:
                return False
            self._is_storing = True
        try:
            if store is not None:
                store()
        except BaseException as error:  # noqa: BLE001 - the caller hears of it
            self._is_over = True
            self.done.set_exception(error)
        else:
            self._is_over = True
            self.done.set_result(answer)
        return True

    @contextmanager
    def writing(self, *, is_last: bool = False) -> Iterator[list[int]]:
        """Keep the call from being ended while it commits to the graph.

        Parameters
        ----------
        is_last
            Whether the answer follows at once; it is the end then, even if the call is cancelled
            before it is there.

        Yields
        ------
        Numbers of the commits of the call, to be added to; its error names them.

        Raises
        ------
        RtaskError
            The call has ended, so nothing may be written any more.
        """
        with self._lock:
            ended = self.done.exception() if self._is_over else None
            if self._is_over:
                raise ended or CancelledError("the call has been answered")
            self._is_storing = True
        try:
            yield self._commits
        except BaseException:
            self._end_writing()
            raise
        if not is_last:
            self._end_writing()

    def _end_writing(self) -> None:
        with self._lock:
            self._is_storing = False
            postponed, self._postponed = self._postponed, None
        if postponed is not None:
            self.fail(postponed)

    def _with_commits(self, error: Exception) -> Exception:
        """Return an error that says what the call had committed to the graph before it ended."""
        if not self._commits or not isinstance(error, RtaskError):
            return error
        numbers = ", ".join(map(str, self._commits))
        words = f"{error}; before that it had written to the graph (commit {numbers})"
        return type(error)(words, **{**error.details, "commits": list(self._commits)})


class Call:
    """The call as its method sees it: a parameter annotated with this class receives it.

    Parameters
    ----------
    caller
        Rights of the caller.
    timeout_s
        From now until the answer is no longer of use.
    chain
        Services through which the call came, the first one first.
    others
        The way to other services; None = there is none.
    effect
        What the called method declares; it can call others with no stronger one.

    Attributes
    ----------
    id
        Unique on all machines.
    deadline
        When the answer is no longer of use, in s of :func:`time.monotonic`.
    fraction, text
        Progress reported last.
    ending
        Its one end.
    """

    def __init__(
        self,
        caller: Access | None = None,
        timeout_s: float = 60.0,
        chain: tuple[str, ...] = (),
        others: Others | None = None,
        effect: Effect = "writes",
    ) -> None:
        self.id = f"{_RUN}{next(_numbers):08x}"
        self.caller = caller or Access()
        self.timeout_s = timeout_s
        self.deadline = time.monotonic() + timeout_s
        self.chain = chain
        self.effect = effect
        self.fraction, self.text = 0.0, ""
        self.ending = Ending()
        self._others = others
        self._is_cancelled = False
        self._listeners: list[Listener] = []
        self._stops: list[Callable[[], object]] = []

    @property
    def left_s(self) -> float:
        """Time until the deadline, s; negative afterwards."""
        return self.deadline - time.monotonic()

    @property
    def is_cancelled(self) -> bool:
        """Whether the caller no longer wants the answer."""
        return self._is_cancelled

    def progress(self, fraction: float, text: str = "") -> None:
        """Tell the caller how far the work is, from 0 to 1; it never decreases.

        Raises
        ------
        CancelledError, DeadlineError
            Nobody waits for the answer any more.
        """
        self.report(fraction, text)
        self.check_cancelled()

    def report(self, fraction: float, text: str = "") -> None:
        """Tell the caller how far the work is, whether or not somebody still waits for it."""
        self.fraction = max(self.fraction, min(float(fraction), 1.0))
        self.text = text
        for listener in self._listeners:
            listener(self.fraction, text)

    def check_cancelled(self) -> None:
        """End the method early if nobody waits for its answer any more.

        Raises
        ------
        CancelledError, DeadlineError
        """
        if self.is_cancelled:
            raise CancelledError("the call was cancelled")
        if self.left_s <= 0:
            raise self.late()

    def late(self) -> DeadlineError:
        """Return the error of a call whose time is up."""
        return DeadlineError(f"no answer within {self.timeout_s:g} s", timeout_s=self.timeout_s)

    def connect(self, name: str, data: dict[str, str] | None = None) -> Any:
        """Return a proxy of another service; its calls end with this one at the latest."""
        return self._reach().connect_within(self, name, data)

    def submit(
        self, name: str, method: str, args: dict[str, Any], data: dict[str, str] | None = None
    ) -> Any:
        """Queue a call of another service, and return its :class:`~rtask.services.task.Task`."""
        return self._reach().submit(Invocation(name, method, args, self.caller, data, None, self))

    def find(self, name: str, method: str) -> Any:
        """Return the :class:`~rtask.services.definition.Method` of another service."""
        return self._reach().find(name, method)[1]

    def check_data(
        self, name: str, data: dict[str, str] | None = None, form: str = "data="
    ) -> None:
        """Refuse a call of another service, before it is made, whose data are missing.

        Parameters
        ----------
        form
            How its caller names datasets, as in
            :func:`rtask.wire.dataset_words.with_example`.

        Raises
        ------
        MissingDataError
            A data resource has no dataset, or the caller may not read it.
        """
        self._reach().check_data(name, data or {}, self.caller, form)

    def _reach(self) -> Others:
        if self._others is None:
            raise UnsupportedError("a worker in a process of its own cannot call other services")
        return self._others

    def on_progress(self, listener: Listener) -> None:
        """Call back with each report of progress, from the thread of the method."""
        self._listeners.append(listener)

    def on_cancel(self, stop: Callable[[], object]) -> None:
        """Call back when the call is cancelled, late or has failed; at once if it was."""
        self._stops.append(stop)
        if self.is_cancelled:
            stop()

    def cancel(self) -> bool:
        """End the call as cancelled and ask the method to stop; return whether this is its end."""
        return self.fail(CancelledError("the call was cancelled"))

    def expire(self) -> bool:
        """End the call as late and ask the method to stop; return whether this is its end."""
        return self.fail(self.late())

    def fail(self, error: Exception, *, is_own: bool = False) -> bool:
        """End the call with an error and ask the method to stop; return whether this is its end.

        Parameters
        ----------
        is_own
            Whether the error comes from what carries out the call.
        """
        is_end = self.ending.fail(error, is_own=is_own)
        if is_end or not self.ending.is_over:
            self._is_cancelled = True
            for stop in self._stops:
                stop()
        return is_end


@dataclass(frozen=True)
class Invocation:
    """Request of a caller to a service.

    Parameters
    ----------
    service
        ``example/Kinematics``, or with a version: ``@1.2.0``, ``@1.2.*``, ``@1.*``.
    args
        The request.
    access
        Rights of the caller; None = those of the owner.
    data
        Names of datasets by the names of the data resources.
    timeout_s
        Time for the answer; None = as the service says.
    parent
        The call on whose behalf this one is made; None = it is made for itself.
    data_form
        How the caller names datasets, as in :func:`rtask.wire.dataset_words.with_example`.
    """

    service: str
    method: str
    args: Mapping[str, Any] = field(default_factory=dict)
    access: Access | None = None
    data: Mapping[str, str] | None = None
    timeout_s: float | None = None
    parent: Call | None = None
    data_form: str = "data="
