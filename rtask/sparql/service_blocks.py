"""``SERVICE`` blocks that this store answers itself: each is replaced by a ``VALUES`` clause."""

from __future__ import annotations

from collections.abc import Callable

from rtask.errors import QuerySyntaxError
from rtask.sparql.lexer import body_start, find_block_end, tokenise
from rtask.sparql.tokens import Token, line_and_column

__all__ = ["block_refusal", "replace_blocks", "string_value"]

_STRING_MARKS = ('"""', "'''", '"', "'")


def replace_blocks(text: str, service: str, values: Callable[[str, list[Token]], str]) -> str:
    """Return a query with the blocks of a service replaced.

    Parameters
    ----------
    service
        IRI of the service.
    values
        Function of the query's prologue and of the tokens in a block, which returns the pattern
        that takes its place.
    """
    if service not in text:
        return text
    tokens = tokenise(text)
    prologue = text[: tokens[body_start(tokens)].start]
    pieces, done, at = [], 0, 0
    while tokens[at].kind != "end":
        start = at
        at += 1
        if not tokens[start].is_word("SERVICE"):
            continue
        name = at + tokens[at].is_word("SILENT")
        if tokens[name].text != f"<{service}>" or not tokens[name + 1].is_mark("{"):
            continue
        end = find_block_end(tokens, name + 1)
        pieces += [text[done : tokens[start].start], values(prologue, tokens[name + 2 : end - 1])]
        done, at = tokens[end - 1].end, end
    return "".join([*pieces, text[done:]])


def block_refusal(text: str, service: str, tokens: list[Token], message: str) -> QuerySyntaxError:
    """Return the error of a block that says something else, with line and column."""
    line, column = line_and_column(text, tokens[0].start if tokens else 0)
    return QuerySyntaxError(
        f"{line}:{column}: in SERVICE <{service}>: {message}", line=line, column=column
    )


def string_value(token: Token) -> str:
    """Return the value of a string token."""
    mark = next(mark for mark in _STRING_MARKS if token.text.startswith(mark))
    inner = token.text[len(mark) : -len(mark)]
    pairs = {"n": "\n", "t": "\t", "r": "\r", "b": "\b", "f": "\f"}
    out, at = [], 0
    while at < len(inner):
        if inner[at] == "\\" and at + 1 < len(inner):
            out.append(pairs.get(inner[at + 1], inner[at + 1]))
            at += 2
        else:
            out.append(inner[at])
            at += 1
    return "".join(out)
