"""A word in the place of another one refutes; one that is missing or doubtful does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from features.words.contradiction import contradicting_word
from features.words.word import Word

VIEW = Word("VANILJ", 0.97, (100.0, 60.0), 80.0, 20.0, 0.0)


def seen(text="NATURELL", score=0.97, at=(102.0, 61.0), size=(90.0, 20.0), angle=0.0):
    return Word(text, score, at, *size, angle)


AS_STORED = np.eye(3)


def told(*words, stored=(VIEW,), also=(), query_from_view=AS_STORED):
    vocabulary = {word.text for word in stored} | set(also)
    return contradicting_word(words, stored, vocabulary, query_from_view)


def test_another_word_in_the_same_place_contradicts():
    found = told(seen())
    assert (found.seen.text, found.stored.text) == ("NATURELL", "VANILJ")


@pytest.mark.parametrize(
    "word",
    [
        seen(score=0.8),  # not clear
        seen(text="NA"),  # too short to be sure
        seen(text="1990"),  # a price
        seen(at=(102.0, 100.0)),  # beside it
        seen(at=(160.0, 61.0)),  # mostly beside it
        seen(size=(180.0, 45.0)),  # of another size
        seen(angle=1.2, size=(20.0, 20.0)),  # across it
        seen(text="Vanilla"),  # spelt nearly alike
        seen(text="SANILI"),  # misread
    ],
)
def test_what_is_not_clearly_another_word_there_says_nothing(word):
    assert told(word) is None


def test_letters_that_readers_take_for_each_other_say_nothing():
    brand = Word("Arla", 0.99, (100.0, 60.0), 80.0, 20.0, 0.0)
    assert told(seen(text="Aria"), stored=(brand,)) is None
    assert told(seen(text="Oatly"), stored=(brand,)) is not None


def test_nothing_read_says_nothing():
    assert told() is None
    assert told(seen(), stored=()) is None
    assert told(seen(), stored=(Word("VANILJ", 0.6, (100.0, 60.0), 80.0, 20.0, 0.0),)) is None


def test_a_word_of_another_view_of_the_object_says_nothing():
    assert told(seen(), also=["NATURELL"]) is None
    assert told(seen(text="naturel"), also=["Naturell yoghurt"]) is None


def test_the_same_word_read_there_as_well_outweighs_the_other():
    assert told(seen(), seen(text="VANILJ", score=0.4)) is None


def test_words_are_carried_over_by_the_map():
    turn, scale = math.radians(50), 0.6
    turned = scale * np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    there = np.eye(3)
    there[:2, :2], there[:2, 2] = turned, (30.0, 20.0)
    at = turned @ VIEW.centre + (30.0, 20.0)
    word = seen(at=tuple(at), size=(54.0, 12.0), angle=turn)
    assert told(word, query_from_view=there) is not None
    assert told(word) is None
    upright = seen(at=tuple(at), size=(54.0, 12.0), angle=turn + math.pi)
    assert told(upright, query_from_view=there) is None


def test_a_map_that_does_not_hold_there_says_nothing():
    for wild in (np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan), np.zeros((3, 3))):
        assert told(seen(), query_from_view=wild) is None


def test_the_clearest_contradiction_is_told():
    more = Word("MILD", 0.99, (100.0, 120.0), 60.0, 20.0, 0.0)
    found = told(seen(), seen(text="SYRLIG", score=0.99, at=(100.0, 120.0)), stored=(VIEW, more))
    assert found.stored.text == "MILD"
