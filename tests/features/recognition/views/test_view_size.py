"""Views of objects that fill large photographs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from features.geometry import Intrinsics
from features.recognition import ViewFeatures, describe_view
from features.recognition.views import view as view_module


def _photograph(height: int, width: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return a print of blobs and the mask of the object in the middle of it."""
    seeds = np.random.default_rng(4).integers(0, 255, (30, 40, 3), dtype=np.uint8)
    image = np.asarray(cv2.resize(seeds, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)
    mask = np.zeros((height, width), bool)
    mask[height // 10 : -height // 10, width // 8 : -width // 8] = True
    return image, mask


def _described(depth_m: float | None = None) -> tuple[ViewFeatures, ViewFeatures]:
    """Return views of one object at 1,199 x 1,601 and at three times as many pixels a side."""
    views = []
    for scale in (1, 3):
        image, mask = _photograph(1199 * scale, 1601 * scale)
        camera = Intrinsics.from_fov(image.shape[1], image.shape[0], 1.0)
        depth = None if depth_m is None else np.full(mask.shape, depth_m, np.float32)
        views.append(describe_view(image, mask, depth, camera))
    return views[0], views[1]


@pytest.mark.slow
def test_a_large_photograph_is_described_as_a_small_one_in_its_own_pixels() -> None:
    small, large = _described()
    assert len(large.keypoints) > 300
    # Places of the same blobs: half of the keypoints lie within 1.5 px of one at the small scale.
    places = (large.keypoints[:, :2] + 0.5) / 3 - 0.5
    gaps = np.linalg.norm(places[:, None] - small.keypoints[None, :, :2], axis=2).min(axis=1)
    assert np.median(gaps) < 1.5
    assert np.allclose(large.mask_px, 3 * small.mask_px, atol=6)
    assert float(large.colour @ small.colour) > 0.99
    assert float(large.hog @ small.hog) > 0.97
    assert small.contour is not None
    assert large.contour is not None
    ends = np.ptp(large.contour.control_points, axis=0) / np.ptp(
        small.contour.control_points, axis=0
    )
    assert np.allclose(ends, 3, rtol=0.01)


@pytest.mark.slow
def test_the_size_of_an_object_does_not_depend_on_the_resolution() -> None:
    small, large = _described(depth_m=0.8)
    assert abs(large.size_m / small.size_m - 1) < 0.01
    assert small.surface is not None
    assert large.surface is not None
    left, top, _, height = large.mask_px
    assert np.allclose(large.surface.box[[0, 1, 3]], [left, top, top + height], atol=6)
    assert np.allclose(large.surface.coefficients, 0.8, atol=1e-3)
    middle = np.nanmedian(large.points3d, axis=0)
    assert abs(middle[2] - 0.8) < 1e-6
    # The object is in the middle of the image, and so are most keypoints.
    assert np.all(np.abs(middle[:2]) < 0.1)


def test_keypoints_are_never_sought_on_more_than_the_largest_side(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    seen = []
    sought = view_module.detect_keypoints

    def spy(grey, mask, params):  # type: ignore[no-untyped-def]
        seen.append(cv2.boundingRect(mask.astype(np.uint8))[2:])
        return sought(grey, mask, params)

    monkeypatch.setattr(view_module, "detect_keypoints", spy)
    image, mask = _photograph(3880, 5184)
    large = describe_view(image, mask)
    (size,) = seen
    assert 640 <= max(size) <= view_module.MAX_SIDE_PX
    assert not large.is_cut
    assert large.keypoints[:, 0].max() > 3000


def test_an_object_at_the_edge_of_a_large_photograph_is_cut() -> None:
    image, mask = _photograph(1500, 2001)
    mask[700, -1] = True
    assert describe_view(image, mask).is_cut
    thin = np.zeros_like(mask)
    thin[700, 10:1990] = True
    assert describe_view(image, thin).mask_px.tolist() == [10, 700, 1980, 1]
