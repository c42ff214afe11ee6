"""Colours in another light: what they still tell, and that another colour stays another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from features.recognition import Recogniser
from features.recognition.views.appearance import colour_histogram
from features.recognition.views.light import LIGHTS, light_costs, relit_colours, spread
from features.recognition.views.picture import take_picture
from tests.features.recognition.views.test_shape import BLUE, GREY, plain, stocked

Colour = tuple[int, int, int]


def times(colour: Colour, factor: float) -> Colour:
    """Return a colour at so many times the exposure."""
    red, green, blue = (round(factor * channel) for channel in colour)
    return red, green, blue


@pytest.mark.parametrize(
    ("kind", "colour", "factor"),
    [("hook", BLUE, 0.6), ("spoon", GREY, 0.5), ("spoon", GREY, 0.6), ("spoon", GREY, 1.4)],
)
def test_a_thing_is_recognised_at_another_exposure(
    kind: str, colour: Colour, factor: float
) -> None:
    asked = plain(kind, times(colour, factor), 0.8, 30)
    assert Recogniser(stocked()).recognise(asked).accepts(kind)


@pytest.mark.parametrize(("factor", "is_other"), [(0.5, True), (1.0, False)])
def test_the_answer_says_that_the_light_differs_where_a_doubt_is_left(
    factor: float, is_other: bool
) -> None:
    answer = Recogniser(stocked()).recognise(plain("spoon", times(GREY, factor), 0.8, 30))
    assert answer.accepts("spoon")
    assert not answer.is_in_other_light
    doubtful = replace(answer, accepted=False, ask_again=True)
    assert doubtful.is_in_other_light == is_other


@pytest.mark.parametrize("colour", [(170, 60, 40), (40, 170, 60), GREY, times(BLUE, 0.3)])
def test_another_colour_is_not_taken_for_another_light(colour: Colour) -> None:
    assert not Recogniser(stocked()).recognise(plain("hook", colour, 0.8, 31)).accepted


def test_every_light_has_a_cost_but_that_of_the_view_itself() -> None:
    costs = light_costs(0.03, 0.1)
    assert costs[0] == 0
    # Twice the exposure without a tint is one power of two, at 0.03 each.
    double = np.flatnonzero((LIGHTS == (1.0, 0.0)).all(axis=1))
    assert costs[double] == pytest.approx([0.03])
    assert (costs[1:] >= 0).all()


def test_lights_are_made_of_the_picture_and_come_out_the_same_each_time() -> None:
    rng = np.random.default_rng(4)
    rgb = rng.integers(40, 120, (60, 80, 3)).astype(np.uint8)
    mask = np.ones(rgb.shape[:2], bool)
    colour, picture = colour_histogram(rgb, mask), take_picture(rgb, mask)
    lit = relit_colours(colour, picture)
    assert lit.shape == (len(LIGHTS), 192)
    assert np.array_equal(lit[0], colour)
    assert np.array_equal(lit, relit_colours(colour, picture))
    # Histograms are square roots of shares, so each has length 1, spread or not.
    for histograms in (lit, spread(lit)):
        assert np.linalg.norm(histograms, axis=1) == pytest.approx(np.ones(len(lit)), abs=1e-5)
    assert np.array_equal(relit_colours(colour, b""), colour[None])
