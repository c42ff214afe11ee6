"""A table that was left in a cloud is found; faces of the object itself are not taken for one."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.spatial.clouds.ground import find_support
from grasp.spatial.contact_plan import plan_contacts_on_cloud
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud
from grasp.spatial.gripper import panda_hand
from grasp.spatial.meshes.shapes import box_mesh
from grasp.spatial.suction_cup import SuctionCup


def _box(size: tuple[float, float, float], count: int = 3000) -> np.ndarray:
    """Draw points of a box that stands on z = 0."""
    points, _ = box_mesh(size).sample(count, np.random.default_rng(2))
    return points + np.array([0.0, 0.0, size[2] / 2])


def _table(half: float = 0.15, count: int = 4000) -> np.ndarray:
    rng = np.random.default_rng(11)
    return np.c_[rng.uniform(-half, half, (count, 2)), rng.normal(0.0, 0.001, count)]


@pytest.mark.parametrize("tilt", [0.0, 0.7, 2.5])
def test_a_table_is_found_in_any_frame(tilt: float) -> None:
    rotation = np.array(
        [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
    )
    cloud = np.vstack([_table(), _box((0.04, 0.06, 0.08))]) @ rotation.T + (0.2, -0.1, 0.5)
    shown = find_support(cloud)
    assert shown is not None
    up = rotation[:, 2]
    assert shown.support.up @ up == pytest.approx(1.0, abs=1e-3)
    assert shown.support.height == pytest.approx(np.array([0.2, -0.1, 0.5]) @ up, abs=0.001)
    assert len(shown.standing) < 3100
    assert "29 x 29 cm" in shown.note


@pytest.mark.parametrize(
    "cloud",
    [
        _box((0.2, 0.2, 0.1)),  # its own faces
        _box((0.3, 0.3, 0.004)),  # a plate
        np.vstack([_box((0.1, 0.1, 0.005)), _box((0.01, 0.1, 0.1))]),  # a bracket
        np.vstack(
            [_table() + np.array([0, 0, 0.2]), _box((0.04, 0.06, 0.35))]
        ),  # a shelf before a post
        np.zeros((5, 3)),
        np.zeros((500, 3)),
        np.full((500, 3), np.nan),
    ],
)
def test_no_table_is_seen_where_there_is_none(cloud: np.ndarray) -> None:
    assert find_support(cloud) is None


def test_plans_keep_off_a_table_that_was_left_in_the_cloud() -> None:
    hand, cloud = panda_hand(), np.vstack([_table(), _box((0.03, 0.1, 0.05))])
    few = SpatialOptions(tries=400, samples=20)
    plan = plan_on_cloud(cloud, hand, options=few)
    assert plan
    assert any("taken for its support" in note for note in plan.notes)
    for grasp in plan:
        corners = np.array([
            [box[i, 0], box[j, 1], box[k, 2]]
            for box in hand.boxes(grasp.opening or hand.max_opening)
            for i in (0, 1) for j in (0, 1) for k in (0, 1)
        ])  # fmt: skip
        pose = grasp.frame_from_gripper
        assert (corners @ pose[2, :3] + pose[2, 3]).min() > 0.0
    alone = plan_on_cloud(cloud, hand, options=SpatialOptions(tries=50, find_support=False))
    assert not any("support" in note for note in alone.notes)


def test_a_cup_takes_what_stands_on_the_table_and_not_the_table() -> None:
    cloud = np.vstack([_table(), _box((0.06, 0.1, 0.05))])
    eye = np.array([[0.0, 0.0, 0.8]])
    plan = plan_contacts_on_cloud(cloud, SuctionCup("cup"), viewpoints=eye)
    assert plan
    assert all(grasp.centre[2] > 0.01 for grasp in plan)
