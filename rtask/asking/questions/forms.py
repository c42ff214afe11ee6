"""Forms of questions to which a graph of what was seen and done has no answer.

The words of such a question may all occur in one of the ontology's: "how heavy is nao?" shares each
of its words with what is asked about payloads. What parts them is what is asked *for*: how to do
something, what will or should be, the measure of something that is no object, who made or owns it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence, Set
from itertools import pairwise

from rtask.asking.questions.catalogue import Phrase
from rtask.asking.questions.words import concept, raw_words, stem

__all__ = ["other_form"]

_HOW_TO_SUBJECT = re.compile(
    r"^(?:and |so |but )?how (?:to|(?:do|can|could|should|would|must|might) "
    r"(?:i|we|you|one|people|somebody|someone))\b(?! (?:know|see|tell|judge|get))",
    re.I,
)
_HOW_IT_WORKS = re.compile(r"^how (?:do|does|did) (?:[\w-]+ ){1,4}(?:work|function)\W*$", re.I)
_HOW_ALL_DO = re.compile(r"^how (?:do|does) (?:the |all |these )?[\w-]+ \w+\W*$", re.I)
_OPINION = re.compile(
    r"\b(?:do|does|would) (?:i|you|people) (?:like|love|hate|prefer|find|feel|want|recommend)\b",
    re.I,
)
_OUGHT = re.compile(r"\b(will|shall|should|ought|gonna)\b", re.I)
_POLITE = re.compile(r"^(?:will|would|could|can) you\b", re.I)
_DEGREE = re.compile(r"^how (?P<how>\w+)(?: (?P<verb>is|are|was|were)\b)?", re.I)
_NO_DEGREE = frozenset(
    re.findall(
        r"\w+",
        "many much often do does did can could is are was were has have had to come should would "
        "will must may might well good successful successfully it they he she each the a an",
    )
)
_MEASURES = frozenset(concept(stem(word)) for word in ("heavy", "large", "wide", "tall", "long"))
_MADE = re.compile(
    r"\b(?:produced?|manufactur\w*|built|bought|sold|invent\w*|construct\w*|born|owns?|owned|"
    r"owners?|made)\b",
    re.I,
)
_ACT_MADE = re.compile(
    r"\b(?:attempts?|tries|grasps?|pictures?|estimates?|mistakes?)\b.*\bmade", re.I
)
_WHERE_IS = re.compile(r"^where(?:'s| is| are| was| were)\b", re.I)
_WHAT_IS_IN = re.compile(
    r"^what(?:'s| is| are| was)?(?: now| currently| there)? (?:in|inside|within)\b", re.I
)
_AGENTS = frozenset({"robot", "robot_kind", "hand"})
_THINGS = frozenset({"object", "kind", "robot", "robot_kind", "hand", "place"})
_DOCUMENTED = "How to do something, or how it works, is told by the documentation, not the graph."


def other_form(text: str, phrases: Sequence[Phrase], roles: Set[str]) -> str:
    """Return why a question asks for something else than the nearest one, or nothing.

    Parameters
    ----------
    text
        The question as it was asked.
    phrases
        The nearest question in its phrasings.
    roles
        Roles that the things named in it can fill.
    """
    text = text.strip()
    phrased = [item.text.lower() for item in phrases]
    if _HOW_IT_WORKS.match(text) or (
        _HOW_TO_SUBJECT.match(text) and not any(map(_HOW_TO_SUBJECT.match, phrased))
    ):
        return _DOCUMENTED
    if _HOW_ALL_DO.match(text) and roles <= _AGENTS and not any(map(_HOW_ALL_DO.match, phrased)):
        return _DOCUMENTED
    if _OPINION.search(text):
        return "What somebody likes or looks for is not stated in the graph."
    ought = _OUGHT.search(text)
    if ought and "task" not in roles and not _POLITE.match(text) and not _has(phrased, ought[1]):
        return "The graph states what was and what is, not what will or should be."
    if why := _measure(text, phrased, roles):
        return why
    made = None if _ACT_MADE.search(text) else _MADE.search(text)
    if roles and roles <= _THINGS and made and not _has(phrased, made[0]):
        return f"Who made or owns a thing, and where, is not stated here ({made[0]!r})."
    if _WHERE_IS.match(text) and roles and roles <= _AGENTS:
        return "Where a robot is itself is not stated here, only where it saw or left things."
    if _WHAT_IS_IN.match(text) and "object" in roles and not roles & {"place", "kind"}:
        return "What is inside of a thing is stated of places and boxes only."
    return ""


def _measure(text: str, phrased: Sequence[str], roles: Set[str]) -> str:
    """Return why nothing says how large, old or loud something is; nothing if that is said."""
    match = _DEGREE.match(text)
    if match is None or match["how"].lower() in _NO_DEGREE:
        return ""
    word = match["how"].lower()
    degree = concept(stem(word))
    own = {concept(stem(other)) for item in phrased for other in raw_words(item)}
    measured = {
        concept(stem(word_after))
        for item in phrased
        for before, word_after in pairwise(raw_words(item))
        if before == "how"
    }  # fmt: skip
    if degree not in (measured if match["verb"] else own):
        return f"How {word} something is, is not what the nearest question asks."
    if match["verb"] and degree in _MEASURES and roles and not roles & {"object", "kind"}:
        return f"How {word} a thing is, is stated of objects only."
    return ""


def _has(phrased: Iterable[str], word: str) -> bool:
    return any(re.search(rf"\b{re.escape(word.lower())}\b", item) for item in phrased)
