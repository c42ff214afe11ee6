"""The table of services that `call_service` finds, and what they may do."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from endpoint.rosbridge.calls import Prepared
from endpoint.rosbridge.messages import JsonObject
from rtask.errors import UnknownTermError, UnsupportedError
from rtask.kb.commit.access import Access
from rtask.wire.effect import Effect
from rtask.wire.message import Answer, Message
from rtask.wire.ros import camel_case

Handler = Callable[[JsonObject, Access], JsonObject]
RequestClass = type[Message]
AnswerClass = type[Answer]


class Operation(Protocol):
    """The part of an operation that rosbridge uses."""

    @property
    def scope(self) -> str:
        """Right that a caller needs."""

    @property
    def effect(self) -> Effect:
        """Its effect on the graph."""

    @property
    def summary(self) -> str:
        """One line for lists."""

    @property
    def request(self) -> type[Message]:
        """Declaration of its request."""

    @property
    def answer(self) -> type[Answer]:
        """Declaration of its answer."""


class Engine(Protocol):
    """The part of :class:`rtask.engine.Engine` that rosbridge uses."""

    @property
    def operations(self) -> Mapping[str, Operation]:
        """All operations by name."""

    def call(self, name: str, args: JsonObject, access: Access) -> Answer:
        """Carry out one operation."""


class NoEngine:
    """Stands where there is no engine: over a bare SPARQL dataset without the ontology."""

    operations: ClassVar[Mapping[str, Operation]] = {}

    def call(self, name: str, args: JsonObject, access: Access) -> Answer:
        """Refuse."""
        raise UnsupportedError(f"{name}: a plain dataset has no ontology for it")


@dataclass(frozen=True)
class Service:
    """One service.

    Parameters
    ----------
    name
        With the leading slash, ``/rtask/recognise_for_grasp``.
    type
        ROS name of its type.
    scope
        ``read``, ``call``, ``write`` or ``teach``.
    handler
        Takes the arguments and the caller's rights, returns the answer.
    inline
        Answered by the reader at once: short, and never behind a queue.
    request, answer
        Their declarations, where there are any.
    prepare
        Takes arguments, rights and the time for the answer, s, and returns a call that can be
        ended; used in place of ``handler`` where there is one.
    positional
        Names of the arguments in order, for callers that send a list, where none is declared.
    at_copy
        Whether a follower answers it too, from its copy of the graph.
    """

    name: str
    type: str
    scope: str
    handler: Handler
    inline: bool = False
    request: RequestClass | None = None
    answer: AnswerClass | None = None
    prepare: Callable[[JsonObject, Access, float], Prepared] | None = None
    positional: tuple[str, ...] = ()
    at_copy: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the arguments in order, for callers that send a list."""
        return self.positional if self.request is None else tuple(self.request.model_fields)


class ServiceTable:
    """Services by name.

    Examples
    --------
    >>> table = ServiceTable([Service("/rtask/ping", "rtask/Ping", "read", lambda a, who: {})])
    >>> table.find("rtask/ping").type
    'rtask/Ping'
    >>> table.find("/rtask/pign")
    Traceback (most recent call last):
    rtask.errors.UnknownTermError: Service /rtask/pign does not exist; did you mean /rtask/ping?
    """

    def __init__(self, services: list[Service]) -> None:
        self._services = {service.name: service for service in services}

    def is_at_copy(self, name: str) -> bool:
        """Return whether a follower answers a service itself; not one that it does not have."""
        service = self._services.get("/" + name.lstrip("/"))
        return service is not None and service.at_copy

    def add(self, service: Service) -> None:
        """Add a service."""
        self._services[service.name] = service

    def find(self, name: str, others: Sequence[str] = ()) -> Service:
        """Return a service by its name, with or without the leading slash.

        Parameters
        ----------
        others
            Names that may have been meant besides.

        Raises
        ------
        UnknownTermError
            With the nearest name.
        """
        path = "/" + name.lstrip("/")
        if path in self._services:
            return self._services[path]
        near = difflib.get_close_matches(path, [*self._services, *others], n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise UnknownTermError(f"Service {path} does not exist{hint}")

    def __iter__(self) -> Any:
        return iter(sorted(self._services.values(), key=lambda service: service.name))

    def __len__(self) -> int:
        return len(self._services)


def ros_type(operation: str) -> str:
    """Return the ROS type of an operation.

    Examples
    --------
    >>> ros_type("recognise_for_grasp")
    'rtask/RecogniseForGrasp'
    """
    return f"rtask/{camel_case(operation)}"


def engine_services(engine: Engine) -> list[Service]:
    """Return one service for each operation of the engine."""

    def handler(operation: str) -> Handler:
        return lambda args, access: engine.call(operation, args, access).as_json()

    return [
        Service(
            f"/rtask/{name}",
            ros_type(name),
            operation.scope,
            handler(name),
            request=operation.request,
            answer=operation.answer,
            at_copy=operation.effect != "writes",
        )
        for name, operation in engine.operations.items()
    ]
