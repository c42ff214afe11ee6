"""Base class and decorators for the authors of services (Kehoe 2014, 5.5 and 5.7)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar, overload

from rtask.errors import UsageError
from rtask.wire.effect import Effect

if TYPE_CHECKING:
    from rtask.services.resources import Resource

__all__ = [
    "MARK",
    "Executor",
    "Mark",
    "ResourceNeed",
    "Service",
    "data_resource",
    "marked",
    "method",
    "own_attributes",
    "shutdown",
    "startup",
]

Executor = Literal["threads", "processes", "ray", "outward"]
F = TypeVar("F", bound=Callable[..., Any])
MARK, _STARTUP, _SHUTDOWN = "__rtask_method__", "__rtask_startup__", "__rtask_shutdown__"


@dataclass(frozen=True)
class Mark:
    """Settings that an author gives for one method.

    Parameters
    ----------
    output
        Name under which a result that is no :class:`~rtask.wire.message.Answer` is sent.
    scope
        Right that a caller needs: read, write or teach.
    effect
        What a call does to the graph and to data; None = the author does not say.
    inputs, result
        Types of the parameters and of the result, where the annotations do not say them.
    """

    output: str = "result"
    scope: str = "read"
    effect: Effect | None = None
    inputs: Mapping[str, Any] | None = None
    result: Any = None


class ResourceNeed:
    """A data resource that a service needs; its attribute holds the data themselves.

    Parameters
    ----------
    type
        ``binary``: files of a dataset; ``graph``: the knowledge graph of the server.
    writable
        Whether methods write to it. Such a service has one worker.
    default
        Name of the dataset that is used if a caller names none.
    summary
        One line about what is expected of the data.
    """

    def __init__(self, type: str, writable: bool, default: str | None, summary: str) -> None:
        if type not in ("binary", "graph"):
            raise UsageError(f"data resource: unknown type {type!r}; binary or graph")
        self.type, self.writable, self.default, self.summary = type, writable, default, summary
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: Service | None, owner: type) -> Any:
        if instance is None:
            return self
        return instance.data_resources[self.name]


def data_resource(
    type: Literal["binary", "graph"],
    *,
    writable: bool = False,
    default: str | None = None,
    summary: str = "",
) -> Any:
    """Declare a data resource as an attribute of a service; see :class:`ResourceNeed`."""
    return ResourceNeed(type, writable, default, summary)


class Service:
    """An algorithm that is offered as a service; subclass it and mark its methods.

    Methods keep no state: what :func:`startup` prepared, a call leaves as it was, so that any
    number of workers can serve the same calls (Kehoe 2014, 5.5).

    Attributes
    ----------
    name
        ``<namespace>/<name>``.
    version
        ``<major>.<minor>.<patch>``. What is served under a version never changes.
    executor
        ``threads`` for numpy and other libraries that release the interpreter's lock;
        ``processes`` for what may hang or crash; ``ray`` for a Ray cluster that is running.
    max_workers
        Largest number of calls that run at a time; None = the number of cores.
    max_waiting
        Length of the queue; further calls are refused.
    timeout_s
        Time for a call, unless its caller gives another.
    extra
        Extra of RTASK whose libraries it needs; where they are missing, lists say so before a call.

    Examples
    --------
    >>> class Scale(Service):
    ...     '''Numbers made larger.'''
    ...     name = "example/Scale"
    ...     @method(output="numbers")
    ...     def scale(self, numbers: list[float], factor: float = 2.0) -> list[float]:
    ...         '''Multiply numbers by a factor.'''
    ...         return [factor * one for one in numbers]
    >>> from rtask.services import ServiceHost
    >>> with ServiceHost([Scale]) as host:
    ...     host.call("example/Scale", "scale", {"numbers": [1, 2]}).as_json()
    {'numbers': [2.0, 4.0]}
    """

    name: ClassVar[str] = ""
    version: ClassVar[str] = "0.1.0"
    executor: ClassVar[Executor] = "threads"
    max_workers: ClassVar[int | None] = None
    max_waiting: ClassVar[int] = 100
    timeout_s: ClassVar[float] = 60.0
    extra: ClassVar[str] = ""

    data_resources: Mapping[str, Resource]

    def __init__(self, data_resources: Mapping[str, Resource] | None = None) -> None:
        self.data_resources = dict(data_resources or {})

    def make_ready(self) -> None:
        """Run the methods marked with :func:`startup`."""
        for name in marked(type(self), _STARTUP):
            getattr(self, name)()

    def end(self) -> None:
        """Run the methods marked with :func:`shutdown`."""
        for name in marked(type(self), _SHUTDOWN):
            getattr(self, name)()


@overload
def method(function: F, /) -> F: ...


@overload
def method(
    *, output: str = "result", scope: str = "read", effect: Effect | None = None
) -> Callable[[F], F]: ...


def method(
    function: Any = None,
    /,
    *,
    output: str = "result",
    scope: str = "read",
    effect: Effect | None = None,
) -> Any:
    """Offer a method of a service; its annotations are the contract.

    Parameters
    ----------
    output
        Name under which the result is sent, unless it is an
        :class:`~rtask.wire.message.Answer`.
    scope
        Right that a caller needs: read, write or teach.
    effect
        What a call does to the graph and to datasets: ``reads``, ``records`` or ``writes``, see
        :data:`rtask.wire.effect.Effect`. It must be given where a method could write: with another
        scope than read, a writable data resource, or a parameter of the class ``Call``, which
        reaches other services. Other methods compute their answers, and read.
    """

    def mark(function: F) -> F:
        setattr(function, MARK, Mark(output, scope, effect))
        return function

    return mark if function is None else mark(function)


def startup(function: F) -> F:
    """Run a method before the first call, when the data resources are there."""
    setattr(function, _STARTUP, True)
    return function


def shutdown(function: F) -> F:
    """Run a method after the last call."""
    setattr(function, _SHUTDOWN, True)
    return function


def marked(service: type, mark: str = MARK) -> dict[str, Any]:
    """Return the methods of a class that carry a mark, by name, base classes first."""
    marked_methods = {}
    for name, value in own_attributes(service):
        if callable(value) and hasattr(value, mark):
            marked_methods[name] = getattr(value, mark)
    return marked_methods


def own_attributes(service: type) -> Iterator[tuple[str, Any]]:
    """Yield each attribute that a class and its bases define, as the class sees it."""
    names = dict.fromkeys(
        name for base in reversed(service.__mro__) if base is not object for name in vars(base)
    )
    for name in names:
        yield name, next(vars(base)[name] for base in service.__mro__ if name in vars(base))
