"""Objects that stick out of the visible table, and things thinner than the prism's floor."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from features.geometry import Intrinsics, points_from_depth
from features.segmentation import SegmentParams, segment_scene

CAMERA = Intrinsics.from_fov(640, 480, 1.2)


def noisy(depth, seed=0):
    """Return depth with the axial noise and the steps of a depth camera (datasets, section 4)."""
    rng = np.random.default_rng(seed)
    field = cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), 0.8)
    sigma = 0.0012 + 0.0019 * (depth - 0.4) ** 2
    shown = depth + 0.8 * sigma * field / field.std()
    constant = CAMERA.fx * 0.075
    return (constant / (np.round(constant / shown * 8) / 8)).astype(np.float32)


def test_an_object_over_the_edge_of_the_table_keeps_what_sticks_out():
    depth = np.zeros((480, 640), np.float32)
    depth[60:420, 60:420] = 0.70
    thing = (slice(200, 260), slice(340, 480))
    depth[thing] = 0.62
    points = points_from_depth(noisy(depth) * (depth > 0), CAMERA)
    whole = segment_scene(points)
    assert len(whole.objects) == 1
    assert (whole.labels[thing] > 0).mean() > 0.95
    cut = segment_scene(points, params=SegmentParams(overhang_m=0))
    assert (cut.labels[thing] > 0).mean() < 0.75


def test_an_object_cut_by_the_image_stays_whole():
    depth = np.full((480, 640), 0.70, np.float32)
    depth[180:480, 240:380] = 0.60  # hides the table below it, down to the rim
    depth[360:] = np.where(depth[360:] < 0.65, depth[360:], 0)
    scene = segment_scene(points_from_depth(noisy(depth) * (depth > 0), CAMERA))
    assert (scene.labels[180:480, 240:380] > 0).mean() > 0.95
    assert scene.objects[0].touches_border


def slanted_view():
    """Return the points (h, w, 3) of a table seen at a slant and which show the block on it."""
    v, u = np.mgrid[:480, :640]
    ray = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], -1)
    fall = ray @ np.array([0.0, np.sin(0.8), np.cos(0.8)])  # m down for each m of depth
    ahead = ray @ np.array([0.0, -np.cos(0.8), np.sin(0.8)])  # and along the table
    fall, ahead = np.maximum(fall, 0.3), np.maximum(ahead, 0.01)
    table, top, front = 0.6 / fall, 0.48 / fall, 0.5 / ahead
    on_top = (np.abs(top * ray[..., 0]) < 0.06) & (np.abs(top * ahead - 0.55) < 0.05)
    drop = front * fall
    on_front = (np.abs(front * ray[..., 0]) < 0.06) & (drop > 0.48) & (drop < 0.6)
    depth = np.select([on_front, on_top], [front, top], table)
    return points_from_depth(noisy(depth), CAMERA), on_top | on_front


def test_an_object_whose_foot_is_out_of_view_is_found_if_it_hides_the_table():
    points, block = slanted_view()
    first, last = np.flatnonzero(block.any(axis=1))[[0, -1]]
    end = int(first + 0.5 * (last - first))
    points, block = points[:end], block[:end]
    scene = segment_scene(points)
    assert (scene.labels[block] > 0).mean() > 0.9
    assert (scene.labels[~block] > 0).mean() < 0.01
    assert scene.objects[0].touches_border


def test_a_wall_behind_the_table_is_no_part_of_what_touches_it():
    depth = np.full((480, 640), 0.70, np.float32)
    depth[:, 420:] = 0.0
    wall = np.linspace(0.70, 0.45, 60)
    depth[:, 420:480] = wall  # rises from the table's edge
    depth[200:260, 380:424] = 0.64
    scene = segment_scene(points_from_depth(noisy(depth) * (depth > 0), CAMERA))
    assert (scene.labels[:, 440:] > 0).mean() < 0.02
    assert (scene.labels[205:255, 385:415] > 0).mean() > 0.9


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("thick_m", "is_found"), [(0.003, True), (0.0, False)])
def test_thin_things_are_found_and_prints_on_the_table_are_not(seed, thick_m, is_found):
    rng = np.random.default_rng(seed)
    y, x = (int(n) for n in rng.integers((120, 150), (300, 400)))
    depth = np.full((480, 640), 0.70, np.float32)
    colours = np.full((480, 640, 3), 130.0)
    card = (slice(y, y + 36), slice(x, x + 90))
    depth[card] -= thick_m
    colours[card] = (200, 60, 50)
    depth[400:450, 540:600] -= 0.05
    ink = np.clip(colours + rng.normal(0, 3, colours.shape), 0, 255).astype(np.uint8)
    points = points_from_depth(noisy(depth, seed), CAMERA)
    scene = segment_scene(points, ink)
    assert len(scene.objects) == 1 + is_found
    assert (scene.labels[card] > 0).mean() > 0.8 if is_found else not scene.labels[card].any()
    without = segment_scene(points, ink, replace(SegmentParams(), thin_objects=False))
    assert len(without.objects) == 1


def test_a_shadow_is_no_thin_thing():
    depth = np.full((480, 640), 0.70, np.float32)
    depth[200:260, 200:260] -= 0.05
    colours = np.full((480, 640, 3), 150.0)
    colours[200:270, 255:330] *= 0.6
    colours[200:260, 200:260] = (40, 90, 160)
    rng = np.random.default_rng(0)
    ink = np.clip(colours + rng.normal(0, 3, colours.shape), 0, 255).astype(np.uint8)
    assert len(segment_scene(points_from_depth(noisy(depth), CAMERA), ink).objects) == 1


def beside_the_camera(x: float) -> np.ndarray:
    """Return a table with a block and what is lower than one, and a block at x m beside it."""
    rng = np.random.default_rng(0)

    def block(at, low, high, count):
        return rng.uniform([at, 0, low], [at + 0.02, 0.02, high], (count, 3))

    table = rng.uniform([-0.3, -0.3, 0.5], [0.3, 0.3, 0.5], (4000, 3))
    far_off = [[2 * x, 2 * x, 0.5], [-2 * x, 2 * x, 0.5], [0, -2 * x, 0.5]]
    blocks = block(0, 0.45, 0.48, 500), block(0, 0.4945, 0.4965, 500), block(x, 0.45, 0.48, 300)
    return np.vstack([table, far_off, *blocks])


def test_points_far_beside_the_camera_are_left_out():
    scene = segment_scene(beside_the_camera(5e5))  # the map of feet would take petabytes
    assert scene.status == "ok"
    assert len(scene.objects) == 1


@pytest.mark.parametrize(
    "points",
    [
        np.tile([0.0, 0.0, 0.5], (500, 1)),
        np.column_stack([np.linspace(-0.2, 0.2, 500), np.zeros(500), np.full(500, 0.5)]),
    ],
    ids=["place", "line"],
)
def test_what_lies_in_one_place_or_on_a_line_is_no_table(points):
    assert segment_scene(points).status == "no_table"
    whole = segment_scene(points, params=SegmentParams(remove_table=False))
    assert len(whole.objects) == 1


@pytest.mark.parametrize("gravity", [np.zeros(3), np.full(3, np.nan), np.array([0, np.inf, 0])])
def test_a_gravity_without_a_direction_is_refused(gravity):
    with pytest.raises(ValueError, match="gravity"):
        segment_scene(beside_the_camera(0.1), gravity=gravity)


def test_a_table_that_no_sampled_row_shows_is_not_grazed():
    depth = np.full((700, 7), 0.5)
    depth[:, 0] = np.nan  # every seventh point is looked at
    points = points_from_depth(depth, Intrinsics(7, 700, 20.0, 20.0, 3.0, 350.0))
    assert segment_scene(points.reshape(-1, 3)).status == "table_only"


def test_a_seed_has_a_finite_size():
    with pytest.raises(ValueError, match="seed_m"):
        SegmentParams(seed_m=np.inf)
