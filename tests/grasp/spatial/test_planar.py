"""Candidates on tabletop shapes: directions, heights, openings, neighbours, order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grasp.spatial.footprint import Footprint
from grasp.spatial.frames import angle_between_axes
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.planar import PlanarGrasp, openings, propose_planar, rate, tip_heights

HAND = ParallelGripper("nao_right_hand", "nao_hand", 0.0, 0.05, symmetric=False)
CAN = Footprint((0.15, -0.10), 0.3, 0.035, 0.034, 0.08, roundness=0.98)
BOX = Footprint((0.15, -0.10), 0.3, 0.042, 0.028, 0.05, roundness=0.1)
PEN = Footprint((0.15, -0.10), 0.3, 0.11, 0.018, 0.018, roundness=0.05)


def test_a_round_thing_is_taken_from_twelve_directions():
    angles = {round(grasp.theta, 6) for grasp in propose_planar(CAN, HAND, max_candidates=200)}
    assert len(angles) == 12
    assert np.allclose(np.diff(sorted(angles)), np.pi / 12)


def test_a_box_is_taken_across_both_sides_that_fit():
    grasps = propose_planar(BOX, HAND, max_candidates=200)
    across = [g for g in grasps if angle_between_axes(g.theta, 0.3 + np.pi / 2) < 1e-6]
    along = [g for g in grasps if angle_between_axes(g.theta, 0.3) < 1e-6]
    assert across
    assert np.allclose([g.width for g in across], 0.028)
    assert along
    assert np.allclose([g.width for g in along], 0.042)


def test_the_side_that_is_too_long_is_left_out():
    long_box = Footprint((0.15, -0.10), 0.3, 0.055, 0.03, 0.05)
    for grasp in propose_planar(long_box, HAND, max_candidates=200):
        assert grasp.width <= 0.048
        assert angle_between_axes(grasp.theta, 0.3 + np.pi / 2) <= np.deg2rad(25) + 1e-9


def test_a_pen_is_taken_across_with_freedom_along_and_about_it():
    grasps = propose_planar(PEN, HAND, max_candidates=200)
    axis = np.array([np.cos(0.3), np.sin(0.3)])
    slides = [(np.array([g.x, g.y]) - PEN.centre) @ axis for g in grasps]
    turns = [angle_between_axes(g.theta, 0.3 + np.pi / 2) for g in grasps]
    # 1 mm: a turned jaw is centred on what it meets, which moves it a little along the pen.
    assert max(slides) == pytest.approx(0.03, abs=1e-3)
    assert min(slides) == pytest.approx(-0.03, abs=1e-3)
    assert max(turns) == pytest.approx(np.deg2rad(25), abs=1e-6)


@pytest.mark.parametrize(
    ("height", "width", "length", "expected"),
    [
        (0.09, 0.03, 0.03, 0.045),
        (0.06, 0.03, 0.03, 0.030),
        (0.046, 0.03, 0.03, 0.026),
        (0.040, 0.03, 0.03, 0.022),
        (0.030, 0.03, 0.03, 0.018),
        (0.018, 0.018, 0.11, 0.008),
        (0.030, 0.020, 0.11, 0.008),
    ],
)
def test_tip_height_follows_the_measured_size(height, width, length, expected):
    heights = tip_heights(height, width, length)
    assert heights[0] == pytest.approx(expected)
    assert all(z <= height for z in heights)
    assert np.allclose(np.diff(heights), 0.007)


def test_no_fingertip_is_proposed_below_the_support() -> None:
    for hand in (HAND, gripper_named("panda"), gripper_named("jaw:0.08")):
        found = propose_planar(PEN, hand)
        assert found
        assert min(grasp.z for grasp in found) >= hand.fingertip + 0.001


def test_low_round_and_thin_things_are_met_with_a_smaller_mouth():
    ball = Footprint((0.0, 0.0), 0.0, 0.03, 0.03, 0.03, roundness=1.0)
    assert openings(0.03, ball, HAND)[0] == pytest.approx(0.036)  # the ball plus 3 mm a side
    assert openings(0.018, PEN, HAND)[0] == pytest.approx(0.0375)
    assert openings(0.03, BOX, HAND)[0] == pytest.approx(0.05)


def test_every_opening_leaves_room_for_the_object():
    for shape in (CAN, BOX, PEN):
        for grasp in propose_planar(shape, HAND, max_candidates=200):
            assert grasp.width < grasp.opening <= HAND.max_opening


def test_what_does_not_fit_gets_no_grasp():
    pot = Footprint((0.0, 0.0), 0.0, 0.12, 0.12, 0.1, roundness=1.0)
    assert propose_planar(pot, HAND) == []
    narrow = ParallelGripper("jaw", "jaw", 0.06, 0.10)
    assert propose_planar(BOX, narrow) == []


def test_best_quality_comes_first_and_lies_between_0_and_1():
    for shape in (CAN, BOX, PEN):
        quality = [grasp.quality for grasp in propose_planar(shape, HAND)]
        assert quality == sorted(quality, reverse=True)
        assert 0 < quality[-1] <= quality[0] < 1


def test_the_straight_middle_grasp_is_the_best_of_a_box_and_a_pen():
    for shape in (BOX, PEN):
        best = propose_planar(shape, HAND)[0]
        assert np.hypot(best.x - shape.centre[0], best.y - shape.centre[1]) < 1e-9
        axis = min(angle_between_axes(best.theta, shape.yaw + side) for side in (0, np.pi / 2))
        assert axis < 1e-6


def test_a_neighbour_closes_the_directions_where_a_finger_would_stand():
    # A post beside the can along theta = 0.3, where one finger would go.
    spot = np.array(CAN.centre) + 0.031 * np.array([np.cos(0.3), np.sin(0.3)])
    post = np.array([[spot[0], spot[1], z] for z in np.linspace(0.0, 0.08, 9)])
    free = {round(g.theta, 3) for g in propose_planar(CAN, HAND, max_candidates=200)}
    left = {round(g.theta, 3) for g in propose_planar(CAN, HAND, post, max_candidates=200)}
    assert 0.3 in free
    assert 0.3 not in left
    assert round(0.3 + np.pi / 2, 3) in left


def test_a_long_bar_is_taken_far_from_its_middle_where_neighbours_leave_no_other_place():
    bar = Footprint((0.0, 0.0), 0.0, 0.20, 0.02, 0.03)
    beside = np.array([0.016, 0.020, 0.024, 0.028])
    along, across = np.linspace(-0.055, 0.055, 45), np.concatenate([-beside, beside])
    rails = np.stack(np.meshgrid(along, across, [0.01, 0.02, 0.03]), axis=-1).reshape(-1, 3)
    left = propose_planar(bar, HAND, rails)
    assert left
    assert {round(abs(g.x), 3) for g in left} == {0.075}


def test_a_neighbour_lower_than_the_fingertips_does_not_matter():
    spot = np.array(CAN.centre) + 0.031 * np.array([np.cos(0.3), np.sin(0.3)])
    low = np.array([[spot[0], spot[1], 0.01]])
    assert propose_planar(CAN, HAND, low) == propose_planar(CAN, HAND)


def test_same_seed_same_candidates_other_seed_other_order_of_equals():
    assert propose_planar(CAN, HAND, seed=3) == propose_planar(CAN, HAND, seed=3)
    a = [g.theta for g in propose_planar(CAN, HAND, seed=3)]
    b = [g.theta for g in propose_planar(CAN, HAND, seed=4)]
    assert a != b


def test_moving_the_object_moves_the_grasps_with_it():
    turn, shift = 0.7, np.array([0.04, -0.02])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = Footprint(tuple(rotation @ BOX.centre + shift), 0.3 + turn, 0.042, 0.028, 0.05)
    for before, after in zip(propose_planar(BOX, HAND), propose_planar(moved, HAND), strict=True):
        assert np.allclose(rotation @ [before.x, before.y] + shift, [after.x, after.y])
        assert angle_between_axes(before.theta + turn, after.theta) < 1e-9
        assert before.quality == pytest.approx(after.quality)


def test_an_irregular_outline_is_measured_where_the_jaws_meet_it():
    # An L: 60 x 60 mm with arms 20 mm wide. Through the middle of one arm it is 20 mm wide.
    corners = np.array([[0, 0], [60, 0], [60, 20], [20, 20], [20, 60], [0, 60]]) / 1e3
    shape = Footprint((0.03, 0.03), 0.0, 0.06, 0.06, 0.03, outline=corners)
    assert shape.kind == "irregular"
    contacts = shape.contacts((0.04, 0.01), np.pi / 2, 0.01)
    assert contacts.width == pytest.approx(0.02)
    assert contacts.deviations == pytest.approx((0.0, 0.0), abs=1e-9)
    assert shape.contacts((0.2, 0.2), 0.0, 0.01) is None


def test_a_slanted_face_is_no_antipodal_contact():
    wedge = np.array([[-0.02, -0.015], [0.02, -0.015], [0.02, 0.015]])
    shape = Footprint((0.005, 0.0), 0.0, 0.04, 0.03, 0.05, outline=wedge)
    contacts = shape.contacts((0.01, 0.0), 0.0, 0.004)
    assert max(contacts.deviations) > np.deg2rad(45)
    assert min(contacts.deviations) < 1e-9


def test_a_remembered_grasp_is_judged_on_the_object_as_it_is_now():
    best = propose_planar(BOX, HAND)[0]
    remembered = PlanarGrasp(best.x, best.y, best.z, best.theta, 0.0, best.opening, 0.0, "memory")
    again = rate(BOX, HAND, remembered)
    assert again.source == "memory"
    assert again.width == pytest.approx(best.width)
    assert again.quality == pytest.approx(best.quality)
    swollen = Footprint(BOX.centre, BOX.yaw, 0.08, 0.07, 0.05)
    assert rate(swollen, HAND, remembered) is None


@pytest.mark.parametrize("sizes", [(0.02, 0.03, 0.05), (0.03, 0.0, 0.05), (np.nan, 0.02, 0.05)])
def test_impossible_sizes_are_refused_with_the_numbers(sizes):
    with pytest.raises(ValueError, match=r"length >= width > 0"):
        Footprint((0.0, 0.0), 0.0, *sizes)


def test_neighbours_of_a_wrong_shape_are_refused_with_it():
    with pytest.raises(ValueError, match=r"\(4, 2\)"):
        propose_planar(CAN, HAND, np.zeros((4, 2)))


def test_neighbours_that_are_not_finite_are_left_out():
    missing = np.array([[np.nan, 0.0, 0.1], [0.0, 0.0, np.inf]])
    assert propose_planar(CAN, HAND, missing) == propose_planar(CAN, HAND)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"centre": (np.nan, 0.0)}, "finite centre"),
        ({"yaw": np.inf}, "finite centre"),
        ({"roundness": np.nan}, "finite centre"),
        ({"outline": np.full((4, 2), np.nan)}, "finite corners"),
    ],
)
def test_a_footprint_that_is_not_finite_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        replace(BOX, **change)


@pytest.mark.parametrize(
    "change", [{"finger_width": np.nan}, {"max_payload": np.nan}, {"max_opening": np.inf}]
)
def test_sizes_of_a_gripper_are_finite(change):
    with pytest.raises(ValueError, match=r"positive|finite"):
        replace(HAND, **change)


def test_how_many_are_proposed_is_bounded_and_what_cannot_be_is_refused():
    best = propose_planar(BOX, HAND, max_candidates=200)[0]
    assert propose_planar(BOX, HAND, max_candidates=1) == [best]
    with pytest.raises(ValueError, match="at least 1, got 0"):
        propose_planar(BOX, HAND, max_candidates=0)
    for shape in ((3,), (4, 2), (2, 2, 3)):
        with pytest.raises(ValueError, match=r"neighbours must have shape \(m, 3\)"):
            propose_planar(BOX, HAND, np.zeros(shape))
