"""Grasps of opposed contacts on the surface of a cloud, seen and completed."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from grasp.spatial.clouds.cloud import prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.collision import Support
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud
from grasp.spatial.gripper import nao_hand, panda_hand
from grasp.spatial.hand_search.surface_pairs import propose_pairs
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh
from simulate.study.grasp_views import TABLE, correct, depth_view

EYE = np.array([0.32, 0.05, 0.3])
FEW = SpatialOptions(tries=600, samples=30)


def _standing(mesh: Mesh) -> Mesh:
    pose = np.eye(4)
    pose[2, 3] = -mesh.vertices[:, 2].min()
    return mesh.moved(pose)


@pytest.mark.parametrize("classifier", [None, "shipped"], ids=["plain", "filter"])
def test_a_cup_wider_than_the_hand_is_taken_by_its_rim_from_above(
    classifier: Literal["shipped"] | None,
) -> None:
    hand = nao_hand()
    cup = _standing(cup_mesh(0.036, 0.07, 0.003))  # 72 mm across, the hand opens 50 mm
    seen = depth_view(cup, EYE)
    found = plan_on_cloud(seen.points, hand, Support(), EYE[None], FEW, classifier)
    right = correct(list(found), cup, hand)
    assert right[:5].any()
    best = found[int(np.argmax(right))]
    assert best.approach[2] < -0.9
    assert best.width < 0.012
    assert all(("classifier" in one.scores) == bool(classifier) for one in found)


def test_a_contact_that_was_not_seen_marks_its_grasp_as_completed() -> None:
    hand, box = panda_hand(), _standing(box_mesh((0.04, 0.05, 0.06)))
    seen = depth_view(box, EYE)
    cloud = prepare_cloud(seen.points, table=TABLE, viewpoints=EYE[None])
    whole = complete_by_symmetry(cloud)
    found = propose_pairs(whole, whole.surface(), hand, Support(), tries=600)
    assert found
    assert correct(list(found), box, hand).mean() > 0.7
    for one in found:
        assert one.contacts is not None
        # The camera looks from +x, almost along x, and sees neither the side at -x nor that at -y.
        hidden = (one.contacts[:, 0] < -0.015) | (one.contacts[:, 1] < -0.02)
        assert one.completed == bool(hidden.any())
        assert (one.source, one.antipodal) == ("cloud", "full")


def test_pairs_keep_off_what_else_stands_there() -> None:
    hand, box = panda_hand(), _standing(box_mesh((0.04, 0.12, 0.06)))
    points, _ = box.sample(6000, np.random.default_rng(0))
    # A wall 5 mm beside each of the narrow sides leaves no room for the fingers.
    y, z = np.meshgrid(np.linspace(-0.1, 0.1, 60), np.linspace(0.012, 0.1, 30))
    walls = np.concatenate(
        [np.stack([np.full(y.size, x), y.ravel(), z.ravel()], axis=1) for x in (-0.025, 0.025)]
    )
    alone = prepare_cloud(points, table=TABLE)
    beside = prepare_cloud(points, table=TABLE, obstacles=walls)
    assert propose_pairs(alone, alone.surface(), hand, Support(), tries=600)
    assert not propose_pairs(beside, beside.surface(), hand, Support(), tries=600)


@pytest.mark.parametrize("hand", [nao_hand(), panda_hand()], ids=["nao", "panda"])
def test_two_grasps_of_one_place_stand_apart_in_the_order(hand) -> None:
    box = _standing(box_mesh((0.03, 0.05, 0.06)))
    seen = depth_view(box, EYE)
    found = plan_on_cloud(seen.points, hand, Support(), EYE[None], FEW)
    # Half a turn about the approach closes on the same two places.
    places = [(one.centre, one.closing, one.approach) for one in found.candidates[:5]]
    for k, (centre, closing, approach) in enumerate(places):
        for other, across, along in places[:k]:
            near = np.linalg.norm(centre - other) < 0.009
            alike = abs(closing @ across) > 0.99 and approach @ along > 0.99
            assert not (near and alike)
