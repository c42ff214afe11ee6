"""What a query asks for: paths along fields, conditions on them, orders."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.model.fields import Field
    from rtask.model.instance import Model

__all__ = [
    "After",
    "Aggregate",
    "And",
    "Compare",
    "Condition",
    "In",
    "Missing",
    "Not",
    "Or",
    "Order",
    "Path",
    "Raw",
    "Text",
    "avg",
    "count",
    "maximum",
    "minimum",
    "total",
]

T = TypeVar("T")


class Condition:
    """Something that holds of an object or not; combine with ``&``, ``|`` and ``~``."""

    def __and__(self, other: Condition) -> Condition:
        return And((self, other))

    def __or__(self, other: Condition) -> Condition:
        return Or((self, other))

    def __invert__(self) -> Condition:
        return Not(self)

    def __bool__(self) -> bool:
        raise UsageError("a condition has no truth value; combine conditions with & | ~")


class Path(Generic[T]):
    """A way along fields, from the class that a query asks for.

    Made by naming a field on a class: ``RTASK.GraspConfiguration.grasp_of.mass``.

    Parameters
    ----------
    root
        The class where it begins.
    steps
        The fields along it.
    """

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, root: type[Model], steps: tuple[Field, ...]) -> None:
        self._root = root
        self._steps = steps

    def __getattr__(self, name: str) -> Path[Any]:
        if name.startswith("__"):  # what Python itself looks for, e.g. to copy
            raise AttributeError(name)
        model = self._steps[-1].target()
        if model is None:
            raise AttributeError(f"{self!r} holds plain values; it has no field {name!r}")
        step = model.__fields__.get(name)
        if step is None:
            near = difflib.get_close_matches(name, model.__fields__, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise AttributeError(f"{model.__name__} has no field {name!r}{hint}")
        return Path(self._root, (*self._steps, step))

    def __repr__(self) -> str:
        return ".".join([self._root.__name__, *(step.name for step in self._steps)])

    def __eq__(self, other: object) -> Condition:  # type: ignore[override]
        return Compare(self, "=", other)

    def __ne__(self, other: object) -> Condition:  # type: ignore[override]
        return Compare(self, "!=", other)

    def __lt__(self, other: object) -> Condition:
        return Compare(self, "<", other)

    def __le__(self, other: object) -> Condition:
        return Compare(self, "<=", other)

    def __gt__(self, other: object) -> Condition:
        return Compare(self, ">", other)

    def __ge__(self, other: object) -> Condition:
        return Compare(self, ">=", other)

    def __neg__(self) -> Order:
        return Order(self, descending=True)

    def in_(self, values: Iterable[object]) -> Condition:
        """Hold where a value is one of these."""
        return In(self, tuple(values))

    def contains(self, text: str, *, ignore_case: bool = False) -> Condition:
        """Hold where a value contains the text."""
        return Text(self, "CONTAINS", text, ignore_case)

    def matches(self, pattern: str, *, ignore_case: bool = False) -> Condition:
        """Hold where a value matches the regular expression."""
        return Text(self, "REGEX", pattern, ignore_case)

    def is_none(self) -> Condition:
        """Hold where there is no value."""
        return Missing(self)


def steps(path: Path[Any]) -> tuple[Field, ...]:
    """Return the fields along a path."""
    return path._steps


def root(path: Path[Any]) -> type[Model]:
    """Return the class where a path begins."""
    return path._root


@dataclass(frozen=True, eq=False)
class Compare(Condition):
    """A value stands in a relation to a constant."""

    path: Path[Any]
    operator: str
    value: object


@dataclass(frozen=True, eq=False)
class In(Condition):
    """A value is one of several."""

    path: Path[Any]
    values: tuple[object, ...]


@dataclass(frozen=True, eq=False)
class Text(Condition):
    """A SPARQL string function holds of a value."""

    path: Path[Any]
    function: str
    text: str
    ignore_case: bool


@dataclass(frozen=True, eq=False)
class Missing(Condition):
    """There is no value."""

    path: Path[Any]


@dataclass(frozen=True, eq=False)
class Not(Condition):
    """The condition does not hold."""

    condition: Condition


@dataclass(frozen=True, eq=False)
class And(Condition):
    """All hold; values along one path are the same value."""

    conditions: tuple[Condition, ...]


@dataclass(frozen=True, eq=False)
class Or(Condition):
    """At least one holds."""

    conditions: tuple[Condition, ...]


@dataclass(frozen=True, eq=False)
class Raw(Condition):
    """A SPARQL pattern about ``?root``, in the prefixes of the ontology."""

    pattern: str


@dataclass(frozen=True, eq=False)
class After(Condition):
    """The object's IRI sorts behind a text."""

    name: str


@dataclass(frozen=True, eq=False)
class Order:
    """What to sort by."""

    path: Path[Any]
    descending: bool = False


@dataclass(frozen=True, eq=False)
class Aggregate:
    """One number about each group."""

    function: str
    path: Path[Any] | None


def count(path: Path[Any] | None = None) -> Aggregate:
    """Count the objects of a group, or different values along a path."""
    return Aggregate("COUNT", path)


def avg(path: Path[Any]) -> Aggregate:
    """Take the mean of the values along a path."""
    return Aggregate("AVG", path)


def total(path: Path[Any]) -> Aggregate:
    """Add up the values along a path."""
    return Aggregate("SUM", path)


def minimum(path: Path[Any]) -> Aggregate:
    """Take the least value along a path."""
    return Aggregate("MIN", path)


def maximum(path: Path[Any]) -> Aggregate:
    """Take the greatest value along a path."""
    return Aggregate("MAX", path)
