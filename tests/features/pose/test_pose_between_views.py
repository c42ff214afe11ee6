"""Poses from one stored view, poses known beforehand, and the check of principal axes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from features.geometry import Frame, Intrinsics
from features.pose import (
    PoseConfidence,
    PoseModel,
    PoseParams,
    axis_check,
    build_pose_model,
    estimate_pose,
    estimate_pose_from_views,
)
from features.pose.rotations import angle_between, rotation_about

CAMERA = Intrinsics(160, 120, 240.0, 240.0, 79.5, 59.5)
BRICK = np.array([0.06, 0.025, 0.02])
KNOB = np.array([0.018, 0.012, 0.03])
KNOB_AT = np.array([0.035, 0.0, 0.03])


def body() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a brick with a knob near one end: no turn leaves it as it is."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    return np.concatenate([signs * BRICK, signs * KNOB + KNOB_AT]), np.concatenate(
        [faces, faces + 8]
    )


def seen_at(pose: NDArray[np.float64]) -> Frame:
    """Return exact depth of the body at a pose ``camera_from_object``."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = np.stack(
        [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1
    ).reshape(-1, 3)
    ways, start = rays @ pose[:3, :3], -pose[:3, :3].T @ pose[:3, 3]
    depth = np.full(len(rays), np.inf)
    for half, at in ((BRICK, np.zeros(3)), (KNOB, KNOB_AT)):
        with np.errstate(divide="ignore"):
            first, second = (at - half - start) / ways, (at + half - start) / ways
        near, far = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
        depth = np.where((near < far) & (near > 0), np.minimum(near, depth), depth)
    shown = np.where(np.isfinite(depth), depth, 0).reshape(u.shape).astype(np.float32)
    return Frame(shown, CAMERA)


def pose_of(azimuth_deg: float, elevation_deg: float = 50.0) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = rotation_about(
        np.array([1.0, 0, 0]), np.deg2rad(-90 - elevation_deg)
    ) @ rotation_about(np.array([0, 0, 1.0]), np.deg2rad(azimuth_deg))
    pose[:3, 3] = (0.004, -0.003, 0.45)
    return pose


@pytest.fixture(scope="module")
def model() -> PoseModel:
    return build_pose_model(*body())


def shaken(movement: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what matched keypoints might give: 4 mm and 3 degrees off."""
    off = np.eye(4)
    off[:3, :3] = rotation_about(np.array([0.6, 0.0, 0.8]), np.deg2rad(3))
    off[:3, 3] = (0.002, -0.003, 0.002)
    return off @ movement


def test_two_views_are_laid_on_each_other() -> None:
    first, second = pose_of(20), pose_of(45)
    true = second @ np.linalg.inv(first)
    found = estimate_pose_from_views(seen_at(first), seen_at(second), shaken(true))
    assert found is not None
    # The middle of the object is where it should be; the clouds are 2 mm apart point from point.
    middle = first[:3, 3]
    moved, wanted = (m[:3, :3] @ middle + m[:3, 3] for m in (found.camera_from_object, true))
    assert np.linalg.norm(moved - wanted) < 0.0015
    assert np.rad2deg(angle_between(found.camera_from_object[:3, :3], true[:3, :3])) < 1.0
    assert found.accepted
    assert found.confidence <= PoseConfidence().max_from_view


def test_a_wrong_movement_between_views_is_not_accepted() -> None:
    first, second = pose_of(20), pose_of(45)
    turned = second @ np.linalg.inv(pose_of(200))  # end for end
    found = estimate_pose_from_views(seen_at(first), seen_at(second), turned)
    assert found is not None
    assert not found.accepted


def test_a_view_without_depth_gives_no_pose() -> None:
    blank = Frame(np.zeros((120, 160), np.float32), CAMERA)
    assert estimate_pose_from_views(seen_at(pose_of(0)), blank, np.eye(4)) is None
    assert estimate_pose_from_views(blank, seen_at(pose_of(0)), np.eye(4)) is None


def test_a_pose_known_beforehand_needs_no_search(model: PoseModel) -> None:
    true = pose_of(30)
    frame = seen_at(true)
    labels = (frame.depth_m > 0).astype(np.int32)
    none = PoseParams(starts=1, more_starts=1, merge=False)  # a search of one start finds nothing
    found = estimate_pose(model, frame, labels, 1, none, initial=shaken(true)[None])
    assert found is not None
    assert found.accepted
    assert np.linalg.norm(found.camera_from_object[:3, 3] - true[:3, 3]) < 0.002


def test_a_wrong_pose_beforehand_does_not_stop_the_search(model: PoseModel) -> None:
    true = pose_of(30)
    frame = seen_at(true)
    labels = (frame.depth_m > 0).astype(np.int32)
    away = pose_of(30)
    away[:3, 3] += (0.1, 0.0, 0.1)
    found = estimate_pose(model, frame, labels, 1, PoseParams(starts=96), initial=away[None])
    assert found is not None
    assert np.linalg.norm(found.camera_from_object[:3, 3] - true[:3, 3]) < 0.002


def test_axes_of_a_right_pose_agree_and_of_a_turned_one_do_not(model: PoseModel) -> None:
    true = pose_of(10, elevation_deg=80)
    frame = seen_at(true)
    right = axis_check(model, frame, true)
    assert right.applies
    assert right.passes
    assert right.angle_rad < 0.05
    turned = true.copy()
    turned[:3, :3] = true[:3, :3] @ rotation_about(np.array([0, 0, 1.0]), np.pi / 3)
    wrong = axis_check(model, frame, turned)
    assert wrong.applies
    assert not wrong.passes
    assert abs(wrong.angle_rad - np.pi / 3) < 0.15


def test_axes_cannot_see_half_a_turn_and_do_not_apply_to_what_looks_round(
    model: PoseModel,
) -> None:
    true = pose_of(10, elevation_deg=80)
    frame = seen_at(true)
    half = true.copy()
    half[:3, :3] = true[:3, :3] @ rotation_about(np.array([0, 0, 1.0]), np.pi)
    assert axis_check(model, frame, half).passes
    strict = axis_check(model, frame, true, min_ratio=50.0)
    assert not strict.applies
    assert strict.passes
    blank = Frame(np.zeros((120, 160), np.float32), CAMERA)
    assert not axis_check(model, blank, true).applies
