"""Compile conditions to SPARQL patterns with a mark in place of each constant.

The text depends only on the shape of a condition, so it can be cached and reused with other
constants (:mod:`rtask.model.query.compile`).
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

from rtask.errors import UsageError
from rtask.model.codec import decode, encode
from rtask.model.instance import Model, Property, term
from rtask.model.query.expressions import (
    After,
    And,
    Compare,
    Condition,
    In,
    Missing,
    Not,
    Or,
    Raw,
    Text,
    steps,
)
from rtask.model.query.plan import short
from rtask.rdf.terms import Literal, NamedNode, Term

__all__ = ["MARK", "Names", "Scope", "shape"]

MARK = "\0"
"""Stands for the next constant."""


def shape(condition: Condition, constants: list[Term]) -> Hashable:
    """Return a cache key for the text of a condition, and collect its constants in order."""
    match condition:
        case And(parts) | Or(parts):
            return type(condition), *(shape(part, constants) for part in parts)
        case Not(inner):
            return Not, shape(inner, constants)
        case Missing(path):
            return Missing, steps(path)
        case Raw(pattern):
            if MARK in pattern:
                raise UsageError("a pattern cannot hold the character U+0000")
            return Raw, pattern
        case After(name):
            constants.append(Literal(name))
            return After
        case Compare(path, operator, value):
            constant = _compared(steps(path), operator, value)
            constants.append(constant)
            return Compare, steps(path), operator, _is_exact(operator, constant)
        case In(path, values):
            constants += [_constant(steps(path)[-1], value) for value in values]
            return In, steps(path), len(values)
        case Text(path, function, text, ignore_case):
            constants.append(Literal(text))
            return Text, steps(path), function, ignore_case
    raise UsageError(f"not a condition: {condition!r}; use == < > in_ & | ~")


def _compared(along: tuple[Property, ...], operator: str, value: object) -> Term:
    if value is None:
        raise UsageError(f"compare {along[-1].describe()} with is_none(), not with None")
    constant = _constant(along[-1], value)
    if operator not in ("=", "!=") and not isinstance(constant, Literal):
        raise UsageError(f"{along[-1].describe()} holds objects; they have no order")
    return constant


def _is_exact(operator: str, constant: Term) -> bool:
    """Whether equality means the same term; numbers and times are compared by value."""
    if operator != "=":
        return False
    return not isinstance(constant, Literal) or isinstance(decode(constant), str)


def _constant(step: Property, value: object) -> Term:
    if step.is_link and isinstance(value, str):
        return NamedNode(value)
    if step.is_link and isinstance(value, Model):
        return NamedNode(value.iri)
    if isinstance(value, NamedNode | Literal):
        return value
    if step.is_link or step.is_list:
        return term(step.item(value))
    try:  # limits do not apply to constants in comparisons
        return encode(value, step.value)
    except ValueError as error:
        raise step.refuse(value, str(error), None) from None


@dataclass
class Names:
    """Fresh variables of one query."""

    used: int = 0

    def fresh(self) -> str:
        """Return an unused variable."""
        self.used += 1
        return f"?_{self.used}"


@dataclass
class Scope:
    """One group of patterns in which equal paths share their variable."""

    names: Names
    inferred: bool
    lines: list[str] = field(default_factory=list)
    bound: dict[tuple[str, ...], str] = field(default_factory=dict)

    def walk(self, along: Sequence[Property]) -> str:
        """Return the variable at the end of a path, and add the patterns that bind it."""
        subject, done = "?root", tuple[str, ...]()
        for step in along:
            done = (*done, step.iri)
            if done not in self.bound:
                self.bound[done] = self.names.fresh()
                self.lines.append(f"{subject} {self.property(step)} {self.bound[done]} .")
            subject = self.bound[done]
        return subject

    def property(self, step: Property) -> str:
        """Return the property, or an equivalent path if derived statements are not visible."""
        if step.is_list:
            return f"{short(step.iri)}/rdf:rest*/rdf:first"
        if self.inferred or step.stored or step.inverse is None:
            return short(step.iri)
        return f"({short(step.iri)}|^{short(step.inverse)})"

    def group(self) -> str:
        """Return the patterns as one group."""
        return "{ " + " ".join(self.lines) + " }"

    def inside(self, condition: Condition) -> str:
        """Return a condition as a separate group, which shares only ``?root``."""
        scope = Scope(self.names, self.inferred)
        scope.add(condition)
        return scope.group()

    def add(self, condition: Condition) -> None:
        """Write the patterns and filters of a condition whose :func:`shape` is known."""
        match condition:
            case And(conditions):
                for part in conditions:
                    self.add(part)
            case Or(conditions):
                self.lines.append(" UNION ".join(map(self.inside, conditions)))
            case Not(inner):
                self.lines.append(f"FILTER NOT EXISTS {self.inside(inner)}")
            case Missing(path):
                scope = Scope(self.names, self.inferred)
                scope.walk(steps(path))
                self.lines.append(f"FILTER NOT EXISTS {scope.group()}")
            case Raw(pattern):
                self.lines.append(pattern.rstrip(" .\n") + "\n.")
            case After():
                self.lines.append(f"FILTER(STR(?root) > {MARK})")
            case Compare(path, operator, value):
                self._compare(steps(path), operator, value)
            case In(path, values):
                listed = ", ".join(MARK for _ in values)
                self.lines.append(f"FILTER({self.walk(steps(path))} IN ({listed}))")
            case Text(path, function, _, ignore_case):
                self._text(self.walk(steps(path)), function, ignore_case)

    def _compare(self, along: tuple[Property, ...], operator: str, value: object) -> None:
        if _is_exact(operator, _constant(along[-1], value)):
            before = self.walk(along[:-1])
            self.lines.append(f"{before} {self.property(along[-1])} {MARK} .")
        else:
            self.lines.append(f"FILTER({self.walk(along)} {operator} {MARK})")

    def _text(self, variable: str, function: str, ignore_case: bool) -> None:
        if function == "REGEX":
            flags = ', "i"' if ignore_case else ""
            self.lines.append(f"FILTER(REGEX(STR({variable}), {MARK}{flags}))")
        elif ignore_case:
            self.lines.append(f"FILTER({function}(LCASE(STR({variable})), LCASE({MARK})))")
        else:
            self.lines.append(f"FILTER({function}(STR({variable}), {MARK}))")
