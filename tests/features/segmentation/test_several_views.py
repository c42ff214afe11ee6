"""Several views of one table are cut as one."""

from __future__ import annotations

import numpy as np
import pytest

from features.segmentation import PlacedView, segment_scene, segment_views
from features.segmentation.voxels import build_voxels, facing
from tests.features.segmentation.test_segmentation import TILT, _scene

TALL = ("box", 0.0, 0.0, 0.06, 0.02, 0.20)
HIDDEN = ("box", 0.0, 0.075, 0.02, 0.02, 0.04)


def table_from_camera() -> np.ndarray:
    s, c = np.sin(TILT), np.cos(TILT)
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, -s, c], [0, -c, -s]]
    pose[:3, 3] = -pose[:3, :3] @ [0, 0, 0.7]
    return pose


def opposite(*things: tuple) -> PlacedView:
    """Return the view of a camera on the other side: the table turned by half a turn before it."""
    turned = [(kind, -x, -y, *size) for kind, x, y, *size in things]
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    return PlacedView(_scene(*turned).astype(np.float32), half @ table_from_camera())


def front(*things: tuple) -> PlacedView:
    return PlacedView(_scene(*things).astype(np.float32), table_from_camera())


def test_what_one_camera_cannot_see_is_found_and_has_one_number_in_all_views() -> None:
    views = [front(TALL, HIDDEN), opposite(TALL, HIDDEN)]
    assert len(segment_scene(views[0].points).objects) == 1
    together = segment_views(views)
    assert together.table_height == pytest.approx(0.0, abs=0.002)
    tall, small = together.objects
    assert together.seen_by(tall.label) == (0, 1)
    assert 1 in together.seen_by(small.label)
    # Both long sides of the tall box, though no camera sees more than one.
    assert tall.box[:, 1] == pytest.approx([-0.02, 0.02], abs=0.004)
    assert tall.box[:, 2] == pytest.approx([0.0, 0.20], abs=0.006)
    assert small.centroid[:2] == pytest.approx([0.0, 0.075], abs=0.01)
    points = together.points[small.indices]
    assert np.allclose(points.mean(axis=0), small.centroid, atol=1e-3)


def test_views_may_come_in_any_order() -> None:
    views = [front(TALL, HIDDEN), opposite(TALL, HIDDEN)]
    one, other = segment_views(views), segment_views(views[::-1])
    assert [each.centroid for each in one.objects] == [
        pytest.approx(each.centroid, abs=0.002) for each in other.objects
    ]


def test_normals_face_the_camera_that_saw_their_points() -> None:
    rng = np.random.default_rng(2)
    wall = np.column_stack([np.full(4_000, 1.0), rng.uniform(-0.1, 0.1, (4_000, 2))])
    voxels = build_voxels(wall, None, 0.01)
    has = np.abs(voxels.normals).any(axis=1)
    assert (voxels.normals[has, 0] < 0).all()  # towards the origin
    behind = facing(voxels, np.broadcast_to([2.0, 0.0, 0.0], wall.shape))
    assert (behind.normals[has, 0] > 0).all()


def test_no_view_is_refused_and_an_empty_one_shows_nothing() -> None:
    with pytest.raises(ValueError, match="at least one view"):
        segment_views([])
    nothing = segment_views([PlacedView(np.full((5, 5, 3), np.nan, np.float32), np.eye(4))])
    assert (nothing.status, nothing.objects) == ("empty", ())
    assert np.isnan(nothing.table_height)
