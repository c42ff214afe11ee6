"""Bounds on what comes in: one depth and one length of literals for every syntax.

Documents, updates and commits share them. Far deeper texts end the process of a recursive parser,
and the time to match, send and index a literal grows with its length.
"""

from __future__ import annotations

from typing import Any

from pyoxigraph import Literal, Triple

from rtask.errors import TooLargeError

__all__ = ["MAX_LITERAL", "MAX_NESTING", "characters", "refuse_long_literal"]

MAX_NESTING = 128
"""Brackets, elements, objects and triple terms within each other."""

MAX_LITERAL = 1 << 20
"""Characters of one literal."""


def characters(term: Any) -> int:
    """Return the length of a literal, also within a triple term; 0 for other terms.

    >>> characters(Literal("mug"))
    3
    """
    if isinstance(term, Literal):
        return len(term.value)
    if isinstance(term, Triple):
        return characters(term.object)
    return 0


def refuse_long_literal(term: Any, where: str) -> None:
    """Raise if a literal is longer than :data:`MAX_LITERAL`.

    Raises
    ------
    TooLargeError
        Naming the limit.
    """
    size = characters(term)
    if size > MAX_LITERAL:
        raise TooLargeError(
            f"{where}: a literal of {size} characters, at most {MAX_LITERAL} are allowed; store "
            "the bytes as a blob and name it",
            limit="literal",
            value=size,
            allowed=MAX_LITERAL,
        )
