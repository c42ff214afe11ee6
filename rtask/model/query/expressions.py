"""Expressions of object queries: paths along fields, conditions, orders and aggregates."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from rtask.errors import UsageError
from rtask.model.instance import Model, Property
from rtask.model.missing import subclasses_with
from rtask.rdf.terms import Literal, NamedNode

__all__ = [
    "After",
    "Aggregate",
    "And",
    "Compare",
    "Condition",
    "Having",
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
_ELSEWHERE = {
    "like": "contains(), startswith(), endswith() or matches()",
    "ilike": "contains(text, ignore_case=True) or matches(pattern, ignore_case=True)",
    "is_": "== , or is_none()",
    "is_not": "!= , or ~path.is_none()",
    "not_in": "~path.in_(values)",
    "desc": "-path in order_by()",
    "asc": "the path itself in order_by()",
}
"""Names of SQLAlchemy, and what does the same here."""


class Condition:
    """A condition on an object; combine with ``&``, ``|`` and ``~``."""

    def __and__(self, other: Condition) -> Condition:
        return And((self, other))

    def __or__(self, other: Condition) -> Condition:
        return Or((self, other))

    def __invert__(self) -> Condition:
        return Not(self)

    def __bool__(self) -> bool:
        raise UsageError("a condition has no truth value; combine conditions with & | ~")


class Path(Generic[T]):
    """A path along fields, from the class of the query.

    Created by accessing a field on a class: ``RTASK.GraspConfiguration.grasp_of.mass``. Its type
    argument is the type of the plain values at its end; that of an object is ``str``, its IRI.

    Parameters
    ----------
    root
        The class at which it begins.
    steps
        The fields along it.
    """

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, root: type[Model], steps: tuple[Property, ...]) -> None:
        self._root = root
        self._steps = steps

    def __getattr__(self, name: str) -> Path[Any]:
        if name.startswith("__"):  # attributes that Python itself looks up, e.g. for copying
            raise AttributeError(name)
        if name in _ELSEWHERE and not self._has_field(name):
            raise AttributeError(f"there is no {name}() on a field; use {_ELSEWHERE[name]}")
        model = self._steps[-1].target()
        if model is None:
            raise AttributeError(f"{self!r} holds plain values; it has no field {name!r}")
        step = model.__fields__.get(name)
        if step is None:
            near = difflib.get_close_matches(name, model.__fields__, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            if narrower := subclasses_with(model, name):
                hint = (
                    f", but {' and '.join(narrower)} has: add .prefetch({self!r}), and read it of "
                    "the results"
                )
            raise AttributeError(f"{model.__name__} has no field {name!r}{hint}")
        return Path(self._root, (*self._steps, step))

    def _has_field(self, name: str) -> bool:
        model = self._steps[-1].target()
        return model is not None and name in model.__fields__

    def __repr__(self) -> str:
        return ".".join([self._root.__name__, *(step.name for step in self._steps)])

    # Narrower than object's: with a value of another type the other operand's `==` counts to a
    # checker, which gives a bool, and that is no condition.
    def __eq__(self, other: T | Model | NamedNode | Literal) -> Condition:  # type: ignore[override]
        return Compare(self, "=", other)

    def __ne__(self, other: T | Model | NamedNode | Literal) -> Condition:  # type: ignore[override]
        return Compare(self, "!=", other)

    def __lt__(self, other: T) -> Condition:
        return Compare(self, "<", other)

    def __le__(self, other: T) -> Condition:
        return Compare(self, "<=", other)

    def __gt__(self, other: T) -> Condition:
        return Compare(self, ">", other)

    def __ge__(self, other: T) -> Condition:
        return Compare(self, ">=", other)

    def __neg__(self) -> Order:
        return Order(self, descending=True)

    def in_(self, values: Iterable[T | Model | NamedNode | Literal]) -> Condition:
        """Hold if a value is one of these."""
        return In(self, tuple(values))

    def contains(self, text: str, *, ignore_case: bool = False) -> Condition:
        """Hold if a value contains the text."""
        return Text(self, "CONTAINS", text, ignore_case)

    def matches(self, pattern: str, *, ignore_case: bool = False) -> Condition:
        """Hold if a value matches the regular expression."""
        return Text(self, "REGEX", pattern, ignore_case)

    def startswith(self, text: str, *, ignore_case: bool = False) -> Condition:
        """Hold if a value starts with the text."""
        return Text(self, "STRSTARTS", text, ignore_case)

    def endswith(self, text: str, *, ignore_case: bool = False) -> Condition:
        """Hold if a value ends with the text."""
        return Text(self, "STRENDS", text, ignore_case)

    def between(self, low: T, high: T) -> Condition:
        """Hold if a value lies between two bounds, inclusive."""
        return And((Compare(self, ">=", low), Compare(self, "<=", high)))

    def is_none(self) -> Condition:
        """Hold if there is no value."""
        return Missing(self)


def steps(path: Path[Any]) -> tuple[Property, ...]:
    """Return the fields along a path."""
    return path._steps


def root(path: Path[Any]) -> type[Model]:
    """Return the class at which a path begins."""
    return path._root


@dataclass(frozen=True, eq=False)
class Compare(Condition):
    """Comparison of a value with a constant."""

    path: Path[Any]
    operator: str
    value: object


@dataclass(frozen=True, eq=False)
class In(Condition):
    """Membership of a value in a list."""

    path: Path[Any]
    values: tuple[object, ...]


@dataclass(frozen=True, eq=False)
class Text(Condition):
    """A SPARQL string function applied to a value."""

    path: Path[Any]
    function: str
    text: str
    ignore_case: bool


@dataclass(frozen=True, eq=False)
class Missing(Condition):
    """Absence of a value."""

    path: Path[Any]


@dataclass(frozen=True, eq=False)
class Not(Condition):
    """Negation of a condition."""

    condition: Condition


@dataclass(frozen=True, eq=False)
class And(Condition):
    """Conjunction; equal paths refer to the same value."""

    conditions: tuple[Condition, ...]


@dataclass(frozen=True, eq=False)
class Or(Condition):
    """Disjunction of conditions."""

    conditions: tuple[Condition, ...]


@dataclass(frozen=True, eq=False)
class Raw(Condition):
    """A SPARQL pattern about ``?root``, which may use the prefixes of the ontology."""

    pattern: str


@dataclass(frozen=True, eq=False)
class After(Condition):
    """Condition that the object's IRI sorts after a text."""

    name: str


@dataclass(frozen=True, eq=False)
class Order:
    """A sort key."""

    path: Path[Any]
    descending: bool = False


@dataclass(frozen=True, eq=False)
class Aggregate:
    """A number computed for each group; compare it to get a condition for ``having``."""

    function: str
    path: Path[Any] | None

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> Having:  # type: ignore[override]
        return Having(self, "=", other)

    def __ne__(self, other: object) -> Having:  # type: ignore[override]
        return Having(self, "!=", other)

    def __lt__(self, other: object) -> Having:
        return Having(self, "<", other)

    def __le__(self, other: object) -> Having:
        return Having(self, "<=", other)

    def __gt__(self, other: object) -> Having:
        return Having(self, ">", other)

    def __ge__(self, other: object) -> Having:
        return Having(self, ">=", other)


@dataclass(frozen=True, eq=False)
class Having:
    """Comparison of a group's number with a constant."""

    number: Aggregate
    operator: str
    value: object

    def __bool__(self) -> bool:
        raise UsageError("a condition has no truth value; pass several conditions to having()")


def count(path: Path[Any] | None = None) -> Aggregate:
    """Count the objects of a group, or different values along a path."""
    return Aggregate("COUNT", path)


def avg(path: Path[Any]) -> Aggregate:
    """Average the values along a path."""
    return Aggregate("AVG", path)


def total(path: Path[Any]) -> Aggregate:
    """Sum the values along a path."""
    return Aggregate("SUM", path)


def minimum(path: Path[Any]) -> Aggregate:
    """Return the minimum of the values along a path."""
    return Aggregate("MIN", path)


def maximum(path: Path[Any]) -> Aggregate:
    """Return the maximum of the values along a path."""
    return Aggregate("MAX", path)
