"""What a robot program works with, whether the graph is in its own process or across a network."""

from __future__ import annotations

import copy
import uuid
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Any

from rtask.client.outbox import Outbox
from rtask.errors import RemoteUnavailableError, RtaskError

__all__ = ["Client"]

_TOLD = ("insert_object", "report_outcome")


class Client(ABC):
    """A connection to the shared graph; made by :func:`rtask.connect`.

    What the robot tells carries an id, so telling it twice stores it once. With an outbox it is
    written to disk before it is sent, and sent again at the next occasion if no answer came.

    Parameters
    ----------
    outbox
        File for what could not be told yet.
    """

    def __init__(self, outbox: Path | str | None = None) -> None:
        self._outbox = None if outbox is None else Outbox(outbox)

    @abstractmethod
    def _call(self, operation: str, args: dict[str, Any]) -> dict[str, Any]:
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
    def close(self) -> None:
        """End the connection; what was not answered stays in the outbox."""

    def call(self, operation: str, /, **args: Any) -> dict[str, Any]:
        """Carry out an operation of the engine by name.

        Raises
        ------
        RemoteUnavailableError
            No answer. What was to be told is kept in the outbox, if there is one.
        CallFailedError
            The server answered that it will not, and why.
        """
        if operation not in _TOLD:
            return self._call(operation, args)
        args = _with_ids(operation, args)
        if self._outbox is None:
            return self._call(operation, args)
        entry = self._outbox.add(operation, args)
        self._deliver_before(entry.id)
        try:
            answer = self._call(operation, args)
        except RemoteUnavailableError as error:
            raise RemoteUnavailableError(
                f"{error}; kept in {self._outbox.path} and sent again later", **error.details
            ) from error
        except RtaskError:
            self._outbox.done(entry)
            raise
        self._outbox.done(entry)
        return answer

    def register_robot(self, **description: Any) -> dict[str, Any]:
        """Introduce this robot; see the operation's fields in ``docs/engine.md``."""
        return self.call("register_robot", **description)

    def recognise_for_grasp(self, **request: Any) -> dict[str, Any]:
        """Ask which object this is and which grasps to try, in order."""
        return self.call("recognise_for_grasp", **request)

    def insert_object(self, **request: Any) -> dict[str, Any]:
        """Tell what was seen, and what came of grasping it."""
        return self.call("insert_object", **request)

    def report_outcome(self, **request: Any) -> dict[str, Any]:
        """Tell what came of a grasp on a known object."""
        return self.call("report_outcome", **request)

    def deliver(self) -> int:
        """Send what waits in the outbox; return how many calls were answered.

        Calls that the server refuses are put aside in ``<outbox>.refused``.

        Raises
        ------
        RemoteUnavailableError
            No answer; the rest stays.
        """
        return self._deliver_before(None)

    def _deliver_before(self, entry_id: str | None) -> int:
        """Send the entries that are older than one, in order: an object before its outcomes."""
        if self._outbox is None:
            return 0
        sent = 0
        for entry in self._outbox.pending():
            if entry.id == entry_id:
                break
            try:
                self._call(entry.operation, entry.args)
            except RemoteUnavailableError:
                raise
            except RtaskError as error:
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


def _with_ids(operation: str, args: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments with an id wherever a repeated call would store something twice."""
    if operation == "report_outcome" or "objects" not in args:
        return {"task_id": f"urn:uuid:{uuid.uuid4()}", **args}
    args = copy.copy(args)
    args["objects"] = [
        {"task_id": f"urn:uuid:{uuid.uuid4()}", **item} if isinstance(item, dict) else item
        for item in args["objects"]
    ]
    return args
