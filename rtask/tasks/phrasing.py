"""Everyday phrasings of goals, brought to the form that goals are read in.

Each rule replaces words by others of the same meaning; what a rule does not know stays as it is,
so that a word without meaning is still refused where the goal is read.
"""

from __future__ import annotations

import re

from rtask.asking.questions.words import stem
from rtask.errors import UsageError

__all__ = ["EXCEPT", "plain_goal"]

EXCEPT = "except"
"""The word before what is left out of a goal."""

_RULES = tuple(
    (re.compile(pattern, re.I), replacement)
    for pattern, replacement in (
        (r"^\s*(?:please\s+)?(?:can|could|would|will) you\s+(?:please\s+)?", ""),
        (r"\b(?:i|we)(?: would|['’]d)?\s+(?:want|need|like)(?:\s+you)?(?:\s+to)?\s+", "move "),
        # A leading verb would read as a wish to hold: what is to be "left" lies somewhere.
        (r"\b(?:leave|let|keep)\s+nothing(?:\s+be)?(?:\s+left)?\s+(?:on|in|at)\b", "clear"),
        (r"\b(?:one|you|we|i|people) (?:can|could|may)\b", "to"),
        (r"\b(?:that|which) to\b", "to"),
        (r"\bat least\s+(?=\w)", ""),
        (r"\b(?:apart from|other than|excluding|but not|except for)\b", EXCEPT),
        (r"\b(all|everything|every \w+|all \w+|each \w+) but\b", rf"\1 {EXCEPT}"),
    )
)
_SAME_NOUN = re.compile(rf"\b(\w+)\s+({EXCEPT}\s+(?:the\s+)?\w+)\s+ones?\b", re.I)
_TIME = re.compile(
    r"\b(?:by|before|until|at)\s+(?:\d{1,2}[:.]\d\d|\d{1,2}\s?(?:am|pm)|noon|midnight|tonight|"
    r"tomorrow|\d{4}-\d\d-\d\d)",
    re.I,
)


def plain_goal(text: str) -> str:
    """Return a goal with everyday phrasings replaced.

    Raises
    ------
    UsageError
        It says by when: deadlines are given apart, with a date and a time zone, which no such word
        has.

    Examples
    --------
    >>> plain_goal("could you please leave nothing on the table")
    'clear the table'
    >>> plain_goal("all cups apart from the red one into the left box")
    'all cups except the red cup into the left box'
    """
    time = _TIME.search(text)
    if time is not None:
        raise UsageError(
            f"{time[0]!r}: by when a goal is to be reached is said apart from it, with date and "
            "time zone: --deadline 2026-12-01T12:00:00Z with --store, or deadline of store_plan"
        )
    for pattern, replacement in _RULES:
        text = pattern.sub(replacement, text)
    return _SAME_NOUN.sub(lambda match: f"{match[1]} {match[2]} {stem(match[1].lower())}", text)
