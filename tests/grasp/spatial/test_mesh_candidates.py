"""Antipodal grasps on shapes whose right grasps are known, and on shapes that have none."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp.spatial import grasp_plan
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_given, plan_on_cloud, plan_on_mesh
from grasp.spatial.gripper import ParallelGripper, panda_hand, parallel_jaw
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh, lathed_mesh, sphere_mesh
from grasp.spatial.pairs import antipodal_pairs

HAND = panda_hand()
CONE = np.cos(np.arctan(HAND.friction))


def _opposed(pairs) -> bool:  # type: ignore[no-untyped-def]
    """Tell whether every pair's line lies in both friction cones."""
    left = -np.einsum("ni,ni->n", pairs.normals[:, 0], pairs.closing)
    right = np.einsum("ni,ni->n", pairs.normals[:, 1], pairs.closing)
    return bool((left >= CONE - 1e-9).all() and (right >= CONE - 1e-9).all())


def test_a_box_closes_on_its_two_narrow_pairs_of_sides() -> None:
    pairs = antipodal_pairs(box_mesh((0.04, 0.06, 0.15)), HAND, tries=600)
    assert _opposed(pairs)
    on_x = np.abs(pairs.normals[:, 0, 0]) > 0.99
    on_y = np.abs(pairs.normals[:, 0, 1]) > 0.99
    # 15 cm do not fit between jaws that open 8 cm.
    assert (on_x | on_y).all()
    assert on_x.sum() > 50
    assert on_y.sum() > 50
    assert (pairs.widths[on_x] >= 0.04 - 1e-9).all()
    assert (pairs.widths[on_y] >= 0.06 - 1e-9).all()


def test_a_sphere_closes_near_its_centre() -> None:
    radius = 0.03
    pairs = antipodal_pairs(sphere_mesh(radius, 48), HAND, tries=400)
    middle = pairs.contacts.mean(axis=1)
    away = np.linalg.norm(np.cross(middle, pairs.closing), axis=1)
    # A chord is inside the cones as far as r sin(atan mu) from the centre; facets are 3.7 deg.
    assert away.max() <= radius * np.sin(np.arctan(HAND.friction) + np.deg2rad(3.8))
    assert len(pairs) > 300


def test_a_thin_plate_closes_across_its_thickness() -> None:
    pairs = antipodal_pairs(box_mesh((0.2, 0.2, 0.004)), HAND, tries=300)
    assert len(pairs) > 200
    assert (np.abs(pairs.normals[:, 0, 2]) > 0.99).all()
    assert pairs.widths.min() >= 0.004 - 1e-9


def test_the_wall_of_a_wide_cup_is_held_from_both_sides() -> None:
    cup = cup_mesh(0.06, 0.1, 0.004)
    pairs = antipodal_pairs(cup, HAND, tries=400)
    assert pairs.widths.max() < 0.01  # 12 cm across do not fit
    found = propose_on_mesh(cup, HAND, Surroundings(Support(-0.05)), tries=600)
    assert found
    for candidate in found:
        inside = np.hypot(*candidate.contacts[:, :2].T)
        assert inside.min() == pytest.approx(0.056, abs=3e-4)
        assert candidate.approach[2] < 0.2  # from above or the side, never through the floor


def test_a_narrow_cup_is_held_across_and_by_its_wall() -> None:
    pairs = antipodal_pairs(cup_mesh(0.02, 0.1, 0.004), HAND, tries=600)
    assert (pairs.widths > 0.03).sum() > 50
    walls = (pairs.widths < 0.01) & (np.abs(pairs.closing[:, 2]) < 0.6)
    assert walls.sum() > 50
    # The finger inside has less room than the cup is wide.
    assert np.median(pairs.room[walls]) < 0.04


def test_candidates_touch_nothing_and_stay_over_the_support() -> None:
    box = box_mesh((0.04, 0.06, 0.05))
    found = propose_on_mesh(box, HAND, Surroundings(Support(-0.025)), tries=600)
    assert found
    for candidate in found:
        fingers = HAND.boxes(candidate.opening)[:2]
        corners = np.array([[box[i, a] for a, i in enumerate(k)] for box in fingers
                            for k in np.ndindex(2, 2, 2)])  # fmt: skip
        world = corners @ candidate.frame_from_gripper[:3, :3].T + candidate.centre
        assert world[:, 2].min() >= -0.025 + 0.002 - 1e-9
        assert candidate.scores["clearance"] > 0
        assert candidate.width < candidate.opening <= HAND.max_opening
        # A right-handed frame whose x axis joins the contacts.
        frame = candidate.frame_from_gripper[:3, :3]
        assert np.linalg.det(frame) == pytest.approx(1.0)
        line = candidate.contacts[1] - candidate.contacts[0]
        assert line / candidate.width == pytest.approx(candidate.closing)


def test_neighbours_keep_the_fingers_away() -> None:
    box = box_mesh((0.04, 0.2, 0.06))
    free = propose_on_mesh(box, HAND, tries=400)
    assert {round(float(np.sign(c.centre[1]))) for c in free} >= {-1, 1}
    rng = np.random.default_rng(0)
    wall = rng.uniform((-0.1, -0.1, -0.1), (0.1, -0.005, 0.1), (20000, 3))
    crowded = propose_on_mesh(box, HAND, Surroundings(neighbours=wall), tries=400)
    assert crowded
    assert all(c.centre[1] > 0 for c in crowded)


@cache
def _scores(seed: int) -> np.ndarray:
    return _sorted(_body(), Surroundings(Support(-0.04)), seed)


@cache
def _body() -> Mesh:
    return cup_mesh(0.03, 0.08, 0.006, 24)


def _sorted(mesh: Mesh, around: Surroundings, seed: int) -> np.ndarray:
    found = plan_on_mesh(mesh, HAND, around, SpatialOptions(samples=40, tries=150, seed=seed))
    names = ("confidence", "epsilon", "clearance")
    return np.array([[c.scores[n] for n in names] for c in found])


@pytest.mark.slow
@settings(max_examples=4, deadline=None, phases=[Phase.generate])
@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
)
def test_a_rigid_motion_of_object_and_support_leaves_the_scores(quaternion, shift) -> None:
    turn = Rotation.from_quat(quaternion).as_matrix()
    moved = np.eye(4)
    moved[:3, :3], moved[:3, 3] = turn, shift
    up = turn @ [0.0, 0.0, 1.0]
    support = Support(float(-0.04 + up @ shift), tuple(up))
    there = _sorted(_body().moved(moved), Surroundings(support), seed=3)
    assert there.shape == _scores(3).shape
    assert np.allclose(there, _scores(3), atol=1e-6)


def _sheet() -> Mesh:
    return as_mesh([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0)], [(0, 1, 2), (0, 2, 3)])


@pytest.mark.parametrize(
    ("mesh", "gripper", "words"),
    [
        (as_mesh([], []), HAND, "no face"),
        (as_mesh(np.full((3, 3), np.nan), [[0, 1, 2]]), HAND, "no face"),
        (_sheet(), HAND, "nothing opposite"),
        (box_mesh((0.2, 0.2, 0.2)), HAND, "nothing opposite"),
        (box_mesh((0.078, 2.0, 2.0)), HAND, "too wide"),
        (box_mesh((0.04, 0.04, 0.04)), parallel_jaw(0.006), "leaves nothing"),
        (box_mesh((0.01, 2.0, 2.0)), ParallelGripper("g", "jaw", 0.02, 0.08), "too narrow"),
    ],
    ids=[
        "empty",
        "nan",
        "one sheet",
        "larger than the stroke",
        "no margin",
        "stroke of 6 mm",
        "jaws that do not close so far",
    ],
)
def test_where_there_is_no_grasp_the_reason_is_said(mesh, gripper, words) -> None:
    found = plan_on_mesh(mesh, gripper)
    assert len(found) == 0
    assert words in found.reason


@pytest.mark.slow
def test_a_grasp_that_the_support_forbids_is_named() -> None:
    tile = box_mesh((0.1, 0.1, 0.01))  # held across 10 mm only, and that from the side
    found = plan_on_mesh(tile, HAND, Surroundings(Support(-0.005)))
    assert not found
    assert "support" in found.reason
    assert "slide it to the edge" in found.advice
    block = box_mesh((0.1, 0.1, 0.05))  # the support is not all that forbids it
    assert plan_on_mesh(block, HAND, Surroundings(Support(-0.025))).advice == ""
    assert plan_on_mesh(tile, HAND).advice == ""


def test_holes_and_flipped_faces_leave_the_grasps() -> None:
    box = box_mesh((0.04, 0.06, 0.1))
    rng = np.random.default_rng(5)
    turned = np.where(rng.random((12, 1)) < 0.5, box.faces[:, ::-1], box.faces)
    without_top = turned[~(box.normals[:, 2] > 0.9)]
    pairs = antipodal_pairs(as_mesh(box.vertices, without_top), HAND, tries=300)
    assert len(pairs) > 100
    assert _opposed(pairs)


def test_the_best_of_a_long_box_is_near_its_middle() -> None:
    bar = lathed_mesh([(0.012, -0.15), (0.012, 0.15)])
    best = plan_on_mesh(bar, HAND, options=SpatialOptions(mass=0.5, tries=1000))[0]
    # 5 N on a lever of 16 mm are 80 mN m, what two pads of 20 N at friction .5 and 4 mm hold.
    assert abs(best.centre[2]) < 0.016 + 0.004


def test_what_is_out_of_reach_is_left_out() -> None:
    box = box_mesh((0.04, 0.06, 0.08))
    left = SpatialOptions(tries=300, samples=5, reachable=lambda pose: pose[1, 3] > 0)
    assert all(c.centre[1] > 0 for c in plan_on_mesh(box, HAND, options=left))
    nowhere = SpatialOptions(tries=300, samples=5, reachable=lambda pose: False)
    assert "out of reach" in plan_on_mesh(box, HAND, options=nowhere).reason


def test_a_cloud_of_a_box_gives_its_grasps() -> None:
    points, _ = box_mesh((0.04, 0.12, 0.06)).sample(5000, np.random.default_rng(0))
    options = SpatialOptions(tries=400)
    found = plan_on_cloud(points, HAND, Support(-0.03), options=options)
    assert found
    best = found[0]
    assert best.width == pytest.approx(0.04, abs=0.006)
    assert abs(best.closing[0]) > 0.95
    assert best.scores["confidence"] > 0.7
    assert best.features is not None


def test_a_wrong_guess_of_the_hidden_side_does_not_take_away_what_is_seen(monkeypatch) -> None:
    box, eye = box_mesh((0.04, 0.06, 0.06)), np.array([0.3, 0.0, 0.4])
    points, faces = box.sample(8000, np.random.default_rng(0))
    seen = points[np.einsum("ij,ij->i", box.normals[faces], eye - points) > 0]
    asked = (seen, HAND, Support(-0.03), eye[None], SpatialOptions(tries=400))
    right = plan_on_cloud(*asked)
    assert right[0].completed

    def wall(cloud, guesses=None):
        """A guess that is wider than the hand opens, along x and along y."""
        lump = box_mesh((0.12, 0.12, 0.06)).sample(8000, np.random.default_rng(1))
        return cloud.with_points(lump[0], box_mesh((0.12, 0.12, 0.06)).normals[lump[1]])

    monkeypatch.setattr(grasp_plan, "complete_by_symmetry", wall)
    found = plan_on_cloud(*asked)
    assert found
    assert found.reason == ""
    assert not any(one.completed for one in found)
    assert not plan_on_cloud(*asked[:-1], SpatialOptions(tries=400, hedge=False))


@pytest.mark.parametrize(
    "points",
    [np.empty((0, 3)), np.zeros((1, 3)), np.full((50, 3), np.nan),
     np.linspace(0, 0.1, 200)[:, None] * [1.0, 0, 0]],
    ids=["empty", "one point", "nan", "a line"],
)  # fmt: skip
def test_clouds_of_nothing_give_a_reason(points: np.ndarray) -> None:
    found = plan_on_cloud(points, HAND)
    assert len(found) == 0
    assert found.reason


def test_given_grasps_of_a_mesh_without_a_face_have_a_reason() -> None:
    nothing = as_mesh(np.empty((0, 3)), np.empty((0, 3), int))
    given = [GraspCandidate(np.eye(4), 0.04)]
    assert plan_given(given, nothing, panda_hand()).reason == "the mesh has no face"
