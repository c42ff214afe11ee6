"""What an expression takes a variable for, by the operator or function around it.

SPARQL 1.1, 17.3 and 17.4: an operand of another type is an error, so that the row is lost.
"""

from __future__ import annotations

from collections.abc import Sequence

from rtask.sparql.tokens import Token

__all__ = ["read_as", "renaming"]

_COMPARISONS = {"<", ">", "<=", ">=", "=", "!="}
_ORDERS = {"<", ">", "<=", ">="}
_STARTS = {"(", "&&", "||", "!", ","}  # behind an operator it is part of a larger expression
_ENDS = {")", "&&", "||", ","}
_ARITHMETIC = {"*": "number", "/": "number", "+": "quantity", "-": "quantity"}
_FUNCTIONS = {
    **dict.fromkeys(("ABS", "ROUND", "CEIL", "FLOOR", "SUM", "AVG"), "number"),
    **dict.fromkeys(("YEAR", "MONTH", "DAY", "HOURS", "MINUTES", "SECONDS", "TZ"), "moment"),
    **dict.fromkeys(
        ("STRLEN", "SUBSTR", "UCASE", "LCASE", "STRSTARTS", "STRENDS", "CONTAINS", "STRBEFORE",
         "STRAFTER", "REGEX", "REPLACE", "ENCODE_FOR_URI", "CONCAT", "LANG"), "text",
    ),
    **dict.fromkeys(("DATATYPE", "GROUP_CONCAT"), "literal"),
}  # fmt: skip
_SAME = {"MIN", "MAX", "AVG", "SUM", "SAMPLE", "STR", "ROUND"}
_CASTS = {"integer", "decimal", "double", "float", "boolean", "dateTime", "int", "long"}


def read_as(tokens: Sequence[Token], at: int) -> str:
    """Return what the variable at a place in the tokens is read as; empty for anything."""
    before, after = tokens[at - 1], tokens[min(at + 1, len(tokens) - 1)]
    if after.is_word("IN") and before.text in _STARTS:
        return _compared(tokens, at + 3)  # ?name IN ("mug", ...)
    if before.is_mark("(") and tokens[at - 2].is_word("SAMETERM") and after.is_mark(","):
        is_constant = tokens[min(at + 2, len(tokens) - 1)].kind != "variable"
        return _compared(tokens, at + 2) if is_constant else ""
    if after.kind == "mark" and after.text in _COMPARISONS:
        if before.text not in _STARTS:
            return _ARITHMETIC.get(before.text, "")
        return _compared(tokens, at + 2)
    if before.text in _ORDERS and tokens[at - 2].kind == "variable" and after.text in _ENDS:
        return "ordered"
    for mark in (before, after):
        if mark.kind == "mark" and mark.text in _ARITHMETIC:
            return _ARITHMETIC[mark.text]
    if after.text not in _ENDS:
        return ""
    return _argument(tokens, at)


def _compared(tokens: Sequence[Token], at: int) -> str:
    """Return the kind of the constant at a place, behind which a comparison ends."""
    value = tokens[min(at, len(tokens) - 1)]
    if value.kind == "number":
        return "number"
    if value.kind == "string":
        behind = tokens[min(at + 1, len(tokens) - 1)]
        # A text equals, and is ordered among, no number and no moment.
        return "literal" if behind.is_mark("^^") else "text"
    if value.kind == "variable" and tokens[at - 1].text not in ("=", "!="):
        return "ordered"  # things have no order
    return "moment" if value.is_word("NOW") else ""


def _argument(tokens: Sequence[Token], at: int) -> str:
    """Return what the function takes of which a variable is the first argument, or CONCAT any."""
    before = at - 1
    if tokens[before].is_word("DISTINCT"):
        before -= 1
    if tokens[before].is_mark(","):
        depth = 0
        while before > 1 and (depth or not tokens[before].is_mark("(")):
            depth += tokens[before].is_mark(")") - tokens[before].is_mark("(")
            before -= 1
        return "text" if tokens[before - 1].is_word("CONCAT") else ""
    if before < 1 or not tokens[before].is_mark("("):
        return ""
    name = tokens[before - 1]
    if name.kind == "word":
        return _FUNCTIONS.get(name.text.upper(), "")
    is_cast = name.kind == "name" and name.text.startswith("xsd:")
    return "literal" if is_cast and name.text[4:] in _CASTS else ""


def renaming(tokens: Sequence[Token], at: int) -> str | None:
    """Return the function of ``(f(?x) AS ?y)`` that begins at a place, empty for ``(?x AS ?y)``.

    None for any other expression: what it defines is not what its variable stands for.
    """
    rest = [token for token in tokens[at : at + 8] if not token.is_word("DISTINCT")]
    words = [token.text.upper() if token.kind == "word" else token.text for token in rest]
    kinds = [token.kind for token in rest]
    if kinds[1:2] == ["variable"] and words[2:3] == ["AS"]:
        return ""
    if words[1:2] and words[1] in _SAME and words[2:3] == ["("] and kinds[3:4] == ["variable"]:
        return words[1] if words[4:6] == [")", "AS"] else None
    return None
