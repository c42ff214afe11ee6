"""Rules as JSON-able data, and back.

Terms are ids, which mean the same in every process that reads them with the dictionary they were
written with. A rule that is read back equals the one that was written.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


def rule_to_data(rule: Rule) -> Data:
    """Return a rule as lists, numbers and strings.

    >>> rule = Rule("cls-hv2", (Atom(-1, 300, 301),), Atom(-1, 0, 302), ((302, 7, 301),))
    >>> rule_from_data(rule_to_data(rule)) == rule
    True
    """
    return [
        rule.name,
        [list(atom) for atom in rule.body],
        None if rule.head is None else list(rule.head),
        [list(fact) for fact in rule.because],
        [_condition_to_data(condition) for condition in rule.conditions],
        list(rule.names),
    ]


def rule_from_data(data: Data) -> Rule:
    """Return the rule that `rule_to_data` was given."""
    name, body, head, because, conditions, names = data
    return Rule(
        name,
        _atoms(body),
        None if head is None else Atom(*head),
        facts_from_data(because),
        tuple(map(_condition_from_data, conditions)),
        tuple(names),
    )


def distinct_to_data(distinct: Distinct) -> Data:
    """Return a list of different individuals as data."""
    return [distinct.name, [list(f) for f in distinct.items], [list(f) for f in distinct.because]]


def distinct_from_data(data: Data) -> Distinct:
    """Return what `distinct_to_data` was given."""
    name, items, because = data
    return Distinct(name, facts_from_data(items), facts_from_data(because))


def facts_from_data(data: Iterable[Sequence[int]]) -> tuple[Fact, ...]:
    """Return facts that were written as lists."""
    return tuple((s, p, o) for s, p, o in data)


def _atoms(data: Iterable[Sequence[int]]) -> tuple[Atom, ...]:
    return tuple(Atom(*atom) for atom in data)


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


def _condition_from_data(data: Data) -> Condition:
    kind, *rest = data
    if kind == "differ":
        return Differ(*rest)
    if kind == "clash":
        return Clash(*rest)
    if kind == "datatype":
        return InDatatype(*rest)
    if kind == "absent":
        atoms, inner, outer = rest
        return Absent(_atoms(atoms), tuple(map(_condition_from_data, inner)), frozenset(outer))
    if kind == "test":
        return Test(_expression_from_data(rest[0]))
    if kind == "assign":
        return Assign(rest[0], _expression_from_data(rest[1]))
    raise ValueError(f"unknown condition {kind!r}")


def _expression_to_data(expression: Expression) -> Data:
    if isinstance(expression, Variable):
        return ["variable", expression.number]
    if isinstance(expression, Constant):
        return ["constant", expression.number]
    return ["operation", expression.operator, *map(_expression_to_data, expression.arguments)]


def _expression_from_data(data: Data) -> Expression:
    kind, first, *rest = data
    if kind == "variable":
        return Variable(first)
    if kind == "constant":
        return Constant(first)
    return Operation(first, tuple(map(_expression_from_data, rest)))
