"""What stands beside the segment decides between poses that the segment alone cannot tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from features.geometry import Frame
from features.pose import PoseModel, PoseParams, build_pose_model, estimate_pose, pose_error
from features.pose.hypotheses import halves, parted
from features.pose.rotations import rotation_about
from tests.features.pose.test_pose import CAMERA, FAST, Mesh, box, joined, rendered

FAR_TABLE = np.array([0.0, 0.0, -1.0, 1.0])
"""Behind everything: all that is measured counts as standing on it."""


def post() -> Mesh:
    """Return an upright round post of 24 sides."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rings = [np.column_stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), 0 * turn + z])
             for z in (-0.05, 0.05)]  # fmt: skip
    vertices = np.vstack([*rings, [(0, 0, -0.05), (0, 0, 0.05)]])
    faces = []
    for i in range(24):
        j = (i + 1) % 24
        faces += [(i, j, 24 + j), (i, 24 + j, 24 + i), (j, i, 48), (24 + i, 24 + j, 49)]
    return vertices, np.array(faces)


def mug() -> Mesh:
    return joined(post(), box((0.016, 0.005, 0.02), (0.045, 0, 0)))


def seen_from_the_side(turn_deg: float) -> np.ndarray:
    """Return a pose in which the axis is upright in the image, turned about that axis."""
    pose = np.eye(4)
    upright = rotation_about(np.array([1.0, 0, 0]), np.deg2rad(70.0))
    pose[:3, :3] = upright @ rotation_about(np.array([0, 0, 1.0]), np.deg2rad(turn_deg))
    pose[:3, 3] = (0, 0, 0.5)
    return pose


@pytest.fixture(scope="module")
def model() -> PoseModel:
    return build_pose_model(*mug())


def without_handle(true: np.ndarray) -> tuple[Frame, np.ndarray]:
    """Return a view of the mug, and labels (h, w) in which the handle belongs to nothing."""
    depth = rendered(mug(), true)
    body = rendered(post(), true)
    return Frame(depth, CAMERA), ((body > 0) & (np.abs(depth - body) < 1e-4)).astype(np.int32)


@pytest.mark.slow
def test_a_handle_that_the_segmenter_left_out_decides_the_turn(model: PoseModel) -> None:
    for turn in (0.0, 160.0):
        true = seen_from_the_side(turn)
        frame, labels = without_handle(true)
        found = estimate_pose(model, frame, labels, 1, FAST, FAR_TABLE)
        assert found is not None
        assert pose_error(model, found.camera_from_object, true).is_within(), turn
        assert found.accepted, turn


def test_a_matched_pose_is_laid_on_the_handle_as_well(model: PoseModel) -> None:
    true = seen_from_the_side(20.0)
    frame, labels = without_handle(true)
    about = np.eye(4)
    about[:3, :3] = rotation_about(np.array([0, 0, 1.0]), np.deg2rad(8.0))
    told = (true @ about)[None]
    found = estimate_pose(model, frame, labels, 1, FAST, FAR_TABLE, told, is_matched=True)
    assert found is not None
    assert np.rad2deg(pose_error(model, found.camera_from_object, true).rotation_rad) < 4.0


def test_one_object_on_both_sides_of_what_stands_before_it_is_taken_together() -> None:
    bar = box((0.08, 0.02, 0.015), (0, 0, 0))
    model = build_pose_model(*bar)
    true = np.eye(4)
    true[:3, :3] = rotation_about(np.array([1.0, 0.3, 0]), 0.5)
    true[:3, 3] = (0, 0, 0.5)
    depth = rendered(bar, true)
    column = np.broadcast_to(np.arange(depth.shape[1]), depth.shape)
    post_before = (column > 125) & (column < 150)
    left, right = (column <= 125) & (depth > 0), (column >= 150) & (depth > 0)
    depth = np.where(post_before, 0.3, depth).astype(np.float32)
    labels = (left + 2 * post_before + 3 * right).astype(np.int32)
    frame = Frame(depth, CAMERA)
    guesses = parted(frame.points(), labels, 1, model.diameter_m)
    assert [guess.labels for guess in guesses] == [(1, 3)]
    found = estimate_pose(model, frame, labels, 3, replace(FAST, enough_fit=2.0), FAR_TABLE)
    assert found is not None
    assert pose_error(model, found.camera_from_object, true).is_within()


@pytest.mark.parametrize("across_m", [0.03, 0.06])
def test_one_of_two_objects_in_one_segment_is_found_in_a_half_of_it(across_m: float) -> None:
    hook = joined(
        box((0.05, 0.015, 0.015), (0, 0, 0)), box((0.015, 0.015, 0.03), (0.035, 0, 0.015))
    )
    model = build_pose_model(*hook)
    true = np.eye(4)
    axis = np.array([1.0, 0.4, 0.2])
    true[:3, :3] = rotation_about(axis / np.linalg.norm(axis), 0.9)
    true[:3, 3] = (-0.05, 0, 0.5)
    other = seen_from_the_side(0.0)
    other[:3, 3] = (across_m, 0, 0.5)
    places, faces = post()
    mine, beside = rendered(hook, true), rendered((0.8 * places, faces), other)
    depth = np.where((mine > 0) & ((beside == 0) | (mine < beside)), mine, beside)
    labels = (depth > 0).astype(np.int32)
    frame = Frame(depth.astype(np.float32), CAMERA)
    parts = halves(frame.points(), labels, 1)
    assert len(parts) == 4
    assert all(abs(2 * int(part.mask.sum()) - int(labels.sum())) < 3 for part in parts)
    whole = estimate_pose(model, frame, labels, 1, PoseParams(enough_fit=0.0), FAR_TABLE)
    found = estimate_pose(model, frame, labels, 1, PoseParams(), FAR_TABLE)
    assert whole is not None
    assert found is not None
    assert not pose_error(model, whole.camera_from_object, true).is_within()
    assert pose_error(model, found.camera_from_object, true).is_within()
    # Half of the segment is not explained: nobody should be sure of it.
    assert not found.accepted


def test_what_passes_as_a_symmetry_is_laid_on_the_points_again() -> None:
    places, _ = block = box((0.04, 0.03, 0.015), (0, 0, 0))
    ends = np.array([(220, 30, 30), (30, 30, 220)], np.uint8)
    grid = np.stack(np.meshgrid(*(np.linspace(a, b, 25) for a, b in
                                  zip(places.min(axis=0), places.max(axis=0), strict=True))),
                    -1).reshape(-1, 3)  # fmt: skip
    model = build_pose_model(*block, colours=(grid, ends[(grid[:, 0] > 0).astype(int)]))
    loose = rotation_about(np.array([0, 0, 1.0]), np.deg2rad(172.0))
    model = replace(model, symmetries=np.stack([np.eye(3), loose]))
    true = np.eye(4)
    true[:3, 3] = (0, 0, 0.4)
    for turn in (0.0, 180.0):
        true[:3, :3] = rotation_about(np.array([0.3, 1.0, 0]), 0.4) @ rotation_about(
            np.array([0, 0, 1.0]), np.deg2rad(turn)
        )
        depth = rendered(block, true)
        frame = Frame(depth, CAMERA)
        across = ((frame.points() - true[:3, 3]) @ true[:3, :3])[..., 0]
        rgb = ends[(np.nan_to_num(across) > 0).astype(int)]
        found = estimate_pose(
            model, Frame(depth, CAMERA, rgb), (depth > 0).astype(np.int32), 1, FAST
        )
        assert found is not None
        off = true[:3, :3].T @ found.camera_from_object[:3, :3]
        # About its length a half turn changes nothing that is seen.
        assert off[0, 0] > np.cos(np.deg2rad(4.0)), turn
