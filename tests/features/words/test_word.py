"""Words as they are kept: bounded, without control characters, on the object alone."""

from __future__ import annotations

import math
import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from features.words.word import (
    MAX_LENGTH,
    MAX_WORDS,
    Word,
    cleaned,
    folded,
    likeness,
    words_of_view,
)


class Reads:
    """A reader that says what it is told."""

    name = "reads"

    def __init__(self, words):
        self.words = words

    def read(self, rgb):
        return self.words


@given(st.text(max_size=400))
def test_a_kept_text_is_short_on_one_line_and_without_controls(text):
    kept = cleaned(text)
    assert len(kept) <= MAX_LENGTH
    assert not any(unicodedata.category(c)[0] == "C" or c in "\u2028\u2029" for c in kept)
    assert cleaned(kept) == kept


@pytest.mark.parametrize("angle", [0.0, 0.4, -2.0, math.pi])
def test_corners_of_a_word_give_the_word_again(angle):
    word = Word("JUICE", 0.9, (40.0, 30.0), 20.0, 8.0, angle)
    again = Word.of_corners(word.text, word.score, word.corners)
    assert np.allclose(again.corners, word.corners)
    assert (again.length, again.height) == pytest.approx((20.0, 8.0))


@pytest.mark.parametrize(
    ("text", "score", "corners"),
    [
        ("\u202e\u0007", 0.9, np.eye(4, 2)),
        ("a", 0.9, np.zeros((4, 2))),
        ("a", 0.9, np.full((4, 2), np.nan)),
        ("a", math.nan, [[0, 0], [9, 0], [9, 9], [0, 9]]),
        ("a", 0.9, np.zeros((3, 2))),
    ],
)
def test_a_word_without_letters_place_or_score_is_none(text, score, corners):
    assert Word.of_corners(text, score, np.asarray(corners, float)) is None


def test_words_beside_the_object_and_of_doubtful_letters_are_left_out():
    mask = np.zeros((50, 100), bool)
    mask[:, :60] = True
    on, beside = Word("MILK", 0.9, (30.0, 20.0), 20.0, 8.0, 0.0), (80.0, 20.0)
    read = [
        on,
        Word("SHELF", 0.9, beside, 20.0, 8.0, 0.0),
        Word("OUTSIDE", 0.9, (-4.0, 20.0), 20.0, 8.0, 0.0),
        Word("DOUBT", 0.3, (30.0, 20.0), 20.0, 8.0, 0.0),
        Word("***", 0.9, (30.0, 20.0), 20.0, 8.0, 0.0),
    ]
    assert words_of_view(Reads(read), np.zeros((50, 100, 3), np.uint8), mask) == (on,)


def test_of_very_many_words_the_surest_are_kept():
    words = [Word(f"w{k}", 0.5 + k / 1000, (5.0, 5.0), 4.0, 4.0, 0.0) for k in range(300)]
    kept = words_of_view(Reads(words), np.zeros((9, 9, 3), np.uint8), np.ones((9, 9), bool))
    assert [word.text for word in kept] == [f"w{k}" for k in range(299, 299 - MAX_WORDS, -1)]


def test_misread_letters_are_alike_and_other_flavours_are_not():
    assert likeness(folded("JORDGUBB"), folded("JORDGUBE")) > 0.8
    assert likeness(folded("VANILI"), folded("vanilj")) > 0.8
    assert likeness(folded("orange"), folded("orange & red")) == 1.0
    for other in ("NATURELL", "JORDGUBB", "Blueberry", "red grapefruit"):
        assert likeness(folded("VANILJ"), folded(other)) < 0.5
    assert likeness("", "x") == 0.0
