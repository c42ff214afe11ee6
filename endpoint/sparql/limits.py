"""Complexity limits of one SPARQL text, checked before the store sees it.

The knowledge base refuses texts that would crash the store's parser. What remains are texts that
parse but take seconds to plan: stars of hundreds of patterns, chains of OPTIONAL, long paths. The
counts take time linear in the text, and the limits are far above what people and libraries write.
"""

from __future__ import annotations

from collections import Counter

from endpoint.http.messages import RefusedError
from endpoint.settings import Limits
from rtask.errors import TooLargeError
from rtask.sparql.lexer import body_start, tokenise
from rtask.sparql.tokens import Token

QUERY_FORMS = frozenset(("SELECT", "ASK", "CONSTRUCT", "DESCRIBE"))
_OPERATIONS = frozenset(("INSERT", "DELETE", "LOAD", "CLEAR", "CREATE", "DROP", "COPY", "MOVE"))
_OPENERS = frozenset("{([")
_CLOSERS = frozenset("})]")
_STEPS = frozenset("/|^")


def checked_form(text: str, limits: Limits, *, update: bool = False) -> str:
    """Return the form of a text, or refuse it beyond the limits.

    Parameters
    ----------
    text
        Query or update.
    limits
        The limits.
    update
        Whether the text is an update.

    Returns
    -------
    form
        ``SELECT``, ``ASK``, ``CONSTRUCT`` or ``DESCRIBE``; empty for anything else.

    Raises
    ------
    TooLargeError
        The text is longer than allowed.
    QuerySyntaxError
        A character begins no token.
    RefusedError
        400, naming the limit: nested too deeply, too many patterns and the like.

    Examples
    --------
    >>> checked_form("PREFIX ask: <x:> ASK {}", Limits())
    'ASK'
    """
    kind, allowed = ("update", limits.update_bytes) if update else ("query", limits.query_bytes)
    if len(text) > allowed:
        raise TooLargeError(f"the {kind} is longer than {allowed} bytes", limit=allowed)
    try:
        tokens = tokenise(text)
    except TooLargeError as error:
        raise RefusedError(400, "query-too-complex", str(error), **error.details) from None
    _check(_count(tokens), limits)
    first = tokens[min(body_start(tokens), len(tokens) - 1)].text.upper()
    return first if first in QUERY_FORMS else ""


def _count(tokens: list[Token]) -> Counter[str]:
    """Count patterns by their separators; VALUES and DATA blocks hold data, not patterns."""
    counts: Counter[str] = Counter()
    depth = data_depth = parentheses = steps = 0
    for index, token in enumerate(tokens):
        mark = token.text if token.kind == "mark" else ""
        if mark in _OPENERS and mark:
            depth += 1
            parentheses += mark == "("
        elif mark in _CLOSERS and mark:
            depth -= 1
            parentheses -= mark == ")"
            if depth < data_depth:
                data_depth = 0
        elif mark in (".", ";", ","):
            # A semicolon outside of braces separates two operations of an update.
            counts["patterns"] += depth > 0 and not data_depth and not parentheses
            steps = 0
        elif mark in _STEPS and mark:
            steps += 1
            counts["path_steps"] = max(counts["path_steps"], steps)
        elif token.kind == "word":
            word = token.text.upper()
            counts["optionals"] += word == "OPTIONAL"
            counts["unions"] += word == "UNION"
            counts["operations"] += word in _OPERATIONS
            if word == "VALUES" or (word == "DATA" and tokens[index - 1].kind == "word"):
                data_depth = depth + 1
    return counts


def _check(counts: Counter[str], limits: Limits) -> None:
    for name in ("patterns", "optionals", "unions", "path_steps", "operations"):
        allowed = getattr(limits, name)
        if counts[name] > allowed:
            raise RefusedError(
                400,
                "query-too-complex",
                f"{counts[name]} {name.replace('_', ' ')} in one request, at most {allowed}; "
                "split it",
                limit=name,
                allowed=allowed,
            )
