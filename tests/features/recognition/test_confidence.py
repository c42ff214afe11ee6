"""Conditions on which a look decides, or only suggests."""

from __future__ import annotations

from dataclasses import replace

import pytest

from features.recognition.confidence import Evidence, confidences

# An object without texture: no inliers, a clear lead, the size of the most similar view.
PLAIN = Evidence(
    inliers=0, rival_inliers=0, appearance=0.95, appearance_lead=0.15, colour=0.99,
    size_ok=True, size_gap=0.01, is_among_many=True,
)  # fmt: skip

# A printed one, seen from another side and in another light than it was stored.
PRINTED = Evidence(
    inliers=12, rival_inliers=0, appearance=0.8, appearance_lead=0.05, colour=0.95,
    place_colour=0.95, size_ok=True, size_gap=0.06, place_gap=0.06,
)  # fmt: skip


def test_a_measured_look_decides_for_what_carries_no_print() -> None:
    assert confidences([PLAIN])[0] > 0.9


@pytest.mark.parametrize(
    "change",
    [
        {"rival_inliers": 30},  # the print of another object
        {"size_gap": None, "size_ok": None},  # no depth
        {"is_among_many": False},  # too few objects to compare with, and it may carry print
        {"size_ok": False},
        {"appearance_lead": -0.05, "colour": 0.95},  # something else looks more like it
        {"colour": 0.80},
        {"is_twin": True, "appearance_lead": 0.1},
    ],
)
def test_otherwise_a_look_does_not_decide(change: dict[str, object]) -> None:
    assert confidences([replace(PLAIN, **change)])[0] < 0.7  # type: ignore[arg-type]


def test_a_larger_one_of_the_same_sort_is_less_likely() -> None:
    gaps = [0.0, 0.02, 0.1, 0.25]
    falling = confidences([replace(PLAIN, size_gap=gap) for gap in gaps])
    assert (falling[1:] < falling[:-1]).all()


def test_agreeing_places_decide_without_a_size() -> None:
    bare = replace(PRINTED, size_ok=None, size_gap=None, place_gap=None)
    assert confidences([bare])[0] > 0.7
    assert confidences([replace(bare, inliers=3)])[0] < 0.7


def test_an_emblem_on_another_package_does_not_decide() -> None:
    """Two packages of one brand: a dozen places agree, colours and size do not."""
    other = replace(PRINTED, colour=0.7, place_colour=0.7, place_gap=0.22, size_gap=0.22)
    assert confidences([PRINTED])[0] > 0.7
    assert confidences([other])[0] < 0.5
    unmeasured = replace(other, size_ok=None, size_gap=None, place_gap=None)
    assert confidences([unmeasured])[0] < 0.7


def test_thirty_places_decide_in_any_light() -> None:
    dark = replace(PRINTED, inliers=30, colour=0.1, place_colour=0.1)
    assert confidences([dark])[0] > 0.7


def test_places_in_space_do_not_decide_where_the_print_refutes_them() -> None:
    """The same can in another colour agrees in every place; a doubt of print is not enough."""
    solid = replace(PRINTED, inliers=30, is_solid=True, has_print=True)
    assert confidences([replace(solid, print_odds=-5.0)])[0] > 0.7
    assert confidences([replace(solid, print_odds=-8.0)])[0] < 0.7


def test_among_few_objects_a_measured_look_decides_only_where_there_is_no_print() -> None:
    few = replace(PLAIN, is_among_many=False, has_print=True)
    assert confidences([replace(few, is_plain=True)])[0] > 0.7
    assert confidences([few])[0] < 0.7
    assert confidences([replace(few, is_plain=True, print_odds=-3.0)])[0] < 0.7
    assert confidences([replace(few, is_plain=True, size_ok=None, size_gap=None)])[0] < 0.7


def test_twins_of_other_colours_are_told_apart_by_them() -> None:
    """Cups of one set: one relief, every cup in a colour of its own."""
    cup = replace(PRINTED, is_twin=True)
    assert confidences([cup])[0] < 0.7
    assert confidences([replace(cup, appearance_lead=0.2)])[0] > 0.7
    assert confidences([replace(cup, appearance_lead=-0.5, place_colour=0.0)])[0] < 0.7


def test_print_in_quite_other_colours_does_not_decide() -> None:
    agrees = Evidence(
        inliers=0, rival_inliers=0, appearance=0.5, appearance_lead=0.0, colour=0.6,
        has_print=True, print_odds=3.0,
    )  # fmt: skip
    assert confidences([agrees])[0] > 0.7
    assert confidences([replace(agrees, colour=0.1)])[0] < 0.5


@pytest.mark.parametrize(
    ("change", "decides"),
    [
        ({"is_plain": True}, True),
        ({}, False),  # print could confirm them, and does not
        ({"is_plain": True, "print_odds": -3.0}, False),  # what print there is contradicts
        ({"is_plain": True, "print_odds": -1.0}, True),
        ({"is_plain": True, "place_colour": 0.7}, False),
    ],
)
def test_without_depth_places_decide_for_what_carries_little_print(
    change: dict[str, object], decides: bool
) -> None:
    places = Evidence(
        inliers=9, rival_inliers=0, appearance=0.9, appearance_lead=0.1, colour=0.98,
        place_colour=0.98, has_print=True,
    )  # fmt: skip
    sure = confidences([replace(places, **change)])[0]  # type: ignore[arg-type]
    assert (sure > 0.7) == decides
