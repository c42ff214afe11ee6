"""Names in a question that nothing in the graph has.

Answering about everything instead would pass for an answer about what was named.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from rtask.asking.questions.catalogue import Question
from rtask.asking.questions.filling import Filled
from rtask.asking.questions.mentions import MAX_MENTIONS, Mention, is_numbered

__all__ = ["missing_name", "missing_number", "not_named"]

_BEFORE_A_NAME = frozenset(re.findall(r"\w+", "the a an this that my our any of with at for to"))


def missing_name(
    question: Question, filled: Iterable[Filled], tokens: Sequence[str], ignored: Iterable[str]
) -> str:
    """Return a word that was to name something for an empty slot of a question, or nothing."""
    has = {item.slot for item in filled}
    empty = [slot for slot in question.slots if slot not in has and slot.role != "time"]
    if not empty:
        return ""
    ignored = set(ignored)
    is_essential = any(slot.is_constant and not slot.is_list for slot in empty)
    for at, token in enumerate(tokens):
        before = tokens[at - 1].lower() if at else ""
        is_name = token.lower() in ignored or token.startswith('"')
        is_written_so = token.startswith('"') or (at > 0 and token[0].isupper())
        if is_name and (is_essential or is_written_so or before in _BEFORE_A_NAME):
            return token.strip('"')
    return ""


def missing_number(tokens: Sequence[str], mentions: Iterable[Mention]) -> str:
    """Return a name with a number that nothing has, as carton-7 or "carton 7"; or nothing.

    It is not just any carton.
    """
    named = {at for item in mentions for at in range(item.start, item.end)}
    for at, token in enumerate(tokens):
        if at not in named and is_numbered(token):
            return token
        if at not in named and token.isdigit() and at - 1 in named:
            return f"{tokens[at - 1]} {token}"
    return ""


def not_named(missing: str, mentions: Iterable[Mention]) -> str:
    """Return words for a name that nothing has."""
    if any(item.is_cut for item in mentions):
        return (
            f"Whether anything is called {missing!r} is not known: the words name more than "
            f"{MAX_MENTIONS} things, of which {MAX_MENTIONS} were looked at. A full name in "
            "quotes, or an IRI, names fewer."
        )
    return f"Nothing in the graph is called {missing!r}; `rtask search` looks for words."
