"""The names of Brass, so that its services and programs run as printed (Kehoe 2014, 5.7).

While a file of services is loaded this module is ``brass``; in scripts that ``rtask service run``
runs it is :mod:`rtask.client.brass`, which has the names of programs as well. New services are
better written with :mod:`rtask.services`, whose annotations type checkers read.

Class decorators run after the class is made and those of methods from the bottom up; therefore an
input is put in front of those that are there.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.services import service as own
from rtask.services.resources import Files, Resource
from rtask.services.service import Mark, ResourceNeed
from rtask.services.service import shutdown as shutdown
from rtask.services.service import startup as startup
from rtask.wire import types as wire

__all__ = [
    "Binary",
    "Bool",
    "Float",
    "Image",
    "Int",
    "PointCloud",
    "Pose",
    "Service",
    "String",
    "data_resource",
    "input",
    "output",
    "shutdown",
    "startup",
]

F = TypeVar("F", bound=Callable[..., Any])
C = TypeVar("C", bound=type[own.Service])


class _Number:
    """A number, or with brackets an array: ``Float[...]``, ``Float[7]``, ``Float[..., 3]``."""

    def __init__(self, single: Any) -> None:
        self.single = single

    def __getitem__(self, shape: Any) -> Any:
        last = shape[-1] if isinstance(shape, tuple) else ...
        if isinstance(shape, tuple) and (len(shape) != 2 or type(last) is not int):
            raise UsageError(f"Float[{shape!r}]: expected Float[...], Float[n] or Float[..., n]")
        if last is ...:
            return wire.Array
        carried = wire.Carried("string", "Sequence[Sequence[float]]", None)
        return Annotated[NDArray, wire.ArrayOf(last), carried]


Float = _Number(float)
Int = _Number(int)
String = str
Bool = bool
Binary = bytes
Pose = wire.Pose
PointCloud = wire.Cloud
Image = wire.Image


class _BrassFiles:
    """A data resource with the method names of Brass beside its own."""

    def __init__(self, files: Files) -> None:
        self._files = files

    def get_file_path_for(self, name: str) -> str:
        """Return the path of a file by its name in the dataset."""
        return str(self._files.path(name))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._files, name)


class Service(own.Service):
    """Base class of services; without a name it is called after its file and its class."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if not cls.name:
            file = getattr(sys.modules.get(cls.__module__), "__file__", None) or cls.__module__
            cls.name = f"{Path(file).stem}/{cls.__name__}"

    def __init__(self, data_resources: Mapping[str, Resource] | None = None) -> None:
        bound: dict[str, Any] = {
            name: _BrassFiles(resource) if isinstance(resource, Files) else resource
            for name, resource in (data_resources or {}).items()
        }
        super().__init__(bound)


def data_resource(name: str, type: str = "binary", writable: bool = False) -> Callable[[C], C]:
    """Declare a data resource of a service class."""

    def declare(service: C) -> C:
        need = ResourceNeed(type, writable, None, "")
        need.name = name
        setattr(service, name, need)
        if writable:  # Brass has no word for what a method does, so that each may write
            for method, mark in own.marked(service).items():
                _marked(getattr(service, method), replace(mark, effect="writes"))
        return service

    return declare


def input(type: Any, name: str) -> Callable[[F], F]:
    """Declare an input of a method, before those below."""

    def declare(function: F) -> F:
        mark = _mark(function)
        before = dict(mark.inputs or {})
        return _marked(function, replace(mark, inputs={name: _type(type), **before}))

    return declare


def output(type: Any, name: str) -> Callable[[F], F]:
    """Declare the output of a method."""

    def declare(function: F) -> F:
        return _marked(function, replace(_mark(function), output=name, result=_type(type)))

    return declare


def _type(given: Any) -> Any:
    return given.single if isinstance(given, _Number) else given


def _mark(function: Any) -> Mark:
    mark: Mark = getattr(function, own.MARK, Mark(inputs={}))
    return mark


def _marked(function: F, mark: Mark) -> F:
    setattr(function, own.MARK, mark)
    return function


@contextmanager
def named_brass(module: str = __name__) -> Iterator[None]:
    """Let ``import brass`` find a module, this one by default, in the block."""
    before = sys.modules.get("brass")
    sys.modules["brass"] = importlib.import_module(module)
    try:
        yield
    finally:
        if before is None:
            del sys.modules["brass"]
        else:
            sys.modules["brass"] = before
