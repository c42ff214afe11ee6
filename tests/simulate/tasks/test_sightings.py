"""What is not recognised is known by its size, or not at all."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from simulate.tasks.arms.sightings import find_by_size

CAN, BOX = [0.03, 0.03, 0.09], [0.03, 0.05, 0.06]


def sighting(size, product=""):
    length, height, width = size
    shape = SimpleNamespace(length=length, width=width, height=height)
    return SimpleNamespace(seen=SimpleNamespace(shape=shape), object=product)


@pytest.mark.parametrize(
    ("there", "missing", "found"),
    [
        ([sighting([0.09, 0.031, 0.028])], [], 0),  # it lies
        ([sighting([0.2, 0.1, 0.04]), sighting(CAN)], [], 1),  # beside the wall of a box
        ([sighting(CAN, "urn:other")], [], None),  # known as another thing
        ([sighting([0.03, 0.03, 0.02])], [], None),
        ([sighting(CAN), sighting(CAN)], [], None),  # which of both, nobody can tell
        ([sighting(CAN)], [[0.032, 0.032, 0.08]], None),  # it may be the other can
        ([sighting(CAN)], [BOX], 0),
        ([], [], None),
    ],
)
def test_the_only_stranger_of_a_size_is_the_thing_unless_it_may_be_another(there, missing, found):
    expected = None if found is None else there[found]
    assert find_by_size(there, CAN, missing) is expected
