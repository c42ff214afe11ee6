"""Compile object queries to SPARQL, each to one query.

The class and the conditions appear once, in a sub-select at the beginning; each branch of the
union then fetches the statements of one kind of object (SPARQL 1.1 Query, 12 and 18.2). The text of
a query is cached by its shape: the same query with another value is not compiled again.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from decimal import Decimal
from itertools import cycle
from typing import Any

from rtask.errors import UsageError
from rtask.model.codec import RDF_TYPE, THING, encode
from rtask.model.instance import Model, Property, class_iris, eager
from rtask.model.query.expressions import Aggregate, Having, Order, Path, steps
from rtask.model.query.patterns import MARK, Names, Scope, shape
from rtask.model.query.plan import Plan, finished, short
from rtask.model.registry import generation
from rtask.rdf.terms import Literal, Term, literal

__all__ = [
    "aggregate_text",
    "ask_text",
    "count_text",
    "fetch_filter",
    "id_text",
    "object_text",
    "page_text",
    "row_text",
]

_MAX_CACHED = 512
_cache: OrderedDict[Hashable, str] = OrderedDict()


def _compiled(plan: Plan, extra: Hashable, write: Callable[[], str]) -> str:
    """Return the text of a query with its prefixes, from the cache if its shape is known.

    Parameters
    ----------
    extra
        Everything else that the text depends on.
    write
        Writes the text, with a mark for each constant of the plan's conditions, in order.
    """
    constants: list[Term] = []
    shapes = tuple(tuple(shape(c, constants) for c in group) for group in plan.conditions)
    orders = tuple((steps(order.path), order.descending) for order in plan.orders)
    key = (plan.model, generation(), plan.inferred, shapes, orders)
    key += (plan.limit, plan.offset, plan.prefetch, extra)  # type: ignore[assignment]
    text = _cache.get(key)
    if text is None:
        text = _cache[key] = finished(write())
        while len(_cache) > _MAX_CACHED:
            _cache.popitem(last=False)
    if not constants:
        return text
    *pieces, last = text.split(MARK)
    # a text may contain the conditions several times, each time in full
    return "".join(f"{piece}{constant}" for piece, constant in zip(pieces, cycle(constants))) + last


Bound = dict[tuple[str, ...], str]


def _group(plan: Plan, names: Names) -> tuple[list[str], Bound]:
    """Return the patterns that select the roots, and the variables of single values.

    A path whose properties all have at most one value gets a single variable.
    """
    lines, single = list[str](), Bound()
    for iri in class_iris(plan.model):
        if iri in ("", THING):  # everything is an owl:Thing without being stated to be one
            lines.append(f"?root a {names.fresh()} .")
        elif plan.inferred:
            lines.append(f"?root a {short(iri)} .")
        else:
            kind = names.fresh()
            lines.append(f"?root a {kind} . {kind} rdfs:subClassOf* {short(iri)} .")
    for together in plan.conditions:
        scope = Scope(names, plan.inferred)
        for condition in together:
            scope.add(condition)
        lines += scope.lines
        single.update(scope.bound)
    return lines, single


def _keys(plan: Plan, names: Names, bound: Bound) -> tuple[list[str], list[str]]:
    """Return OPTIONAL patterns that bind the sort keys, and the keys' variables."""
    lines, variables = [], []
    for order in plan.orders:
        path = tuple(step.iri for step in steps(order.path))
        if path in bound and _is_single(order):
            variables.append(bound[path])
            continue
        scope = Scope(names, plan.inferred)
        variables.append(scope.walk(steps(order.path)))
        lines.append(f"OPTIONAL {scope.group()}")
    return lines, variables


def _is_single(order: Order) -> bool:
    return all(step.functional for step in steps(order.path))


def _slice(plan: Plan) -> str:
    limit = f" LIMIT {plan.limit}" if plan.limit is not None else ""
    return limit + (f" OFFSET {plan.offset}" if plan.offset else "")


def _roots(plan: Plan) -> str:
    """Return the sub-select of the roots with their sort keys ``?key0``, ``?key1``...

    A root with several values of a key is sorted by the smallest, or the largest if descending.
    """
    names = Names()
    lines, bound = _group(plan, names)
    optional, variables = _keys(plan, names, bound)
    body = "\n    ".join([*lines, *optional])
    if not plan.orders:
        order = " ORDER BY ?root" if _slice(plan) else ""
        return f"SELECT DISTINCT ?root WHERE {{\n    {body}\n  }}{order}{_slice(plan)}"
    single = all(map(_is_single, plan.orders))
    picks, sorts = [], []
    for at, (order_by, variable) in enumerate(zip(plan.orders, variables, strict=True)):
        extreme = "MAX" if order_by.descending else "MIN"
        picks.append(f"({variable if single else f'{extreme}({variable})'} AS ?key{at})")
        sorts.append(f"{'DESC' if order_by.descending else 'ASC'}(?key{at})")
    distinct, grouped = ("DISTINCT ", "") if single else ("", " GROUP BY ?root")
    return (
        f"SELECT {distinct}?root {' '.join(picks)} WHERE {{\n    {body}\n  }}"
        f"{grouped} ORDER BY {' '.join(sorts)} ?root{_slice(plan)}"
    )


def fetch_filter(model: type[Model], more: Sequence[Property] = ()) -> str:
    """Return the list of properties to fetch, for ``FILTER(?p IN (...))``."""
    return ", ".join(map(short, [RDF_TYPE, *sorted(eager(model, more))]))


def object_text(plan: Plan) -> str:
    """Return the query for objects and what is prefetched with them."""
    return _compiled(plan, "objects", lambda: _object_text(plan))


def _object_text(plan: Plan) -> str:
    keys = "".join(f" ?key{at}" for at in range(len(plan.orders)))
    prefixes = {path[:n] for path in plan.prefetch for n in range(1, len(path) + 1)}
    branches = []
    for path in ((), *sorted(prefixes, key=lambda p: [step.iri for step in p])):
        model = (path[-1].target() if path else plan.model) or Model
        following = plan.following(path)
        start, own = _start(path, plan.inferred), "?s" if path else "?root"
        bind = "" if path else " BIND(?root AS ?s)"
        inside = fetch_filter(model, following)
        branches.append(f"{{ {start}{own} ?p ?o FILTER(?p IN ({inside})){bind} }}")
        if not plan.inferred:
            branches += _derived(start, own, bind, following)
    union = "\n  UNION\n  ".join(branches)
    return f"SELECT DISTINCT ?root ?s ?p ?o{keys} WHERE {{\n  {{ {_roots(plan)} }}\n  {union}\n}}"


def _start(path: Sequence[Property], inferred: bool) -> str:
    """Return the patterns that lead from ``?root`` to ``?s``."""
    if not path:
        return ""
    scope = Scope(Names(), inferred)
    before = scope.walk(path[:-1])
    return " ".join([*scope.lines, f"{before} {scope.property(path[-1])} ?s . "])


def _derived(start: str, own: str, bind: str, following: Iterable[Property]) -> list[str]:
    """Return branches for inverse properties, which are not derived without inference."""
    return [
        f"{{ {start}?o {short(step.inverse)} {own} BIND({short(step.iri)} AS ?p){bind} }}"
        for step in following
        if not step.stored and step.inverse
    ]


def row_text(plan: Plan, paths: Sequence[Path[Any]]) -> str:
    """Return a query for plain values; one row for each combination."""
    extra = ("rows", *map(steps, paths))
    return _compiled(plan, extra, lambda: _row_text(plan, paths))


def _row_text(plan: Plan, paths: Sequence[Path[Any]]) -> str:
    names = Names()
    lines, bound = _group(plan, names)
    lines += _columns(plan, names, paths)
    picks = [f"?value{at}" for at in range(len(paths))]
    optional, variables = _keys(plan, names, bound)
    sorts = [
        f"{'DESC' if order.descending else 'ASC'}({variable})"
        for order, variable in zip(plan.orders, variables, strict=True)
    ]
    tail = f" ORDER BY {' '.join([*sorts, '?root'])}{_slice(plan)}"
    chosen = " ".join(["?root", *picks, *dict.fromkeys(variables)])
    body = "\n  ".join([*lines, *optional])
    return f"SELECT DISTINCT {chosen} WHERE {{\n  {body}\n}}{tail}"


def _columns(plan: Plan, names: Names, paths: Sequence[Path[Any]]) -> Iterator[str]:
    """Yield a pattern for each path that binds ``?value0``, ``?value1``... where there is one."""
    for at, path in enumerate(paths):
        scope = Scope(names, plan.inferred)
        variable = scope.walk(steps(path))
        yield "OPTIONAL { " + " ".join(scope.lines) + f" BIND({variable} AS ?value{at}) }}"


def page_text(plan: Plan, paths: Sequence[Path[Any]]) -> str:
    """Return a query for the plain values of a limited number of roots, with all rows of each."""

    def write() -> str:
        body = "\n  ".join([f"{{ {_roots(plan)} }}", *_columns(plan, Names(), paths)])
        picks = " ".join(f"?value{at}" for at in range(len(paths)))
        return f"SELECT DISTINCT ?root {picks} WHERE {{\n  {body}\n}} ORDER BY ?root"

    return _compiled(plan, ("page", *map(steps, paths)), write)


def id_text(plan: Plan) -> str:
    """Return a query for the IRIs of the roots, in order."""
    return _compiled(plan, "ids", lambda: _roots(plan))


def count_text(plan: Plan) -> str:
    """Return a query for the number of roots."""

    def write() -> str:
        if plan.limit is not None or plan.offset:
            return f"SELECT (COUNT(?root) AS ?n) WHERE {{ {{ {_roots(plan)} }} }}"
        body = "\n  ".join(_group(plan, Names())[0])
        return f"SELECT (COUNT(DISTINCT ?root) AS ?n) WHERE {{\n  {body}\n}}"

    return _compiled(plan, "count", write)


def ask_text(plan: Plan) -> str:
    """Return a query that asks whether there is a root."""

    def write() -> str:
        return "ASK {\n  " + "\n  ".join(_group(plan, Names())[0]) + "\n}"

    return _compiled(plan, "ask", write)


def aggregate_text(
    plan: Plan,
    groups: Sequence[Path[Any]],
    columns: Sequence[Aggregate],
    having: Sequence[Having] = (),
) -> str:
    """Return a query for aggregates of groups of roots: ``?group0``... and ``?column0``..."""
    every = [*columns, *(condition.number for condition in having)]
    numbers = tuple((c.function, c.path and steps(c.path)) for c in every)
    conditions = tuple(
        f"FILTER(?column{at} {condition.operator} {_having_constant(condition)})"
        for at, condition in enumerate(having, len(columns))
    )
    extra = ("groups", tuple(map(steps, groups)), numbers, len(columns), conditions)
    return _compiled(
        plan, extra, lambda: _aggregate_text(plan, groups, every, len(columns), conditions)
    )


def _having_constant(condition: Having) -> Literal:
    """Return the constant with which an aggregate is compared."""
    value, path = condition.value, condition.number.path
    along = () if path is None else steps(path)
    if condition.number.function in ("MIN", "MAX") and along and not along[-1].is_link:
        constant = encode(value, along[-1].value)
    elif isinstance(value, bool) or not isinstance(value, int | float | Decimal):
        raise UsageError(f"an aggregate is compared with a number, not with {value!r}")
    else:
        constant = literal(value)
    if MARK in str(constant):
        raise UsageError("a constant cannot hold the character U+0000")
    return constant


def _aggregate_text(
    plan: Plan,
    groups: Sequence[Path[Any]],
    columns: Sequence[Aggregate],
    shown: int,
    conditions: Sequence[str],
) -> str:
    """Write one sub-select per path, so that the values of one do not multiply those of another.

    Parameters
    ----------
    shown
        Number of columns to return; the others are only compared.
    conditions
        Filters of the groups.
    """
    by = [f"?group{at}" for at in range(len(groups))]
    parts: dict[tuple[Property, ...] | None, dict[int, Aggregate]] = {}
    for at, column in enumerate(columns):
        path = None if column.path is None else steps(column.path)
        parts.setdefault(path, {})[at] = column
    if (
        len(parts) > 1 and None in parts
    ):  # roots are counted once, even if other paths multiply their rows
        counts = parts.pop(None)
        next(iter(parts.values())).update(counts)
    texts = [_numbers_text(plan, groups, path, part) for path, part in parts.items()]
    texts = texts or [_numbers_text(plan, groups, None, {})]
    picks = [*by, *(f"?column{at}" for at in range(shown))]
    tail = f" ORDER BY {' '.join(by)}" if by else ""
    joined = "\n  ".join([*(f"{{ {text} }}" for text in texts), *conditions])
    return f"SELECT {' '.join(picks)} WHERE {{\n  {joined}\n}}{tail}"


def _numbers_text(
    plan: Plan,
    groups: Sequence[Path[Any]],
    along: tuple[Property, ...] | None,
    columns: dict[int, Aggregate],
) -> str:
    names = Names()
    lines, _ = _group(plan, names)
    scope = Scope(names, plan.inferred)
    by = [scope.walk(steps(path)) for path in groups]
    lines += scope.lines
    variable = ""
    if along is not None:
        inner = Scope(names, plan.inferred)
        variable = inner.walk(along)
        lines.append(f"OPTIONAL {inner.group()}")
    picks = [f"({name} AS ?group{at})" for at, name in enumerate(by)]
    for at, column in columns.items():
        what = "DISTINCT ?root" if column.path is None else variable
        if column.path is not None and column.function == "COUNT":
            what = f"DISTINCT {variable}"
        picks.append(f"({column.function}({what}) AS ?column{at})")
    tail = f" GROUP BY {' '.join(by)}" if by else ""
    chosen = " ".join(picks) or "*"
    return f"SELECT {chosen} WHERE {{ {' '.join(lines)} }}{tail}"
