"""From a tabletop cloud to objects."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from features.geometry import Intrinsics, points_from_depth
from features.segmentation import (
    SegmentParams,
    find_table_plane,
    score_labels,
    segment_cloud,
    segment_scene,
    table_prism,
)
from features.segmentation.convexity import patch_graph
from features.segmentation.fpfh import fpfh
from features.segmentation.merge import contract
from features.segmentation.supervoxels import Supervoxels, grow_supervoxels
from features.segmentation.voxels import VoxelGrid, build_voxels

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
TILT = 0.9  # rad, camera looks down at the table


def _scene(*spheres_and_boxes, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Render a table 0.7 m away with upright boxes and spheres by casting a ray per pixel.

    A thing is ``("box", x, y, half_x, half_y, height)`` or ``("ball", x, y, radius)``, m, table
    frame: x to the right, y away from the camera, z up, origin in the image centre.
    """
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1
    )
    s, c = np.sin(TILT), np.cos(TILT)
    table_from_camera = np.array([[1, 0, 0], [0, -s, c], [0, -c, -s]])
    origin = -table_from_camera @ np.array([0, 0, 0.7])
    directions = rays @ table_from_camera.T
    depth = np.full(u.shape, np.inf)
    t = -origin[2] / directions[..., 2]
    depth[t > 0] = t[t > 0]
    for kind, x, y, *size in spheres_and_boxes:
        if kind == "ball":
            centre = np.array([x, y, size[0]])
            b = directions @ (origin - centre)
            a = np.einsum("...k,...k->...", directions, directions)
            root = b**2 - a * ((origin - centre) @ (origin - centre) - size[0] ** 2)
            hit = np.where(root >= 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        else:
            low, high = np.array([x - size[0], y - size[1], 0]), np.array([x + size[0], y + size[1],
                                                                        size[2]])  # fmt: skip
            with np.errstate(divide="ignore", invalid="ignore"):
                t1, t2 = (low - origin) / directions, (high - origin) / directions
            near = np.nanmax(np.minimum(t1, t2), axis=-1)
            far = np.nanmin(np.maximum(t1, t2), axis=-1)
            hit = np.where((near <= far) & (far > 0), near, np.inf)
        depth = np.minimum(depth, hit)
    depth[~np.isfinite(depth)] = 0
    if noise:
        depth += (depth > 0) * np.random.default_rng(seed).normal(0, noise, depth.shape)
    return points_from_depth(depth.astype(np.float32), CAMERA)


THREE = (
    ("ball", -0.15, 0.0, 0.035),
    ("box", 0.0, 0.0, 0.03, 0.02, 0.08),
    ("box", 0.15, 0.03, 0.025, 0.025, 0.05),
)


def test_the_table_plane_is_found_to_a_degree_and_a_millimetre() -> None:
    plane = find_table_plane(_scene(*THREE, noise=0.001))
    assert plane is not None
    expected = np.array([0, -np.cos(TILT), -np.sin(TILT)])
    # Least squares over thousands of points with 1 mm noise: far below these bounds.
    assert np.degrees(np.arccos(plane.normal @ expected)) < 0.5
    assert plane.offset == pytest.approx(0.7 * np.sin(TILT), abs=1e-3)


@pytest.mark.slow
def test_three_things_give_three_labels() -> None:
    scene = segment_scene(_scene(*THREE, noise=0.001))
    assert scene.status == "ok"
    assert len(scene.objects) == 3
    xs = sorted(round(float(o.centroid[0]), 2) for o in scene.objects)
    np.testing.assert_allclose(xs, [-0.15, 0.0, 0.15], atol=0.012)
    assert not any(o.touches_border for o in scene.objects)


@pytest.mark.slow
def test_two_touching_boxes_are_two_by_convexity_and_one_by_distance() -> None:
    # Not flush: what lies in one plane is one thing to anybody who only sees its shape.
    cloud = _scene(("box", -0.03, 0.0, 0.03, 0.03, 0.10), ("box", 0.03, 0.02, 0.03, 0.03, 0.05))
    assert len(segment_scene(cloud).objects) == 2
    thesis = SegmentParams(method="components", tolerance_deg=12)
    assert len(segment_scene(cloud, params=thesis).objects) == 2
    touching = _scene(("box", -0.03, 0, 0.03, 0.03, 0.10), ("box", 0.03, 0, 0.03, 0.03, 0.05))
    assert len(segment_scene(touching, params=SegmentParams(method="euclidean")).objects) == 1


def test_the_same_cloud_gives_the_same_labels_organised_or_not() -> None:
    cloud = _scene(*THREE, noise=0.001)
    first, again = segment_scene(cloud), segment_scene(cloud)
    np.testing.assert_array_equal(first.labels, again.labels)
    assert len(segment_scene(cloud.reshape(-1, 3)).objects) == 3


def test_small_things_are_kept() -> None:
    """A ball of 24 mm at 0.7 m: about 250 pixels."""
    cloud = _scene(("ball", 0.05, 0.0, 0.012), ("box", -0.05, 0.0, 0.03, 0.03, 0.06))
    params = SegmentParams(min_points=60)
    assert len(segment_scene(cloud, params=params).objects) == 2


def test_low_points_go_to_the_object_they_stand_under() -> None:
    cloud = _scene(("box", 0.0, 0.0, 0.03, 0.03, 0.06))
    with_base = segment_scene(cloud)
    without = segment_scene(cloud, params=SegmentParams(base_m=0.006))
    assert with_base.objects[0].indices.size > without.objects[0].indices.size


def test_gravity_tells_the_table_from_a_larger_wall() -> None:
    rng = np.random.default_rng(0)
    wall = np.column_stack([rng.uniform(-1, 1, (9000, 2)), np.full(9000, 1.5)])
    floor = np.column_stack([rng.uniform(-0.5, 0.5, 4000), np.full(4000, 0.4),
                             rng.uniform(0.6, 1.4, 4000)])  # fmt: skip
    cloud = np.concatenate([wall, floor])
    blind, told = find_table_plane(cloud), find_table_plane(cloud, gravity=np.array([0, 1.0, 0]))
    assert blind is not None
    assert told is not None
    assert abs(blind.normal[2]) > 0.99
    assert told.normal[1] == pytest.approx(-1, abs=0.01)


def test_the_prism_holds_what_stands_on_the_table_only() -> None:
    cloud = _scene(*THREE)
    plane = find_table_plane(cloud)
    assert plane is not None
    prism = table_prism(cloud, plane)
    assert 0.005 < prism.heights[prism.mask].min() < 0.5
    assert 0.01 < prism.mask.mean() < 0.2


@pytest.mark.parametrize(
    ("cloud", "status"),
    [
        (np.zeros((0, 3)), "empty"),
        (np.full((48, 64, 3), np.nan), "empty"),
        (np.random.default_rng(0).uniform(0.5, 2, (5000, 3)), "no_table"),
        (_scene(), "table_only"),
    ],
)
def test_scenes_without_objects_say_why(cloud: np.ndarray, status: str) -> None:
    scene = segment_scene(cloud)
    assert (scene.status, scene.objects) == (status, ())
    assert not scene.labels.any()


def test_infinite_and_negative_points_are_missing() -> None:
    cloud = _scene(*THREE).copy()
    cloud[::7, ::5] = np.inf
    cloud[1::9, ::5, 2] *= -1
    scene = segment_scene(cloud)
    assert len(scene.objects) == 3
    assert not scene.labels[::7, ::5].any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: segment_cloud(np.zeros((48, 64))), "use points_from_depth"),
        (lambda: segment_cloud(np.zeros((9, 3), int)), "expected float"),
        (lambda: segment_cloud(np.zeros((9, 3)), np.zeros((8, 3), np.uint8)), "expected uint8"),
        (lambda: segment_cloud(np.zeros((9, 3)), None, np.zeros(8, bool)), "expected a mask"),
        (lambda: segment_cloud(np.full((99, 3), 900.0)), "wrong units"),
        (lambda: SegmentParams(method="magic"), "unknown method"),
        (lambda: SegmentParams(features="magic"), "unknown features"),
        (lambda: SegmentParams(voxel_m=0.1), "voxel_m <= seed_m"),
    ],
)
def test_wrong_calls_say_what_was_expected(call, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_real_kinect_scenes(mosd_dir: Path) -> None:
    """Six of the 45 scenes; over all of them F is .979 on average and .92 at worst."""
    camera = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
    scores = []
    for number in (1, 8, 15, 22, 29, 41):
        depth = cv2.imread(str(mosd_dir / f"learn{number}_depth.png"), cv2.IMREAD_UNCHANGED)
        rgb = cv2.imread(str(mosd_dir / f"learn{number}_rgb.jpg"))[..., ::-1].copy()
        label = cv2.imread(str(mosd_dir / f"learn{number}_label.png"), cv2.IMREAD_UNCHANGED)
        scene = segment_scene(
            points_from_depth(depth / np.float32(1000), camera), rgb, SegmentParams(min_points=150)
        )
        score = score_labels(scene.labels, np.where(label >= 20, label, 0), label > 0)
        assert score is not None
        scores.append(score.f)
    assert np.mean(scores) > 0.95, scores


def _bottle(shoulder: float = 0.02, neck: float = 0.008) -> tuple[tuple[float | str, ...], ...]:
    """A post on a post: as sharp a valley as between two things that touch."""
    return (("box", 0.0, 0.0, shoulder, shoulder, 0.08), ("box", 0.0, 0.0, neck, neck, 0.12))


def test_what_stands_wholly_on_a_larger_thing_is_joined_when_asked_for() -> None:
    cloud = _scene(*_bottle(), ("box", 0.12, 0.0, 0.02, 0.02, 0.08))
    apart = segment_scene(cloud, params=SegmentParams(voxel_m=0.004, seed_m=0.012, min_points=60))
    joined = segment_scene(
        cloud,
        params=SegmentParams(voxel_m=0.004, seed_m=0.012, min_points=60, join_standing=True),
    )
    assert len(apart.objects) == 3
    assert len(joined.objects) == 2
    assert [o.label for o in joined.objects] == [1, 2]
    assert joined.objects[0].indices.size >= joined.objects[1].indices.size


def test_what_hangs_behind_or_is_as_wide_is_not_joined() -> None:
    # A tall post behind a low block: its foot is hidden, so it floats, but not over the block.
    cloud = _scene(("box", 0.0, -0.03, 0.04, 0.02, 0.08), ("box", 0.0, 0.05, 0.01, 0.01, 0.14))
    params = SegmentParams(min_points=60, join_standing=True)
    assert len(segment_scene(cloud, params=params).objects) == 2


def test_settings_follow_the_distance() -> None:
    assert SegmentParams.for_distance(0.3) == SegmentParams.near()
    assert SegmentParams.for_distance(0.9) == SegmentParams()


@pytest.mark.slow
@pytest.mark.parametrize("turn_deg", [90, 180, 217])
def test_turning_the_cloud_about_the_viewing_axis_keeps_the_partition(turn_deg: float) -> None:
    cloud = _scene(*THREE).reshape(-1, 3)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turned = cloud @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    first, second = segment_scene(cloud).labels, segment_scene(turned).labels
    score = score_labels(second, first)
    assert score is not None
    assert score.true_count == score.predicted_count == 3
    assert score.f > 0.99  # voxels cut the outlines elsewhere


def test_mirroring_the_cloud_keeps_the_partition() -> None:
    cloud = _scene(*THREE).reshape(-1, 3)
    score = score_labels(segment_scene(cloud * (-1, 1, 1)).labels, segment_scene(cloud).labels)
    assert score is not None
    assert score.predicted_count == 3
    assert score.f > 0.99


def test_a_plane_seen_edge_on_is_said_to_be_grazing() -> None:
    rng = np.random.default_rng(0)
    table = np.column_stack(
        [rng.uniform(-0.4, 0.4, 9000), np.full(9000, 0.05), rng.uniform(0.6, 1.4, 9000)]
    )
    assert segment_scene(table, gravity=np.array([0, 1.0, 0])).status == "grazing"


def test_duplicated_points_change_nothing() -> None:
    cloud = _scene(*THREE, noise=0.001).reshape(-1, 3)
    twice = np.concatenate([cloud, cloud])
    once, doubled = segment_cloud(cloud).labels, segment_cloud(twice).labels
    np.testing.assert_array_equal(doubled[: len(cloud)] > 0, once > 0)


def test_too_many_supervoxels_are_refused_with_advice() -> None:
    cloud = np.random.default_rng(0).uniform(0.1, 3.0, (60_000, 3))
    with pytest.raises(ValueError, match="use a larger voxel or crop"):
        segment_cloud(cloud)


def test_a_perfect_map_scores_one_and_an_empty_one_nothing() -> None:
    truth = np.repeat([0, 3, 7], 100)
    score = score_labels(truth * 2, truth)
    assert score is not None
    assert (score.f, score.p75, score.weighted_overlap, score.over, score.under) == (1, 1, 1, 0, 0)
    nothing = score_labels(np.zeros(300, int), truth)
    assert nothing is not None
    assert (nothing.f, nothing.p75, nothing.over, nothing.predicted_count) == (0, 0, 1, 0)
    assert score_labels(truth, np.zeros(300, int)) is None


def test_splitting_and_merging_are_told_apart() -> None:
    truth = np.repeat([1, 2], 100)
    split = score_labels(np.repeat([1, 2, 3], [50, 50, 100]), truth)
    merged = score_labels(np.ones(200, int), truth)
    assert split is not None
    assert merged is not None
    assert (split.over, split.under) == (0.25, 0.0)
    assert (merged.over, merged.under) == (0.0, 1.0)


def test_pixels_of_unknown_truth_do_not_count() -> None:
    truth, found = np.array([1, 1, 0, 0]), np.array([1, 1, 1, 1])
    known = score_labels(found, truth, np.array([True, True, False, False]))
    assert known is not None
    assert known.f == 1
    with pytest.raises(ValueError, match="differ in shape"):
        score_labels(found, truth[:3])


def test_what_stands_beside_the_table_is_not_on_it() -> None:
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.3, 0.3, (9000, 2)), np.full(9000, 0.6)])
    over, beside = (
        rng.uniform(-0.03, 0.03, (2000, 3)) + np.array([x, 0, 0.55]) for x in (0.1, 0.45)
    )
    cloud = np.concatenate([table, over, beside])
    plane = find_table_plane(cloud)
    assert plane is not None
    prism = table_prism(cloud, plane)
    assert prism.mask[9_000:11_000].all()
    assert not prism.mask[11_000:].any()


def test_voxels_know_those_around_them_wherever_they_lie() -> None:
    """Compared with a search among all pairs; one point lies a light year off."""
    points = np.random.default_rng(2).uniform(-0.02, 0.02, (400, 3)) + np.array([0, 0, 0.5])
    far = np.concatenate([points, [[1e16, -1e16, 0.5], [0.3, -0.2, 0.9]]])
    for cloud in (points, far[400:], points[:1]):
        voxels = build_voxels(cloud, None, 0.005)
        cells = np.floor((cloud - cloud.mean(axis=0)) / 0.005)
        _, first = np.unique(voxels.of_point, return_index=True)
        assert len(np.unique(cells, axis=0)) == len(voxels)
        apart = np.abs(cells[first][:, None] - cells[first][None]).max(axis=-1)
        for k in range(len(voxels)):
            found = voxels.neighbours[voxels.starts[k] : voxels.starts[k + 1]]
            assert sorted(found) == np.flatnonzero(apart[k] == 1).tolist()


def test_contraction_is_greedy_edge_by_edge() -> None:
    """Against the rule spelled out on a matrix, with ties."""
    rng = np.random.default_rng(5)
    for number in (2, 9, 40):
        i, j = np.triu_indices(number, 1)
        some = rng.random(len(i)) < 0.3
        pairs = np.stack([i[some], j[some]], axis=1)
        weights = rng.integers(-4, 5, len(pairs)).astype(float)
        matrix = np.zeros((number, number))
        matrix[pairs[:, 0], pairs[:, 1]] = matrix[pairs[:, 1], pairs[:, 0]] = weights
        linked = np.zeros((number, number), bool)
        linked[pairs[:, 0], pairs[:, 1]] = linked[pairs[:, 1], pairs[:, 0]] = True
        groups = np.arange(number)
        while (np.where(linked, matrix, 0.0) > 0).any():
            a, b = np.unravel_index(np.where(linked, matrix, -np.inf).argmax(), matrix.shape)
            if (linked[a].sum(), -a) < (linked[b].sum(), -b):
                a, b = b, a
            for table in (matrix, linked):
                table[a] += table[b]
                table[:, a] = table[a]
                table[b] = table[:, b] = table[a, a] = 0
            groups[groups == b] = a
        same = groups[:, None] == groups[None]
        found = contract(pairs, weights, number)
        np.testing.assert_array_equal(found[:, None] == found[None], same)


def test_every_part_keeps_a_patch_however_near_the_next_one_is() -> None:
    """Seeds 6 mm apart are thinned out, but not to the loss of a part that touches nothing."""
    grid = np.stack(np.meshgrid([0.0, 0.002], [0.0, 0.002], [0.5]), -1).reshape(-1, 3)
    voxels = build_voxels(
        np.concatenate([grid, grid + np.array([0.008, 0, 0])]) + 0.0005, None, 0.002
    )
    patches = grow_supervoxels(voxels, 0.002, 0.02)
    assert (patches.of_voxel >= 0).all()
    assert len(patches) == 2


@pytest.mark.parametrize(("apart", "sane"), [((0.02, 0.0, 0.0), True), ((0.0, 0.02, 0.0), False)])
def test_patches_side_by_side_along_their_crease_say_nothing_about_convexity(
    apart: tuple[float, float, float], sane: bool
) -> None:
    """Normals 60 deg apart about the y axis: a crease along y can only part what lies across it."""
    tilt = np.radians(30)
    normals = np.array([[np.sin(tilt), 0, -np.cos(tilt)], [-np.sin(tilt), 0, -np.cos(tilt)]])
    centroids = np.array([apart, (0.0, 0.0, 0.0)])
    voxels = VoxelGrid(
        of_point=np.array([0, 1], np.int32),
        starts=np.array([0, 1, 2], np.int32),
        neighbours=np.array([1, 0], np.int32),
        centroids=centroids,
        colours=np.zeros((2, 3)),
        counts=np.ones(2),
        normals=normals,
    )
    patches = Supervoxels(np.array([0, 1], np.int32), centroids, normals, np.zeros((2, 3)))
    graph = patch_graph(voxels, patches, 0.02, 0.1, 0.005)
    assert graph.pairs.tolist() == [[0, 1]]
    assert graph.sane.tolist() == [sane]
    if sane:
        assert graph.angle_deg[0] == pytest.approx(60)  # the right one looks to the right: convex


def _surface(height) -> VoxelGrid:
    x, y = np.meshgrid(np.arange(-0.05, 0.05, 0.001), np.arange(-0.05, 0.05, 0.001))
    cloud = np.stack([x, y, 0.5 + height(x, y)], axis=-1).reshape(-1, 3)
    return build_voxels(cloud, None, 0.005)


def test_histograms_of_normals_tell_flat_from_bent_and_sum_to_one() -> None:
    flat, tilted, bent = (
        _surface(height)
        for height in (lambda x, y: 0 * x, lambda x, y: 0.3 * x, lambda x, y: (x**2 + y**2) / 0.06)
    )
    means = [fpfh(grid).mean(axis=0) for grid in (flat, tilted, bent)]
    for grid in (flat, tilted, bent):
        np.testing.assert_allclose(fpfh(grid).sum(axis=1), 1)
    # Turning a plane shifts voxel borders, bending it shifts the angles themselves.
    assert np.abs(means[0] - means[1]).sum() < 0.5 * np.abs(means[0] - means[2]).sum()


def test_growing_by_39_numbers_finds_the_same_three_things() -> None:
    cloud = _scene(*THREE, noise=0.001)
    colours = np.full(cloud.shape, 128, np.uint8)
    rich = segment_scene(cloud, colours, SegmentParams(features="39d"))
    score = score_labels(rich.labels, segment_scene(cloud, colours).labels)
    assert len(rich.objects) == 3
    assert score is not None
    assert score.f > 0.98


def test_a_cloud_without_a_table_is_cut_up_whole_when_asked_for() -> None:
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(20_000, 3))
    ball *= 0.25 / np.linalg.norm(ball, axis=1, keepdims=True)
    # A slab of 16 mm holds 3 % of a ball of half a metre: no plane holds a tenth of three.
    middles = np.array([[0, 0, 0.6], [0.8, 0, 1.0], [0, 0.8, 1.6]])
    cloud = (ball[:, None] + middles).reshape(-1, 3)
    assert segment_scene(cloud).status == "no_table"
    # By distance: no camera sees the backs of balls, whose normals would point inwards.
    coarse = SegmentParams(
        method="euclidean", voxel_m=0.02, seed_m=0.08, min_points=1000, remove_table=False
    )
    whole = segment_scene(cloud, params=coarse)
    assert (whole.status, len(whole.objects)) == ("no_table", 3)


def test_one_voxel_is_an_object_when_it_holds_enough_points() -> None:
    points = np.tile([[0.001, 0.001, 0.501]], (100, 1))
    assert segment_cloud(points).counts.tolist() == [100]
    assert segment_cloud(points[:99]).counts.tolist() == []


def test_objects_are_numbered_by_size_with_their_bases() -> None:
    x, y = np.meshgrid(np.linspace(-0.3, 0.3, 320), np.linspace(-0.2, 0.2, 240))
    z = np.full(x.shape, 0.6)
    # The right block is the smaller one until its low, wide foot is given to it.
    for centre, half_x, half_y, height in (
        (-0.12, 0.021, 0.020, 0.05),
        (0.12, 0.019, 0.020, 0.05),
        (0.12, 0.028, 0.029, 0.0055),
    ):
        inside = (abs(x - centre) < half_x) & (abs(y) < half_y)
        z[inside] = np.minimum(z[inside], 0.6 - height)
    scene = segment_scene(np.stack([x, y, z], axis=-1))
    sizes = [len(thing.indices) for thing in scene.objects]
    assert len(sizes) == 2
    assert sizes == sorted(sizes, reverse=True)
    assert scene.objects[0].centroid[0] > 0
