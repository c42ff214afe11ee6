"""The hidden side of an object: completed where the view allows it, marked, and trusted less."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.spatial.clouds.cloud import SurfaceCloud, prepare_cloud
from grasp.spatial.clouds.completion import compare_symmetries, complete_by_symmetry
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.hand_search import propose_from_cloud, propose_on

JAW = ParallelGripper("jaw", "jaw", 0.0, 0.08, finger_width=0.012, finger_length=0.06)
TABLE = np.array([0.0, 0.0, 1.0, 0.0])
CAMERA = np.array([0.4, 0.15, 0.3])


def facing(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    return points[np.einsum("ij,ij->i", normals, CAMERA - points) > 0]


def half_can(radius: float = 0.03, height: float = 0.1, lid: bool = True) -> np.ndarray:
    rng = np.random.default_rng(0)
    turn = rng.uniform(0, 2 * np.pi, 12000)
    out = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    side = facing(radius * out + np.outer(rng.uniform(0, height, 12000), [0, 0, 1]), out)
    top = radius * np.sqrt(rng.random(12000))[:, None] * out + (0, 0, height)
    return np.concatenate([side, top]) if lid else side


def corner_of_box(size: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (20000, 3))
    axis = rng.integers(0, 3, 20000)
    sign = np.sign(points[np.arange(20000), axis])
    points[np.arange(20000), axis] = sign / 2
    normals = np.zeros_like(points)
    normals[np.arange(20000), axis] = sign
    return facing(points * size + (0, 0, size[2] / 2), normals)


def cloud_of(points: np.ndarray) -> SurfaceCloud:
    return prepare_cloud(points, table=TABLE, viewpoints=CAMERA[None])


def test_a_can_is_completed_where_it_is() -> None:
    cloud = complete_by_symmetry(cloud_of(half_can()))
    added = cloud.points[cloud.completed]
    radius = np.linalg.norm(added[:, :2], axis=1)
    assert len(added) > 300
    # One and a half voxels of 3 mm are what a completed point may miss the surface by.
    assert np.median(np.abs(radius - 0.03)) < 0.003
    # Of the far quarter nothing was seen and all is there now.
    far = np.rad2deg(np.arctan2(-added[:, 1], -added[:, 0]) - np.arctan2(CAMERA[1], CAMERA[0]))
    far = far[np.abs(far) < 45]
    assert np.histogram(far, 9, (-45, 45))[0].min() > 10
    outward = cloud.normals[cloud.completed][:, :2] * added[:, :2]
    assert np.mean(outward.sum(axis=1) > 0) > 0.95


def test_nothing_is_completed_where_the_camera_saw_nothing_or_the_table_is() -> None:
    for points in (half_can(), corner_of_box(np.array([0.05, 0.07, 0.09]))):
        cloud = complete_by_symmetry(cloud_of(points))
        added = cloud.points[cloud.completed]
        seen = cloud.points[~cloud.completed]
        rays = seen - CAMERA
        depth = np.linalg.norm(rays, axis=1)
        rays /= depth[:, None]
        for point in added[::7]:
            away = np.linalg.norm(point - CAMERA)
            near = rays @ ((point - CAMERA) / away) > np.cos(0.006 / away * 2)
            # Something that was seen lies on its ray, before it but for the tolerance.
            assert near.any()
            assert depth[near].min() < away + 0.006
        assert added[:, 2].min() > 0


def test_no_wall_falls_from_a_brim_under_which_the_camera_saw() -> None:
    rng = np.random.default_rng(0)
    stem = half_can(0.01, 0.08, lid=False)
    turn, r = rng.uniform(0, 2 * np.pi, 9000), 0.04 * np.sqrt(rng.random(9000))
    brim = np.stack([r * np.cos(turn), r * np.sin(turn), np.full(9000, 0.085)], axis=1)
    cloud = complete_by_symmetry(cloud_of(np.concatenate([stem, brim])))
    added = cloud.points[cloud.completed]
    towards = CAMERA[:2] / np.linalg.norm(CAMERA[:2])
    # In front of the stem's axis, beside the stem, below the brim: open space, seen as such.
    low = (added[:, 2] < 0.05) & (added[:, :2] @ towards > 0.02)
    assert not low.any()
    assert len(added) > 50


def test_a_box_seen_at_a_corner_gets_its_other_sides() -> None:
    size = np.array([0.05, 0.07, 0.09])
    cloud = complete_by_symmetry(cloud_of(corner_of_box(size)))
    sides = np.abs(cloud.points[:, :2]) > size[:2] / 2 - 0.004
    for axis in (0, 1):
        for sign in (-1, 1):
            there = cloud.points[sides[:, axis] & (np.sign(cloud.points[:, axis]) == sign)]
            assert np.ptp(there, axis=0)[1 - axis] > size[1 - axis] - 0.015
            assert np.ptp(there[:, 2]) > 0.07
    assert np.quantile(np.abs(cloud.points[:, :2]), 0.99, axis=0).max() < size[1] / 2 + 0.006


def test_both_sides_of_a_can_can_be_gripped_once_completed() -> None:
    seen = propose_from_cloud(
        half_can(), JAW, table=TABLE, viewpoints=CAMERA[None], samples=100, complete=False
    )
    whole = propose_from_cloud(half_can(), JAW, table=TABLE, viewpoints=CAMERA[None], samples=100)
    assert not any(grasp.completed for grasp in seen)
    best = whole[0]
    assert (best.antipodal, best.completed) == ("full", True)
    assert best.width == pytest.approx(0.06, abs=0.008)
    assert {g.antipodal for g in seen} == {"half"}


def test_what_is_guessed_is_trusted_less_than_what_is_seen() -> None:
    around = np.random.default_rng(0).uniform(0, 2 * np.pi, 8000)
    can = np.stack(
        [0.03 * np.cos(around), 0.03 * np.sin(around), np.linspace(0, 0.1, 8000)], axis=1
    )
    seen = propose_from_cloud(can, JAW, table=TABLE, samples=60)
    guessed = propose_from_cloud(half_can(), JAW, table=TABLE, viewpoints=CAMERA[None], samples=60)
    half = propose_from_cloud(
        half_can(), JAW, table=TABLE, viewpoints=CAMERA[None], samples=60, complete=False
    )
    confidence = [found[0].scores["confidence"] for found in (seen, guessed, half)]
    assert confidence == sorted(confidence, reverse=True)
    assert len(set(confidence)) == 3
    assert all(0 < c < 1 for c in confidence)


def test_without_table_or_camera_nothing_is_guessed() -> None:
    blind = prepare_cloud(half_can(), table=TABLE)
    floating = prepare_cloud(half_can(), viewpoints=CAMERA[None])
    assert compare_symmetries(blind) is compare_symmetries(floating) is None
    assert not complete_by_symmetry(blind).completed.any()
    assert not complete_by_symmetry(floating).completed.any()


def test_the_top_of_a_low_box_gets_walls() -> None:
    rng = np.random.default_rng(1)
    top = np.c_[rng.uniform(-0.02, 0.02, 4000), rng.uniform(-0.05, 0.05, 4000), np.full(4000, 0.03)]
    noisy = top + rng.normal(size=top.shape) * 5e-4
    found = propose_on(complete_by_symmetry(cloud_of(noisy)), JAW)
    assert len(found) > 0
    assert found[0].completed
    assert abs(found[0].closing[0]) > 0.9
    assert found[0].approach[2] < -0.5


def test_a_tall_thing_seen_from_straight_above_is_turned_about_its_own_axes() -> None:
    """Neither the view nor the longest axis has a level part."""
    steps = np.arange(-4, 5) / 256  # exact in binary, so that nothing is level by rounding alone
    x, y, z = (a.ravel() for a in np.meshgrid(steps, 2 * steps, 8 * steps))
    points = np.stack([x, y, z], axis=1)
    every = np.ones(len(points), bool)
    cloud = SurfaceCloud(
        points, np.tile([0.0, 0, 1], (len(points), 1)), every, every, ~every, 1 / 256,
        np.array([[0.0, 0, 1]]), np.array([0.0, 0, 1, 0.25]),
    )  # fmt: skip
    guesses = compare_symmetries(cloud)
    assert guesses is not None
    found = guesses.best
    assert found is not None
    assert np.isfinite(found.offset).all()
