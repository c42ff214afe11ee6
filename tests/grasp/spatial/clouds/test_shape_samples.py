"""Samples of a shape keep to what was seen, differ where nothing was, and tell grasps apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.clouds.cloud import prepare_cloud
from grasp.spatial.clouds.shape_samples import ShapeSamples, sample_shapes
from grasp.spatial.frames import pose_from_planar
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.gripper import panda_hand
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import first_and_last
from grasp.spatial.meshes.shapes import box_mesh
from grasp.spatial.scoring import shape_chance
from grasp.spatial.scoring.shape_chance import with_shape_chance

EYE = np.array([0.3, 0.25, 0.35])
TABLE = np.array([0.0, 0.0, 1.0, 0.0])
SIZE = (0.04, 0.08, 0.06)
UP = np.eye(4)
UP[2, 3] = SIZE[2] / 2
BOX = box_mesh(SIZE).moved(UP)


def seen(mesh: Mesh, eye: np.ndarray, noise: float = 0.001) -> np.ndarray:
    """Return the points (n, 3) of a mesh that a camera sees, 1 mm apart, with noise along rays."""
    rng = np.random.default_rng(0)
    middle = mesh.vertices.mean(axis=0)
    away = middle - eye
    forward = away / np.linalg.norm(away)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    u, v = np.meshgrid(np.arange(-0.08, 0.08, 0.001), np.arange(-0.08, 0.08, 0.001))
    targets = middle + u.reshape(-1, 1) * right + v.reshape(-1, 1) * np.cross(forward, right)
    rays = targets - eye
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    at, face = first_and_last(mesh.tree, targets, rays, 0.2)
    hit = face[:, 0] >= 0
    depth = at[hit, 0] + rng.normal(0, noise, int(hit.sum()))
    return targets[hit] + depth[:, None] * rays[hit]


def samples_of(points: np.ndarray, count: int = 12, seed: int = 0) -> ShapeSamples:
    cloud = prepare_cloud(points, table=TABLE, viewpoints=EYE[None])
    samples = sample_shapes(cloud, points, count, seed)
    assert samples is not None
    return samples


@pytest.fixture(scope="module")
def view() -> np.ndarray:
    return seen(BOX, EYE)


@pytest.fixture(scope="module")
def samples(view: np.ndarray) -> ShapeSamples:
    return samples_of(view)


def test_every_sample_has_the_surface_that_was_seen(samples, view):
    inner = view[(view[:, 2] > 0.015)]
    for k in range(len(samples)):
        off = samples.distances(inner, k)
        assert np.quantile(np.abs(off), 0.9) < 0.003  # noise of 1 mm, cells of 3 mm


def test_space_that_was_seen_empty_is_in_no_sample(samples, view):
    before = view + 0.012 * (EYE - view) / np.linalg.norm(EYE - view, axis=1, keepdims=True)
    below = np.array([[0.0, 0.0, -0.01]])
    for k in range(len(samples)):
        assert samples.distances(before, k).min() > 0
        assert samples.distances(below, k)[0] > 0


def test_the_hidden_side_varies_about_the_true_one(samples):
    truth = float(np.prod(SIZE))
    assert 0.6 * truth < samples.volume.mean() < 1.6 * truth
    assert samples.volume.std() > 0.02 * truth
    assert np.linalg.norm(samples.com.mean(axis=0) - BOX.com) < 0.012
    back = np.array([[-SIZE[0] / 2, -0.01, 0.04]])
    hidden = np.array([samples.distances(back, k)[0] for k in range(len(samples))])
    front = np.array([samples.distances(back * (-1, 1, 1), k)[0] for k in range(len(samples))])
    assert hidden.std() > 2 * front.std()


def test_a_seed_gives_the_same_samples_and_another_gives_others(view, samples):
    np.testing.assert_array_equal(samples_of(view).com, samples.com)
    assert not np.array_equal(samples_of(view, seed=1).com, samples.com)


def test_without_a_table_or_a_camera_nothing_says_where_the_back_is(view):
    for given in ({"table": TABLE}, {"viewpoints": EYE[None]}):
        assert sample_shapes(prepare_cloud(view, **given), view) is None


def test_less_than_no_sample_is_refused():
    with pytest.raises(ValueError, match="shapes: expected 0 or more samples, got -1"):
        SpatialOptions(shapes=-1)


def grasp(x: float, y: float, theta: float, width: float) -> GraspCandidate:
    pose = pose_from_planar(x, y, 0.045, theta)
    return GraspCandidate(pose, width, opening=min(width + 0.02, 0.08))


def test_a_grasp_holds_the_likelier_the_more_samples_it_closes_on(samples):
    hand = panda_hand()
    across, corner, beside = grasp(0, 0, 0, 0.04), grasp(0, 0, 0.7, 0.06), grasp(0.1, 0, 0, 0.04)
    good, lean, none = with_shape_chance([across, corner, beside], samples, hand, 0.1)
    assert good.scores["carry"] > lean.scores["carry"] > none.scores["carry"] == 0
    assert good.scores["lift"] > 0.5
    assert good.scores["lever"] < 0.02
    heavy = with_shape_chance([across], samples, hand, 1.5)[0]
    assert heavy.scores["lift"] < good.scores["lift"]
    assert heavy.scores["lift_chance"] < good.scores["lift_chance"]
    assert with_shape_chance([], samples, hand) == []


def test_a_hand_is_inside_a_sample_wherever_it_is_turned():
    """A block below z = 6 cells of 1 mm: the points of a hand in it are told by a product."""
    cell = 0.001
    heights = np.broadcast_to((np.arange(12) - 6.0) * cell, (12, 12, 12)).astype(np.float32)
    ripple = np.zeros((12, 12, 12), np.float32)
    shape = (heights, heights, ripple, np.eye(4), cell, 1.0)
    rng = np.random.default_rng(5)
    told, expected = [], []
    for turn in Rotation.random(60, random_state=6).as_matrix():
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, rng.uniform(4.0, 7.5, 3)
        probes = rng.uniform(-1.7, 1.7, (2, 3))
        told.append(bool(shape_chance._is_inside(shape, pose, probes)))
        depth_m = (6.0 - (probes @ turn.T + pose[:3, 3])[:, 2]) * cell
        expected.append(bool((depth_m > shape_chance._IN_WALL_M).any()))
    assert told == expected
    assert 10 < sum(expected) < 50
