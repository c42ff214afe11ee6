"""Immutable builder of object queries; each runs as one SPARQL query."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Generic, NoReturn, TypeVar, overload

from rtask.errors import FieldError, UnknownTermError, UsageError
from rtask.model.instance import Model, absent, eager
from rtask.model.query import compile as compiled
from rtask.model.query.assembly import Assembly, PlainAnswers, plain_value
from rtask.model.query.expressions import (
    After,
    Aggregate,
    And,
    Compare,
    Condition,
    Having,
    In,
    Missing,
    Not,
    Or,
    Order,
    Path,
    Raw,
    Text,
    maximum,
    minimum,
    total,
)
from rtask.model.query.plan import check_root

__all__ = ["Query"]

_ELSEWHERE = {
    "filter": "where(Model.field == value)",
    "filter_by": "where(Model.field == value)",
    "one_or_none": "first(), or one() if there must be one",
    "scalars": "all(), or iterate over the query",
    "scalar": "one(), min(), max() or sum()",
    "get": "session.get(Model, iri)",
    "join": "a path, such as where(Model.link.field == value)",
    "options": "prefetch(Model.link)",
    "distinct": "all(), which returns each object once",
}
M = TypeVar("M", bound=Model)
T = TypeVar("T")


class Query(PlainAnswers, Generic[M]):
    """A query for objects of a class; created by :meth:`Session.query`.

    Every method that restricts it returns a new query. Nothing is sent until a result is
    requested, and then a single query.
    """

    if not TYPE_CHECKING:  # type checkers name attributes that are not there themselves

        def __getattr__(self, name: str) -> NoReturn:
            raise absent("query", name, _ELSEWHERE)

    def _with(self, **changes: Any) -> Query[M]:
        return Query(self._session, replace(self._plan, **changes))

    # Narrowing

    def where(self, *conditions: Condition) -> Query[M]:
        """Keep the objects for which all conditions hold.

        Within one call, equal paths refer to the same value: ``where(G.has_view.a == 1,
        G.has_view.b == 2)`` requires one view with both.
        """
        for condition in conditions:
            for path in _paths(condition):
                check_root(self._plan, path)
        return self._with(conditions=(*self._plan.conditions, conditions))

    def raw(self, pattern: str) -> Query[M]:
        """Keep the objects ``?root`` that match a SPARQL pattern."""
        return self.where(Raw(pattern))

    def order_by(self, *keys: Path[Any] | Order) -> Query[M]:
        """Sort by these paths; ``-path`` sorts descending."""
        orders = tuple(key if isinstance(key, Order) else Order(key) for key in keys)
        for order in orders:
            check_root(self._plan, order.path)
        return self._with(orders=orders)

    def limit(self, number: int) -> Query[M]:
        """Return at most this many objects."""
        return self._with(limit=_count(number))

    def offset(self, number: int) -> Query[M]:
        """Skip this many objects."""
        return self._with(offset=_count(number))

    def prefetch(self, *paths: Path[Any]) -> Query[M]:
        """Read the objects at the end of these paths in the same query."""
        steps = [check_root(self._plan, path) for path in paths]
        for path, along in zip(paths, steps, strict=True):
            if not along[-1].is_link:
                raise UsageError(f"{path!r} holds plain values, which are read anyway")
        return self._with(prefetch=(*self._plan.prefetch, *steps))

    # Answers

    def sparql(self) -> str:
        """Return the one query that :meth:`all` runs."""
        return compiled.object_text(self._plan)

    def explain(self) -> str:
        """Describe the query for people: its text, the effect of each step and what is prefetched.

        Each ``where`` is counted together with those before it, which shows the one that leaves
        nothing.
        """
        plan, query = self._plan, self._with(conditions=(), limit=None, offset=0, orders=())
        lines = [f"{query.count():7d}  {plan.model.__name__}"]
        for at, conditions in enumerate(plan.conditions):
            query = query.where(*conditions)
            named = ", ".join(dict.fromkeys(repr(p) for c in conditions for p in _paths(c)))
            lines.append(f"{query.count():7d}  after where {at + 1}: {named or 'a raw pattern'}")
        if plan.limit is not None or plan.offset:
            some = "all" if plan.limit is None else plan.limit
            lines.append(f"         then {some} of them from number {plan.offset} on")
        eager_iris = eager(plan.model, plan.following(()))
        lines.append(f"{len(eager_iris):7d}  properties are read with each")
        for path in plan.prefetch:
            steps = ".".join(step.name for step in path)
            model = path[-1].target() or Model
            lines.append(
                f"         and {steps}: a {model.__name__}, {len(eager(model))} properties"
            )
        return "\n".join([*lines, "", self.sparql()])

    def all(self) -> list[M]:
        """Return the objects, in order."""
        rows = self._select(compiled.object_text(self._plan))
        return Assembly(self._session.reader, self._plan, rows).objects()

    def __iter__(self) -> Iterator[M]:
        return iter(self.all())

    @overload
    def __getitem__(self, at: int) -> M: ...
    @overload
    def __getitem__(self, at: slice) -> list[M]: ...
    def __getitem__(self, at: int | slice) -> M | list[M]:
        """Return one object by position, or those of a slice; the rest is not read.

        Raises
        ------
        IndexError
            If there is no object at the position.
        UsageError
            For negative positions, and for slices with a step.
        """
        if isinstance(at, int):
            items = self[_count(at) : at + 1]
            if not items:
                raise IndexError(f"no {self._plan.model.__name__} at position {at}")
            return items[0]
        if at.step not in (None, 1):
            raise UsageError("a slice of a query takes no step")
        start = 0 if at.start is None else _count(at.start)
        left = None if self._plan.limit is None else max(self._plan.limit - start, 0)
        if at.stop is not None:
            count = max(_count(at.stop) - start, 0)
            left = count if left is None else min(left, count)
        return self._with(offset=self._plan.offset + start, limit=left).all()

    def stream(self, batch: int = 500) -> Iterator[M]:
        """Yield the objects ordered by IRI, batch by batch.

        Memory use is constant. Each batch is one query, which begins after the last IRI.
        """
        self._check_batch(batch, "stream()")
        return self._objects(batch)

    def _objects(self, batch: int) -> Iterator[M]:
        last = ""
        while True:
            objects = Query[M](self._session, self._page(last, batch)).all()
            yield from objects
            if len(objects) < batch:
                return
            last = max(item.iri for item in objects)

    def _at_most(self, number: int) -> Query[M]:
        limit = self._plan.limit
        return self.limit(number if limit is None else min(number, limit))

    def first(self) -> M | None:
        """Return the first object, or ``None``."""
        items = self._at_most(1).all()
        return items[0] if items else None

    def one(self) -> M:
        """Return the only object.

        Raises
        ------
        UnknownTermError
            If there is none.
        UsageError
            If there are several.
        """
        items = self._at_most(2).all()
        name = self._plan.model.__name__
        if not items:
            raise UnknownTermError(f"no {name} matches the query")
        if len(items) > 1:
            raise UsageError(f"several {name} match the query, among them {items[0]}, {items[1]}")
        return items[0]

    def group_by(self, *paths: Path[Any]) -> Groups:
        """Group the objects by the values along paths."""
        for path in paths:
            check_root(self._plan, path)
        return Groups(self, paths)

    def aggregate(self, **columns: Aggregate) -> dict[str, Any]:
        """Return aggregates over all objects."""
        return Groups(self, ()).aggregate(**columns)[0]

    def min(self, path: Path[T]) -> T | None:
        """Return the minimum of the values along a path, ``None`` if there is none."""
        least: T | None = self._number(minimum(path))
        return least

    def max(self, path: Path[T]) -> T | None:
        """Return the maximum of the values along a path, ``None`` if there is none."""
        greatest: T | None = self._number(maximum(path))
        return greatest

    def sum(self, path: Path[T]) -> T:
        """Return the sum of the values along a path, 0 if there is none."""
        total_: T = self._number(total(path))
        return total_

    def _number(self, number: Aggregate) -> Any:
        if self._plan.limit is not None or self._plan.offset:
            raise UsageError("aggregates cover all objects: remove limit and offset")
        return self.aggregate(number=number)["number"]

    # Changing

    def update(self, **values: object) -> int:
        """Assign values to fields of all objects found; ``None`` unsets a field.

        The changes obey the rules of single objects and are written with the other changes of
        the session.

        Returns
        -------
        int
            The number of objects.
        """
        fields = []
        for name in values:
            if name not in self._plan.model.__fields__:
                raise FieldError(f"{self._plan.model.__name__} has no field {name!r}", field=name)
            fields.append(self._plan.model.__fields__[name])
        query = self.prefetch(*(Path(self._plan.model, (f,)) for f in fields if f.is_link))
        instances = query._present()
        for item in instances:
            for name, value in values.items():
                if value is None:
                    delattr(item, name)
                else:
                    setattr(item, name, value)
        return len(instances)

    def delete(self) -> int:
        """Delete all objects found, each as :meth:`Session.delete` does; return their number."""
        instances = self._present()
        for item in instances:
            self._session.delete(item)
        return len(instances)

    def _present(self) -> list[M]:
        """Return the objects that are not yet marked for deletion."""
        return [item for item in self.all() if not item.__state__.deleted]

    def __repr__(self) -> str:
        return f"<Query for {self._plan.model.__name__}>"


class Groups:
    """Objects grouped by some of their values."""

    def __init__(
        self, query: Query[Any], paths: tuple[Path[Any], ...], having: tuple[Having, ...] = ()
    ) -> None:
        self._query = query
        self._paths = paths
        self._having = having

    def having(self, *conditions: Having) -> Groups:
        """Keep the groups whose aggregates satisfy all conditions, such as ``count() > 1``."""
        for condition in conditions:
            if not isinstance(condition, Having):
                raise UsageError(f"not a condition on a group: {condition!r}; use count() > 1")
        return Groups(self._query, self._paths, (*self._having, *conditions))

    def aggregate(self, **columns: Aggregate) -> list[dict[str, Any]]:
        """Return one dictionary per group: path names and the named aggregates."""
        plan = self._query._plan
        for column in (*columns.values(), *(condition.number for condition in self._having)):
            if not isinstance(column, Aggregate):
                raise UsageError(f"not an aggregate: {column!r}; use count(), avg(path) and so on")
            if column.path is not None:
                check_root(plan, column.path)
        text = compiled.aggregate_text(plan, self._paths, list(columns.values()), self._having)
        names = [check_root(plan, path)[-1].name for path in self._paths]
        rows = self._query._select(text)
        return [dict(zip([*names, *columns], map(plain_value, row), strict=True)) for row in rows]


def _paths(condition: Condition) -> Iterable[Path[Any]]:
    match condition:
        case And(inner) | Or(inner):
            for part in inner:
                yield from _paths(part)
        case Not(part):
            yield from _paths(part)
        case Compare(path) | In(path) | Text(path) | Missing(path):
            yield path
        case Raw() | After():
            return
        case _:
            raise UsageError(f"not a condition: {condition!r}; use == < > in_ & | ~")


def _count(number: int) -> int:
    if isinstance(number, bool) or not isinstance(number, int) or number < 0:
        raise UsageError(f"expected a number of objects, 0 or more, not {number!r}")
    return number
