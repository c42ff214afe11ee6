"""Calls that must arrive: what a robot reports is kept on disk until it was answered."""

from __future__ import annotations

import base64
import logging
import math
import threading
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtask.client.calling.rules import CallRules
from rtask.client.outbox import Entry, Outbox
from rtask.errors import AuthenticationError, CallFailedError, RemoteUnavailableError, RtaskError

__all__ = ["ReportingCaller"]

_log = logging.getLogger(__name__)


class ReportingCaller(ABC):
    """Calls operations by name; reports go by way of an outbox, if there is one.

    Parameters
    ----------
    outbox
        File for what could not be told yet.
    rules
        Which operations may wait, and what identifies their requests.
    """

    def __init__(self, outbox: Path | str | None, rules: CallRules) -> None:
        self._outbox = None if outbox is None else Outbox(outbox)
        self._rules = rules
        self._claiming = threading.Lock()
        self._claimed: set[str] = set()

    @abstractmethod
    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Carry out one operation of the engine."""

    def call(
        self, operation: str, /, timeout_s: float | None = None, **args: Any
    ) -> dict[str, Any]:
        """Carry out an operation of the engine by name.

        Parameters
        ----------
        timeout_s
            For this call, instead of the client's.
        **args
            Fields of the request; bytes are sent as base64.

        Raises
        ------
        RemoteUnavailableError
            No answer. What was to be told is kept in the outbox, if there is one.
        CallFailedError
            The server answered that it will not, and why.
        """
        args = {name: _as_text(value) for name, value in args.items()}
        if operation not in self._rules.deferrable:
            received = self._call(operation, args, timeout_s)
            self._deliver_waiting(timeout_s)
            return received
        ids = self._rules.request_ids.get(operation)
        if ids is not None:
            args = ids.filled(args, lambda _: f"urn:uuid:{uuid.uuid4()}")
        if self._outbox is None:
            return self._call(operation, args, timeout_s)
        # Another thread that delivers must not send it as well: its answer would be "stored 0".
        with self._claiming:
            entry = self._outbox.add(operation, args)
            self._claimed.add(entry.id)
        try:
            return self._report(entry, timeout_s)
        finally:
            self._claimed.discard(entry.id)

    def _report(self, entry: Entry, timeout_s: float | None) -> dict[str, Any]:
        """Send a call that is in the outbox, after those that are older."""
        assert self._outbox is not None
        self._deliver_before(entry.id)
        try:
            answer = self._call(entry.operation, entry.args, timeout_s)
        except RtaskError as error:
            if _may_pass(error):
                raise RemoteUnavailableError(
                    f"{error}; kept in {self._outbox.path} and sent again later", **error.details
                ) from error
            if not isinstance(error, AuthenticationError):  # a new token makes the call good
                self._outbox.done(entry)
            raise
        self._outbox.done(entry)
        return answer

    def tell(self, operation: str, /, **args: Any) -> dict[str, Any] | None:
        """Carry out an operation now, or later when nobody answers.

        For robots that work on without a network: what is told goes to the outbox, and with the
        next call that gets through, or :meth:`deliver`, it arrives, once.

        Returns
        -------
        The answer; None when it was kept.

        Raises
        ------
        CallFailedError
            The server answered that it will not, and why.
        AuthenticationError
            The token is not valid, or no longer; an outbox keeps the call for the next token.
        RemoteUnavailableError
            No answer, and no outbox to keep it.
        """
        try:
            return self.call(operation, **args)
        except RemoteUnavailableError:
            if self._outbox is None or operation not in self._rules.deferrable:
                raise
            return None

    @property
    def waiting(self) -> int:
        """Number of calls that wait in the outbox."""
        return 0 if self._outbox is None else len(self._outbox.pending())

    def deliver(self) -> int:
        """Send what waits in the outbox; return how many calls were answered.

        Calls that the server refuses are put aside in ``<outbox>.refused``.

        Raises
        ------
        RemoteUnavailableError
            No answer; the rest stays.
        AuthenticationError
            The token is not valid, or no longer; the rest stays.
        """
        return self._deliver_before(None)

    def _deliver_waiting(self, timeout_s: float | None = None) -> None:
        """Send what waits in the outbox, after a call that was answered; what fails stays.

        Parameters
        ----------
        timeout_s
            Of the call that was answered; nothing more is sent when it has passed again.
        """
        end = math.inf if timeout_s is None else time.monotonic() + timeout_s
        try:
            while self.waiting and time.monotonic() < end:
                if not self._deliver_before(None, timeout_s, at_most=1):
                    break  # another thread is sending it
        except (RemoteUnavailableError, AuthenticationError) as error:
            _log.warning("%d calls still wait in the outbox: %s", self.waiting, error)

    def _deliver_before(
        self, entry_id: str | None, timeout_s: float | None = None, at_most: int | None = None
    ) -> int:
        """Send the entries that are older than one, in order: an object before its outcomes."""
        if self._outbox is None:
            return 0
        sent = 0
        for entry in self._outbox.pending()[:at_most]:
            if entry.id == entry_id:
                break
            if not self._claim(entry):
                continue
            try:
                self._call(entry.operation, entry.args, timeout_s)
            except RtaskError as error:
                if isinstance(error, AuthenticationError):
                    raise
                if _may_pass(error):
                    if isinstance(error, RemoteUnavailableError):
                        raise
                    raise RemoteUnavailableError(str(error), **error.details) from error
                self._outbox.refuse(entry, str(error))
            else:
                self._outbox.done(entry)
            finally:
                self._claimed.discard(entry.id)
            sent += 1
        return sent

    def _claim(self, entry: Entry) -> bool:
        """Take a waiting call for this thread; return whether no other has it."""
        assert self._outbox is not None
        with self._claiming:
            is_waiting = any(other.id == entry.id for other in self._outbox.pending())
            if entry.id in self._claimed or not is_waiting:
                return False
            self._claimed.add(entry.id)
            return True


def _may_pass(error: RtaskError) -> bool:
    """Return whether the same call may succeed later: nobody answered, or nobody had time."""
    if isinstance(error, CallFailedError) and "http_status" not in error.details:
        return False  # an answer of a kind that says nothing about it
    return error.is_transient


def _as_text(value: Any) -> Any:
    """Return a value with its bytes as base64 text, as JSON carries them."""
    if isinstance(value, bytes | bytearray | memoryview):
        return base64.b64encode(value).decode("ascii")
    if isinstance(value, Mapping):
        return {name: _as_text(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_as_text(part) for part in value]
    return value
