"""Lexical analysis of SPARQL texts within limits, without a parser.

The store's parser does not expose what it parsed, and very deep nesting crashes its process. The
knowledge base therefore reads tokens itself, in linear time and without recursion.
"""

from __future__ import annotations

import re
from functools import lru_cache

from rtask.errors import QuerySyntaxError
from rtask.rdf.bounds import MAX_IRI, MAX_LITERAL, MAX_NESTING
from rtask.sparql.complexity import check_complexity, limit
from rtask.sparql.tokens import Token, scan, shape

__all__ = ["body_start", "find_block_end", "guard", "names_dataset", "query_form", "tokenise"]

_OPENERS = {"{", "(", "[", "<<", "<<(", "{|"}
_CLOSERS = {"}", ")", "]", ">>", ")>>", "|}"}
_OPERATORS = {"+", "-", "*", "/", "&&", "||", "=", "!=", "<", ">", "<=", ">=", "|", "^"}
_NAMES = {"iri", "name", "language"}
_SEPARATORS = {"{", "}", ".", ";", ","}
_MAX_OPERATORS = 1_000
_MAX_NEGATIONS = 64
_ESCAPE = re.compile(r"\\(?:u[0-9A-Fa-f]{4}|U[0-9A-Fa-f]{8}|.)", re.S)
_HARMLESS = 64
_LONG = 1_000
_CACHED = 16_000
_READ_AGAIN = 4_000


def tokenise(text: str) -> list[Token]:
    """Return the tokens of a query or update, ended by one of kind ``end``.

    >>> [token.text for token in tokenise("ASK { ?s a <urn:Mug> }")]
    ['ASK', '{', '?s', 'a', '<urn:Mug>', '}', '']

    Raises
    ------
    QuerySyntaxError
        If some characters do not start a token.
    TooLargeError
        If the nesting is deeper or an expression longer than the store's parser can handle.
    """
    return [*(_tokens(text) if len(text) > _READ_AGAIN else _recent_tokens(text))]


def _tokens(text: str) -> tuple[Token, ...]:
    tokens = list(scan(text))
    _check_limits(tokens)
    tokens.append(Token("end", "", len(text), len(text)))
    return tuple(tokens)


@lru_cache(maxsize=16)
def _recent_tokens(text: str) -> tuple[Token, ...]:
    """Return the tokens of a short text; on its way to the store each is read a few times."""
    return _tokens(text)


def _check_limits(tokens: list[Token]) -> None:
    depth = operators = negations = 0
    for kind, text, _, _ in tokens:
        if kind != "mark":
            negations = 0
            if kind == "string" and len(text) > MAX_LITERAL:
                limit("characters in one literal", _characters(text), MAX_LITERAL)
            elif kind in _NAMES:
                limit("characters in one IRI or language tag", len(text) - 2, MAX_IRI)
            continue
        negations = negations + 1 if text == "!" else 0
        if text in _OPENERS:
            depth += 1
        elif text in _CLOSERS:
            depth -= 1
        if text in _SEPARATORS:
            operators = 0
        elif text in _OPERATORS:
            operators += 1
        limit("nesting", depth, MAX_NESTING)
        limit("operators in one expression", operators, _MAX_OPERATORS)
        limit("negations in a row", negations, _MAX_NEGATIONS)
    check_complexity(tokens)


def _characters(string: str) -> int:
    """Return the length of the literal that a token stands for."""
    quotes = 6 if string[:3] in ('"""', "'''") else 2
    return len(string) - quotes - sum(len(escape) - 1 for escape in _ESCAPE.findall(string))


def guard(text: str) -> None:
    """Refuse text that would crash the store's parser or planner.

    For most texts counting characters is enough; only suspicious ones are tokenised.
    """
    if len(text) > _CACHED:
        tokenise(text)
    else:
        _guard(shape(text))


@lru_cache(maxsize=1024)
def _guard(text: str) -> None:
    if len(text) < _HARMLESS:
        return
    brackets = text.count("{") + text.count("(") + text.count("[") + text.count("<<")
    operators = sum(text.count(mark) for mark in "+-*/!=|&^<")
    separators = text.count(".") + text.count(";") + text.count(",")
    many = max(brackets, separators) > MAX_NESTING or operators > _MAX_NEGATIONS
    if many or len(text) > _LONG:
        tokenise(text)


def find_block_end(tokens: list[Token], start: int) -> int:
    """Return the index after the ``}`` that closes the ``{`` at ``start``.

    Raises
    ------
    QuerySyntaxError
        If the block is not closed.
    """
    depth = 0
    for index in range(start, len(tokens)):
        if tokens[index].is_mark("{"):
            depth += 1
        elif tokens[index].is_mark("}"):
            depth -= 1
            if depth == 0:
                return index + 1
    raise QuerySyntaxError("a block is never closed; add the missing }")


def body_start(tokens: list[Token]) -> int:
    """Return the index of the first token after the prologue (BASE, PREFIX, VERSION)."""
    index = 0
    while tokens[index].is_word("BASE", "PREFIX", "VERSION"):
        index += 3 if tokens[index].is_word("PREFIX") else 2
    return index


def query_form(text: str) -> str:
    """Return ``select``, ``ask``, ``construct`` or ``describe``; empty if it is none of them.

    >>> query_form("PREFIX : <urn:> SELECT * { ?s ?p ?o }")
    'select'
    """
    tokens = tokenise(text)
    start = body_start(tokens)
    word = tokens[min(start, len(tokens) - 1)].text.lower()
    return word if word in ("select", "ask", "construct", "describe") else ""


def names_dataset(text: str) -> bool:
    """Whether a query names its own dataset by ``FROM`` or ``FROM NAMED``.

    >>> names_dataset("SELECT * FROM <urn:g> { ?s ?p ?o }"), names_dataset("ASK { ?from ?p ?o }")
    (True, False)
    """
    if "from" not in text.lower():
        return False
    return any(token.is_word("FROM") for token in tokenise(text))
