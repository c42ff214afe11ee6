"""Syntax check of SPARQL texts with the store's own parser, without evaluation."""

from __future__ import annotations

import re
import threading
from itertools import pairwise

from pyoxigraph import Store

import ontology
from rtask.errors import DataError, QuerySyntaxError, RtaskError
from rtask.sparql.lexer import guard, tokenise
from rtask.sparql.misspelt import bare_slash, misspelling, unbalanced
from rtask.sparql.tokens import Token, line_and_column
from rtask.sparql.update_outline import Update

__all__ = ["check_query", "check_update", "syntax_error"]

_FAILS = "CREATE GRAPH <urn:rtask:twice> ; CREATE GRAPH <urn:rtask:twice> ;\n"
_POSITION = re.compile(r"error at (\d+):(\d+): ?(.*)", re.S)
# The parser lists the characters that a name may have, class by class.
_CHARACTERS = re.compile(r"\[[^]]*\](?:, \[[^]]*\])*", re.S)
_scratch = threading.local()


def _empty_store() -> Store:
    if not hasattr(_scratch, "store"):
        _scratch.store = Store()
    store: Store = _scratch.store
    return store


def syntax_error(
    error: Exception, what: str, text: str, skipped_lines: int = 0
) -> QuerySyntaxError:
    """Return the store's syntax error with line and column.

    Parameters
    ----------
    text
        The caller's text.
    skipped_lines
        Number of lines prepended to it for the store's parser.
    """
    try:
        tokens = tokenise(text)
    except RtaskError:
        tokens = []
    fault = (
        _undeclared_prefix(tokens)
        or bare_slash(tokens)
        or (tokens and misspelling(tokens, what == "query"))
        or unbalanced(tokens)
    )
    if fault:
        message, token = fault
        line, column = line_and_column(text, token.start)
    else:
        position = _POSITION.search(str(error))
        if position is None or int(position[1]) <= skipped_lines:
            return QuerySyntaxError(f"{what}: {error}")
        line, column = int(position[1]) - skipped_lines, int(position[2])
        message = _CHARACTERS.sub("a name", position[3])
    return QuerySyntaxError(f"{what} {line}:{column}: {message}", line=line, column=column)


def _undeclared_prefix(tokens: list[Token]) -> tuple[str, Token] | None:
    """Return what is wrong with the first prefix that is used and not declared, and its token."""
    declared: set[str] = set()
    for before, token in pairwise([Token("", "", 0, 0), *tokens]):
        if token.kind != "name":
            continue
        prefix = token.text.partition(":")[0] + ":"
        if before.is_word("PREFIX"):
            declared.add(prefix)
        elif prefix not in declared:
            namespace = ontology.PREFIXES.get(prefix[:-1])
            hint = f"; add PREFIX {prefix} <{namespace}>" if namespace else ""
            return f"undeclared prefix {prefix!r}{hint}", token
    return None


def check_update(update: Update, base: str | None = None) -> None:
    """Raise unless the text is a SPARQL 1.1 update.

    The second of two prepended CREATE operations always fails, so nothing is executed. Declarations
    come first, because the store's parser accepts none between two operations.

    Raises
    ------
    QuerySyntaxError
        With line and column.
    """
    head = update.declarations + _FAILS
    try:
        _empty_store().update(head + update.body, base_iri=base)
    except SyntaxError as error:
        raise syntax_error(error, "update", update.text, head.count("\n")) from error
    except RuntimeError:
        return


def check_query(text: str, base: str | None = None) -> None:
    """Raise unless the text is a SPARQL 1.1 query; no data are read.

    Raises
    ------
    QuerySyntaxError
        With line and column.
    DataError
        It calls a function that the store does not have, so that it can never be evaluated.
    """
    guard(text)
    try:
        _empty_store().query(text, base_iri=base)
    except SyntaxError as error:
        raise syntax_error(error, "query", text) from error
    except RuntimeError as error:
        raise DataError(f"the query cannot be evaluated: {error}") from error
