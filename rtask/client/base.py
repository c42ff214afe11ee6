"""The interface of a robot program to the graph, in its own process or across a network."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from rtask.client.calling.reporting import ReportingCaller
from rtask.client.calling.rules import CallRules
from rtask.client.calls import DEFERRABLE, REPEATABLE, REQUEST_IDS, Calls
from rtask.errors import UnsupportedError

if TYPE_CHECKING:
    from rtask.client.following import FollowedChange
    from rtask.services.proxy import Proxy

__all__ = ["RULES", "Client"]

RULES = CallRules(REPEATABLE, DEFERRABLE, REQUEST_IDS)
"""What follows for callers from the declarations of the operations."""


class Client(ReportingCaller, Calls):
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
        super().__init__(outbox, RULES)

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
