"""``SERVICE`` is switched off: the store would call out without a time limit.

``SERVICE SILENT`` becomes one empty solution, as the standard asks of a call that fails
(SPARQL 1.1 Federated Query, 2.4); any other is refused before anything is evaluated.
"""

from __future__ import annotations

from rtask.errors import ForbiddenError
from rtask.sparql.lexer import find_block_end, line_and_column, tokenise

__all__ = ["without_services"]


def without_services(text: str) -> str:
    """Return a query or pattern in which nothing calls out.

    >>> without_services("ASK { SERVICE SILENT <urn:x> { ?s ?p ?o } }")
    'ASK { {} }'

    Raises
    ------
    ForbiddenError
        At a ``SERVICE`` without ``SILENT``.
    """
    if "service" not in text.lower():
        return text
    tokens = tokenise(text)
    pieces, done, at = [], 0, 0
    while tokens[at].kind != "end":
        if not tokens[at].is_word("SERVICE"):
            at += 1
            continue
        if not tokens[at + 1].is_word("SILENT"):
            line, column = line_and_column(text, tokens[at].start)
            raise ForbiddenError(
                f"{line}:{column}: SERVICE is switched off; query that server yourself",
                operation="SERVICE",
                line=line,
                column=column,
            )
        end = find_block_end(tokens, at + 3)
        pieces += [text[done : tokens[at].start], "{}"]
        done, at = tokens[end - 1].end, end
    return "".join([*pieces, text[done:]])
