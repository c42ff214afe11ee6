"""Rigid movement of matches in space: found among wrong ones, never mirrored."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from features.recognition.rigid import _of_triangle, fit_rigid, kabsch

SIZE_M = 0.2


def moved(seed: int, count: int, wrong: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places of a view, where a movement brings them (the last ones elsewhere), and it."""
    rng = np.random.default_rng(seed)
    view = rng.uniform(-SIZE_M / 2, SIZE_M / 2, (count, 3))
    movement = np.eye(4)
    movement[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    movement[:3, 3] = rng.normal(size=3)
    query = view @ movement[:3, :3].T + movement[:3, 3] + rng.normal(0, 0.0005, view.shape)
    query[count - wrong :] = rng.uniform(-SIZE_M, SIZE_M, (wrong, 3)) + movement[:3, 3]
    return view.astype(np.float32), query.astype(np.float32), movement


def test_half_wrong_matches_do_not_hide_the_movement() -> None:
    view, query, movement = moved(3, 30, wrong=15)
    query[0] = np.nan
    found = fit_rigid(query, view, SIZE_M)
    assert found is not None
    assert not found.inliers[0]
    assert found.inliers[1:15].all()
    # Noise of 0.5 mm on fourteen places within 10 cm: a few tenths of a mm, and of a degree.
    assert np.abs(found.query_from_view - movement).max() < 0.005
    assert found.rms_m < 0.0015


def test_a_mirror_image_agrees_on_no_movement() -> None:
    view, query, _ = moved(4, 30, wrong=0)
    found = fit_rigid(query * np.float32([-1, 1, 1]), view, SIZE_M)
    assert found is None or found.inliers.sum() < 10


def test_matches_at_one_place_say_nothing() -> None:
    view, query, _ = moved(5, 8, wrong=0)
    assert fit_rigid(query[:1].repeat(8, axis=0), view[:1].repeat(8, axis=0), SIZE_M) is None
    assert fit_rigid(query[:3], view[:3], SIZE_M) is None


def test_the_closed_form_of_a_triangle_is_the_least_squares_fit() -> None:
    rng = np.random.default_rng(6)
    for seed in range(50):
        view, query, _ = moved(seed, 3, wrong=0)
        noisy = query + rng.normal(0, 0.01, query.shape)
        rotation, shift = _of_triangle(noisy, view.astype(np.float64), (0, 1, 2))
        fitted = kabsch(noisy, view.astype(np.float64))
        # Both are exact but for rounding, which a narrow triangle multiplies.
        assert np.abs(rotation - fitted[:3, :3]).max() < 1e-8
        assert np.abs(shift - fitted[:3, 3]).max() < 1e-8
