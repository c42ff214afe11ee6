"""Workers: programs on other machines that carry out calls of services (Kehoe 2014, 5.4 and 5.6).

A worker advertises each of its services with a description, and then answers calls like any
provider of rosbridge; docs/workers.md has the messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from pydantic import BaseModel

from endpoint.rosbridge.calls import Deadlines
from endpoint.rosbridge.hosted import hosted_service
from endpoint.rosbridge.messages import JsonObject
from endpoint.rosbridge.packing import Frame
from endpoint.rosbridge.services import ServiceTable
from rtask.errors import ForbiddenError, UsageError
from rtask.kb.commit.access import Access
from rtask.services import ServiceHost
from rtask.services.outward.frames import pack, packed, plain, unpack

__all__ = ["WorkerSeat", "Workers"]

_LOOK_S = 5.0


class WorkerSession(Protocol):
    """The part of a session that workers use."""

    access: Access

    @property
    def identity(self) -> str:
        """Name of the caller."""

    def put(self, frame: Frame) -> None:
        """Queue a frame without waiting."""

    def emit(self, message: JsonObject) -> None:
        """Queue a message without waiting."""


class Workers:
    """State that the workers of all sessions share.

    Parameters
    ----------
    host
        Gives them its calls; None = there are no services here.
    table
        Receives their methods as services of rosbridge.
    deadlines
        Looks for silent ones.
    """

    def __init__(self, host: ServiceHost | None, table: ServiceTable, deadlines: Deadlines) -> None:
        self.host, self.table, self._deadlines = host, table, deadlines
        self._is_looking = False

    def look(self) -> None:
        """Look every few seconds for workers that fell silent, as long as there are any."""
        if not self._is_looking:
            self._is_looking = True
            self._deadlines.after(_LOOK_S, self._looked)

    def _looked(self) -> None:
        assert self.host is not None
        self._is_looking = False
        self.host.outward.drop_silent()
        if not self.host.outward.is_empty:
            self.look()


class WorkerSeat:
    """The services that one session offers as a worker.

    Parameters
    ----------
    workers
        What all share.
    session
        The connection.
    """

    def __init__(self, workers: Workers, session: WorkerSession) -> None:
        self._workers, self._session = workers, session
        self._is_worker = self._is_binary = False

    @property
    def name(self) -> str:
        """Of the worker, for errors."""
        return f"worker {self._session.identity}"

    def advertise(self, message: JsonObject) -> None:
        """Take the session on as a worker for one service, and tell it so.

        Raises
        ------
        ForbiddenError
            Its token has not the right ``deploy``.
        UsageError
            The description cannot be read, or does not fit.
        """
        access, host = self._session.access, self._workers.host
        if access.role not in ("admin", "anonymous") and "deploy" not in access.rights:
            raise ForbiddenError(
                "offering services needs the right deploy: rtask token create --robot NAME "
                "--right deploy"
            )
        if host is None:
            raise UsageError("this server has no services")
        self._is_binary = message.get("compression") == "cbor"
        definition = host.outward.join(self, message.get("description"), message.get("slots", 1))
        self._is_worker = True
        for method in definition.methods.values():
            self._workers.table.add(hosted_service(host, definition, method))
        status = {"op": "status", "level": "info", "msg": f"serving {definition.exact}"}
        self._session.emit({**status, "id": message.get("id")})
        self._workers.look()

    def unadvertise(self, name: str) -> bool:
        """Take a service from the worker, one version or all; its calls in progress end.

        Returns
        -------
        Whether the worker offered it.
        """
        host = self._workers.host if self._is_worker else None
        return host is not None and host.outward.withdraw(self, name)

    def drain(self, _: JsonObject) -> None:
        """Give the worker no further calls."""
        if self._is_worker and self._workers.host is not None:
            self._workers.host.outward.drain(self)

    def take(self, message: JsonObject) -> bool:
        """Accept a message about a call; tell whether it was one of a worker."""
        if not self._is_worker or self._workers.host is None:
            return False
        return self._workers.host.outward.take(self, message)

    def read(self, frame: bytes) -> JsonObject:
        """Return the message of a binary frame.

        Raises
        ------
        UsageError
            The session is no worker, or the frame cannot be read.
        """
        if not self._is_worker:
            raise UsageError("binary frames are taken from workers only; send JSON")
        return unpack(frame)

    def heard(self, _: JsonObject) -> None:
        """Note that the worker is there."""
        if self._is_worker and self._workers.host is not None:
            self._workers.host.outward.heard(self)

    def leave(self) -> None:
        """Forget the worker; its calls are given to others or fail."""
        if self._is_worker and self._workers.host is not None:
            self._workers.host.outward.leave(self)

    def send(self, message: Mapping[str, Any], args: BaseModel | None) -> None:
        """Queue a message, with its ``args`` if there are any, without waiting."""
        if self._is_binary:
            whole = dict(message) if args is None else {**message, "args": packed(args)}
            self._session.put(pack(whole))
        else:
            whole = dict(message) if args is None else {**message, "args": plain(args)}
            self._session.emit(whole)

    def refuse(self, words: str) -> None:
        """Tell the worker that it is not served any more."""
        self._is_worker = False
        self._session.emit({"op": "status", "level": "error", "msg": words})
