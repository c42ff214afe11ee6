"""Clouds in the frame of a robot or a room are brought to that of their camera, or doubted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from features.codec import decode
from features.codec.types import Cloud
from features.imaging.camera import frame_of_grid
from features.imaging.placed import camera_of_placed_grid, in_camera_frame, on_pixels
from tests.features.imaging.table_seen import BASE_FROM_CAMERA, CAMERA, in_base, points_of_table

SEEN = points_of_table().astype(np.float32)


def ply(points: np.ndarray) -> bytes:
    rows = points.reshape(-1, 3)
    rows = rows[np.isfinite(rows).all(axis=1)]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    return f"{head}end_header\n".encode() + rows.astype("<f4").tobytes()


def pcd(points: np.ndarray, viewpoint: str = "0 0 0 1 0 0 0") -> bytes:
    """Write an organised cloud (h, w, 3), or one (n, 3) without rows."""
    high, wide = points.shape[:2] if points.ndim == 3 else (1, len(points))
    head = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {wide}\nHEIGHT {high}\nVIEWPOINT {viewpoint}\nPOINTS {high * wide}\nDATA binary\n"
    )
    return head.encode() + points.astype("<f4").tobytes()


def viewpoint() -> str:
    x, y, z, w = Rotation.from_matrix(BASE_FROM_CAMERA[:3, :3]).as_quat()
    return " ".join(f"{value:.9f}" for value in (*BASE_FROM_CAMERA[:3, 3], w, x, y, z))


def read(data: bytes) -> tuple[Cloud, str]:
    cloud = decode(data)
    assert isinstance(cloud, Cloud)
    return in_camera_frame(cloud)


def assert_as_seen(cloud: Cloud) -> None:
    wanted = SEEN.reshape(-1, 3)
    wanted = wanted[np.isfinite(wanted).all(axis=1)]
    assert np.allclose(cloud.positions, wanted, atol=0.001)
    assert not cloud.frame_id


@pytest.mark.parametrize("data", [ply(SEEN), pcd(SEEN), pcd(SEEN[np.isfinite(SEEN[..., 2])])])
def test_a_cloud_in_its_cameras_frame_stays_and_raises_no_doubt(data: bytes) -> None:
    cloud, said = read(data)
    assert_as_seen(cloud)
    assert not said


def test_the_rows_of_a_cloud_in_the_robots_frame_show_where_the_camera_was() -> None:
    cloud, said = read(pcd(in_base(SEEN)))
    assert_as_seen(cloud)
    assert "a camera at (0.000, -0.600, 0.550) m" in said
    found = camera_of_placed_grid(in_base(SEEN))
    assert found is not None
    assert found[0].fx == pytest.approx(CAMERA.fx, rel=0.002)


def test_no_camera_is_made_up_for_mirror_images_planes_or_other_grids() -> None:
    placed = in_base(SEEN)
    assert camera_of_placed_grid(placed * [1, -1, 1]) is None
    flat = placed.copy()
    flat[..., 2] = 0
    assert camera_of_placed_grid(flat) is None
    shuffled = np.random.default_rng(1).permutation(placed.reshape(-1, 3)).reshape(placed.shape)
    assert camera_of_placed_grid(shuffled) is None
    assert camera_of_placed_grid(np.full((20, 20, 3), np.nan)) is None


@pytest.mark.parametrize("lift_m", [0.0, 0.8, -0.3])
def test_a_cloud_of_a_robots_frame_without_rows_is_doubted(lift_m: float) -> None:
    placed = in_base(SEEN) + np.float32([0.5, 0, lift_m])
    _, said = read(ply(placed))
    assert "behind" in said


@pytest.mark.parametrize("is_organised", [True, False])
def test_axes_of_drawings_are_turned_into_those_of_a_camera(is_organised: bool) -> None:
    # RealSense's viewer exports y up and z backward, as OpenGL draws.
    drawn = SEEN * np.float32([1, -1, -1])
    cloud, said = read(pcd(drawn) if is_organised else ply(drawn))
    assert_as_seen(cloud)
    assert "read in" in said


def test_the_axes_of_a_vehicle_are_doubted() -> None:
    # A camera_link has x forward and z up (REP 103).
    _, said = read(ply(SEEN @ np.float32([[0, -1, 0], [0, 0, -1], [1, 0, 0]])))
    assert "behind the camera" in said


@pytest.mark.parametrize("is_organised", [True, False])
@pytest.mark.parametrize("is_placed", [True, False])
def test_viewpoint_places_points_of_the_sensor_or_says_where_placed_ones_were_seen(
    is_organised: bool, is_placed: bool
) -> None:
    points = in_base(SEEN) if is_placed else SEEN
    if not is_organised:
        points = points[np.isfinite(points[..., 2])]
    cloud, said = read(pcd(points, viewpoint()))
    assert_as_seen(cloud)
    assert "VIEWPOINT" in said


def test_many_points_at_the_origin_were_not_measured_and_one_may_be() -> None:
    rows = SEEN[np.isfinite(SEEN[..., 2])]
    many = np.concatenate([rows, np.zeros((len(rows) // 20, 3), np.float32)])
    assert len(decode(ply(many)).positions) == len(rows)
    assert len(decode(ply(np.concatenate([rows, np.zeros((1, 3))]))).positions) == len(rows) + 1


def test_a_cloud_without_rows_is_laid_on_the_pixels_that_it_was_measured_on() -> None:
    points = SEEN[np.isfinite(SEEN[..., 2])]
    shuffled = np.random.default_rng(2).permutation(points)
    colours = (np.abs(shuffled) * 200).clip(0, 255).astype(np.uint8)
    whole = on_pixels(Cloud(shuffled, colours))
    assert whole is not None
    assert np.array_equal(whole.positions, shuffled)
    frame = frame_of_grid(whole)
    assert frame is not None
    assert frame.intrinsics.fx == pytest.approx(CAMERA.fx, rel=1e-4)
    kept = SEEN[np.isfinite(SEEN[..., 2]).any(axis=1)][:, np.isfinite(SEEN[..., 2]).any(axis=0)]
    assert np.array_equal(frame.depth_m > 0, np.isfinite(kept[..., 2]))


def test_points_of_no_camera_are_laid_on_no_pixels() -> None:
    rng = np.random.default_rng(3)
    scattered = rng.uniform(0.5, 1.0, (3000, 3)).astype(np.float32)
    assert on_pixels(Cloud(scattered)) is None
    turned = in_base(SEEN[np.isfinite(SEEN[..., 2])]).astype(np.float32) + np.float32(2)
    assert on_pixels(Cloud(turned)) is None
    assert on_pixels(Cloud(scattered - np.float32(0.7))) is None
    twice = SEEN[np.isfinite(SEEN[..., 2])]
    assert on_pixels(Cloud(np.concatenate([twice, twice]))) is None  # two looks in one file
