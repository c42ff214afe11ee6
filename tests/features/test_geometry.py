"""Cameras, frames and their pictures."""

from __future__ import annotations

import numpy as np
import pytest

from features.geometry import Frame, Intrinsics, look_at
from features.pictures import shade

CAMERA = Intrinsics(4, 1, 1.0, 1.0, 0.0, 0.0)


def test_depth_that_is_not_finite_is_no_part_of_an_object() -> None:
    frame = Frame(np.array([[1.0, np.inf, np.nan, 0.0]], np.float32), CAMERA)
    assert frame.object_mask().tolist() == [[True, False, False, False]]


@pytest.mark.parametrize(("height", "down"), [(1.0, -1.0), (-1.0, 1.0)])
def test_a_camera_looks_straight_down_and_up(height: float, down: float) -> None:
    pose = look_at(np.array([0.0, 0.0, height]), np.zeros(3))
    assert pose[:3, :3].tolist() == [[1, 0, 0], [0, down, 0], [0, 0, down]]


def test_a_camera_does_not_look_at_its_own_place() -> None:
    with pytest.raises(ValueError, match="own place"):
        look_at(np.ones(3), np.ones(3))


@pytest.mark.parametrize("angle", [0.0, np.pi, np.nan])
def test_a_field_of_view_is_less_than_half_a_turn(angle: float) -> None:
    with pytest.raises(ValueError, match="field of view"):
        Intrinsics.from_fov(640, 480, angle)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5)])
def test_an_image_without_slopes_is_shaded_as_where_depth_is_missing(
    shape: tuple[int, int],
) -> None:
    assert (shade(np.ones(shape), CAMERA) == 20).all()
