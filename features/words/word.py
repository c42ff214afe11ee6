"""Words as a reader of pictures found them, and how alike two of them are.

What is read is text that anybody may have printed: it is bounded, without control characters, and
nothing is ever done because of what it says.
"""

from __future__ import annotations

import difflib
import math
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array

__all__ = ["MAX_WORDS", "Word", "WordReader", "cleaned", "folded", "likeness", "words_of_view"]

MAX_WORDS = 48
"""Of one view, the surest first: more is small print."""
MAX_LENGTH = 80
"""Characters of one line."""
_MIN_SCORE = 0.5
_LOOK_ALIKE = str.maketrans("i10", "llo")
"""Letters that readers take for each other: one of four is too many to forgive by a share."""


@dataclass(frozen=True)
class Word:
    """A line of print: one word, or several that stand beside each other.

    Parameters
    ----------
    text
        As read, :func:`cleaned`.
    score
        Confidence of the reader, 0 to 1.
    centre
        Column and row of the middle, px.
    length, height
        Along the line and across it, px.
    angle
        From the direction of the columns to that of reading, clockwise in the image, rad.
    """

    text: str
    score: float
    centre: tuple[float, float]
    length: float
    height: float
    angle: float

    @classmethod
    def of_corners(cls, text: str, score: float, corners: NDArray[np.floating]) -> Word | None:
        """Return a word by its corners, or None if there is nothing to keep of it.

        Parameters
        ----------
        corners : (4, 2), px
            In the order of reading: upper left, upper right, lower right, lower left.
        """
        text, box = cleaned(text), np.asarray(corners, np.float64)
        if not text or box.shape != (4, 2) or not np.isfinite([*box.ravel(), score]).all():
            return None
        along = (box[1] + box[2] - box[0] - box[3]) / 2
        across = (box[2] + box[3] - box[0] - box[1]) / 2
        length, height = float(np.linalg.norm(along)), float(np.linalg.norm(across))
        if length < 1 or height < 1:
            return None
        u, v = box.mean(axis=0).tolist()
        angle = math.atan2(along[1], along[0])
        return cls(text, min(max(float(score), 0.0), 1.0), (u, v), length, height, angle)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners (4, 2), px, from the upper left one clockwise as the word is read."""
        along = np.array([math.cos(self.angle), math.sin(self.angle)]) * self.length / 2
        across = np.array([-math.sin(self.angle), math.cos(self.angle)]) * self.height / 2
        middle = np.array(self.centre)
        return np.array(
            [middle - along - across, middle + along - across,
             middle + along + across, middle - along + across]
        )  # fmt: skip


class WordReader(Protocol):
    """A program that reads the print in a picture."""

    @property
    def name(self) -> str:
        """Name and version: what another one read may differ."""

    def read(self, rgb: UInt8Array) -> Sequence[Word]:
        """Return the words in a picture (h, w, 3) uint8; none are no error.

        Raises
        ------
        ValueError
            The picture cannot be read.
        """


def words_of_view(reader: WordReader, rgb: UInt8Array, mask: NDArray[np.bool_]) -> tuple[Word, ...]:
    """Return the words on an object, the surest first, at most :data:`MAX_WORDS`.

    Parameters
    ----------
    rgb : (h, w, 3) uint8
    mask : (h, w) bool
        Pixels of the object: words whose middle lies beside it are on something else.
    """
    height, width = mask.shape
    legible = []
    for word in reader.read(rgb):
        column, row = (math.floor(value) for value in word.centre)
        is_on = 0 <= row < height and 0 <= column < width and bool(mask[row, column])
        if is_on and word.score >= _MIN_SCORE and folded(word.text):
            legible.append(word)
    return tuple(sorted(legible, key=lambda word: (-word.score, word.text))[:MAX_WORDS])


def cleaned(text: str) -> str:
    """Return a text on one bounded line, in Unicode's composed form, without control characters.

    Characters that change the direction of writing or that nobody sees are controls, too.

    Examples
    --------
    >>> cleaned("  VANILJ\\u202e\\x07\\n  YOGHURT "), len(cleaned("x" * 500))
    ('VANILJ YOGHURT', 80)
    """
    composed = unicodedata.normalize("NFC", text[: 4 * MAX_LENGTH])
    seen = "".join(
        " " if character.isspace() else character
        for character in composed
        if character.isspace() or unicodedata.category(character)[0] != "C"
    )
    return " ".join(seen.split())[:MAX_LENGTH].rstrip()


def folded(text: str) -> str:
    """Return the letters and digits of a text, without case and accents, to compare it.

    Examples
    --------
    >>> folded("Crème-Brûlée 3,5 %"), folded("MELLANMJÖLK")
    ('cremebrulee35', 'mellanmjolk')
    """
    apart = unicodedata.normalize("NFKD", text.casefold())
    return "".join(character for character in apart if character.isalnum())


def likeness(text: str, other: str) -> float:
    """Return how much of the shorter of two folded texts the other contains in order, 0 to 1.

    A reader joins words of a line, and misses some of its letters: a part says the same.

    Examples
    --------
    >>> likeness("vanilj", "vanilj"), likeness("godmorgon", "morgon"), likeness("abc", "xyz")
    (1.0, 1.0, 0.0)
    >>> likeness("naturell", "vanilj") < 0.5 < likeness("mellanmjolk", "mellanmj0lk")
    True
    >>> likeness("aria", "arla"), likeness("0atly", "oatly")
    (1.0, 1.0)
    """
    short, long = sorted((text.translate(_LOOK_ALIKE), other.translate(_LOOK_ALIKE)), key=len)
    if not short:
        return 0.0
    if short in long:
        return 1.0
    # Only a stretch of the longer one that is about as long as the shorter one says the same.
    stretch = len(short) + 2
    starts = range(max(len(long) - stretch, 0) + 1)
    best = 0.0
    for start in starts:
        matcher = difflib.SequenceMatcher(None, long[start : start + stretch], short, False)
        same = sum(block.size for block in matcher.get_matching_blocks() if block.size > 1)
        best = max(best, same / len(short))
    return best
