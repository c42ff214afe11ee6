"""Visual features that the graph keeps one by one."""

from __future__ import annotations

import io

import numpy as np
import pytest

from features.geometry import Frame
from features.recognition.views.stored import stored_features


@pytest.mark.usefixtures("compiled_kernels")
def test_a_view_with_depth_leaves_all_four_sorts(photo) -> None:
    from features.geometry import Intrinsics

    shot = photo(3, seed=5)
    camera = Intrinsics(200, 200, 467.7, 467.7, 99.5, 99.5)
    frame = Frame(shot.depth, camera, shot.image, shot.mask)
    found = {feature.kind: feature for feature in stored_features(shot.describe(), frame)}
    assert set(found) == {"HOGDescriptor", "FPFHFeatureSet", "BSplineContour", "BSplineSurface"}
    fpfh = np.load(io.BytesIO(found["FPFHFeatureSet"].data))
    assert fpfh["fpfh"].shape == (found["FPFHFeatureSet"].numbers["descriptorCount"], 33)
    assert np.allclose(fpfh["fpfh"].sum(axis=1), 1, atol=1e-3)
    # A flat card: voxels lie on it within the noise of depth.
    places = fpfh["places_m"] - fpfh["places_m"].mean(axis=0)
    assert np.linalg.svd(places, compute_uv=False)[-1] / np.sqrt(len(places)) < 0.002
    assert found["BSplineContour"].numbers["controlPointCount"] == 32


def test_without_depth_there_is_no_geometry(photo) -> None:
    shot = photo(3, seed=5)
    kinds = {feature.kind for feature in stored_features(shot.describe())}
    assert "FPFHFeatureSet" not in kinds
    assert "HOGDescriptor" in kinds
