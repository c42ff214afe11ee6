"""Which queries are quick: a guess from the text, so that they need not wait behind slow ones.

A wrong guess costs time and nothing else: a point query that takes a second is ended and asked
again where long ones run. Only :func:`is_lookup` decides more, and is strict.
"""

from __future__ import annotations

import re

from rtask.sparql.lexer import body_start, tokenise
from rtask.sparql.tokens import Token

MAX_PATTERNS = 8
_MAX_LOOKUP = 2_000
_IRI = r"<[^<>\"{}|^`\\\x00-\x20]*>"
_NAME = r"(?:[A-Za-z][\w-]*)?:[A-Za-z_][\w-]*"
_TERM = rf"(?:{_IRI}|{_NAME}|\?\w+)"
_LOOKUP = re.compile(
    rf"""\s*(?:PREFIX\s+(?:[A-Za-z][\w-]*)?:\s*{_IRI}\s*)*
    SELECT\s*(?:\*|(?:\s\?\w+)+)\s*(?:WHERE\s*)?
    \{{\s*(?:{_IRI}|{_NAME})\s+(?:{_TERM}|a)\s+{_TERM}\s*\.?\s*\}}\s*(?:LIMIT\s+\d{{1,9}}\s*)?""",
    re.X | re.I | re.A,
)
_SLOW_WORDS = frozenset(
    (
        *("GROUP", "ORDER", "HAVING", "DISTINCT", "REDUCED", "MINUS", "EXISTS", "SERVICE"),
        *("COUNT", "SUM", "AVG", "MIN", "MAX", "SAMPLE", "GROUP_CONCAT"),
    )
)
_CONSTANTS = frozenset(("iri", "name", "string", "number"))
_TYPE = "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type>"


def is_lookup(text: str) -> bool:
    """Tell whether a query asks for the statements about one thing: its cost is their number.

    Examples
    --------
    >>> is_lookup("SELECT ?p ?o WHERE { <urn:mug> ?p ?o }")
    True
    >>> is_lookup("SELECT * { ?s ?p ?o }"), is_lookup("SELECT * { <urn:a> ?p ?o . ?o ?q ?r }")
    (False, False)
    """
    return len(text) <= _MAX_LOOKUP and _LOOKUP.fullmatch(text) is not None


def is_point(text: str) -> bool:
    """Tell whether a query probably reads little: few patterns, held by a constant.

    Examples
    --------
    >>> is_point("SELECT ?name { ?mug <urn:on> <urn:table> ; <urn:name> ?name }")
    True
    >>> is_point("SELECT * { ?s ?p ?o }"), is_point("SELECT * { ?s a <urn:Mug> }")
    (False, False)
    >>> is_point("SELECT (COUNT(*) AS ?n) { <urn:mug> ?p ?o }")
    False
    """
    tokens = tokenise(text)
    body = tokens[body_start(tokens) :]
    words = [token.text.upper() for token in body if token.kind == "word"]
    if _SLOW_WORDS.intersection(words) or words.count("SELECT") + words.count("ASK") != 1:
        return False
    return _is_held(body)


def _is_held(tokens: list[Token]) -> bool:
    """Tell whether one of a few patterns has a constant subject, or object of another than type."""
    at = next((i for i, token in enumerate(tokens) if token.is_mark("{")), len(tokens))
    place = patterns = parentheses = 0
    held = typed = False
    for token in tokens[at:]:
        mark = token.text if token.kind == "mark" else ""
        parentheses += (mark == "(") - (mark == ")")
        if parentheses or mark == ")":
            continue
        if mark in ("/", "|", "^", "*", "+", "["):
            return False
        if mark in (".", "{", "}"):
            place, patterns = 0, patterns + (mark == ".")
        elif mark in (";", ","):
            place, patterns = (1 if mark == ";" else 2), patterns + 1
        elif token.kind in _CONSTANTS or token.kind == "variable" or token.is_word("A"):
            if place == 1:
                typed = token.is_word("A") or token.text in (_TYPE, "rdf:type")
            elif token.kind in _CONSTANTS and (place == 0 or not typed):
                held = True
            place += 1
    return held and patterns <= MAX_PATTERNS
