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

_IN_ORDER = "; then"
_RULES = tuple(
    (re.compile(pattern, re.I), replacement)
    for pattern, replacement in (
        (r"^\s*(?:please\s+)?(?:can|could|would|will) you\s+(?:please\s+)?", ""),
        (r"\b(?:i|we)(?: would|['’]d)?\s+(?:want|need|like)(?:\s+you)?(?:\s+to)?\s+", "move "),
        # A leading verb would read as a wish to hold: what is to be "left" lies somewhere.
        (r"\b(?:leave|let|keep)\s+nothing(?:\s+be)?(?:\s+left)?\s+(?:on|in|at)\b", "clear"),
        (r"\b(?:that|which) (?:one|you|we|i|people) (?:can|could|may)\b", "to"),
        # "one can" alone is a tin.
        (r"\b(\w+thing|things?) (?:one|you|we|i|people) (?:can|could|may)\b", r"\1 to"),
        (r"\b(?:that|which) to\b", "to"),
        (r"\bat least\s+(?=\w)", ""),
        (r"(?<!drink )\bout of\b", "off"),
        (
            r"\bback (?:to )?where (?:it|they) (?:was|were)(?: before)?(?=\s*(?:$|[,;.!]|\band\b))",
            "back",
        ),
        (r"\b(?:what|whatever|all that) (is|lies|stands)\b", r"everything that \1"),
        (r"[,\s]*\bplease\b[,\s]*", " "),
        (
            r"\b(box|half|part|table|shelf|bin|tray)\s+on the (left|right)"
            r"(?=\s*(?:$|[,;.!]|\b(?:and|then|into|onto|from|in|on|to)\b))",
            r"\2 \1",
        ),
        (
            r"(?:[,;.]\s*(?:and\s+)?|\s+and\s+)(?:after that|afterwards|next)\s*,?\s+(?!to\b)",
            f"{_IN_ORDER} ",
        ),
        (
            r"\b(?:take|pick up|grab|get|fetch|lift)\s+((?:(?!\b(?:and|then)\b)[^;.!,])+?)\s*"
            r"(?:,\s*)?(?:and|then|and then)\s+(?:put|place|move|bring|carry|drop|lay|set)\s+"
            r"(?:it|them)\b",
            r"move \1",
        ),
        (r"\b(?:apart from|other than|excluding|but not|except for)\b", EXCEPT),
        (r"\b(all|everything|every \w+|all \w+|each \w+) but\b", rf"\1 {EXCEPT}"),
    )
)
_ONES = re.compile(
    rf"\b{EXCEPT}\s+(?:(?:the|all|every)\s+)*(?!(?:ones?|the|all|every)\b)(\w+)\s+ones?\b", re.I
)
_NOUN = re.compile(
    r"\b(?:all|every|each|both|any|some|an?|the|one|two|three|four|five|six|seven|eight|nine|\d+)\s+"
    r"(?:of\s+)?(?:the\s+)?(\w+)",
    re.I,
)
_TIME = re.compile(
    r"\b(?:by|before|until|at)\s+(?:\d{1,2}[:.]\d\d|\d{1,2}\s?(?:am|pm)|noon|midnight|tonight|"
    r"tomorrow|\d{4}-\d\d-\d\d)|"
    r"\b(?:within|in)\s+(?:the next\s+)?\w+\s+(?:seconds?|minutes?|hours?)",
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
    return _with_nouns(text)


def _with_nouns(text: str) -> str:
    """Return a goal with the noun in the place of "ones": that of the things that it is about.

    The nearest noun would be another: "all cups into the left box except the red one".
    """
    ones = _ONES.search(text)
    before = text[: ones.start()] if ones is not None else ""
    noun = _NOUN.search(before) or re.search(r"(\w+)\s*$", before)
    if ones is None or noun is None:
        return text
    return f"{before}{EXCEPT} the {ones[1]} {stem(noun[1].lower())}{text[ones.end() :]}"
