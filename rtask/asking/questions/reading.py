"""The words of a question: what they name, and what of them means nothing here."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass

from rtask.asking.questions.matching import Asked, matcher
from rtask.asking.questions.mentions import (
    Mention,
    Select,
    find_by_part,
    find_mentions,
    tokens_of,
    with_called,
)
from rtask.asking.questions.periods import Period, find_period
from rtask.asking.questions.words import split_name, stem, uncontracted

__all__ = ["Reading", "read"]


@dataclass(frozen=True)
class Reading:
    """The words of a question, and what they name."""

    tokens: tuple[str, ...]
    mentions: tuple[Mention, ...]
    period: Period | None
    asked: Asked
    ignored: tuple[str, ...]


def read(run: Select, text: str, base: str, now: dt.datetime) -> Reading:
    """Return the words of a question and what they name in a graph."""
    period = find_period(text, now)
    plain = text.replace(period.text, " ") if period is not None else text
    tokens = tuple(tokens_of(plain))
    mentions = tuple(with_called(run, tokens, find_mentions(run, list(tokens), base)))
    strange = [at for at, token in enumerate(tokens) if _is_strange(token, at, mentions)]
    mentions += tuple(find_by_part(run, tokens, strange))
    words: list[str] = []
    names: set[str] = set()
    ignored: list[str] = []
    for at, token in enumerate(tokens):
        covering = [item for item in mentions if item.start <= at < item.end]
        words += sorted({f"@{item.role}" for item in covering if item.start == at})
        for part in split_name(uncontracted(token.strip('"<>').lower())):
            word = stem(part)
            if covering:
                names.add(word)
            else:
                word = matcher().corrected(word)
                if not matcher().is_familiar(word):
                    ignored.append(part)
            words.append(word)
    if period is not None:
        words.append("@time")
    places = {(item.start, item.end) for item in mentions}
    roles = [
        frozenset(item.role for item in mentions if (item.start, item.end) == place)
        for place in places
    ]
    roles += [frozenset({"time"})] if period is not None else []
    return Reading(
        tokens, mentions, period, Asked(tuple(words), frozenset(names), tuple(roles)),
        tuple(dict.fromkeys(ignored)),
    )  # fmt: skip


def _is_strange(token: str, at: int, mentions: tuple[Mention, ...]) -> bool:
    """Return whether a word names nothing and means nothing in a question."""
    if any(item.start <= at < item.end for item in mentions):
        return False
    return not any(matcher().is_familiar(stem(part)) for part in split_name(token.lower()))
