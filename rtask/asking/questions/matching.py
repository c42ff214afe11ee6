"""Likeness of a person's words to the ontology's questions: shared words, the rarer the better."""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from rtask.asking.questions.catalogue import Phrase, Question, questions
from rtask.asking.questions.words import STOP, concept, has_synonyms

__all__ = ["Asked", "Match", "Matcher", "matcher"]

_STOP_WEIGHT = 0.15
_NAME_WEIGHT = 0.1
_PAIR_WEIGHT = 0.3
_SLOT_WEIGHT = 0.8
_COVERED = 0.6
_RARELY = 0.15
_UNFILLED = 0.12
_UNUSED = 0.12
_SIMILAR_SPELLING = 0.8
NEAR = 0.2
"""Likeness from which a question is looked at: what is named may be missing in the graph."""
ASKED = 0.35
"""Likeness from which a question counts as asked."""
APART = 0.1
"""By how much the next question is farther away where less likeness is enough.

To questions that mean none of these, the nearest two are about as near.
"""
_QUESTION_WORDS = ("which", "what", "where", "when", "whose", "there", "many", "much")

Vector = Mapping[str, float]


@dataclass(frozen=True)
class Asked:
    """A person's words, as they are compared.

    Parameters
    ----------
    words
        Stems and ``@role`` for what is named, in order.
    names
        Stems that belong to names.
    roles
        For each thing named, the roles that it can fill.
    """

    words: tuple[str, ...]
    names: frozenset[str] = frozenset()
    roles: tuple[frozenset[str], ...] = ()


@dataclass(frozen=True)
class Match:
    """A question and its likeness, at most about 1."""

    question: Question
    score: float


class Matcher:
    """Compares words with a set of questions.

    Parameters
    ----------
    asked
        Each question with the phrases to compare with.
    """

    def __init__(self, asked: Iterable[tuple[Question, Sequence[Phrase]]]) -> None:
        self._asked = [(question, tuple(phrases)) for question, phrases in asked]
        counts = Counter(
            feature
            for _, phrases in self._asked
            for feature in {f for item in phrases for f in _features(item.words)}
        )
        total = len(self._asked)
        # Rare words tell questions apart; those that every question has tell nothing.
        self._idf = {f: math.log(1 + total / n) for f, n in counts.items()}
        self._rare = math.log(1 + total)
        self.vocabulary = frozenset(
            word for _, phrases in self._asked for item in phrases for word in item.words
        )
        self._vectors = [(question, *self._compared(phrases)) for question, phrases in self._asked]

    def phrases(self, question: Question) -> Sequence[Phrase]:
        """Return the phrases with which a question is compared."""
        return next(phrases for item, phrases in self._asked if item is question)

    def _compared(self, phrases: Sequence[Phrase]) -> tuple[list[Vector], Vector]:
        """Return the vectors of phrases, and how usual each feature is in them, up to 1."""
        counts = Counter(feature for item in phrases for feature in _features(item.words))
        # Flattened: a word in one of ten phrasings is nearly as usual as one in all.
        usual = {feature: (n / len(phrases)) ** _RARELY for feature, n in counts.items()}
        return [_normed(self._weights(item.words)) for item in phrases], usual

    def matches(self, asked: Asked) -> list[Match]:
        """Return all questions, the most alike first."""
        names = frozenset(w if has_synonyms(w) else concept(w) for w in asked.names)
        weights = self._weights(asked.words, names)
        result = [
            Match(question, _likeness(weights, vectors, usual) - _misfit(question, asked.roles))
            for question, vectors, usual in self._vectors
        ]
        return sorted(result, key=lambda item: (-item.score, item.question.key))

    def corrected(self, word: str) -> str:
        """Return a word, or the one of the questions that it is a misspelling of."""
        if self.is_familiar(word):
            return word
        # Two letters swapped are the commonest slip, and no ratio of likeness finds them in short
        # words.
        if len(word) >= 4 and (swapped := _swapped(word, {*_QUESTION_WORDS, *self.vocabulary})):
            return swapped
        # Of four letters one difference is a quarter: only the words that begin questions are worth
        # it.
        if len(word) == 4 and word.isalpha():
            near = difflib.get_close_matches(word, _QUESTION_WORDS, 1, _SIMILAR_SPELLING)
            return near[0] if near else word
        if len(word) < 5 or word in self.vocabulary or has_synonyms(word) or word in STOP:
            return word
        # Slips keep the first letter, and "glass" is no "class".
        known = [w for w in self.vocabulary if len(w) > 3 and w[0] == word[0]]
        near = difflib.get_close_matches(word, known, n=1, cutoff=_SIMILAR_SPELLING)
        return near[0] if near else word

    def is_familiar(self, word: str) -> bool:
        """Return whether a word means anything here."""
        return word in self.vocabulary or word in STOP or concept(word) in self._idf

    def _weights(self, words: Sequence[str], names: frozenset[str] = frozenset()) -> Vector:
        return {feature: self._weight(feature, names) for feature in _features(words)}

    def _weight(self, feature: str, names: frozenset[str]) -> float:
        weight = self._idf.get(feature, self._rare)
        # A pair that no question has tells no more than its words do.
        if " " in feature:
            return weight * _PAIR_WEIGHT if feature in self._idf else 0.0
        if feature in STOP:
            return weight * _STOP_WEIGHT
        if feature in names:
            return weight * _NAME_WEIGHT
        return weight * _SLOT_WEIGHT if feature.startswith("@") else weight


def _features(words: Sequence[str]) -> set[str]:
    """Return the concepts of words, and the pairs of content words that follow each other."""
    concepts = [_slot_feature(word) if word.startswith("@") else concept(word) for word in words]
    content = [word for word in concepts if word not in STOP]
    pairs = {f"{a} {b}" for a, b in pairwise(content)}
    return {*concepts, *pairs}


def _swapped(word: str, others: Iterable[str]) -> str:
    """Return the word of which one is written with two neighbouring letters swapped, or nothing."""
    turned = {word[:at] + word[at + 1] + word[at] + word[at + 2 :] for at in range(len(word) - 1)}
    return next((other for other in sorted(others) if other in turned and other != word), "")


def _slot_feature(word: str) -> str:
    return "@object" if word == "@kind" else word


def _dot(item: Vector, other: Vector) -> float:
    return sum(weight * other[feature] for feature, weight in item.items() if feature in other)


def _normed(weights: Vector) -> Vector:
    length = math.sqrt(sum(weight * weight for weight in weights.values())) or 1.0
    return {feature: weight / length for feature, weight in weights.items()}


def _likeness(weights: Vector, phrases: Sequence[Vector], usual: Vector) -> float:
    """Return the likeness to the nearest phrase, with the share that any phrase covers."""
    vector = _normed(weights)
    nearest = max(_dot(vector, item) for item in phrases)
    covered = _dot(weights, usual) / (sum(weights.values()) or 1.0)
    return (1 - _COVERED) * nearest + _COVERED * covered


_FITS = {"kind": "object", "object": "kind"}


def _misfit(question: Question, roles: Sequence[frozenset[str]]) -> float:
    """Return what a question loses for slots left empty, and for names without a slot."""
    takes = {slot.role for slot in question.slots}
    # An object answers for its kind, and the other way round.
    takes |= {_FITS[role] for role in takes if role in _FITS}
    named = frozenset().union(*roles)
    named |= {_FITS[role] for role in named if role in _FITS}
    empty = sum(
        slot.is_constant and not slot.is_list and slot.role not in named
        and not slot.role.endswith("kind")
        for slot in question.slots
    )  # fmt: skip
    unused = sum(not (item & takes) for item in roles)
    return _UNFILLED * empty + _UNUSED * unused


@cache
def matcher() -> Matcher:
    """Return the matcher of the ontology's questions."""
    return Matcher((question, question.phrases) for question in questions())
