"""What is stored as a round thing that stands is measured by its sides once it lies."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rtask.engine.perception.placement import footprint_of, is_lying
from rtask.engine.perception.poses import locate
from rtask.engine.remembered import Memory, RememberedObject

BOTTLE = (0.037, 0.037, 0.098)


def shape(length, width, height):
    return SimpleNamespace(
        length=length, width=width, height=height, centre=np.array([0.2, 0.1]), yaw=0.4,
        support_height=0.26, is_round=False, roundness=0.2, outline=None,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("measured", "size", "lies"),
    [
        ((0.086, 0.037, 0.039), BOTTLE, True),
        ((0.037, 0.037, 0.098), BOTTLE, False),
        ((0.037, 0.020, 0.095), BOTTLE, False),  # only its front is seen
        ((0.080, 0.080, 0.030), (0.08, 0.08, 0.03), False),  # a plate
        ((0.086, 0.037, 0.039), None, False),
    ],
)
def test_a_slender_thing_lies_where_it_is_as_long_as_it_was_high(measured, size, lies):
    assert is_lying(shape(*measured), size) is lies


@pytest.mark.parametrize(
    ("measured", "kind"), [((0.086, 0.037, 0.039), "rectangle"), (BOTTLE, "round")]
)
def test_a_bottle_that_lies_is_taken_across_its_sides(measured, kind):
    seen = SimpleNamespace(shape=shape(*measured), object_pose=None)
    bottle = RememberedObject("urn:bottle", size=BOTTLE, is_round=True)
    models = SimpleNamespace(of=lambda *_: None)
    matches = SimpleNamespace(matches=[], accepted=False)
    placement, _ = locate(models, seen, matches, bottle, Memory())
    assert placement is not None
    footprint = footprint_of(seen.shape, placement)
    assert footprint.kind == kind
    assert footprint.width == pytest.approx(0.037)
