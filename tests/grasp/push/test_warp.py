"""Correlated deviations: a smooth warp of the plane keeps outlines whole."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.push import plan_push_grasps
from grasp.push.perturb import Tolerance, normals, perturbed, valid_outlines


def _flange(vertices: int = 36) -> np.ndarray:
    angle = 2 * np.pi * np.arange(vertices) / vertices
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _gear(teeth: int = 24) -> np.ndarray:
    angle = 2 * np.pi * np.arange(4 * teeth) / (4 * teeth)
    radius = np.where(np.arange(4 * teeth) % 4 < 2, 1.0, 0.9)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _moved(ring: np.ndarray, tolerance: Tolerance, count: int = 400) -> tuple[np.ndarray, ...]:
    return perturbed(ring, np.zeros(2), tolerance, normals(7, 0, count, len(ring) + 3))


@pytest.mark.parametrize("length", [0.2, 0.5])
@pytest.mark.parametrize("ring", [_flange(), _gear()], ids=["flange", "gear"])
def test_hardly_any_warped_outline_crosses_itself(ring: np.ndarray, length: float) -> None:
    # A warp folds where its slope, of deviation .045 / length, falls below -1: beyond 4.4
    # deviations, which not every draw avoids. Which do depends on the signs of eigenvectors.
    vx, vy, _ = _moved(ring, Tolerance(0.045, correlation=length))
    assert valid_outlines(vx, vy).mean() >= 0.99
    vx, vy, _ = _moved(ring, Tolerance(0.045))
    assert not valid_outlines(vx, vy).all()


@pytest.mark.parametrize(
    ("count", "std_within", "correlation_within"),
    [
        # A correlation of n draws has a standard error below 1 / sqrt(n), a deviation one of
        # 1 / sqrt(2 n); the largest of some 700 stays within five of them.
        (2_000, 0.08, 0.12),
        pytest.param(20_000, 0.03, 0.04, marks=pytest.mark.deep),
    ],
)
def test_near_vertices_move_together_and_far_ones_on_their_own(
    count: int, std_within: float, correlation_within: float
) -> None:
    ring, length, std = _flange(), 0.4, 0.05
    vx, _, com = _moved(ring, Tolerance(std, correlation=length), count)
    off = np.column_stack([vx - ring[:, 0], com[:, 0]])
    points = np.vstack([ring, [0, 0]])
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    expected = np.exp(-(apart**2) / (2 * length**2))
    assert np.allclose(off.std(axis=0), std, rtol=std_within)
    assert np.allclose(np.corrcoef(off.T), expected, atol=correlation_within)


def test_the_warp_of_a_trial_does_not_depend_on_its_shard() -> None:
    ring, tolerance = _gear(), Tolerance(0.02, 0.01, correlation=0.3)
    whole = _moved(ring, tolerance, 20)
    part = perturbed(ring, np.zeros(2), tolerance, normals(7, 15, 5, len(ring) + 3))
    for one, same in zip(part, whole, strict=True):
        assert np.allclose(one, same[15:], atol=1e-12)


def test_without_correlation_each_vertex_deviates_by_its_own_draw() -> None:
    ring = _flange()
    draws = normals(7, 0, 3, len(ring) + 3)
    vx, vy, com = perturbed(ring, np.zeros(2), Tolerance(0.05, 0.1), draws)
    assert np.array_equal(vx, ring[:, 0] + draws[:, :36, 0] * 0.05)
    assert np.array_equal(vy, ring[:, 1] + draws[:, :36, 1] * 0.05)
    assert np.array_equal(com, draws[:, 36] * 0.1)


def test_rounded_corners_are_planned_on_again() -> None:
    corners = [(-0.8, -0.5), (0.8, -0.5), (0.8, 0.5), (-0.8, 0.5)]
    arc = [np.array(c) * (1 - 0.2 / np.abs(c)) + 0.2 * np.array([np.cos(t), np.sin(t)])
           for c, start in zip(corners, (np.pi, 1.5 * np.pi, 0, np.pi / 2), strict=True)
           for t in start + np.linspace(0, np.pi / 2, 9)]  # fmt: skip
    plate = np.array(arc)
    asked = {"jaw_width": 0.3, "vertex_std": 0.042, "com_std": 0.028, "density": 3.0}
    alone = plan_push_grasps(plate, **asked)
    warped = plan_push_grasps(plate, correlation=0.2, **asked)
    assert alone.quality < 0.5
    assert warped.quality >= 0.9


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"vertex_std": 0.1, "correlation": 0.2}, "folds"),
        ({"vertex_std": 0.1, "correlation": 0.0}, "positive"),
        ({"vertex_std": [0.1, 0.2, 0.1, 0.1], "correlation": 1.0}, "one vertex_std"),
        ({"vertex_std": 0.1, "correlation": 1.0, "weighting": "density"}, "plainly"),
    ],
)
def test_warps_that_make_no_sense_are_refused(wrong: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        plan_push_grasps([(0, 0), (2, 0), (2, 1), (0, 1)], jaw_width=0.5, **wrong)
