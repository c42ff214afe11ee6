"""Rules as JSON-able data, and back.

Terms are ids, which mean the same in every process that reads them with the dictionary they were
written with. A rule that is read back equals the one that was written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from reasoner.rules.compile import Distinct
from reasoner.rules.expressions import (
    Assign,
    Constant,
    Expression,
    Operation,
    Test,
    Variable,
)
from reasoner.rules.rule import Absent, Atom, Clash, Condition, Differ, InDatatype, Rule
from reasoner.terms.dictionary import Fact

Data = list[Any]
Number = Callable[[int], int]
"""Returns the id here of an id elsewhere; variables, which are negative, stay."""


def _same(number: int) -> int:
    return number


def rules_to_data(rules: Iterable[Rule], places: Mapping[Rule, int] | None = None) -> Data:
    """Return rules as lists, numbers and strings.

    All rules of one axiom share the facts behind them, perhaps a list of thousands, which is
    written once.

    Parameters
    ----------
    places : mapping of Rule to int, optional
        Rules of which the reader has a list; these are written as their places in it.

    Examples
    --------
    >>> rule = Rule("cls-hv2", (Atom(-1, 300, 301),), Atom(-1, 0, 302), ((302, 7, 301),))
    >>> rules_from_data(rules_to_data([rule])) == [rule]
    True
    """
    reasons: list[list[list[int]]] = []
    held: list[tuple[Fact, ...]] = []  # alive, so that no other has the same id meanwhile
    reason_at: dict[int, int] = {}
    written: list[int | Data] = []
    for rule in rules:
        place = None if places is None else places.get(rule)
        if place is not None:
            written.append(place)
            continue
        key = id(rule.because)
        if key not in reason_at:
            reason_at[key] = len(reasons)
            reasons.append([list(fact) for fact in rule.because])
            held.append(rule.because)
        written.append(_rule_to_data(rule, reason_at[key]))
    return [reasons, written]


def rules_from_data(data: Data, listed: Sequence[Rule] = (), number: Number = _same) -> list[Rule]:
    """Return the rules that `rules_to_data` was given, with their terms numbered anew if asked to.

    Parameters
    ----------
    listed : sequence of Rule
        In the places that `rules_to_data` was given.
    """
    reasons = [facts_from_data(facts, number) for facts in data[0]]
    return [
        listed[rule] if isinstance(rule, int) else _rule_from_data(rule, reasons, number)
        for rule in data[1]
    ]


def _rule_to_data(rule: Rule, because: int) -> Data:
    return [
        rule.name,
        [list(atom) for atom in rule.body],
        None if rule.head is None else list(rule.head),
        because,
        [_condition_to_data(condition) for condition in rule.conditions],
        list(rule.names),
    ]


def _rule_from_data(data: Data, reasons: Sequence[tuple[Fact, ...]], number: Number) -> Rule:
    name, body, head, because, conditions, names = data
    return Rule(
        name,
        _atoms(body, number),
        None if head is None else Atom(*map(number, head)),
        reasons[because],
        tuple(_condition_from_data(condition, number) for condition in conditions),
        tuple(names),
    )


def distinct_to_data(distinct: Distinct) -> Data:
    """Return a list of different individuals as data."""
    return [distinct.name, [list(f) for f in distinct.items], [list(f) for f in distinct.because]]


def distinct_from_data(data: Data, number: Number = _same) -> Distinct:
    """Return what `distinct_to_data` was given."""
    name, items, because = data
    return Distinct(name, facts_from_data(items, number), facts_from_data(because, number))


def facts_from_data(data: Iterable[Sequence[int]], number: Number = _same) -> tuple[Fact, ...]:
    """Return facts that were written as lists."""
    return tuple((number(s), number(p), number(o)) for s, p, o in data)


def _atoms(data: Iterable[Sequence[int]], number: Number) -> tuple[Atom, ...]:
    return tuple(Atom(*map(number, atom)) for atom in data)


def _condition_to_data(condition: Condition) -> Data:
    if isinstance(condition, Differ):
        return ["differ", condition.left, condition.right]
    if isinstance(condition, Clash):
        return ["clash", condition.left, condition.right]
    if isinstance(condition, InDatatype):
        return ["datatype", condition.variable, condition.datatype, condition.inside]
    if isinstance(condition, Absent):
        atoms = [list(atom) for atom in condition.atoms]
        inner = [_condition_to_data(each) for each in condition.conditions]
        return ["absent", atoms, inner, sorted(condition.outer)]
    if isinstance(condition, Test):
        return ["test", _expression_to_data(condition.expression)]
    if isinstance(condition, Assign):
        return ["assign", condition.variable, _expression_to_data(condition.expression)]
    raise TypeError(f"no form on disk for the condition {condition!r}")


def _condition_from_data(data: Data, number: Number) -> Condition:
    kind, *rest = data
    if kind == "differ":
        return Differ(*rest)
    if kind == "clash":
        return Clash(*rest)
    if kind == "datatype":
        variable, datatype, inside = rest
        return InDatatype(variable, number(datatype), inside)
    if kind == "absent":
        atoms, inner, outer = rest
        conditions = tuple(_condition_from_data(each, number) for each in inner)
        return Absent(_atoms(atoms, number), conditions, frozenset(outer))
    if kind == "test":
        return Test(_expression_from_data(rest[0], number))
    if kind == "assign":
        return Assign(rest[0], _expression_from_data(rest[1], number))
    raise ValueError(f"unknown condition {kind!r}")


def _expression_to_data(expression: Expression) -> Data:
    if isinstance(expression, Variable):
        return ["variable", expression.number]
    if isinstance(expression, Constant):
        return ["constant", expression.number]
    return ["operation", expression.operator, *map(_expression_to_data, expression.arguments)]


def _expression_from_data(data: Data, number: Number) -> Expression:
    kind, first, *rest = data
    if kind == "variable":
        return Variable(first)
    if kind == "constant":
        return Constant(number(first))
    return Operation(first, tuple(_expression_from_data(each, number) for each in rest))
