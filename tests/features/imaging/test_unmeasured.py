"""What cameras write where they measured nothing, and numbers in another unit, are no surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from features.depth import depth_of_metres, depth_of_steps
from features.geometry import points_from_depth
from features.imaging.doubts import (
    doubtful_distortion,
    doubtful_inverse,
    doubtful_rays,
    doubtful_steps,
    implausible_depth,
)
from features.imaging.pictures import depth_of_message
from tests.features.imaging.table_seen import CAMERA, depth_of_table, rays

HOLES = (slice(20, 50), slice(30, 60))


def with_holes(value: float) -> np.ndarray:
    """Return the depth of a table, m, with holes of one number."""
    depth = depth_of_table()
    depth[HOLES] = value
    return depth


@pytest.mark.parametrize("mark", [0, 4_095, 8_191, 10_000, 16_383, 32_767, 65_534, 65_535])
def test_a_number_that_stands_for_nothing_is_no_wall(mark: int) -> None:
    steps = np.rint(with_holes(0) * 1000).astype(np.uint16)
    steps[HOLES] = mark
    said: list[str] = []
    depth = depth_of_steps(steps, say=said.append)
    assert not depth[HOLES].any()
    assert np.count_nonzero(depth) == np.count_nonzero(with_holes(0))
    assert [f"exactly {mark / 1000:.4g} m" in one for one in said] == [True] * (
        mark not in (0, 65_535)
    )


def test_marks_of_a_finer_unit_are_none_either() -> None:
    steps = np.rint(depth_of_table() * 10_000).astype(np.uint16)
    steps[HOLES] = 65_534
    assert not depth_of_steps(steps, 0.0001)[HOLES].any()


@pytest.mark.parametrize("mark", [-1.0, np.nan, np.inf, -np.inf, 3.4028235e38, 1e6, 10.0, 65.535])
def test_marks_of_metres_are_no_wall(mark: float) -> None:
    depth = depth_of_metres(with_holes(mark).astype(np.float32))
    assert not depth[HOLES].any()
    assert np.count_nonzero(depth) == np.count_nonzero(with_holes(0))


def test_two_marks_in_one_image_are_both_found() -> None:
    depth = with_holes(10.0)
    depth[60:80, 10:40] = 65.535
    assert depth_of_metres(depth).max() < 2


@pytest.mark.parametrize("at_mm", [4_095, 10_000])
def test_a_wall_at_a_mark_is_kept_where_others_lie_near_it(at_mm: int) -> None:
    noise = np.random.default_rng(1).normal(0, 30, (120, 160))
    steps = np.rint(at_mm + noise).astype(np.uint16)
    steps[:40] = 700
    steps[40:45] = at_mm  # much of the image has that number, as its neighbours do
    assert np.array_equal(depth_of_steps(steps) > 0, steps > 0)
    assert (depth_of_metres(steps / 1000)[40:45] > 0).all()


def test_a_single_number_of_the_largest_signed_is_not_measured() -> None:
    pixels = np.array([[700, 32_767], [-5, 700]], "<i2")
    message = {"height": 2, "width": 2, "encoding": "16SC1", "step": 0, "data": pixels.tobytes()}
    read = depth_of_message(message, is_depth_topic=True)
    assert read.tolist() == pytest.approx(np.array([[0.7, 0], [0, 0.7]]))


def test_a_number_that_noise_does_not_explain_is_doubted_at_any_depth() -> None:
    assert "is exactly 2.047 m" in implausible_depth(with_holes(2.047).astype(np.float32))
    assert not implausible_depth(depth_of_table().astype(np.float32))
    # Without noise a wall is of one number, too: nobody is alarmed by a picture of a simulator.
    clean = depth_of_table(noise_m=0)
    clean[HOLES] = 2.047
    assert not implausible_depth(clean.astype(np.float32))


@pytest.mark.parametrize("by", [5, 8, 10])
def test_steps_that_are_all_multiples_of_one_number_are_doubted(by: int) -> None:
    steps = np.rint(depth_of_table() * 1000).astype(np.uint16) * np.uint16(by)
    assert f", {0.001 / by:.4g} m?" in doubtful_steps(steps)
    assert not doubtful_steps(steps // by)


@pytest.mark.parametrize("bits", [2, 3, 4])
def test_an_index_in_the_lowest_bits_is_told_from_noise(bits: int) -> None:
    steps = np.rint(depth_of_table() * 1000).astype(np.uint16)
    shifted = steps << np.uint16(bits)
    shifted[:, 40:80] |= np.uint16(2)  # a person is there
    shifted[60:, 80:] |= np.uint16(1)
    assert f"{0.001 / 2**bits:.4g} m" in doubtful_steps(np.where(steps > 0, shifted, 0))
    assert not doubtful_steps(steps)


def test_one_number_in_two_of_a_hundred_pixels_of_a_small_image_is_doubted() -> None:
    depth = depth_of_table()[20:68, 40:104]
    depth[np.random.default_rng(1).random(depth.shape) < 0.02] = 1.5
    assert "2% of the depth is exactly 1.5 m" in implausible_depth(depth.astype(np.float32))


@pytest.mark.parametrize("scale", [10.5, 1.0], ids=["disparity", "inverse depth"])
def test_numbers_that_are_linear_over_a_plane_are_told_from_depth(scale: float) -> None:
    depth = depth_of_table().astype(np.float32)
    assert not doubtful_inverse(depth)
    numbers = np.where(depth > 0, scale / np.maximum(depth, 0.1), 0)
    assert "disparity" in doubtful_inverse(numbers.astype(np.float32))
    assert not doubtful_inverse(np.zeros_like(depth))
    assert not doubtful_inverse(np.full_like(depth, 0.7))


def test_numbers_below_zero_are_not_left_out_without_a_word() -> None:
    said: list[str] = []
    assert not depth_of_metres(-depth_of_table(), said.append).any()
    assert not depth_of_steps(
        np.rint(-1000 * depth_of_table()).astype(np.int16), say=said.append
    ).any()
    assert ["is z backward?" in one for one in said] == [True, True]
    # One number is a code, as some cameras write it.
    said.clear()
    depth_of_metres(np.where(np.arange(100).reshape(10, 10) < 70, -1.0, 0.7), said.append)
    assert not said


def test_a_distortion_that_loses_most_of_the_view_is_doubted() -> None:
    depth = depth_of_table().astype(np.float32)
    assert not doubtful_distortion(depth, depth)
    assert not doubtful_distortion(np.zeros_like(depth), depth)
    assert "are D and K its own?" in doubtful_distortion(depth, np.where(depth > 0.9, depth, 0))


def test_distance_along_the_rays_is_told_from_depth_by_the_table_that_it_bends() -> None:
    depth = depth_of_table().astype(np.float32)
    along_rays = (depth * np.linalg.norm(rays(), axis=-1)).astype(np.float32)
    assert not doubtful_rays(depth, CAMERA)
    assert "along each ray" in doubtful_rays(along_rays, CAMERA)
    assert not doubtful_rays(np.zeros_like(depth), CAMERA)
    assert np.isfinite(points_from_depth(depth, CAMERA)).any()
