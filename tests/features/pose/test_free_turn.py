"""Round things may lie at any turn; a turn that moves a part of the surface still counts."""

from __future__ import annotations

import numpy as np

from features.geometry import Frame
from features.pose import build_pose_model, estimate_pose, pose_error
from features.pose.rotations import rotation_about
from features.pose.surface import SAME_SURFACE_M, surface_distance
from tests.features.pose.test_pose import CAMERA, box, joined, rendered


def fruit() -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh of 70 to 77 mm that is round but for some millimetres."""
    turns, heights = 40, 24
    angle = np.linspace(0, 2 * np.pi, turns, endpoint=False)
    height = np.linspace(0, np.pi, heights)
    places = np.array([
        [np.sin(h) * np.cos(a), np.sin(h) * np.sin(a), -np.cos(h)] for h in height for a in angle
    ])  # fmt: skip
    faces = []
    for row in range(heights - 1):
        for k in range(turns):
            here, there = row * turns + k, row * turns + (k + 1) % turns
            faces += [(here, there, here + turns), (there, there + turns, here + turns)]
    return places * (0.035, 0.0368, 0.0385), np.array(faces)


def test_where_a_fruit_is_is_known_and_its_turn_is_said_to_be_free() -> None:
    mesh = fruit()
    model = build_pose_model(*mesh)
    assert len(model.symmetric_axes) < 2  # it is no ball, by its shape
    pose = np.eye(4)
    pose[:3, :3] = rotation_about(np.array([0.6, 0.8, 0.0]), 0.7)
    pose[:3, 3] = 0.02, -0.01, 0.6
    seen = rendered(mesh, pose)
    noisy = seen + (seen > 0) * np.random.default_rng(0).normal(0, 0.0015, seen.shape)
    frame = Frame(noisy.astype(np.float32), CAMERA)
    found = estimate_pose(model, frame, (seen > 0).astype(np.int32), 1)
    assert found is not None
    assert found.ambiguous
    assert found.is_turn_free
    assert not found.accepted  # its turn is no more known than that of a cube
    assert pose_error(model, found.camera_from_object, pose).surface_m < 0.005


def test_a_handle_on_the_other_side_is_another_surface() -> None:
    mug = joined(box((0.04, 0.04, 0.05), (0, 0, 0)), box((0.012, 0.005, 0.02), (0.052, 0, 0)))
    model = build_pose_model(*mug)
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    assert surface_distance(model, np.eye(4), half_turn) > 2 * SAME_SURFACE_M
    assert surface_distance(model, half_turn, half_turn) < 0.001
