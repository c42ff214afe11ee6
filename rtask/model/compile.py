"""Queries over objects to SPARQL: always one query.

The class and the conditions stand once, in a sub-select in front; each branch of the union
then fetches the statements of one kind of object (SPARQL 1.1 Query, 12 and 18.2).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import ontology
from rtask.errors import UsageError
from rtask.kb.terms import Literal, NamedNode, Term, prologue
from rtask.model.codec import decode
from rtask.model.expressions import (
    Aggregate,
    And,
    Compare,
    Condition,
    In,
    Missing,
    Not,
    Or,
    Order,
    Path,
    Raw,
    Text,
    root,
    steps,
)
from rtask.model.fields import Field, term
from rtask.model.instance import Model, class_iris, family

__all__ = ["Plan", "aggregate_text", "ask_text", "count_text", "eager", "object_text", "row_text"]

THING = ontology.PREFIXES["owl"] + "Thing"
RDF_TYPE = ontology.PREFIXES["rdf"] + "type"
_LOCAL = re.compile(r"[A-Za-z_]\w*")


def short(iri: str) -> str:
    """Return an IRI for a query, with a prefix of the ontology where one fits.

    >>> short(ontology.NS + "mass"), short("urn:mug")
    ('rt:mass', '<urn:mug>')
    """
    for name, namespace in ontology.PREFIXES.items():
        if iri.startswith(namespace) and _LOCAL.fullmatch(iri[len(namespace) :]):
            return f"{name}:{iri[len(namespace) :]}"
    return str(NamedNode(iri))


def finished(text: str) -> str:
    """Return a query with the prefixes that it uses."""
    names = [name for name in ontology.PREFIXES if re.search(rf"\b{name}:", text)]
    return prologue({name: ontology.PREFIXES[name] for name in names}) + text


@dataclass(frozen=True)
class Plan:
    """What a query asks for, before it is text.

    Parameters
    ----------
    model
        The class of the roots.
    conditions
        One tuple for each call of ``where``: in a call, one path means one value.
    inferred
        Whether derived statements are seen; if not, subclasses and inverses are spelled out.
    """

    model: type[Model]
    conditions: tuple[tuple[Condition, ...], ...] = ()
    orders: tuple[Order, ...] = ()
    limit: int | None = None
    offset: int = 0
    prefetch: tuple[tuple[Field, ...], ...] = ()
    inferred: bool = True


@dataclass
class _Names:
    """Fresh variables of one query."""

    used: int = 0

    def fresh(self) -> str:
        self.used += 1
        return f"?_{self.used}"


@dataclass
class _Scope:
    """One group of patterns in which equal paths share their variable."""

    names: _Names
    inferred: bool
    lines: list[str] = field(default_factory=list)
    bound: dict[tuple[str, ...], str] = field(default_factory=dict)

    def walk(self, along: Sequence[Field]) -> str:
        """Return the variable at the end of a path, with patterns that lead there."""
        subject, done = "?root", tuple[str, ...]()
        for step in along:
            done = (*done, step.iri)
            if done not in self.bound:
                self.bound[done] = self.names.fresh()
                self.lines.append(f"{subject} {self.property(step)} {self.bound[done]} .")
            subject = self.bound[done]
        return subject

    def property(self, step: Field) -> str:
        """Return the property, or what stands for it where nothing is derived."""
        if self.inferred or step.stored or step.inverse is None:
            return short(step.iri)
        return f"({short(step.iri)}|^{short(step.inverse)})"

    def inside(self, condition: Condition) -> str:
        """Return a condition as a group of its own, which shares only ``?root``."""
        scope = _Scope(self.names, self.inferred)
        scope.add(condition)
        return "{ " + " ".join(scope.lines) + " }"

    def add(self, condition: Condition) -> None:
        """Write the patterns and filters of a condition."""
        match condition:
            case And(conditions):
                for part in conditions:
                    self.add(part)
            case Or(conditions):
                self.lines.append(" UNION ".join(map(self.inside, conditions)))
            case Not(inner):
                self.lines.append(f"FILTER NOT EXISTS {self.inside(inner)}")
            case Missing(path):
                scope = _Scope(self.names, self.inferred)
                scope.walk(steps(path))
                self.lines.append("FILTER NOT EXISTS { " + " ".join(scope.lines) + " }")
            case Raw(pattern):
                self.lines.append(pattern.rstrip(" .\n") + "\n.")
            case Compare(path, operator, value):
                self._compare(steps(path), operator, value)
            case In(path, values):
                listed = ", ".join(str(self._constant(steps(path)[-1], v)) for v in values)
                self.lines.append(f"FILTER({self.walk(steps(path))} IN ({listed}))")
            case Text(path, function, text, ignore_case):
                self._text(self.walk(steps(path)), function, text, ignore_case)
            case _:
                raise UsageError(f"not a condition: {condition!r}; use == < > in_ & | ~")

    def _compare(self, along: tuple[Field, ...], operator: str, value: object) -> None:
        if value is None:
            raise UsageError(f"compare {along[-1].describe()} with is_none(), not with None")
        constant = self._constant(along[-1], value)
        plain_text = isinstance(constant, Literal) and isinstance(decode(constant), str)
        if operator == "=" and (not isinstance(constant, Literal) or plain_text):
            before = self.walk(along[:-1])
            self.lines.append(f"{before} {self.property(along[-1])} {constant} .")
            return
        if operator in ("=", "!=") or isinstance(constant, Literal):
            self.lines.append(f"FILTER({self.walk(along)} {operator} {constant})")
            return
        raise UsageError(f"{along[-1].describe()} holds objects; they have no order")

    @staticmethod
    def _constant(step: Field, value: object) -> Term:
        if step.is_link and isinstance(value, str):
            return NamedNode(value)
        if step.is_link and isinstance(value, Model):
            return NamedNode(value.iri)
        if isinstance(value, NamedNode | Literal):
            return value
        return term(step.item(value)) if step.is_link else _unchecked(step, value)

    def _text(self, variable: str, function: str, text: str, ignore_case: bool) -> None:
        wanted = str(Literal(text))
        if function == "REGEX":
            flags = ', "i"' if ignore_case else ""
            self.lines.append(f"FILTER(REGEX(STR({variable}), {wanted}{flags}))")
        elif ignore_case:
            self.lines.append(f"FILTER(CONTAINS(LCASE(STR({variable})), LCASE({wanted})))")
        else:
            self.lines.append(f"FILTER(CONTAINS(STR({variable}), {wanted}))")


def _unchecked(step: Field, value: object) -> Term:
    """Return the literal of a constant; limits do not apply to what is only compared with."""
    from rtask.model.codec import encode

    try:
        return encode(value, step.value)
    except ValueError as error:
        raise step.refuse(value, str(error), None) from None


Bound = dict[tuple[str, ...], str]


def _group(plan: Plan, names: _Names) -> tuple[list[str], Bound]:
    """Return the patterns that say which roots are meant, and the variables of single values.

    A path on which nothing can have two values has one variable, whatever binds it first.
    """
    lines, single = list[str](), Bound()
    for iri in class_iris(plan.model):
        if iri in ("", THING):  # everything is one, and nobody says so
            lines.append(f"?root a {names.fresh()} .")
        elif plan.inferred:
            lines.append(f"?root a {short(iri)} .")
        else:
            kind = names.fresh()
            lines.append(f"?root a {kind} . {kind} rdfs:subClassOf* {short(iri)} .")
    for together in plan.conditions:
        scope = _Scope(names, plan.inferred)
        for condition in together:
            scope.add(condition)
        lines += scope.lines
        single.update(scope.bound)
    return lines, single


def _keys(plan: Plan, names: _Names, bound: Bound) -> tuple[list[str], list[str]]:
    """Return OPTIONAL patterns that bind the sort keys, and the keys' variables."""
    lines, variables = [], []
    for order in plan.orders:
        path = tuple(step.iri for step in steps(order.path))
        if path in bound and _is_single(order):
            variables.append(bound[path])
            continue
        scope = _Scope(names, plan.inferred)
        variables.append(scope.walk(steps(order.path)))
        lines.append("OPTIONAL { " + " ".join(scope.lines) + " }")
    return lines, variables


def _is_single(order: Order) -> bool:
    return all(step.functional for step in steps(order.path))


def _slice(plan: Plan) -> str:
    limit = f" LIMIT {plan.limit}" if plan.limit is not None else ""
    return limit + (f" OFFSET {plan.offset}" if plan.offset else "")


def _roots(plan: Plan) -> str:
    """Return the sub-select of the roots with their sort keys ``?key0``, ``?key1``...

    A root with several values of a key is sorted by the least, or the greatest if descending.
    """
    names = _Names()
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


def eager(model: type[Model]) -> list[Field]:
    """Return the fields that come with every object of a class or its subclasses.

    What only other objects state (an inverse) may be unbounded, and links that anything may have
    are rarely wanted: both come when asked for.
    """
    fields = {field.iri: field for kind in family(model) for field in kind.__fields__.values()}
    return [fields[iri] for iri in sorted(fields) if _comes_along(fields[iri])]


def _comes_along(field: Field) -> bool:
    return field.stored and not (field.is_link and field.owner.__iri__ == THING)


def fetch_filter(model: type[Model], more: Iterable[Field] = ()) -> str:
    """Return the list of properties to fetch, for ``FILTER(?p IN (...))``."""
    iris = {field.iri for field in (*eager(model), *more)}
    return ", ".join(map(short, [RDF_TYPE, *sorted(iris)]))


def object_text(plan: Plan) -> str:
    """Return the one query for objects with what is prefetched."""
    keys = "".join(f" ?key{at}" for at in range(len(plan.orders)))
    wanted = {path[:n] for path in plan.prefetch for n in range(1, len(path) + 1)}
    branches = []
    for path in ((), *sorted(wanted, key=lambda p: [step.iri for step in p])):
        model = (path[-1].target() if path else plan.model) or Model
        following = [other[-1] for other in wanted if other[:-1] == path]
        start, own = _start(path, plan.inferred), "?s" if path else "?root"
        bind = "" if path else " BIND(?root AS ?s)"
        inside = fetch_filter(model, following)
        branches.append(f"{{ {start}{own} ?p ?o FILTER(?p IN ({inside})){bind} }}")
        if not plan.inferred:
            branches += _derived(start, own, bind, following)
    union = "\n  UNION\n  ".join(branches)
    return f"SELECT DISTINCT ?root ?s ?p ?o{keys} WHERE {{\n  {{ {_roots(plan)} }}\n  {union}\n}}"


def _start(path: Sequence[Field], inferred: bool) -> str:
    """Return the patterns that lead from ``?root`` to ``?s``."""
    if not path:
        return ""
    scope = _Scope(_Names(), inferred)
    before = scope.walk(path[:-1])
    return " ".join([*scope.lines, f"{before} {scope.property(path[-1])} ?s . "])


def _derived(start: str, own: str, bind: str, following: Iterable[Field]) -> list[str]:
    """Return branches for inverses, which nobody derives without inference."""
    return [
        f"{{ {start}?o {short(step.inverse)} {own} BIND({short(step.iri)} AS ?p){bind} }}"
        for step in following
        if not step.stored and step.inverse
    ]


def row_text(plan: Plan, paths: Sequence[Path[Any]]) -> str:
    """Return a query for plain values; one row for each combination."""
    names = _Names()
    lines, bound = _group(plan, names)
    picks = []
    for at, path in enumerate(paths):
        scope = _Scope(names, plan.inferred)
        variable = scope.walk(steps(path))
        lines.append("OPTIONAL { " + " ".join(scope.lines) + f" BIND({variable} AS ?value{at}) }}")
        picks.append(f"?value{at}")
    optional, variables = _keys(plan, names, bound)
    sorts = [
        f"{'DESC' if order.descending else 'ASC'}({variable})"
        for order, variable in zip(plan.orders, variables, strict=True)
    ]
    tail = f" ORDER BY {' '.join([*sorts, '?root'])}"
    tail += _slice(plan)
    chosen = " ".join(["?root", *picks, *dict.fromkeys(variables)])
    body = "\n  ".join([*lines, *optional])
    return f"SELECT DISTINCT {chosen} WHERE {{\n  {body}\n}}{tail}"


def id_text(plan: Plan) -> str:
    """Return a query for the IRIs of the roots, in order."""
    return _roots(plan)


def count_text(plan: Plan) -> str:
    """Return a query for the number of roots."""
    if plan.limit is not None or plan.offset:
        return f"SELECT (COUNT(?root) AS ?n) WHERE {{ {{ {_roots(plan)} }} }}"
    body = "\n  ".join(_group(plan, _Names())[0])
    return f"SELECT (COUNT(DISTINCT ?root) AS ?n) WHERE {{\n  {body}\n}}"


def ask_text(plan: Plan) -> str:
    """Return a query for whether there is a root."""
    body = "\n  ".join(_group(plan, _Names())[0])
    return f"ASK {{\n  {body}\n}}"


def aggregate_text(plan: Plan, groups: Sequence[Path[Any]], columns: dict[str, Aggregate]) -> str:
    """Return a query for numbers about groups of roots."""
    names = _Names()
    lines, _ = _group(plan, names)
    scope = _Scope(names, plan.inferred)
    by = [scope.walk(steps(path)) for path in groups]
    lines += scope.lines
    picks = [f"({variable} AS ?group{at})" for at, variable in enumerate(by)]
    for name, column in columns.items():
        if column.path is None:
            picks.append(f"(COUNT(DISTINCT ?root) AS ?{name})")
            continue
        inner = _Scope(names, plan.inferred)
        variable = inner.walk(steps(column.path))
        lines.append("OPTIONAL { " + " ".join(inner.lines) + " }")
        distinct = "DISTINCT " if column.function == "COUNT" else ""
        picks.append(f"({column.function}({distinct}{variable}) AS ?{name})")
    body = "\n  ".join(lines)
    tail = f" GROUP BY {' '.join(by)} ORDER BY {' '.join(by)}" if by else ""
    return f"SELECT {' '.join(picks)} WHERE {{\n  {body}\n}}{tail}"


def check_root(plan: Plan, path: Path[Any]) -> tuple[Field, ...]:
    """Return the fields of a path, which must begin at the class of the query.

    Raises
    ------
    UsageError
        If it begins elsewhere.
    """
    if not (issubclass(plan.model, root(path)) or issubclass(root(path), plan.model)):
        raise UsageError(f"{path!r} does not begin at {plan.model.__name__}")
    return steps(path)
