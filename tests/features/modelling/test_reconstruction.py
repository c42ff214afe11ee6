"""Closed surfaces from views that leave sides unseen."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from features.codec import Cloud, decode
from features.modelling import ObjectModel, Reconstruction, mesh_to_ply, reconstruct
from tests.features.modelling.test_grow import AROUND, HALF, distance_to_body, view_from

pytestmark = pytest.mark.slow


def standing(views: list[tuple[float, float]]) -> ObjectModel:
    """Return the model of the body that stands on z = 0."""
    model = ObjectModel()
    for azimuth, elevation in views:
        frame, pose = view_from(azimuth, elevation)
        lifted = pose.copy()
        lifted[2, 3] += HALF[2]
        model, found = model.add(frame, object_from_camera=lifted, is_measured=True)
        assert found is not None
    return model


@pytest.fixture(scope="module")
def model() -> ObjectModel:
    return standing([(float(a), float(e)) for a, e in AROUND])


@pytest.fixture(scope="module")
def made(model: ObjectModel) -> Reconstruction:
    return reconstruct(model)


def depth_in(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return distance_to_body(points - (0, 0, HALF[2]))


def test_the_surface_is_closed_and_on_the_body_also_below_where_nothing_was_seen(
    made: Reconstruction,
) -> None:
    assert made.is_watertight
    assert made.vertices[:, 2].min() >= 0
    # Exact depth, cells of 3 mm: half a millimetre where it was seen.
    assert np.median(np.abs(depth_in(made.vertices[made.seen]))) < 0.0005
    bottom = made.vertices[:, 2] < 0.001
    assert bottom.sum() > 50
    assert np.quantile(np.abs(depth_in(made.vertices[bottom])), 0.9) < 0.004


def test_what_was_filled_in_is_not_said_to_be_seen(made: Reconstruction) -> None:
    a, b, c = made.vertices[made.faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    areas = np.linalg.norm(normals, axis=1) / 2
    under = normals[:, 2] / (2 * np.maximum(areas, 1e-15)) < -0.9
    below = under & (made.vertices[made.faces][:, :, 2] < 0.001).all(axis=1)
    assert not made.seen[made.faces[below]].all(axis=1).any()
    expected = 1 - areas[below].sum() / areas.sum()
    # A rim of a cell or two about the bottom is neither.
    assert expected - 0.15 < made.seen_share <= expected


def test_one_view_shows_less_than_many(made: Reconstruction) -> None:
    one = reconstruct(standing([(30.0, 35.0)]))
    assert one.seen_share < made.seen_share - 0.1
    hidden = np.abs(depth_in(one.vertices[~one.seen]))
    assert np.quantile(hidden, 0.9) > np.quantile(np.abs(depth_in(one.vertices[one.seen])), 0.9)


def test_the_same_model_gives_the_same_surface(model: ObjectModel, made: Reconstruction) -> None:
    again = reconstruct(model)
    assert np.array_equal(again.vertices, made.vertices)
    assert np.array_equal(again.faces, made.faces)


def test_residuals_tell_a_noisy_model_from_an_exact_one(made: Reconstruction) -> None:
    assert 0 <= made.median_residual_m < made.residual_90_m < 0.002


def test_a_stray_cluster_off_the_object_does_not_draw_the_surface_to_it(
    model: ObjectModel, made: Reconstruction
) -> None:
    stray = np.tile(model.cloud[:40], (1, 1))
    stray[:, :3] += 0.2
    wider = ObjectModel(
        np.vstack([model.cloud, stray]),
        np.vstack([model.colours, model.colours[:40]]),
        np.concatenate([model.weights, model.weights[:40]]),
        sources=model.sources,
    )
    extent = np.ptp(reconstruct(wider).vertices, axis=0)
    assert np.abs(extent - np.ptp(made.vertices, axis=0)).max() < 0.004


def test_too_few_points_are_refused() -> None:
    with pytest.raises(ValueError, match="needs 60"):
        reconstruct(ObjectModel())


def test_a_ply_says_of_each_vertex_whether_it_was_seen(made: Reconstruction) -> None:
    data = mesh_to_ply(made.vertices, made.faces, made.colours, made.seen)
    assert b"property uchar seen\n" in data
    read = decode(data)
    assert isinstance(read, Cloud)
    assert len(read) == len(made.vertices)
