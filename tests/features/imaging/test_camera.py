"""Lenses, colour of other cameras, organised clouds."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from features.codec.types import Cloud
from features.geometry import Intrinsics, points_from_depth, transform
from features.imaging.camera import (
    Lens,
    align_colour,
    camera_of_grid,
    frame_of_grid,
    lens_from_message,
    undistorted,
)

CAMERA = Intrinsics(160, 120, 140.0, 150.0, 78.0, 61.0)


def test_distortion_is_taken_out_of_colour_and_depth():
    lens = Lens(CAMERA, (-0.25, 0.08, 0.001, -0.002))
    matrix = np.array([[140.0, 0, 78], [0, 150, 61], [0, 0, 1]])
    corner = np.array([[[0.45, -0.33, 1.0]]])
    seen, _ = cv2.projectPoints(corner, np.zeros(3), np.zeros(3), matrix, np.array(lens.distortion))
    u, v = np.rint(seen.ravel()).astype(int)
    rgb, depth = np.zeros((120, 160, 3), np.uint8), np.ones((120, 160), np.float32)
    rgb[v - 2 : v + 3, u - 2 : u + 3], depth[v - 2 : v + 3, u - 2 : u + 3] = 255, 2.0
    straight, straight_depth = undistorted(lens, rgb, depth)
    place = np.argwhere(straight[..., 0] > 128).mean(axis=0)[::-1]
    # The square is put at whole pixels, half a pixel off at most.
    assert np.abs(place - (78 + 140 * 0.45, 61 - 150 * 0.33)).max() < 1.2
    assert straight_depth[tuple(np.rint(place[::-1]).astype(int))] == 2.0


def test_a_lens_is_read_from_messages_of_ros_1_and_2():
    k = [500, 0, 320, 0, 501, 240, 0, 0, 1]
    for names in (("k", "d"), ("K", "D")):
        said = {"width": 640, "height": 480, names[0]: k, names[1]: [0.1, 0, 0, 0, 0]}
        lens = lens_from_message(said)
        assert lens.intrinsics.fy == 501
        assert lens.is_distorted
    with pytest.raises(ValueError, match="lacks height"):
        lens_from_message({"width": 640, "k": k})
    with pytest.raises(ValueError, match="a fisheye has 4"):
        lens_from_message({**said, "distortion_model": "equidistant"})
    with pytest.raises(ValueError, match="'thin_prism' is not known"):
        lens_from_message({**said, "distortion_model": "thin_prism"})
    with pytest.raises(ValueError, match="coefficients"):
        Lens(CAMERA, (0.1, 0.2))


def test_colour_of_another_resolution_covers_the_same_view():
    rgb = np.zeros((240, 320, 3), np.uint8)
    rgb[100:140, 200:260] = 200
    frame = align_colour(np.ones((120, 160)), CAMERA, rgb)
    assert frame.rgb[60, 115, 0] == 200
    assert frame.rgb[20, 20, 0] == 0
    with pytest.raises(ValueError, match="how the colour camera"):
        align_colour(np.ones((120, 160)), CAMERA, rgb[:, :200])


def test_colour_of_a_camera_beside_is_found_through_the_depth():
    colour_camera = Intrinsics(320, 240, 280.0, 280.0, 160.0, 120.0)
    pose = np.eye(4)
    pose[0, 3] = 0.05
    depth = np.full((120, 160), 0.8, np.float32)
    depth[:, 80:] = 1.6
    rgb = np.zeros((240, 320, 3), np.uint8)
    target = transform(pose, points_from_depth(depth, CAMERA)[60, 40])
    u, v = (280 * target[:2] / target[2] + (160, 120)).astype(int)
    rgb[v - 3 : v + 4, u - 3 : u + 4] = 250
    frame = align_colour(depth, CAMERA, rgb, colour_camera, pose)
    assert frame.rgb[60, 40, 0] > 200
    place = np.argwhere(frame.rgb[..., 0] > 200)
    assert np.abs(place - (60, 40)).max() <= 3


def test_an_organised_cloud_becomes_the_frame_of_its_camera():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 1, (120, 160)).astype(np.float32)
    depth[10:30] = 0
    points = points_from_depth(depth, CAMERA)
    flat = points.reshape(-1, 3)
    known = np.isfinite(flat).all(axis=1)
    ink = rng.integers(0, 255, (len(flat), 3)).astype(np.uint8)
    cloud = Cloud(
        flat[known], ink[known], shape=(120, 160), places=np.flatnonzero(known)
    )  # fmt: skip
    frame = frame_of_grid(cloud)
    assert frame is not None
    assert np.allclose(frame.depth_m, depth, atol=1e-6)
    assert np.array_equal(frame.rgb.reshape(-1, 3)[known], ink[known])
    assert abs(frame.intrinsics.fx - 140) < 0.01
    turned = np.eye(4)
    turned[:3, :3] = cv2.Rodrigues(np.array([0.5, 0.2, 0]))[0]
    assert camera_of_grid(transform(turned, points)) is None


@pytest.mark.parametrize("width", ["a", "640", 640.5, None])
def test_a_size_that_is_no_whole_number_is_named(width):
    message = {"width": width, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
    with pytest.raises(ValueError, match="width and height must be whole numbers of px, got"):
        lens_from_message(message)


@pytest.mark.parametrize(
    "change", [{"fx": 10**400}, {"d": 5}, {"k": [1, 2, {}]}, {"distortion": [None] * 4}]
)
def test_numbers_of_a_camera_that_are_none_are_refused(change):
    plain = {"width": 80, "height": 60, "fx": 100, "fy": 100, "cx": 40, "cy": 30}
    with pytest.raises(ValueError, match=r"camera|sequence"):
        lens_from_message({**plain, **change})


def test_depth_beyond_the_range_of_the_camera_is_missing():
    camera = Intrinsics(6, 4, 5.0, 5.0, 2.5, 1.5)
    depth = np.full((4, 6), 0.5, np.float32)
    depth[0], depth[1] = np.inf, -np.inf  # REP 117: too far, and too near
    rgb = np.zeros((4, 6, 3), np.uint8)
    assert align_colour(depth, camera, rgb).depth_m[:2].max() == 0
    straight = undistorted(Lens(camera, (0.0, 0.0, 0.01, 0.0)), None, depth)[1]
    assert straight is not None
    assert straight.max() == 0.5
