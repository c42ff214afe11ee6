"""FILTER and BIND of user-defined rules (SPARQL 1.1 Query 17), as conditions of the engine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TypeVar

from pyoxigraph import Literal

from reasoner.rules.rule import Bindings, View
from reasoner.terms.datatypes import Value, compare, value_of
from reasoner.terms.dictionary import Dictionary
from reasoner.terms.vocabulary import LITERAL, XSD

Result = int | Value
"""Id of a term, or a computed value."""

Number = int | float | Fraction
Real = TypeVar("Real", float, Fraction)

COMPARISONS = frozenset({"=", "!=", "<", "<=", ">", ">="})


Truth = Callable[[Dictionary, Bindings], bool]
"""Tells whether an expression is true; raises `EvaluationError` where it has no value."""


class EvaluationError(Exception):
    """The expression has no value for these bindings (SPARQL 1.1 Query 17.2)."""


@dataclass(frozen=True, slots=True)
class Variable:
    """The value of a variable."""

    number: int


@dataclass(frozen=True, slots=True)
class Constant:
    """A term."""

    number: int


@dataclass(frozen=True, slots=True)
class Operation:
    """An operator or function with its arguments."""

    operator: str
    arguments: tuple[Expression, ...]


Expression = Variable | Constant | Operation


def variables_of(expression: Expression) -> Iterator[int]:
    """Yield the variables of an expression."""
    if isinstance(expression, Variable):
        yield expression.number
    elif isinstance(expression, Operation):
        for argument in expression.arguments:
            yield from variables_of(argument)


def constants_of(expression: Expression) -> Iterator[int]:
    """Yield the terms of an expression."""
    if isinstance(expression, Constant):
        yield expression.number
    elif isinstance(expression, Operation):
        for argument in expression.arguments:
            yield from constants_of(argument)


def sees_identity(expression: Expression) -> bool:
    """Tell whether an expression compares or spells out terms that may be merged.

    Order is for literals only, and these are never merged.
    """
    if not isinstance(expression, Operation):
        return False
    if expression.operator in ("=", "!=", "IN", "NOT IN", "STR") and any(
        isinstance(argument, Variable) for argument in expression.arguments
    ):
        return True
    return any(sees_identity(argument) for argument in expression.arguments)


@dataclass(frozen=True)
class Test:
    """FILTER: an expression must be true."""

    expression: Expression
    gives: frozenset[int] = frozenset()

    __test__ = False  # not a test case, despite its name

    @property
    def needs(self) -> frozenset[int]:
        """Variables of the expression."""
        return frozenset(variables_of(self.expression))

    @property
    def sees_identity(self) -> bool:
        """Whether the result may change when two terms turn out to be the same."""
        return sees_identity(self.expression)

    def holds(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        """Evaluate the expression; an error is false."""
        try:
            return self._truth(terms, env)
        except EvaluationError:
            return False

    @cached_property
    def _truth(self) -> Truth:
        return truth_of(self.expression)


@dataclass(frozen=True, slots=True)
class Assign:
    """BIND: give a variable the value of an expression."""

    variable: int
    expression: Expression

    @property
    def needs(self) -> frozenset[int]:
        """Variables of the expression."""
        return frozenset(variables_of(self.expression))

    @property
    def gives(self) -> frozenset[int]:
        """The variable."""
        return frozenset((self.variable,))

    @property
    def sees_identity(self) -> bool:
        """Whether the value may change when two terms turn out to be the same."""
        return sees_identity(self.expression)

    def holds(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        """Bind the variable, or compare if it is bound (looking backward from a head)."""
        try:
            result = evaluate(self.expression, terms, env)
        except EvaluationError:
            return False
        number = result if isinstance(result, int) else terms.encode(literal_of(result))
        before = env[~self.variable]
        if before is not None:
            return terms.is_same(before, number)
        env[~self.variable] = number
        return True


def evaluate(expression: Expression, terms: Dictionary, env: Bindings) -> Result:
    """Return the value of an expression.

    Raises
    ------
    EvaluationError
        Where SPARQL has a type error or an unbound variable.
    """
    if isinstance(expression, Constant):
        return expression.number
    if isinstance(expression, Variable):
        bound = env[~expression.number]
        if bound is None:
            raise EvaluationError("unbound variable")
        return bound
    operator, arguments = expression.operator, expression.arguments
    if operator in ("&&", "||"):
        return _truth(truth_of(expression)(terms, env))
    if operator == "IF":
        chosen = is_true(evaluate(arguments[0], terms, env), terms)
        return evaluate(arguments[1 if chosen else 2], terms, env)
    # From here on every operand has to have a value; the operators above can do without some.
    values = [evaluate(argument, terms, env) for argument in arguments]
    if operator in COMPARISONS:
        return _truth(_related(operator, values[0], values[1], terms))
    if operator in ("IN", "NOT IN"):
        is_member = any(_related("=", values[0], other, terms) for other in values[1:])
        return _truth(is_member is (operator == "IN"))
    if operator == "!":
        return _truth(not is_true(values[0], terms))
    if operator == "STR":
        return value_of(_text(values[0], terms), XSD + "string")
    if operator == "DATATYPE":
        return _datatype(values[0], terms)
    return _arithmetic(operator, [_number(value, terms) for value in values])


def truth_of(expression: Expression) -> Truth:
    """Compile an expression to a test, so that its operators are looked up only once.

    >>> test = truth_of(Operation("<", (Variable(-1), Variable(-2))))
    >>> terms = Dictionary()
    >>> test(terms, [terms.encode(Literal(1)), terms.encode(Literal(2.5))])
    True
    """
    if isinstance(expression, Operation):
        operator, arguments = expression.operator, expression.arguments
        if operator in ("&&", "||"):
            return _connected(operator == "||", tuple(map(truth_of, arguments)))
        if operator == "!":
            inner = truth_of(arguments[0])
            return lambda terms, env: not inner(terms, env)
        if operator in COMPARISONS:
            left, right = arguments
            return lambda terms, env: _related(
                operator, evaluate(left, terms, env), evaluate(right, terms, env), terms
            )
    return lambda terms, env: is_true(evaluate(expression, terms, env), terms)


def _connected(decisive: bool, tests: tuple[Truth, ...]) -> Truth:
    """Three-valued and/or: a decisive operand wins over an error (SPARQL 1.1 Query 17.2)."""

    def test(terms: Dictionary, env: Bindings) -> bool:
        failure: EvaluationError | None = None
        for each in tests:
            try:
                if each(terms, env) is decisive:
                    return decisive
            except EvaluationError as error:
                failure = error
        if failure is not None:
            raise failure
        return not decisive

    return test


def _related(operator: str, left: Result, right: Result, terms: Dictionary) -> bool:
    # No comparison of its own: what is incomparable must raise in both.
    if operator == "!=":
        return not _related("=", left, right, terms)
    a, b = _value(left, terms), _value(right, terms)
    if a is None or b is None:
        if operator == "=":
            return isinstance(left, int) and left == right
        raise EvaluationError("only literals have an order")
    order = compare(a, b)
    if operator == "=":
        # NaN: of the same family, with an order, and equal to nothing, itself included.
        if order is None and a.family == b.family and a.order is not None:
            return False
        # The same term is equal even where its datatype is unknown (SPARQL 1.1 Query, 17.4.1.7).
        return a.key == b.key or order == 0
    if order is None:
        raise EvaluationError(f"cannot order {a.family} and {b.family}")
    if operator == ">":
        return order > 0
    return {"<": order < 0, "<=": order <= 0, ">=": order >= 0}[operator]


def _value(result: Result, terms: Dictionary) -> Value | None:
    if isinstance(result, Value):
        return result
    return terms.value(result) if result >= LITERAL else None


def is_true(result: Result, terms: Dictionary) -> bool:
    """Return the effective boolean value (SPARQL 1.1 Query 17.2.2)."""
    value = _value(result, terms)
    if value is None or value.order is None or value.family not in ("boolean", "number", "string"):
        raise EvaluationError("no effective boolean value")
    # NaN is false (SPARQL 1.1 Query, 17.2.2), and the one value that differs from itself.
    return bool(value.order) and value.order == value.order


def _text(result: Result, terms: Dictionary) -> str:
    if isinstance(result, Value):
        return literal_of(result).value
    return terms.text(result)


def _datatype(result: Result, terms: Dictionary) -> int:
    literal = literal_of(result) if isinstance(result, Value) else terms.decode(result)
    if not isinstance(literal, Literal):
        raise EvaluationError("only literals have a datatype")
    return terms.encode(literal.datatype)


def _number(result: Result, terms: Dictionary) -> Number:
    value = _value(result, terms)
    if (
        value is None
        or value.family != "number"
        or not isinstance(value.order, int | float | Fraction)
    ):
        raise EvaluationError("not a number")
    return value.order


def _arithmetic(operator: str, numbers: list[Number]) -> Value:
    if any(isinstance(number, float) for number in numbers):
        return _value_of_number(_combine(operator, [float(number) for number in numbers]))
    # Exact: .1 + .2 is .3 of xsd:decimal, and a rule may compare with it.
    return _value_of_number(_combine(operator, [Fraction(number) for number in numbers]))


def _combine(operator: str, numbers: list[Real]) -> Real:
    last = numbers[-1]
    if operator == "ABS":
        return abs(last)
    if len(numbers) == 1:
        return -last if operator == "-" else last
    if operator == "+":
        return numbers[0] + last
    return numbers[0] - last if operator == "-" else numbers[0] * last


def _value_of_number(number: Number) -> Value:
    if isinstance(number, float):
        return value_of(repr(number).replace("inf", "INF").replace("nan", "NaN"), XSD + "double")
    return value_of(_decimal(Fraction(number)), XSD + "decimal")


def _decimal(number: Fraction) -> str:
    """Return a decimal numeral; sums and products of decimals are always finite."""
    whole, rest = divmod(abs(number), 1)
    # By hand, since str() of a Decimal of a huge or tiny number has an exponent, which xsd:decimal
    # forbids.
    digits = ""
    while rest and len(digits) < 40:
        digit, rest = divmod(rest * 10, 1)
        digits += str(digit)
    return f"{'-' if number < 0 else ''}{whole}" + (f".{digits}" if digits else "")


def _truth(value: bool) -> Value:
    return value_of("true" if value else "false", XSD + "boolean")


def literal_of(value: Value) -> Literal:
    """Return a literal that denotes a computed value."""
    order = value.order
    if isinstance(order, bool | str | float):
        return Literal(order)
    if isinstance(order, int):
        return Literal(order)
    if isinstance(order, Fraction):
        from pyoxigraph import NamedNode

        return Literal(_decimal(order), datatype=NamedNode(XSD + "decimal"))
    raise EvaluationError("no literal form")
