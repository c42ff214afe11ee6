"""Grasps on partial clouds: labels, rules of the search, invariance, input that is no object."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.spatial.clouds.cloud import prepare_cloud
from grasp.spatial.clouds.neighbours import PointGrid, within
from grasp.spatial.clouds.surfaces import estimate_normals, surface_frames
from grasp.spatial.collision import Support, Surroundings, room_around
from grasp.spatial.gripper import ParallelGripper, nao_hand, panda_hand
from grasp.spatial.hand_search.antipodal import antipodal_label
from grasp.spatial.hand_search.hand_kernel import support
from grasp.spatial.hand_search.hand_search import propose_from_cloud
from grasp.spatial.hand_search.hands import SearchOptions, find_hands

TABLE = np.array([0.0, 0.0, 1.0, 0.0])
JAW = ParallelGripper("jaw", "jaw", 0.0, 0.08, finger_width=0.012, finger_length=0.06)


def cylinder(radius: float, height: float, count: int = 8000, seed: int = 0) -> np.ndarray:
    """Side and lid of an upright cylinder on z = 0, (count, 3), m."""
    rng = np.random.default_rng(seed)
    lid = int(count * radius / (radius + 2 * height))
    turn = rng.uniform(0, 2 * np.pi, count)
    r = np.where(np.arange(count) < lid, radius * np.sqrt(rng.random(count)), radius)
    z = np.where(np.arange(count) < lid, height, rng.uniform(0, height, count))
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def seen_from(points: np.ndarray, normals: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Points of a convex surface that face a camera."""
    return points[np.einsum("ij,ij->i", normals, camera - points) > 0]


def one_view_of_cylinder(radius: float, height: float, camera: np.ndarray) -> np.ndarray:
    points = cylinder(radius, height, 20000)
    lid = points[:, 2] > height - 1e-9
    normals = np.where(lid[:, None], (0.0, 0.0, 1.0), points * (1, 1, 0) / radius)
    return seen_from(points, normals, camera)


def box(size: tuple[float, float, float], count: int = 12000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis]) / 2
    return points * size


# the label


@pytest.mark.parametrize(
    ("left", "right", "label"), [(7, 7, "full"), (7, 6, "half"), (6, 7, "half"), (6, 6, "none")]
)
def test_a_side_counts_from_seven_points_on(left: int, right: int, label: str) -> None:
    local = np.zeros((left + right, 3))
    local[:left, 0], local[left:, 0] = -0.02, 0.02
    along_x = np.where(np.arange(left + right) < left, -1.0, 1.0)
    out = np.empty(12)
    flags = np.ones(left + right, np.int64)
    cos20 = np.cos(np.deg2rad(20))
    count = support(local, along_x, flags, left + right, 0.0, 0.08, -0.04, 0.01, cos20, 0.003, out)
    assert count == left + right
    assert (out[2], out[3]) == (left, right)
    assert antipodal_label(out[2], out[3], 6) == label


def test_only_points_between_palm_and_fingertips_with_steep_normals_count() -> None:
    local = np.array(
        [[0.02, 0, 0], [0.02, 0.011, 0], [0.02, -0.041, 0], [0.05, 0, 0], [0.02, 0, 0]]
    )
    along_x = np.array([1.0, 1.0, 1.0, 1.0, np.cos(np.deg2rad(21))])
    flags = np.ones(5, np.int64)
    out = np.empty(12)
    between = support(
        local, along_x, flags, 5, 0.0, 0.08, -0.04, 0.01, np.cos(np.deg2rad(20)), 0.003, out
    )
    assert between == 2
    assert (out[2], out[3]) == (0, 1)


# what the search finds


def test_a_can_is_taken_across_its_axis() -> None:
    found = propose_from_cloud(cylinder(0.03, 0.12), JAW, table=TABLE, samples=60)
    assert found.counts["full"] > 30
    for grasp in found:
        assert grasp.antipodal == "full"
        assert not grasp.completed
        # A contact is the mean of a 3 mm voxel's points: 3 mm on either side.
        assert grasp.width == pytest.approx(0.06, abs=0.006)
        assert abs(grasp.closing[2]) < np.sin(np.deg2rad(20))
        assert np.linalg.det(grasp.frame_from_gripper[:3, :3]) == pytest.approx(1.0)
        # The jaws meet it where it is widest, not beyond.
        assert abs(grasp.centre[:2] @ grasp.approach[:2]) < 0.012


def test_a_box_is_taken_across_two_pairs_of_sides() -> None:
    points = box((0.05, 0.065, 0.12)) + np.array([0, 0, 0.06])
    found = propose_from_cloud(points, JAW, table=TABLE, samples=150)
    along = np.abs([grasp.closing for grasp in found])
    assert (along.max(axis=1) > np.cos(np.deg2rad(15))).all()
    assert {0, 1} == set(along.argmax(axis=1).tolist())


def test_quadric_frames_find_the_same_kind_of_grasp() -> None:
    options = SearchOptions(frames="quadric")
    found = propose_from_cloud(cylinder(0.03, 0.12), JAW, table=TABLE, samples=40, options=options)
    assert found[0].antipodal == "full"
    assert found[0].width == pytest.approx(0.06, abs=0.006)


def test_the_axis_of_a_local_frame_runs_along_a_cylinder() -> None:
    grid = PointGrid.of(cylinder(0.03, 0.12), 0.01)
    normals, known = estimate_normals(grid, 0.01)
    side = np.flatnonzero((np.abs(grid.points[:, 2] - 0.06) < 0.02) & known)[:20]
    for quadric in (False, True):
        frames, usable = surface_frames(grid, normals, side, 0.02, np.array([1.0, 0, 0]), quadric)
        assert usable.all()
        assert np.abs(frames[:, 0, 2]).min() > np.cos(np.deg2rad(6))
        assert np.allclose(frames @ frames.transpose(0, 2, 1), np.eye(3), atol=1e-9)


def test_no_hand_comes_from_where_no_camera_was() -> None:
    camera = np.array([0.5, 0.1, 0.4])
    points = one_view_of_cylinder(0.03, 0.12, camera)
    hands = find_hands(prepare_cloud(points, viewpoints=camera[None]), JAW, 100)
    surface = hands.poses[:, :3, 3]
    ray = surface - camera
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    # The rule holds at the sample, a hand's breadth from the tool centre point: 10 degrees.
    assert len(hands) > 50
    assert (np.einsum("ij,ij->i", hands.poses[:, :3, 2], ray) > -np.sin(np.deg2rad(10))).all()
    around = find_hands(prepare_cloud(points), JAW, 100)
    assert (
        np.einsum("ij,ij->i", around.poses[:, :3, 2], around.poses[:, :3, 3] - camera).min() < -0.2
    )


def test_one_view_of_a_mug_has_no_two_opposed_sides() -> None:
    camera = np.array([0.45, 0.0, 0.3])
    points = one_view_of_cylinder(0.033, 0.09, camera)
    found = propose_from_cloud(
        points, JAW, table=TABLE, viewpoints=camera[None], samples=100, complete=False
    )
    assert len(found) > 0
    assert {grasp.antipodal for grasp in found} == {"half"}


def test_two_views_see_both_sides() -> None:
    cameras = np.array([[0.4, 0.1, 0.3], [-0.4, -0.1, 0.3]])
    points = np.concatenate([one_view_of_cylinder(0.03, 0.1, camera) for camera in cameras])
    found = propose_from_cloud(
        points, JAW, table=TABLE, viewpoints=cameras, samples=100, complete=False
    )
    assert found[0].antipodal == "full"
    assert not found[0].completed


def test_fingers_stay_over_the_table_and_off_neighbours() -> None:
    lying = box((0.12, 0.03, 0.03)) + np.array([0, 0, 0.015])
    wall = box((0.3, 0.002, 0.1), 8000) + np.array([0, 0.03, 0.05])
    gripper = panda_hand()
    free = propose_from_cloud(lying, gripper, table=TABLE, samples=80)
    beside = propose_from_cloud(lying, gripper, table=TABLE, samples=80, obstacles=wall)
    assert len(free) > 0
    for found, obstacles in ((free, None), (beside, wall)):
        room = room_around(
            np.stack([g.frame_from_gripper for g in found] or [np.eye(4)]),
            np.array([g.opening for g in found] or [0.0]),
            gripper,
            Surroundings(Support(clearance=0.0015), obstacles, sweep=0.0),
        )
        assert room.free.all() or not found
    across = [abs(g.closing[1]) > 0.9 and g.opening == 0.08 for g in beside]
    assert not any(across)


def test_unequal_jaws_get_each_grasp_both_ways_round() -> None:
    found = propose_from_cloud(cylinder(0.018, 0.1), nao_hand(), table=TABLE, samples=30)
    first, second = found[0], found[1]
    assert np.allclose(first.closing, -second.closing)
    assert np.allclose(first.approach, second.approach)
    assert np.allclose(first.contacts, second.contacts[::-1])


# invariance


@pytest.mark.parametrize("complete", [False, True])
def test_a_moved_scene_gives_the_moved_grasps(complete: bool) -> None:
    camera = np.array([0.4, 0.2, 0.35])
    points = one_view_of_cylinder(0.03, 0.12, camera) * (1.0, 0.8, 1.0)
    rng = np.random.default_rng(5)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    shift = np.array([0.3, -1.2, 0.7])
    up = rotation @ TABLE[:3]
    here = propose_from_cloud(
        points, JAW, table=TABLE, viewpoints=camera[None], samples=40, complete=complete
    )
    there = propose_from_cloud(
        points @ rotation.T + shift,
        JAW,
        table=np.array([*up, -up @ shift]),
        viewpoints=(rotation @ camera + shift)[None],
        samples=40,
        complete=complete,
    )
    assert len(here) == len(there) > 10
    # Completed walls stand in rows, where the last digit may decide what is outermost: the best
    # ten are enough then.
    pairs = list(zip(here, there, strict=True))[: 10 if complete else None]
    for a, b in pairs:
        assert np.allclose(rotation @ a.centre + shift, b.centre, atol=1e-6)
        assert np.allclose(rotation @ a.closing, b.closing, atol=1e-6)
        assert a.scores["geometry"] == pytest.approx(b.scores["geometry"], abs=1e-6)


def test_the_seed_decides_alone() -> None:
    points = cylinder(0.03, 0.1, 4000)
    once, again, other = (propose_from_cloud(points, JAW, samples=20, seed=s) for s in (3, 3, 4))
    assert all(
        np.array_equal(a.frame_from_gripper, b.frame_from_gripper)
        for a, b in zip(once, again, strict=True)
    )
    assert not np.array_equal(once[0].frame_from_gripper, other[0].frame_from_gripper)


# input that is no object


def _plane() -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.c_[rng.uniform(-0.1, 0.1, (3000, 2)), np.full(3000, 0.2)]


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.empty((0, 3)), "no finite point"),
        (np.full((50, 3), np.nan), "no finite point"),
        (np.array([[0.1, 0.2, 0.3]]), "one place"),
        (np.tile([[0.1, 0.2, 0.3]], (500, 1)), "one place"),
        (np.outer(np.linspace(0, 0.1, 400), [1.0, 2.0, 0.5]), "one line"),
        (_plane(), "one plane"),
        (np.full((10, 3), 1e300), "no finite point"),
    ],
    ids=["empty", "nan", "one", "one place", "line", "plane", "huge"],
)
@pytest.mark.parametrize("viewpoints", [None, np.array([[0.5, 0.0, 0.5]])], ids=["", "camera"])
def test_what_has_no_volume_gives_a_reason(
    points: np.ndarray, reason: str, viewpoints: np.ndarray | None
) -> None:
    found = propose_from_cloud(points, JAW, viewpoints=viewpoints)
    assert len(found) == 0
    assert reason in found.reason


def test_points_that_are_not_finite_are_left_out_and_named() -> None:
    points = cylinder(0.03, 0.1, 4000)
    broken = np.insert(points, [0, 100], [[np.nan, 0, 0], [0, np.inf, 0]], axis=0)
    found = propose_from_cloud(broken, JAW, samples=20)
    assert len(found) == len(propose_from_cloud(points, JAW, samples=20)) > 0
    assert "2 points that are not finite" in found.notes[0]


def test_a_part_wider_than_the_stroke_gives_a_reason() -> None:
    found = propose_from_cloud(cylinder(0.06, 0.15), JAW, table=TABLE, samples=60)
    assert len(found) == 0
    assert "wider than the stroke of 80 mm" in found.reason


def test_a_gripper_wider_than_the_part_still_closes_on_it() -> None:
    assert propose_from_cloud(cylinder(0.006, 0.1), JAW, table=TABLE, samples=60)[0].width < 0.02


def test_an_empty_table_gives_a_reason() -> None:
    found = propose_from_cloud(_plane() - (0, 0, 0.2), JAW, table=TABLE)
    assert found.reason == "nothing stands on the table"


@pytest.mark.slow
def test_a_million_points_are_thinned_with_a_note() -> None:
    found = propose_from_cloud(cylinder(0.03, 0.12, 1_000_000), JAW, table=TABLE, samples=10)
    assert len(found) > 0
    assert "every 2th of 1000000 points" in found.notes[0]


def test_a_large_scene_gets_larger_voxels_with_a_note() -> None:
    rng = np.random.default_rng(0)
    floor = np.c_[rng.uniform(-1, 1, (150_000, 2)), rng.normal(0, 1e-3, 150_000)]
    cloud = prepare_cloud(np.concatenate([floor, cylinder(0.03, 0.12, 4000)]), table=TABLE)
    assert len(cloud.points) <= 40_000
    assert "voxels enlarged" in cloud.notes[0]


@pytest.mark.parametrize(
    "arguments",
    [
        {"points": np.zeros((5, 2))},
        {"table": np.zeros(4)},
        {"viewpoints": np.zeros(3)},
        {"viewpoints": np.full((1, 3), np.nan)},
        {"samples": 0},
    ],
)
def test_arrays_of_the_wrong_shape_are_errors(arguments: dict) -> None:
    with pytest.raises(ValueError, match="must"):
        propose_from_cloud(**{"points": cylinder(0.03, 0.1, 500), "gripper": JAW, **arguments})


# the parts


def test_neighbours_are_those_of_an_exhaustive_search() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(500, 3)) * (0.1, 0.05, 0.02)
    grid = PointGrid.of(points, 0.013)
    out = np.empty(500, np.int64)
    for centre in [*points[:20], np.full(3, 5.0)]:
        count = within(*grid.arrays, centre, 0.04, out)
        near = np.flatnonzero(np.linalg.norm(points - centre, axis=1) <= 0.04)
        assert np.array_equal(np.sort(out[:count]), near)


def test_normals_of_a_ball_are_its_radii() -> None:
    rng = np.random.default_rng(2)
    radii = rng.normal(size=(4000, 3))
    radii /= np.linalg.norm(radii, axis=1)[:, None]
    cloud = prepare_cloud(0.04 * radii + (1.0, 2.0, 3.0))
    outward = cloud.points - (1.0, 2.0, 3.0)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    # Uneven neighbourhoods on a curved surface tilt a normal by some degrees.
    assert np.quantile(np.einsum("ij,ij->i", cloud.normals, outward), 0.01) > np.cos(np.deg2rad(8))
