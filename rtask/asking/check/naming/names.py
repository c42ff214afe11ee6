"""Nearness of names: of a misspelt term to a known one, and of a variable to what it stands for."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from functools import lru_cache

from rtask.asking.check.vocabulary import Vocabulary, local

__all__ = [
    "PREPOSITIONS",
    "affinities",
    "affinity",
    "likeness",
    "may_be_like",
    "properties_named",
    "words_of",
]

_VARIABLES = 2_000
_PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")

PREPOSITIONS = frozenset({"from", "with", "for", "via", "into", "onto", "near", "per"})
"""Words that say how something is involved, and nothing of what it is."""


@lru_cache(maxsize=8192)
def words_of(name: str) -> tuple[str, ...]:
    """Return the words of a name in camel case or with underscores, in lower case.

    >>> words_of("hasHiddenCause"), words_of("robot_name")
    (('has', 'hidden', 'cause'), ('robot', 'name'))
    """
    return tuple(word.lower() for word in _PART.findall(name))


@lru_cache(maxsize=16_384)
def _pairs(name: str) -> frozenset[tuple[str, int]]:
    """Return the letters of a name and its pairs of neighbours, ends included, each with a number.

    The number tells repetitions apart, so that sets are intersected and not counted: most of the
    time of a check with an unknown term goes there.
    """
    framed = f"^{name}$"
    counts = Counter([*name, *(framed[at : at + 2] for at in range(len(framed) - 1))])
    return frozenset((pair, at) for pair, count in counts.items() for at in range(count))


@lru_cache(maxsize=65_536)
def likeness(name: str, other: str) -> float:
    """Return how alike two names are, from 0 to 1: the share of letters and of neighbours.

    >>> likeness("GrapsAttempt", "GraspAttempt") > 0.8 > likeness("Grasp", "Task")
    True
    """
    shared = len(_pairs(name) & _pairs(other))
    total = len(name) * 2 + len(other) * 2 + 2
    return 2 * shared / total


@lru_cache(maxsize=16_384)
def _letters(name: str) -> int:
    """Return a bit for each letter of a name, by its number modulo 64."""
    bits = 0
    for letter in name:
        bits |= 1 << (ord(letter) & 63)
    return bits


def may_be_like(name: str, other: str, least: float) -> bool:
    """Return whether two names could be alike, by their letters alone; much quicker to ask.

    A letter that the other does not have takes two pairs of neighbours, or more, with it.

    >>> may_be_like("graspWidth", "jawWidth", 0.5), may_be_like("mass", "phone", 0.5)
    (True, False)
    """
    a, b = _letters(name), _letters(other)
    total = len(name) * 2 + len(other) * 2 + 2
    for length, missing in ((len(name), a & ~b), (len(other), b & ~a)):
        if 2 * (2 * length + 1 - 2 * missing.bit_count()) < least * total:
            return False
    return True


def affinity(variable: str, iri: str, vocabulary: Vocabulary) -> float:
    """Return how well the name of a variable fits a class or property, from 0 to 1."""
    labels = vocabulary.labels.get(iri)
    return _affinity(variable, local(iri), min(labels) if labels else "")


@lru_cache(maxsize=65_536)
def _affinity(variable: str, name: str, label: str) -> float:
    asked = words_of(variable)
    if not asked or len(asked[0]) < 2:
        return 0.0
    best = 0.0
    for words in (words_of(name), tuple(label.split())):
        hits = sum(any(_same(a, b) for b in words) for a in asked)
        best = max(best, hits / len(asked) * (0.6 + 0.4 * hits / max(len(words), 1)))
    return best


def properties_named(variable: str, vocabulary: Vocabulary) -> list[str]:
    """Return the properties that may have a word in common with a variable, sorted."""
    index = _properties_by_word(vocabulary)
    starts = {start for word in words_of(variable) for start in (word[:4], word.rstrip("s")[:4])}
    return sorted({iri for start in starts for iri in index.get(start, ())})


def affinities(variable: str, vocabulary: Vocabulary) -> Mapping[str, float]:
    """Return how well the name of a variable fits each property, where it does at all."""
    by_variable = _affinities(vocabulary)
    if variable not in by_variable:
        if len(by_variable) > _VARIABLES:
            by_variable.clear()
        by_variable[variable] = {
            iri: affinity(variable, iri, vocabulary)
            for iri in properties_named(variable, vocabulary)
        }
    return by_variable[variable]


@lru_cache(maxsize=4)
def _affinities(vocabulary: Vocabulary) -> dict[str, dict[str, float]]:
    return {}


@lru_cache(maxsize=4)
def _properties_by_word(vocabulary: Vocabulary) -> dict[str, list[str]]:
    by_beginning: dict[str, list[str]] = {}
    for iri in vocabulary.properties:
        labels = " ".join(vocabulary.labels.get(iri, ()))
        for word in {*words_of(local(iri)), *labels.split()}:
            for start in {word[:4], word.rstrip("s")[:4]}:
                by_beginning.setdefault(start, []).append(iri)
    return by_beginning


def _same(word: str, other: str) -> bool:
    if word == other or word.rstrip("s") == other.rstrip("s"):
        return True
    return min(len(word), len(other)) >= 4 and word[:4] == other[:4]
