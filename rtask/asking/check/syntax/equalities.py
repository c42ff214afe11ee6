"""What a FILTER lets a variable be: ``?x = rt:Mug``, ``?x IN (...)``, ``sameTerm(?x, rt:Mug)``.

Such a filter says as much about a variable as VALUES does, if nothing else could make it true.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rtask.asking.check.syntax.outline import Node
from rtask.sparql.tokens import Token

__all__ = ["computes_literal", "equalities"]

_MAX_TOKENS = 200
_LITERALS = {
    "COUNT", "SUM", "AVG", "GROUP_CONCAT", "STR", "CONCAT", "STRLEN", "SUBSTR", "UCASE", "LCASE",
    "REPLACE", "LANG", "ABS", "ROUND", "CEIL", "FLOOR", "YEAR", "MONTH", "DAY", "HOURS", "MINUTES",
    "SECONDS", "NOW", "BOUND", "STRBEFORE", "STRAFTER", "ENCODE_FOR_URI", "CONTAINS", "STRSTARTS",
    "STRENDS", "REGEX", "ISIRI", "ISLITERAL", "SAMETERM", "STRDT", "STRLANG", "STRUUID",
}  # fmt: skip
_OPERATORS = {"+", "-", "*", "/", "<", ">", "<=", ">=", "=", "!=", "&&", "||"}


def equalities(
    tokens: Sequence[Token], read_term: Callable[[Sequence[Token]], Node | None]
) -> list[tuple[Token, list[Node]]]:
    """Return the variables that a FILTER makes equal to constants, each with all it may be.

    Only conjuncts count that consist of such comparisons with one variable: in
    ``?x = rt:Mug || ?y > 3`` the first may be anything.

    Parameters
    ----------
    tokens
        Those of the expression.
    read_term
        Returns the IRI or literal that some tokens are; None for any other expression.
    """
    if len(tokens) > _MAX_TOKENS:
        return []
    tokens = _bare(tokens)
    equal: list[tuple[Token, list[Node]]] = []
    for conjunct in _split(tokens, "&&"):
        options = [_atom(_bare(option), read_term) for option in _split(_bare(conjunct), "||")]
        complete = [option for option in options if option is not None]
        # One alternative that is not understood may let the variable be anything.
        if complete and len(complete) == len(options):
            variables = {variable.text[1:] for variable, _ in complete}
            if len(variables) == 1:
                equal.append((complete[0][0], [term for _, terms in complete for term in terms]))
    return equal


def computes_literal(tokens: Sequence[Token]) -> bool:
    """Return whether an expression gives a literal whatever its variables are: a count, a sum."""
    tokens = _bare(tokens)
    if not tokens:
        return False
    if any(len(_split(tokens, mark)) > 1 for mark in _OPERATORS):
        return True
    first = tokens[0]
    if first.is_mark("!"):
        return True
    if first.kind in ("string", "number") or first.is_word("TRUE", "FALSE"):
        return True
    if len(tokens) < 2 or not tokens[1].is_mark("("):
        return False
    if first.kind == "name":
        return first.text.startswith("xsd:")
    return first.kind == "word" and first.text.upper() in _LITERALS


def _atom(
    tokens: Sequence[Token], read_term: Callable[[Sequence[Token]], Node | None]
) -> tuple[Token, list[Node]] | None:
    """Return the variable of one comparison and what it is compared with."""
    if not tokens:
        return None
    if tokens[0].is_word("SAMETERM") and len(tokens) > 1 and tokens[1].is_mark("("):
        sides = _split(_bare(tokens[1:]), ",")
    else:
        sides = _split(tokens, "=")
    if len(sides) == 2:
        # Either side may be the variable.
        for variable, other in (sides, sides[::-1]):
            if len(variable) == 1 and variable[0].kind == "variable":
                term = read_term(other)
                return None if term is None else (variable[0], [term])
        return None
    if len(tokens) > 3 and tokens[0].kind == "variable" and tokens[1].is_word("IN"):
        terms = [read_term(part) for part in _split(_bare(tokens[2:]), ",")]
        named = [term for term in terms if term is not None]
        return (tokens[0], named) if named and len(named) == len(terms) else None
    return None


def _bare(tokens: Sequence[Token]) -> Sequence[Token]:
    """Return an expression without the brackets around all of it."""
    while len(tokens) > 1 and tokens[0].is_mark("(") and tokens[-1].is_mark(")"):
        depth = 0
        for at, token in enumerate(tokens):
            depth += token.is_mark("(") - token.is_mark(")")
            # (a) && (b): the first bracket closes before the end, so the outer two are no pair.
            if depth == 0 and at < len(tokens) - 1:
                return tokens
        tokens = tokens[1:-1]
    return tokens


def _split(tokens: Sequence[Token], mark: str) -> list[Sequence[Token]]:
    """Return the parts of an expression between marks that stand in no brackets."""
    parts: list[Sequence[Token]] = []
    depth = start = 0
    for at, token in enumerate(tokens):
        if token.kind != "mark":
            continue
        if token.text == "(":
            depth += 1
        elif token.text == ")":
            depth -= 1
        elif depth == 0 and token.text == mark:
            parts.append(tokens[start:at])
            start = at + 1
    return [*parts, tokens[start:]]
