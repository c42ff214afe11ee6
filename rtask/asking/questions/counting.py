"""Questions that count: "how many cartons are there?" is the question for cartons, counted."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rtask.asking.questions.catalogue import Question
from rtask.asking.questions.filling import Filled, projected, without_order
from rtask.asking.questions.mentions import Mention, Select
from rtask.asking.questions.words import STOP, concept, split_name, stem
from rtask.sparql.results import Solutions

__all__ = [
    "Counting", "Noun", "count_of", "counting", "counting_of", "is_numeric", "noun_counted",
]  # fmt: skip

_ROLES = {"robot": "robot", "object": "object", "hand": "hand", "trait": "trait"}
_STARRED = re.compile(r"\{(\w+)\*\}")
_TYPED = re.compile(r"\?(\w+)\s+a\s+\w*:(\w+)")
_HAD = re.compile(r"\w*:has(\w+)\s+\?(\w+)")
_INNERMOST = re.compile(r"\([^()]*\)")
_AGGREGATED = re.compile(r"\b(?:COUNT|SUM)\s*\([^()]*\)", re.I)
_AGGREGATE = re.compile(r"\b(?:COUNT|SUM)\s*\(", re.I)


@dataclass(frozen=True)
class Counting:
    """What is counted.

    Parameters
    ----------
    variable
        Variable of the query, with its question mark.
    listed
        The query, in whose rows the variable is.
    counted
        The query for the number alone.
    """

    variable: str
    listed: str
    counted: str


@dataclass(frozen=True)
class Noun:
    """The noun that a question counts.

    Parameters
    ----------
    at
        Its place among the tokens, as of :func:`noun_counted`.
    tokens, mentions
        Words of the question, and what they name.
    """

    at: int
    tokens: Sequence[str]
    mentions: Sequence[Mention]


def noun_counted(tokens: Sequence[str]) -> int | None:
    """Return where the noun stands that a question counts, or None if it counts nothing.

    >>> noun_counted(["how", "many", "of", "the", "boxes", "are", "red"])
    4
    >>> noun_counted(["how", "often", "did", "nao-1", "fail"]) is None
    True
    """
    lower = [token.lower() for token in tokens]
    for at, word in enumerate(lower):
        before = lower[at - 1] if at else ""
        begins = (word == "many" and before == "how") or (word == "of" and before == "number")
        begins = begins or (word == "count" and at == 0)
        if begins:
            nouns = (i for i in range(at + 1, len(lower)) if lower[i] not in STOP)
            return next(nouns, None)
    return None


def is_numeric(question: Question, noun: str) -> bool:
    """Return whether a question has the number of what a noun names as its answer anyway.

    >>> from rtask.asking.questions.catalogue import questions
    >>> how_often = next(item for item in questions() if item.key == "eq01")
    >>> is_numeric(how_often, "attempt"), is_numeric(how_often, "sensor")
    (True, False)
    """
    own = {concept(word) for word in question.own_words}
    return concept(noun) in own and _AGGREGATE.search(question.sparql) is not None


def counting(question: Question, sparql: str, noun: str, variable: str = "") -> Counting | None:
    """Return how the things of a noun are counted in the answer of a question, or None.

    Parameters
    ----------
    sparql
        Its query with its slots filled.
    noun
        A stem, such as ``robot``; empty for a kind that fills a slot.
    variable
        The variable that stands for them, if that is known.
    """
    variable = variable or _variable(question, noun)
    head = sparql[sparql.index("SELECT") : sparql.index("{")]
    is_own = _has(question.sparql, variable) or _has(head, variable)
    if not is_own or _has(_aggregates(head), variable):
        return None
    if not _has(_plain(head), variable):
        sparql = projected(sparql, variable)
    start = sparql.index("SELECT")
    prefixes, body = sparql[:start], without_order(sparql[start:]).strip()
    inner = "\n".join(f"    {line}" for line in body.splitlines())
    number = f"SELECT (COUNT(DISTINCT {variable}) AS ?count)"
    counted = f"{prefixes}{number}\nWHERE {{\n  {{\n{inner}\n  }}\n}}\n"
    return Counting(variable, sparql, counted)


def counting_of(
    question: Question, filled: Sequence[Filled], sparql: str, noun: Noun
) -> tuple[Counting | None, bool]:
    """Return how the noun of a question is counted in its answer, and whether it is at all."""
    covering = {item.text for item in noun.mentions if item.start <= noun.at < item.end}
    for item in filled:
        if item.text in covering:
            variable = "" if item.slot.is_constant else item.slot.term
            counts = counting(question, sparql, "", variable)
            return counts, counts is not None
    word = stem(noun.tokens[noun.at].lower())
    counts = counting(question, sparql, word)
    return counts, counts is not None or is_numeric(question, word)


def count_of(select: Select, counts: Counting, rows: Solutions, is_cut: bool) -> int:
    """Return how many things there are; beyond the rows that are shown, the graph counts them."""
    if is_cut:
        return int(str(select(counts.counted)[0].value("count")))
    return len({row[counts.variable.removeprefix("?")] for row in rows} - {None})


def _has(text: str, variable: str) -> bool:
    return bool(variable) and re.search(re.escape(variable) + r"(?!\w)", text) is not None


def _plain(head: str) -> str:
    """Return what a SELECT projects as it is, without what it computes."""
    while (without := _INNERMOST.sub(" ", head)) != head:
        head = without
    return head.partition("WHERE")[0]


def _aggregates(head: str) -> str:
    """Return what a SELECT counts and adds up already."""
    return " ".join(_AGGREGATED.findall(head))


def _variable(question: Question, noun: str) -> str:
    """Return the variable of a query that stands for the things of a noun, or nothing."""
    meant = concept(noun)
    role = _ROLES.get(meant, "")
    for slot in question.slots:
        if role and slot.role == role and not slot.is_constant:
            return slot.term
    found = _STARRED.findall(question.answer)
    if len(found) == 1 and (not noun or meant in {concept(word) for word in question.own_words}):
        return f"?{found[0]}"
    named = [(name, variable) for variable, name in _TYPED.findall(question.sparql)]
    for name, variable in [*_HAD.findall(question.sparql), *named]:
        if noun and meant in {concept(stem(word)) for word in split_name(name)}:
            return f"?{variable}"
    return ""
