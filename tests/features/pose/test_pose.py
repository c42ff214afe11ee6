"""Poses against stored models: exact on exact data, honest on the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.geometry import Frame, Intrinsics
from features.pose import (
    PoseModel,
    PoseParams,
    build_pose_model,
    estimate_pose,
    pose_error,
)
from features.pose.rotations import angle_between, rotation_about, super_fibonacci
from features.pose.visibility import check_free_space

CAMERA = Intrinsics(240, 180, 340.0, 340.0, 119.5, 89.5)
FAST = PoseParams(starts=144, more_starts=48)
Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


def box(half: tuple[float, float, float], centre: tuple[float, float, float]) -> Mesh:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    return signs * half + np.array(centre), faces


def joined(*meshes: Mesh) -> Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [f + start for (_, f), start in zip(meshes, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def lamp() -> Mesh:
    """A body without any symmetry: a block with a ridge and two knobs of different reach."""
    return joined(
        box((0.03, 0.025, 0.05), (0, 0, 0)),
        box((0.012, 0.02, 0.012), (0.01, -0.045, 0.03)),
        box((0.02, 0.01, 0.01), (0.05, 0.008, -0.03)),
        box((0.008, 0.012, 0.015), (-0.015, 0.005, 0.065)),
    )


def rendered(mesh: Mesh, pose: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return exact depth (h, w), 0 = nothing, by intersecting every ray with every triangle."""
    vertices = mesh[0] @ pose[:3, :3].T + pose[:3, 3]
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1
    ).reshape(-1, 3)
    depth = np.full(len(rays), np.inf)
    for a, b, c in vertices[mesh[1]]:
        corners = np.stack([a, b, c])
        seen = corners[:, :2] / corners[:, 2:]
        low, high = seen.min(axis=0), seen.max(axis=0)
        near = np.flatnonzero(((rays[:, :2] >= low) & (rays[:, :2] <= high)).all(axis=1))
        weights = rays[near] @ np.linalg.pinv(corners)
        hit = (weights > -1e-9).all(axis=1)
        depth[near[hit]] = np.minimum(depth[near[hit]], 1 / weights[hit].sum(axis=1))
    return np.where(np.isfinite(depth), depth, 0).reshape(u.shape).astype(np.float32)


def pose_of(seed: int, distance: float = 0.6) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = super_fibonacci(97)[(37 * seed) % 97]
    pose[:3, 3] = (0.02 * (seed % 3 - 1), 0.015 * (seed % 2), distance)
    return pose


@pytest.fixture(scope="module")
def model() -> PoseModel:
    return build_pose_model(*lamp())


@pytest.mark.slow
def test_the_pose_of_an_asymmetric_body_is_found_exactly(model: PoseModel) -> None:
    for seed in range(4):
        true = pose_of(seed)
        depth = rendered(lamp(), true)
        found = estimate_pose(model, Frame(depth, CAMERA), (depth > 0).astype(np.int32), 1, FAST)
        assert found is not None
        error = pose_error(model, found.camera_from_object, true)
        # Samples lie 3 mm apart; a side seen end-on slides until its edges stop it.
        assert error.translation_m < 0.0025, seed
        assert np.rad2deg(error.rotation_rad) < 1.0, seed
        assert found.accepted


def test_the_pose_maps_the_object_onto_what_was_measured(model: PoseModel) -> None:
    depth = rendered(lamp(), pose_of(3))
    frame = Frame(depth, CAMERA)
    found = estimate_pose(model, frame, (depth > 0).astype(np.int32), 1, FAST)
    assert found is not None
    points = frame.points()[depth > 0]
    back = (points - found.camera_from_object[:3, 3]) @ found.camera_from_object[:3, :3]
    low, high = lamp()[0].min(axis=0), lamp()[0].max(axis=0)
    assert ((back > low - 0.003) & (back < high + 0.003)).all()


def test_a_crop_gives_the_same_pose_as_its_frame(model: PoseModel) -> None:
    depth = rendered(lamp(), pose_of(1))
    frame = Frame(depth, CAMERA)
    whole = estimate_pose(model, frame, (depth > 0).astype(np.int32), 1, FAST)
    crop = frame.crop(depth > 0)
    part = estimate_pose(model, crop, crop.object_mask().astype(np.int32), 1, FAST)
    assert whole is not None
    assert part is not None
    assert np.allclose(whole.camera_from_object, part.camera_from_object, atol=1e-3)


def test_the_same_question_gives_the_same_answer(model: PoseModel) -> None:
    depth = rendered(lamp(), pose_of(2))
    asked = (model, Frame(depth, CAMERA), (depth > 0).astype(np.int32), 1, FAST)
    first, second = estimate_pose(*asked), estimate_pose(*asked)
    assert first is not None
    assert second is not None
    assert np.array_equal(first.camera_from_object, second.camera_from_object)


@pytest.mark.slow
def test_a_mirrored_body_fits_worse_than_the_body_itself(model: PoseModel) -> None:
    vertices, faces = lamp()
    mirror = (vertices * (1, -1, 1), faces[:, ::-1])
    lost = []
    for seed in range(3):
        confidence = []
        for body in (mirror, lamp()):
            depth = rendered(body, pose_of(seed))
            labels = (depth > 0).astype(np.int32)
            found = estimate_pose(model, Frame(depth, CAMERA), labels, 1, FAST)
            assert found is not None
            confidence.append(found.fit - found.violation)
        lost.append(confidence[1] - confidence[0])
    assert min(lost) > 0
    assert max(lost) > 0.15


def test_inner_walls_are_no_part_of_the_surface() -> None:
    hollow = joined(box((0.05, 0.04, 0.03), (0, 0, 0)), box((0.03, 0.02, 0.01), (0, 0, 0)))
    samples = build_pose_model(*hollow).samples
    away = np.abs(np.abs(samples[:, :3]) - (0.05, 0.04, 0.03)).min(axis=1)
    assert (away < 1e-4).mean() > 0.99


def test_a_part_of_the_object_that_was_cut_off_is_found_again(model: PoseModel) -> None:
    true = pose_of(5)
    depth = rendered(lamp(), true)
    labels = (depth > 0).astype(np.int32)
    rows = np.nonzero(labels)[0]
    labels[: int(np.quantile(rows, 0.45))][labels[: int(np.quantile(rows, 0.45))] > 0] = 2
    found = estimate_pose(model, Frame(depth, CAMERA), labels, 1, FAST)
    assert found is not None
    assert pose_error(model, found.camera_from_object, true).is_within()


def test_free_space_contradicts_a_model_where_the_sensor_looked_through(model: PoseModel) -> None:
    true = pose_of(0)
    depth = rendered(lamp(), true)
    behind = np.where(depth > 0, depth, 0.9).astype(np.float32)  # a wall behind
    shifted = true[:3, 3] + true[:3, :3] @ model.centre + (0.06, 0, 0)
    poses = np.stack([true[:3, 3] + true[:3, :3] @ model.centre, shifted])
    sight = check_free_space(
        *(model.samples, np.stack([true[:3, :3]] * 2), poses, behind, depth > 0),
        (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy),
        model.spacing_m,
    )
    assert sight.violation[0] < 0.05
    assert sight.violation[1] > 0.3


@pytest.mark.slow
def test_symmetries_are_those_of_the_body() -> None:
    brick = build_pose_model(*box((0.05, 0.03, 0.02), (0.1, 0.2, 0.3)), samples=2000)
    assert len(brick.symmetries) == 4
    assert len(brick.symmetric_axes) == 0
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle)], axis=1)
    side = np.concatenate(
        [np.column_stack([ring, np.full(60, z)]) for z in np.linspace(-0.05, 0.05, 40)]
    )
    normal = np.concatenate([np.column_stack([ring / 0.03, np.zeros(60)])] * 40)
    tube = build_pose_model(side, normals=normal, samples=2000)
    assert len(tube.symmetric_axes) == 1
    assert np.allclose(np.abs(tube.symmetric_axes[0]), (0, 0, 1))
    flipped = np.diag([1.0, -1.0, -1.0])
    assert angle_between(np.eye(3), flipped, tube.symmetries) < 1e-6
    assert (
        angle_between(np.eye(3), rotation_about(np.array([1.0, 0, 0]), 0.5), tube.symmetries) > 0.4
    )


def test_an_ambiguous_view_says_so_and_lists_the_other_pose() -> None:
    # The knob sits on the far end: from here, turned by half a turn, the block looks the same.
    body = joined(box((0.03, 0.02, 0.05), (0, 0, 0)), box((0.008, 0.006, 0.01), (0.02, 0, 0.058)))
    model = build_pose_model(*body)
    pose = np.eye(4)
    pose[:3, 3] = (0, 0, 0.5)
    depth = rendered(body, pose)
    found = estimate_pose(model, Frame(depth, CAMERA), (depth > 0).astype(np.int32), 1, FAST)
    assert found is not None
    assert found.ambiguous
    assert not found.accepted
    assert len(found.alternatives) > 0


def test_a_model_survives_its_bytes(model: PoseModel) -> None:
    again = PoseModel.from_bytes(model.to_bytes())
    assert np.array_equal(again.grid, model.grid)
    assert np.allclose(again.samples, model.samples)
    with pytest.raises(ValueError, match="no pose model"):
        PoseModel.from_bytes(model.to_bytes()[:200])


def test_bad_models_and_segments_are_refused(model: PoseModel) -> None:
    vertices, faces = lamp()
    with pytest.raises(ValueError, match="mesh units"):
        build_pose_model(1000 * vertices, faces)
    with pytest.raises(ValueError, match="NaN"):
        build_pose_model(np.where(vertices > 0.04, np.nan, vertices), faces)
    with pytest.raises(ValueError, match="degenerate"):
        build_pose_model(vertices, np.zeros((3, 3), np.int64))
    for wrong in ([[0, 1, len(vertices)]], [[0, 1, -1]], [[0, 1, 2, 3]]):
        with pytest.raises(ValueError, match="faces must be"):
            build_pose_model(vertices, np.array(wrong))
    with pytest.raises(ValueError, match="normals hold NaN"):
        build_pose_model(vertices, normals=np.full_like(vertices, np.nan))
    with pytest.raises(ValueError, match="samples"):
        build_pose_model(vertices, faces, samples=0)
    depth = rendered(lamp(), pose_of(0))
    nothing = np.zeros(depth.shape, np.int32)
    assert estimate_pose(model, Frame(depth, CAMERA), nothing, 1, FAST) is None
    holes = Frame(np.full(depth.shape, np.nan, np.float32), CAMERA)
    assert estimate_pose(model, holes, nothing + 1, 1, FAST) is None
    with pytest.raises(ValueError, match="differ in shape"):
        estimate_pose(model, Frame(depth, CAMERA), nothing[:5], 1, FAST)


@pytest.mark.slow
def test_a_time_limit_ends_the_search_and_is_reported(model: PoseModel) -> None:
    depth = rendered(lamp(), pose_of(5))
    labels = (depth > 0).astype(np.int32)
    columns = np.nonzero(labels)[1]
    labels[:, : int(np.median(columns))] *= 2
    hurried = replace(FAST, time_limit_s=0.0, enough_fit=2.0)
    found = estimate_pose(model, Frame(depth, CAMERA), labels, 1, hurried)
    assert found is not None
    assert not found.is_complete


@pytest.mark.slow
def test_the_grid_knows_the_nearest_sample(model) -> None:
    places, cell = model.samples[:, :3], model.cell_m
    cells = np.argwhere(model.grid >= 0)
    centres = model.corner + (cells + 0.5) * cell
    exact, _ = cKDTree(places).query(centres)
    away = np.linalg.norm(centres - places[model.grid.ravel()], axis=1)
    near = exact < 2 * cell
    np.testing.assert_allclose(away[near], exact[near], atol=1e-6)
    assert (away - exact).max() < 0.5 * cell


def test_noise_does_not_break_a_symmetry_that_it_may_break() -> None:
    vertices, faces = box((0.03, 0.0284, 0.03), (0.0, 0.0, 0.0))  # a cube, but for 1.6 mm a side
    assert len(build_pose_model(vertices, faces).symmetries) == 8
    assert len(build_pose_model(vertices, faces, noise_m=0.0007).symmetries) == 24
