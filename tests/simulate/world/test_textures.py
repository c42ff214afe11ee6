"""Prints: their own look per seed, structure that a head camera at 0.3 m can use."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from simulate.world.textures import make_look, paint_panel

HEAD_CAMERA_PX_PER_M = 467.7 / 0.3  # focal length over distance


def _keypoints(panel: np.ndarray, width_m: float) -> tuple[list[cv2.KeyPoint], np.ndarray]:
    scale = width_m * HEAD_CAMERA_PX_PER_M / panel.shape[1]
    grey = cv2.cvtColor(panel, cv2.COLOR_RGB2GRAY)
    seen = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    points, descriptors = cv2.SIFT_create(contrastThreshold=0.02).detectAndCompute(seen, None)
    return list(points), descriptors


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.033, 0.075), (0.03, 0.03), (0.11, 0.02), (0.027, 0.027)])
def test_a_panel_gives_enough_keypoints_at_the_head_cameras_resolution(
    size: tuple[float, float],
) -> None:
    counts = [
        len(_keypoints(paint_panel(make_look(seed), "side", *size), size[0])[0])
        for seed in range(10)
    ]
    assert min(counts) >= 25


def test_different_products_share_few_descriptors() -> None:
    size = (0.033, 0.075)
    panels = [paint_panel(make_look(seed), "side", *size) for seed in range(6)]
    descriptors = [_keypoints(panel, size[0])[1] for panel in panels]
    matcher = cv2.BFMatcher()
    for i in range(1, 6):
        pairs = matcher.knnMatch(descriptors[0], descriptors[i], k=2)
        kept = sum(first.distance < 0.75 * second.distance for first, second in pairs)
        # Emblem frames and letters are alike; a print recognised would keep most of its points.
        assert kept < 0.1 * len(descriptors[0])


def test_the_edges_of_a_panel_fit_together() -> None:
    seams, columns = [], []
    for seed in range(12):
        panel = paint_panel(make_look(seed), "side", 0.04, 0.06).astype(float)
        seams.append(np.abs(panel[:, 0] - panel[:, -1]).mean())
        columns.append(np.abs(np.diff(panel, axis=1)).mean())
    # Words and bar codes may be cut by the seam, areas and shapes go on behind it: over some
    # looks the seam is not much rougher than any other pair of columns. Unrelated columns of
    # these panels differ by 70 to 90 levels.
    assert np.median(seams) < 2.5 * np.median(columns)


def test_same_seed_same_print_and_other_surface_other_print() -> None:
    first = paint_panel(make_look(3), "side", 0.03, 0.03)
    np.testing.assert_array_equal(first, paint_panel(make_look(3), "side", 0.03, 0.03))
    assert (first != paint_panel(make_look(3), "lid", 0.03, 0.03)).mean() > 0.2
    assert (first != paint_panel(make_look(4), "side", 0.03, 0.03)).mean() > 0.2
    same_colours = replace(make_look(3), seed=4)
    assert (first != paint_panel(same_colours, "side", 0.03, 0.03)).mean() > 0.2


def test_a_panel_without_size_is_refused() -> None:
    with pytest.raises(ValueError, match="positive size"):
        paint_panel(make_look(0), "side", 0.0, 0.1)
