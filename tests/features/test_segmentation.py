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
    segment_cloud,
    segment_scene,
    table_prism,
)

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
_TILT = 0.9  # rad, camera looks down at the table


def _scene(*spheres_and_boxes, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Render a table 0.7 m away with upright boxes and spheres by casting a ray per pixel.

    A thing is ``("box", x, y, half_x, half_y, height)`` or ``("ball", x, y, radius)``, m, table
    frame: x to the right, y away from the camera, z up, origin in the image centre.
    """
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1
    )
    s, c = np.sin(_TILT), np.cos(_TILT)
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
    expected = np.array([0, -np.cos(_TILT), -np.sin(_TILT)])
    # Least squares over thousands of points with 1 mm noise: far below these bounds.
    assert np.degrees(np.arccos(plane.normal @ expected)) < 0.5
    assert plane.offset == pytest.approx(0.7 * np.sin(_TILT), abs=1e-3)


def test_three_things_give_three_labels() -> None:
    scene = segment_scene(_scene(*THREE, noise=0.001))
    assert scene.status == "ok"
    assert len(scene.objects) == 3
    xs = sorted(round(float(o.centroid[0]), 2) for o in scene.objects)
    np.testing.assert_allclose(xs, [-0.15, 0.0, 0.15], atol=0.012)
    assert not any(o.touches_border for o in scene.objects)


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
        (lambda: SegmentParams(voxel_m=0.1), "voxel_m <= seed_m"),
    ],
)
def test_wrong_calls_say_what_was_expected(call, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def _overlap_f(found: np.ndarray, truth: np.ndarray) -> float:
    """Overlap F over the best one-to-one match of segments (Hungarian), valid pixels only."""
    from scipy.optimize import linear_sum_assignment

    table = np.zeros((truth.max() + 1, found.max() + 1))
    np.add.at(table, (truth, found), 1)
    g, p = table.sum(axis=1), table.sum(axis=0)
    f = 2 * table / np.maximum(g[:, None] + p[None], 1)
    rows, columns = linear_sum_assignment(-f[1:, 1:])
    common = table[1:, 1:][rows, columns].sum()
    return float(2 * common / (g[1:].sum() + p[1:].sum()))


def test_real_kinect_scenes(mosd_dir: Path) -> None:
    """Six of the 45 scenes; all of them give .95 or more with one exception at most."""
    camera = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
    scores = []
    for number in (1, 8, 15, 22, 29, 41):
        depth = cv2.imread(str(mosd_dir / f"learn{number}_depth.png"), cv2.IMREAD_UNCHANGED)
        rgb = cv2.imread(str(mosd_dir / f"learn{number}_rgb.jpg"))[..., ::-1].copy()
        label = cv2.imread(str(mosd_dir / f"learn{number}_label.png"), cv2.IMREAD_UNCHANGED)
        scene = segment_scene(
            points_from_depth(depth / np.float32(1000), camera), rgb, SegmentParams(min_points=150)
        )
        valid = depth > 0
        truth = np.unique(np.where(label >= 20, label, 0), return_inverse=True)[1].reshape(
            label.shape
        )
        scores.append(_overlap_f(scene.labels[valid], truth[valid]))
    assert np.mean(scores) > 0.95, scores
