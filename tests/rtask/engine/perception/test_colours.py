"""Colours of an object are named as people name them, those of what stands behind it are not."""

from __future__ import annotations

import numpy as np
import pytest

import ontology
from features.geometry import Frame, Intrinsics
from rtask.engine.perception.colours import COLOURS, colours_of
from rtask.rdf.namespaces import RT

_CAMERA = Intrinsics(60, 40, 100.0, 100.0, 30.0, 20.0)


def _frame(*bands: tuple[int, int, int], mask: bool = True) -> Frame:
    """Return a picture of equal vertical bands on a green ground that is no part of the object."""
    rgb = np.full((40, 60, 3), (0, 160, 0), np.uint8)
    width = 40 // len(bands)
    for k, colour in enumerate(bands):
        rgb[10:30, 10 + k * width : 10 + (k + 1) * width] = colour
    seen = np.zeros((40, 60), bool)
    seen[10:30, 10 : 10 + width * len(bands)] = True
    depth = np.where(seen, 0.5, 0).astype(np.float32)
    return Frame(depth, _CAMERA, rgb, seen if mask else None)


@pytest.mark.parametrize(
    ("rgb", "name"),
    [
        ((190, 30, 30), "red"), ((240, 130, 20), "orange"), ((110, 65, 25), "brown"),
        ((235, 215, 40), "yellow"), ((30, 120, 50), "green"), ((30, 60, 170), "blue"),
        ((120, 40, 160), "purple"), ((240, 140, 180), "pink"), ((20, 20, 25), "black"),
        ((240, 240, 235), "white"), ((120, 122, 125), "grey"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("mask", [True, False])
def test_a_colour_has_the_name_that_people_give_it(rgb, name, mask):
    assert colours_of(_frame(rgb, mask=mask)) == (name,)


def test_the_largest_come_first_and_small_ones_are_left_out():
    red, white, blue = (190, 30, 30), (240, 240, 240), (30, 60, 170)
    assert colours_of(_frame(white, red, white, white, red)) == ("white", "red")
    assert colours_of(_frame(*[white] * 9, blue)) == ("white",)


def test_each_name_is_one_of_the_ontology():
    stated = ontology.path("rtask/object.ttl").read_text()
    for name in COLOURS:
        assert f"rt:{getattr(RT, f'colour_{name}').value.rpartition('#')[2]} a owl:" in stated
