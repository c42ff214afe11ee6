"""Bounds on what comes in: one depth, one length of literals and one of names for every syntax.

Documents, updates and commits share them. Far deeper texts end the process of a recursive parser,
and the time to match, send and index a term grows with its length: an IRI of 2 MB was copied and
hashed a hundred times on the way of one commit.
"""

from __future__ import annotations

from typing import Any

from pyoxigraph import Literal, NamedNode, Quad, Triple

from rtask.errors import TooLargeError

__all__ = [
    "MAX_IRI",
    "MAX_LITERAL",
    "MAX_NESTING",
    "characters",
    "name_characters",
    "refuse_long_literal",
    "refuse_long_names",
]

MAX_NESTING = 128
"""Brackets, elements, objects and triple terms within each other."""

MAX_LITERAL = 1 << 20
"""Characters of one literal."""

MAX_IRI = 1 << 14
"""Characters of one IRI, also of a datatype, and of a language tag; Web servers take 8,000."""


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


def name_characters(term: Any) -> int:
    """Return the length of an IRI; of a literal, that of its datatype or language tag.

    >>> name_characters(NamedNode("urn:mug")), name_characters(Literal("mug", language="en"))
    (7, 53)
    """
    if isinstance(term, NamedNode):
        return len(term.value)
    if isinstance(term, Literal):
        return max(len(term.datatype.value), len(term.language or ""))
    if isinstance(term, Triple):
        return max(map(name_characters, (term.subject, term.predicate, term.object)))
    return 0


def refuse_long_names(quad: Quad) -> None:
    """Raise if a term of a quad has an IRI or language tag longer than :data:`MAX_IRI`.

    Raises
    ------
    TooLargeError
        Naming the limit.
    """
    if len(str(quad)) <= MAX_IRI:  # one call for the four terms of nearly all quads
        return
    for term in quad:
        size = name_characters(term)
        if size > MAX_IRI:
            raise TooLargeError(
                f"{str(term)[:60]}...: an IRI or language tag of {size} characters, at most "
                f"{MAX_IRI} are allowed",
                limit="iri",
                value=size,
                allowed=MAX_IRI,
            )
