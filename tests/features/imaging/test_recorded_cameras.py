"""Recordings in which image, camera, time, place or bytes are not what the first message says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from features.codec.limits import CloudFormatError
from features.codec.types import Cloud
from features.imaging.doubts import implausible_depth
from features.imaging.placed import in_camera_frame
from features.imaging.recordings import first_view, views_of
from tests.features.imaging.drives import HEIGHT, WIDTH, Drive, depth_mm, seen
from tests.features.imaging.table_seen import depth_of_table, points_of_table

pytest.importorskip("rosbags")

DEPTH, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"


def headed(drive: Drive, stamp_s: float = 1.0, frame: str = "optical") -> None:
    """Give the newest message another header."""
    types = drive.store.types
    ns = round(stamp_s * 1e9)
    stamp = types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
    drive.messages[-1][1].header = types["std_msgs/msg/Header"](stamp, frame)


def k(focal: float, cx: float = 31.5, cy: float = 23.5) -> list[float]:
    return [focal, 0, cx, 0, focal, cy, 0, 0, 1]


def views(drive: Drive, tmp_path: Path) -> tuple[list[Any], list[str]]:
    warnings: list[str] = []
    return list(views_of(drive.save(tmp_path / "drive"), warn=warnings.append)), warnings


@pytest.mark.parametrize("is_late", [False, True], ids=["info first", "image first"])
def test_two_cameras_on_one_topic_are_each_described_by_their_own(
    tmp_path: Path, is_late: bool
) -> None:
    drive = Drive()
    for number, (frame, focal) in enumerate([("left", 60.0), ("right", 120.0)] * 2):
        at = 1000 + 10 * number
        drive.camera(INFO, at + 5 * is_late, k=k(focal))
        headed(drive, frame=frame)
        drive.image(DEPTH, at + 5 * (not is_late), "16UC1", depth_mm(700))
        headed(drive, frame=frame)
    found, warnings = views(drive, tmp_path)
    assert [(view.frame_id, view.intrinsics.fx) for view in found] == [
        ("left", 60.0), ("right", 120.0)
    ] * 2  # fmt: skip
    assert not warnings


def test_two_cameras_on_one_topic_keep_their_own_colours(tmp_path: Path) -> None:
    drive = Drive()
    for number in range(3):
        at = 1000 + 33 * number
        for frame, grey in (("left", 10), ("right", 200)):
            drive.camera(INFO, at)
            headed(drive, at / 1000, frame)
            # Taken at once, and the right one's colour arrives first.
            order = ("right", "left").index(frame)
            drive.image(DEPTH, at + 2 + order, "16UC1", depth_mm())
            headed(drive, at / 1000, frame)
            picture = np.full((HEIGHT, WIDTH, 3), grey + number, "u1")
            drive.image("/camera/color/image_raw", at + 5 + order, "rgb8", picture)
            headed(drive, at / 1000, frame)
    found, warnings = views(drive, tmp_path)
    greys = {(view.frame_id, int(view.rgb[20, 20, 0])) for view in found}
    assert greys == {("left", 10 + k) for k in range(3)} | {("right", 200 + k) for k in range(3)}
    assert not warnings


def test_a_camera_that_zooms_is_described_as_it_was_when_the_image_was_taken(
    tmp_path: Path,
) -> None:
    drive = Drive()
    focals = [60.0, 60.0, 90.0, 90.0]
    for number, focal in enumerate(focals):
        drive.camera(INFO, 1000 + 50 * number, k=k(focal))
        drive.image(DEPTH, 1001 + 50 * number, "16UC1", depth_mm())
    found, _ = views(drive, tmp_path)
    assert [view.intrinsics.fx for view in found] == focals


def test_a_description_in_another_frame_than_its_images_is_used_and_said(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera(INFO)
    drive.image(DEPTH, 1005, "16UC1", depth_mm())
    headed(drive, frame="depth_optical")
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(0.7)
    assert ["its CameraInfo in optical" in one for one in warnings] == [True]


@pytest.mark.parametrize("lags_ms", [(0, 60), (90, 0), (0, 0)])
def test_colour_is_paired_by_when_it_was_taken_and_not_by_when_it_was_recorded(
    tmp_path: Path, lags_ms: tuple[int, int]
) -> None:
    drive = Drive()
    drive.camera(INFO, 999)
    for number in range(5):
        at = 33 * number
        drive.image(DEPTH, 1000 + at + lags_ms[0], "16UC1", depth_mm(700 + number))
        headed(drive, 1 + at / 1000)
        grey = np.full((HEIGHT, WIDTH, 3), 10 + number, "u1")
        drive.image("/camera/color/image_raw", 1001 + at + lags_ms[1], "rgb8", grey)
        headed(drive, 1.001 + at / 1000)
    found, warnings = views(drive, tmp_path)
    assert [round(float(view.depth_m[20, 20]) * 1000) for view in found] == [*range(700, 705)]
    assert [int(view.rgb[20, 20, 0]) for view in found] == [*range(10, 15)]
    assert not warnings


def test_stamps_of_two_clocks_are_not_compared_and_that_is_said(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera(INFO, 999)
    for number in range(3):
        drive.image(DEPTH, 1000 + 33 * number, "16UC1", depth_mm())
        headed(drive, 5_000 + 0.033 * number)  # since the device was switched on
        grey = np.full((HEIGHT, WIDTH, 3), 10 + number, "u1")
        drive.image("/camera/color/image_raw", 1001 + 33 * number, "rgb8", grey)
        headed(drive, 1 + 0.033 * number)
    found, warnings = views(drive, tmp_path)
    assert [int(view.rgb[20, 20, 0]) for view in found] == [10, 11, 12]
    assert ["of another clock" in one for one in warnings] == [True]


def test_a_view_from_a_time_on_was_recorded_no_earlier(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera(INFO, 1000)
    for number in range(4):
        drive.image(DEPTH, 1000 + 100 * number, "16UC1", depth_mm(700 + number))
    view = first_view(drive.save(tmp_path / "drive"), at_s=0.15)
    assert view.depth_m[20, 20] == pytest.approx(0.702)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        (k(120.0, 63.0, 47.0), "a centre at (63, 47)"),  # of an image of twice the size
        ([60.0, 0, 0.5, 0, 61, 0.5, 0, 0, 1], "a centre at (0.5, 0.5)"),  # as shares
        ([60.0, 0, 31.5, 0, 122, 23.5, 0, 0, 1], "60 across and 122 down"),
    ],
)
def test_a_camera_whose_numbers_are_of_another_image_is_doubted(
    tmp_path: Path, numbers: list[float], said: str
) -> None:
    drive = Drive()
    drive.camera(INFO, k=numbers)
    drive.image(DEPTH, 1005, "16UC1", depth_mm())
    _, warnings = seen(drive, tmp_path)
    assert [said in one for one in warnings] == [True]


@pytest.mark.parametrize("is_said", [True, False], ids=["flag wrong", "flag missing"])
def test_bytes_in_another_order_than_is_said_are_doubted(tmp_path: Path, is_said: bool) -> None:
    drive = Drive()
    drive.camera(INFO)
    noisy = (700 + np.random.default_rng(0).normal(0, 2, (HEIGHT, WIDTH))).astype("<u2")
    drive.image(DEPTH, 1005, "16UC1", noisy if is_said else noisy.byteswap())
    drive.messages[-1][1].is_bigendian = int(is_said)
    _, warnings = seen(drive, tmp_path)
    assert any("is is_bigendian wrong?" in one for one in warnings)


def _fifths(drive: Drive) -> None:
    steps = np.random.default_rng(0).integers(640, 760, (HEIGHT, WIDTH))
    drive.image(DEPTH, 1005, "16UC1", (5 * steps).astype("<u2"))


def _float_bytes(drive: Drive) -> None:
    drive.image(DEPTH, 1005, "32FC1", np.full((HEIGHT, WIDTH), 0.7, ">f4").view("<f4"))


def _near_code(drive: Drive) -> None:
    depth = depth_mm()
    depth[:5] = 1
    drive.image(DEPTH, 1005, "16UC1", depth)


@pytest.mark.parametrize(
    ("add", "said"),
    [
        (_fifths, "a multiple of 5"), (_float_bytes, "its bytes in another order"),
        (_near_code, "exactly 0.001 m"),
    ],
)  # fmt: skip
def test_depth_in_doubtful_numbers_is_said(
    tmp_path: Path, add: Callable[[Drive], None], said: str
) -> None:
    drive = Drive()
    drive.camera(INFO)
    add(drive)
    _, warnings = seen(drive, tmp_path)
    assert any(said in one for one in warnings)


def test_a_tiff_of_metres_is_depth(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera(INFO)
    stored = cv2.imencode(".tiff", np.full((HEIGHT, WIDTH), 0.7, np.float32))[1].tobytes()
    drive.compressed(f"{DEPTH}/compressed", 1005, "32FC1; tiff compressed", stored)
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(0.7)
    assert not warnings


def _streams(drive: Drive, tells: bool) -> None:
    """Depth and colour of RealSense's SDK, 7 cm apart, whose images name no frame."""
    types = drive.store.types
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    for stream, encoding, x_m in (
        ("/device_0/sensor_0/Depth_0", "mono16", 0.02), ("/device_0/sensor_1/Color_0", "rgb8", 0.09)
    ):  # fmt: skip
        drive.camera(f"{stream}/info/camera_info", 1001)
        headed(drive, frame="")
        picture = depth_mm() if encoding == "mono16" else np.zeros((HEIGHT, WIDTH, 3), "u1")
        if encoding == "rgb8":
            picture[:, 24:27] = (200, 0, 0)
        drive.image(f"{stream}/image/data", 1002, encoding, picture)
        headed(drive, frame="")
        if tells:
            place = types["geometry_msgs/msg/Vector3"](x_m, 0.0, 0.0)
            pose = types["geometry_msgs/msg/Transform"](place, turn)
            drive.messages.append((f"{stream}/tf/0", pose, 1000))


def test_streams_of_the_realsense_sdk_are_laid_over_one_another_by_their_transforms(
    tmp_path: Path,
) -> None:
    drive = Drive()
    _streams(drive, tells=True)
    view, warnings = seen(drive, tmp_path)
    # Colour is 7 cm on in x from depth: 60 px of focal length times 7 cm over 70 cm are 6 px.
    assert view.rgb[20, 19].tolist() == [200, 0, 0]
    assert not warnings


def test_streams_whose_places_nobody_tells_are_said_to_be_taken_for_one_place(
    tmp_path: Path,
) -> None:
    drive = Drive()
    _streams(drive, tells=False)
    view, warnings = seen(drive, tmp_path)
    assert view.rgb[20, 25].tolist() == [200, 0, 0]
    assert ["taken for seen from one place" in one for one in warnings] == [True]


@pytest.mark.parametrize("focal", [60.0, 90.0])
def test_two_cameras_in_one_frame_are_said_to_be_taken_for_one_place(
    tmp_path: Path, focal: float
) -> None:
    drive = Drive()
    drive.camera(INFO)
    drive.camera("/camera/color/camera_info", k=k(focal))
    drive.image(DEPTH, 1005, "16UC1", depth_mm())
    drive.image("/camera/color/image_raw", 1006, "rgb8", np.full((HEIGHT, WIDTH, 3), 80, "u1"))
    _, warnings = seen(drive, tmp_path)
    assert ["no frame tells them apart" in one for one in warnings] == [True] * (focal != 60.0)


def test_the_baseline_of_a_rectified_pair_is_read_from_p(tmp_path: Path) -> None:
    drive = Drive()
    p = [60.0, 0, 31.5, 0, 0, 60, 23.5, 0, 0, 0, 1, 0]
    drive.camera(INFO, p=p)
    drive.image("/camera/depth/image_rect", 1005, "16UC1", depth_mm())
    drive.camera("/camera/color/camera_info", p=[*p[:3], -60.0 * 0.07, *p[4:]])
    picture = np.zeros((HEIGHT, WIDTH, 3), "u1")
    picture[:, 24:27] = (200, 0, 0)
    drive.image("/camera/color/image_rect_color", 1006, "rgb8", picture)
    view, warnings = seen(drive, tmp_path)
    assert view.rgb[20, 31].tolist() == [200, 0, 0]
    assert not warnings


def test_depth_beside_the_frame_that_it_names_is_said(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera(INFO, p=[60.0, 0, 31.5, -60.0 * 0.07, 0, 60, 23.5, 0, 0, 0, 1, 0])
    drive.image("/camera/depth/image_rect", 1005, "16UC1", depth_mm())
    _, warnings = seen(drive, tmp_path)
    assert ["0.07 m beside its frame optical" in one for one in warnings] == [True]


def test_what_a_recording_holds_instead_is_named(tmp_path: Path) -> None:
    drive = Drive()
    text = drive.store.types["std_msgs/msg/String"]
    drive.messages.append(("/talk", text("hello"), 1000))
    with pytest.raises(CloudFormatError, match="it holds std_msgs/msg/String"):
        seen(drive, tmp_path)


def _cloud(drive: Drive, points: np.ndarray, shape: tuple[int, int], frame: str) -> None:
    make = drive.store.types["sensor_msgs/msg/PointField"]
    fields = [make(axis, 4 * place, 7, 1) for place, axis in enumerate("xyz")]
    data = np.frombuffer(points.astype("<f4").tobytes(), "u1")
    drive.add(
        "/points", "sensor_msgs/msg/PointCloud2", 1000, *shape, fields, False, 12, 12 * shape[1],
        data, False,
    )  # fmt: skip
    headed(drive, frame=frame)


@pytest.mark.parametrize(
    ("change", "said", "middle_m"),
    [
        (lambda p: p, "", 0.734),
        (lambda p: p * (-1, 1, 1), "a mirror image", 0.734),
        (lambda p: p * (1, -1, 1), "a mirror image", 0.734),
        (lambda p: 10 * p, "beyond 7.3", 7.34),
        (lambda p: p / 1000, "within 0.0007", 0.000734),
        # x forward, y to the left, z up: brought back to the frame of the camera
        (lambda p: np.stack([p[..., 2], -p[..., 0], -p[..., 1]], -1), "show a camera at", 0.734),
    ],
    ids=["good", "mirror", "y up", "dm", "km", "body"],
)
def test_a_cloud_of_other_axes_or_units_is_put_right_or_doubted(
    tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], said: str, middle_m: float
) -> None:
    drive = Drive()
    points = points_of_table()
    _cloud(drive, change(points), points.shape[:2], "camera_link")
    cloud, warnings = seen(drive, tmp_path)
    assert np.median(cloud.positions[:, 2]) == pytest.approx(middle_m, rel=0.01)
    assert [said in one for one in warnings] == [True] * bool(said)


@pytest.mark.parametrize(
    ("axes", "is_mirrored"),
    [((1, 1, 1), False), ((-1, 1, 1), True), ((1, -1, 1), True), ((-1, -1, 1), False)],
)
@pytest.mark.parametrize("is_shuffled", [False, True])
def test_points_in_the_order_of_pixels_show_a_mirror_image(
    axes: tuple[int, int, int], is_mirrored: bool, is_shuffled: bool
) -> None:
    points = points_of_table().reshape(-1, 3)
    points = (points[np.isfinite(points).all(axis=1)] * axes).astype(np.float32)
    if is_shuffled:
        np.random.default_rng(0).shuffle(points)
    _, doubt = in_camera_frame(Cloud(points))
    # A table seen from below hangs: only what stands on it is doubted then, and not here.
    assert ("mirror image" in doubt) is (is_mirrored and not is_shuffled)


@pytest.mark.parametrize("mark_mm", [350, 4000])
def test_a_number_far_from_all_others_is_doubted_in_a_small_share(mark_mm: int) -> None:
    depth = depth_of_table().astype(np.float32)
    depth[np.random.default_rng(0).random(depth.shape) < 0.03] = mark_mm / 1000
    assert f"exactly {mark_mm / 1000:g} m" in implausible_depth(depth)
    assert not implausible_depth(depth_of_table().astype(np.float32))


def test_height_and_width_that_are_exchanged_are_put_right_and_said(tmp_path: Path) -> None:
    drive = Drive()
    points = points_of_table()
    _cloud(drive, points, points.shape[:2][::-1], "optical")
    cloud, warnings = seen(drive, tmp_path)
    assert cloud.shape == points.shape[:2]
    assert ["are taken to be exchanged" in one for one in warnings] == [True]
