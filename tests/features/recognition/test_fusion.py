"""One answer from several looks: which looks suffice, and what has to be in view."""

from __future__ import annotations

import pytest

from features.recognition import Match, Recognition, fuse

WIDE, NARROW = 0.35, 0.25
"""Spans of the matches that print between them is accepted by, and is not."""


def look(*sure: float, extent: float = WIDE, by_print: bool = True, least: float = 0.7):
    """Return a look that gives object 1, 2 … so much confidence, and accepts a clear first."""
    matches = tuple(
        Match(f"object:{k}", "class", one, 20, (), 0.9, None, None, f"view:{k}",
              by_print=by_print, extent=extent)
        for k, one in sorted(enumerate(sure, 1), key=lambda pair: -pair[1])
    )  # fmt: skip
    return Recognition("single", max(sure) >= least, matches)


def test_two_looks_that_each_accept_an_object_are_told_that_it_is_this_one():
    answer = fuse([look(0.77), look(0.77)])
    assert answer.accepts("object:1")
    assert not answer.ask_again
    assert answer.matches[0].confidence == pytest.approx(0.77)


@pytest.mark.parametrize(("second", "is_enough"), [(0.3, False), (0.6, True)])
def test_a_look_that_alone_accepts_needs_the_others(second: float, is_enough: bool):
    # Odds of 3.0 with -0.85 and with 0.41: their means are 1.08 and 1.70, required is 1.5.
    assert fuse([look(0.953), look(second)]).accepted is is_enough


def test_looks_that_agree_are_not_held_to_what_is_asked_of_one_alone():
    assert fuse([look(0.77), look(0.77)], min_confidence=0.82).accepted
    assert not fuse([look(0.77), look(0.77, least=0.8)], min_confidence=0.82).accepted


def test_looks_in_which_only_a_small_part_agrees_do_not_decide_by_print():
    narrow = [look(0.99, extent=NARROW), look(0.9, extent=NARROW)]
    answer = fuse(narrow)
    assert not answer.accepted
    assert answer.ask_again  # from another side more of it may agree
    assert answer.matches[0].confidence == pytest.approx(0.5)
    assert fuse([*narrow, look(0.8, extent=WIDE)]).accepted
    # What a look that does not accept has in view is no part of what the others accept by.
    assert not fuse([*narrow, look(0.4, extent=WIDE)]).accepted


def test_keypoints_in_space_decide_however_close_they_lie():
    assert fuse([look(0.99, extent=0.0, by_print=False), look(0.9, extent=NARROW)]).accepted


def test_a_look_that_accepts_another_object_outweighs_one_that_is_surer():
    surer, other = look(0.998, 0.05), look(0.3, 0.75)
    assert not fuse([surer, other]).accepted
    assert fuse([surer, other, surer]).accepts("object:1")


def test_a_single_look_is_returned_as_it_is():
    alone = look(0.71, extent=NARROW)
    assert fuse([alone]) is alone
