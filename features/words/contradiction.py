"""A word where the recognised object has another one: a sibling, however much else agrees.

Print that agrees says little about the flavour: two cartons of a brand differ in one word. The
words of the stored view are carried into the query by the map on which the matches agree. Only a
word that was read clearly on both sides contradicts; one that is missing, hidden, blurred or spelt
nearly alike says nothing, and agreement proves nothing, since siblings share the brand.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.words.word import Word, folded, likeness

__all__ = ["WordContradiction", "WordParams", "contradicting_word"]

_MIN_WEIGHT = 1e-6


@dataclass(frozen=True)
class WordParams:
    """Constants of the comparison; frozen before they were measured on other draws.

    Parameters
    ----------
    min_score
        Confidence of the reader from which a word counts as clearly read.
    min_letters
        Letters and digits of a word that may contradict, of which at least so many are letters.
    max_alike
        Two words that are more alike say the same.
    max_vocabulary
        A word of the query that is more like any word of the object, read on any of its views, is
        no other object's.
    min_overlap
        Share of the smaller of two places that both cover.
    max_size_ratio
        Between the heights of two lines at one place.
    max_turn
        Between their directions, rad.
    """

    min_score: float = 0.9
    min_letters: int = 4
    max_alike: float = 0.5
    max_vocabulary: float = 0.6
    min_overlap: float = 0.5
    max_size_ratio: float = 1.7
    max_turn: float = math.radians(20)


@dataclass(frozen=True)
class WordContradiction:
    """Two words that cannot be on one object.

    Parameters
    ----------
    seen
        As read in the query.
    stored
        As read on the stored view.
    """

    seen: Word
    stored: Word


def contradicting_word(
    seen: Sequence[Word],
    stored: Sequence[Word],
    vocabulary: Collection[str],
    query_from_view: NDArray[np.float64],
    params: WordParams | None = None,
) -> WordContradiction | None:
    """Return the clearest contradiction, or None where no word contradicts another.

    Parameters
    ----------
    seen
        Words of the query, the doubtful ones too: they may be the stored ones, read badly.
    stored
        Words of the stored view.
    vocabulary
        Texts of all words on any view of the stored object.
    query_from_view : (3, 3) float64, px
        Map of the stored view's image into the query's.

    Examples
    --------
    >>> vanilla = Word("VANILJ", 0.98, (50.0, 20.0), 60.0, 15.0, 0.0)
    >>> other = Word("JORDGUBB", 0.97, (51.0, 21.0), 70.0, 15.0, 0.0)
    >>> told = contradicting_word([other], [vanilla], ["VANILJ"], np.eye(3))
    >>> told.seen.text, told.stored.text
    ('JORDGUBB', 'VANILJ')
    >>> contradicting_word([vanilla], [vanilla], ["VANILJ"], np.eye(3)) is None
    True
    """
    params = params or WordParams()
    texts = [folded(text) for text in vocabulary]
    best: tuple[float, WordContradiction] | None = None
    for word in stored:
        placed = _carried(word, query_from_view) if _is_clear(word, params) else None
        if placed is None:
            continue
        here = [other for other in seen if _overlap(placed, other) > 0]
        text = folded(word.text)
        if any(likeness(text, folded(other.text)) > params.max_alike for other in here):
            continue
        for other in here:
            if _contradicts(placed, other, texts, params):
                score = min(word.score, other.score)
                if best is None or score > best[0]:
                    best = score, WordContradiction(other, word)
    return None if best is None else best[1]


def _contradicts(placed: Word, other: Word, texts: Sequence[str], params: WordParams) -> bool:
    """Tell whether another clear word, of no view of the object, stands in a word's place."""
    ratio = placed.height / other.height
    turn = abs(math.remainder(placed.angle - other.angle, 2 * math.pi))
    if not _is_clear(other, params) or _overlap(placed, other) < params.min_overlap:
        return False
    if max(ratio, 1 / ratio) > params.max_size_ratio or turn > params.max_turn:
        return False
    text = folded(other.text)
    return all(likeness(text, word) <= params.max_vocabulary for word in texts if len(word) > 1)


def _is_clear(word: Word, params: WordParams) -> bool:
    letters = sum(character.isalpha() for character in folded(word.text))
    return word.score >= params.min_score and letters >= params.min_letters


def _carried(word: Word, query_from_view: NDArray[np.float64]) -> Word | None:
    """Return a word at its place in the query, or None where the map does not hold there."""
    corners = np.column_stack([word.corners, np.ones(4)]) @ query_from_view.T
    if not np.isfinite(corners).all() or (corners[:, 2] < _MIN_WEIGHT).any():
        return None
    return Word.of_corners(word.text, word.score, corners[:, :2] / corners[:, 2:])


def _overlap(word: Word, other: Word) -> float:
    """Return the common area of two places, as share of the smaller one."""
    first, second = word.corners.astype(np.float32), other.corners.astype(np.float32)
    common, _ = cv2.intersectConvexConvex(first, second)
    smaller = min(word.length * word.height, other.length * other.height)
    return float(common) / smaller
