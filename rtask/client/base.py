"""The interface of a robot program to the graph, in its own process or across a network."""

from __future__ import annotations

import base64
import logging
import math
import time
import uuid
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rtask.client.calls import Calls
from rtask.client.outbox import Outbox
from rtask.errors import (
    AuthenticationError,
    CallFailedError,
    RemoteUnavailableError,
    RtaskError,
    UnsupportedError,
)

if TYPE_CHECKING:
    from rtask.client.following import FollowedChange
    from rtask.services.proxy import Proxy

__all__ = ["Client"]

_log = logging.getLogger(__name__)

_REPORTS = ("insert_object", "report_outcome", "report_refusal")


class Client(Calls):
    """A connection to the shared graph; made by :func:`rtask.connect`.

    What the robot tells carries an id, so telling it twice stores it once. With an outbox it is
    written to disk before it is sent, and sent again at the next occasion if no answer came.

    A client may be used from many threads, one call at a time; in an asyncio program, call it by
    ``asyncio.to_thread``.

    Parameters
    ----------
    outbox
        File for what could not be told yet.
    """

    def __init__(self, outbox: Path | str | None = None) -> None:
        self._outbox = None if outbox is None else Outbox(outbox)

    @abstractmethod
    def _call(
        self, operation: str, args: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Carry out one operation of the engine."""

    @abstractmethod
    def query(self, sparql: str) -> list[dict[str, Any]]:
        """Return the rows of a SELECT: variable name to value, IRIs as text, unbound as None."""

    @abstractmethod
    def ask(self, sparql: str) -> bool:
        """Return the answer of an ASK."""

    @abstractmethod
    def update(self, sparql: str) -> None:
        """Carry out a SPARQL update."""

    @abstractmethod
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
        """Yield commits that touch matching statements, as they come.

        A lost connection is opened again, and nothing is missed or heard twice. Iterate in a
        thread of its own; leave the loop, or close the iterator, to end.

        Parameters
        ----------
        s, p, o, graph
            IRIs, or terms as N-Triples write them; None fits everything.
        cls
            Statements about instances of a class.
        inferred
            Whether derived statements count.
        since
            ``version`` of the last change that was heard; None = from now on.

        Raises
        ------
        GoneError, EpochChangedError
            What was missed is no longer kept; read everything again.
        RemoteUnavailableError
            Nobody answered for the client's time.
        """

    def answer(self, text: str) -> dict[str, Any]:
        """Answer a question in words, such as ``which robot fails at cartons, and why?``.

        Returns
        -------
        dict
            As :meth:`rtask.asking.questions.answering.Answer.to_dict` gives it; ``sparql`` is empty
            if no question is near, and ``nearest`` has the three nearest.

        Raises
        ------
        UsageError
            The text is empty or too long.
        """
        raise UnsupportedError(f"{type(self).__name__} answers no questions in words")

    def services(self) -> list[dict[str, Any]]:
        """Return the services that are offered, with their versions and methods."""
        raise _no_services(self)

    def describe_service(self, name: str) -> dict[str, Any]:
        """Return the description of a service, with the JSON Schemas of its methods.

        Parameters
        ----------
        name
            ``example/Kinematics``, or with a version: ``@1.2.0``, ``@1.2.*``, ``@1.*``.

        Raises
        ------
        UnknownTermError, CallFailedError
            No such service.
        """
        raise _no_services(self)

    def call_service(
        self,
        name: str,
        method: str,
        args: Mapping[str, Any] | None = None,
        data: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
        may_repeat: bool = False,
    ) -> dict[str, Any]:
        """Call a method of a service.

        Parameters
        ----------
        name
            Of the service, with or without a version.
        args
            The request, as JSON carries it.
        data
            Names of datasets by the names of the service's data resources.
        timeout_s
            Time for the answer; None = as the service says.
        may_repeat
            Whether the call may be sent again when the connection was lost.

        Raises
        ------
        CallFailedError, ServiceError
            The service answered that it will not, and why.
        """
        raise _no_services(self)

    def service(self, name: str, data: Mapping[str, str] | None = None) -> Proxy:
        """Return an object with the methods of a service (Kehoe 2014, 5.6).

        Parameters
        ----------
        name
            As in :meth:`describe_service`; the version is chosen now and stays.
        data
            Names of datasets by the names of the service's data resources.
        """
        from rtask.client.services import proxy_of

        return proxy_of(self.describe_service(name), self.call_service, data)

    @abstractmethod
    def close(self) -> None:
        """End the connection; what was not answered stays in the outbox."""

    # Operations

    def _operate(self, operation: str, given: dict[str, Any]) -> Any:
        args = {name: value for name, value in given.items() if value is not None}
        args.pop("self", None)
        return self.call(operation, **args)

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
        if operation not in _REPORTS:
            received = self._call(operation, args, timeout_s)
            self._deliver_waiting(timeout_s)
            return received
        args = _with_ids(operation, args)
        if self._outbox is None:
            return self._call(operation, args, timeout_s)
        entry = self._outbox.add(operation, args)
        self._deliver_before(entry.id)
        try:
            answer = self._call(operation, args, timeout_s)
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
            if self._outbox is None or operation not in _REPORTS:
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
                self._deliver_before(None, timeout_s, at_most=1)
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
            sent += 1
        return sent

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _no_services(client: Client) -> UnsupportedError:
    return UnsupportedError(f"{type(client).__name__} reaches no services")


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


def _with_ids(operation: str, args: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments with an id wherever a repeated call would store something twice."""
    if operation == "report_refusal":
        return args
    if operation == "report_outcome" or "objects" not in args:
        return {"task_id": f"urn:uuid:{uuid.uuid4()}", **args}
    objects = [
        {"task_id": f"urn:uuid:{uuid.uuid4()}", **item} if isinstance(item, dict) else item
        for item in args["objects"]
    ]
    return {**args, "objects": objects}
