"""Grasps in a scene close on one thing, keep clear of the others, and say what they belong to."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.spatial.gripper import panda_hand
from grasp.spatial.meshes.shapes import box_mesh
from grasp.spatial.scene_plan import SceneOptions, plan_on_scene

HAND = panda_hand()
TABLE = np.array([0.0, 0.0, 1.0, 0.0])
FEW = SceneOptions(samples=20)


def box_points(size, centre, count=2500, seed=0):
    points, _ = box_mesh(size).sample(count, np.random.default_rng(seed))
    return points + centre


@pytest.fixture(scope="module")
def close_together():
    """Two boxes side by side, so near that no finger fits between them."""
    left = box_points((0.04, 0.06, 0.06), (-0.025, 0.0, 0.03))
    right = box_points((0.04, 0.06, 0.06), (0.025, 0.0, 0.03), seed=1)
    return np.vstack([left, right]), np.repeat([1, 2], 2500)


def test_things_close_together_are_held_across_their_free_sides_alone(close_together):
    points, labels = close_together
    found = plan_on_scene(points, HAND, labels=labels, table=TABLE, options=FEW)
    assert len(found)
    assert {one.segment for one in found} == {1, 2}
    assert abs(found[0].closing[1]) > 0.9
    for one in found:
        local = (points - one.centre) @ one.frame_from_gripper[:3, :3]
        for low, high in HAND.boxes(one.opening, 0.05):
            # Voxels stand for what lies up to half their edge, 1.5 mm, around them.
            inside = ((local > low + 0.003) & (local < high - 0.003)).all(axis=1)
            assert not inside.any()


def test_contacts_on_two_things_are_no_grasp(close_together):
    points, _ = close_together
    halves = np.where(points[:, 1] < 0, 1, 2)  # of each box one half belongs to either thing
    found = plan_on_scene(points, HAND, labels=halves, table=TABLE, options=FEW)
    assert found.counts["two_objects"] > 0
    for one in found:
        near = np.linalg.norm(points[None] - one.contacts[:, None], axis=2).argmin(axis=1)
        assert set(halves[near]) == {one.segment}


def test_what_lies_on_top_comes_before_what_it_lies_on():
    lower = box_points((0.12, 0.12, 0.04), (0.0, 0.0, 0.02), 4000)
    upper = box_points((0.03, 0.05, 0.05), (0.0, 0.0, 0.065))
    labels = np.repeat([1, 2], [4000, 2500])
    found = plan_on_scene(np.vstack([lower, upper]), HAND, labels=labels, table=TABLE, options=FEW)
    assert found[0].segment == 2


def test_moves_tells_how_often_the_open_hand_would_touch_the_neighbour():
    alone = box_points((0.04, 0.06, 0.06), (0.0, 0.0, 0.03))
    wall = box_points((0.01, 0.06, 0.06), (0.05, 0.0, 0.03))
    labels = np.repeat([1, 2], 2500)
    near = plan_on_scene(np.vstack([alone, wall]), HAND, labels=labels, table=TABLE, options=FEW)
    on_box = [one for one in near if one.segment == 1]
    towards = [one.scores["moves"] for one in on_box if abs(one.closing[0]) > 0.9]
    along = [one.scores["moves"] for one in on_box if abs(one.closing[1]) > 0.9]
    assert along
    assert np.mean(along) < 0.4
    assert not towards or np.mean(towards) > np.mean(along)


def test_without_labels_things_that_stand_apart_are_told_apart():
    points = np.vstack(
        [
            box_points((0.04, 0.06, 0.06), (0.0, 0.0, 0.03)),
            box_points((0.04, 0.06, 0.06), (0.2, 0.0, 0.03)),
        ]
    )
    found = plan_on_scene(points, HAND, table=TABLE, options=FEW)
    assert found.counts["objects"] == 2
    by_side = {one.segment: one.centre[0] > 0.1 for one in found}
    assert sorted(by_side.values()) == [False, True]


def test_the_same_scene_and_seed_give_the_same_grasps(close_together):
    points, labels = close_together
    first, second = (
        plan_on_scene(points, HAND, labels=labels, table=TABLE, options=FEW) for _ in range(2)
    )
    assert len(first) == len(second)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.frame_from_gripper, b.frame_from_gripper)


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.empty((0, 3)), "holds no finite point"),
        (np.full((50, 3), np.nan), "holds no finite point"),
        (np.zeros((50, 3)), "one place"),
    ],
)
def test_a_scene_without_things_says_why(points, reason):
    assert reason in plan_on_scene(points, HAND, table=TABLE).reason


def test_labels_that_do_not_fit_are_refused(close_together):
    points, labels = close_together
    with pytest.raises(ValueError, match="one for each point"):
        plan_on_scene(points, HAND, labels=labels[:-1])
    with pytest.raises(ValueError, match="integers"):
        plan_on_scene(points, HAND, labels=labels.astype(float))


def test_of_very_many_objects_the_largest_are_planned_on_and_the_notes_say_so(monkeypatch):
    monkeypatch.setattr("grasp.spatial.scene_plan._MAX_OBJECTS", 2)
    boxes = [
        box_points((0.03, size, 0.05), (0.1 * k, 0.0, 0.025))
        for k, size in enumerate((0.03, 0.06, 0.07))
    ]
    labels = np.repeat([1, 2, 3], 2500)
    found = plan_on_scene(np.vstack(boxes), HAND, labels=labels, table=TABLE, options=FEW)
    assert found.notes == ("grasps planned of the 2 largest of 3 objects",)
    assert found.counts["objects"] == 2
    assert {2, 3} <= {one.segment for one in found}


def test_a_thing_alone_moves_nothing():
    points = box_points((0.04, 0.06, 0.06), (0.0, 0.0, 0.03))
    found = plan_on_scene(points, HAND, table=TABLE, options=FEW)
    assert found
    assert all(one.scores["moves"] == 0 for one in found)


def test_stray_points_give_a_reason_and_no_error():
    rng = np.random.default_rng(0)
    for count in (3, 30, 300):
        points = rng.uniform(-0.2, 0.2, (count, 3)) + np.array([0.0, 0.0, 0.3])
        found = plan_on_scene(points, HAND, rng.uniform(1, 2, (1, 3)), table=TABLE, options=FEW)
        assert found or found.reason
