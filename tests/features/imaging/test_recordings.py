"""Recordings of real cameras: what a topic carries is read, and one bad topic spoils nothing."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from features.codec.limits import CloudFormatError
from features.geometry import Frame
from features.imaging.photo import Photo
from features.imaging.recordings import first_view, views_of
from tests.features.imaging.drives import (
    BENT,
    HEIGHT,
    WIDTH,
    Drive,
    P,
    depth_mm,
    good_topics,
    seen,
)  # fmt: skip

pytest.importorskip("rosbags")


@pytest.mark.parametrize("name", ["junk.bag", "junk.mcap", "junk.db3"])
@pytest.mark.parametrize("start", [b"", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
def test_bytes_that_are_no_recording_are_told_in_one_line(
    tmp_path: Path, name: str, start: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(start + np.random.default_rng(3).bytes(400))
    with pytest.raises(CloudFormatError, match="no recording of ROS"):
        first_view(path)


def test_a_recording_that_was_cut_short_says_how_to_mend_it(tmp_path: Path) -> None:
    """As a robot leaves one that loses power: its index stands at the end."""
    drive = Drive()
    good_topics(drive)
    folder = drive.save(tmp_path / "drive")
    (file,) = folder.glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[:-60])
    with pytest.raises(CloudFormatError, match=r"`mcap recover cut\.mcap"):
        first_view(cut)
    unfinished = tmp_path / "day.bag"
    unfinished.write_bytes(b"#ROSBAG V2.0\n" + bytes(4096))
    with pytest.raises(CloudFormatError, match=r"`rosbag reindex day\.bag`"):
        first_view(unfinished)
    (folder / "metadata.yaml").unlink()
    with pytest.raises(CloudFormatError, match="`ros2 bag reindex"):
        first_view(folder)
    junk = tmp_path / "junk.mcap"
    junk.write_bytes(bytes(500))
    with pytest.raises(CloudFormatError) as refused:
        first_view(junk)
    assert "recover" not in str(refused.value)


@pytest.mark.parametrize("bins", [0, 2])
def test_a_camera_of_another_size_is_taken_for_the_whole_view_and_that_is_said(
    tmp_path: Path, bins: int
) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", k=[120.0, 0, 63.5, 0, 122, 47.5, 0, 0, 1])
    told = drive.messages[-1][1]
    told.width, told.height, told.binning_x, told.binning_y = 2 * WIDTH, 2 * HEIGHT, bins, bins
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm())
    view, warnings = seen(drive, tmp_path)
    assert view.intrinsics.fx == 60.0
    assert [("no binning or roi" in text) for text in warnings] == [True] * (bins == 0)


def test_a_rectified_image_is_described_by_p_and_not_straightened_again(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", d=BENT, p=P)
    # A step of depth that undistortion would bend.
    depth = depth_mm()
    depth[:, 57:] = 900
    drive.image("/camera/depth/image_rect", 1005, "16UC1", depth)
    view, warnings = seen(drive, tmp_path)
    assert np.allclose(view.depth_m * 1000, depth, atol=0.01)
    assert (view.intrinsics.fx, view.intrinsics.cy) == (50.0, 22.0)
    assert not warnings


def test_a_raw_image_is_straightened_by_k_and_d(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", d=BENT, p=P)
    depth = depth_mm()
    depth[:, 57:] = 900
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth)
    view, _ = seen(drive, tmp_path)
    assert view.intrinsics.fx == 60.0
    assert not np.allclose(view.depth_m * 1000, depth, atol=0.01)


def _infrared(drive: Drive) -> None:
    drive.image("/camera/infra1/image_rect_raw", 1001, "mono8", np.full((HEIGHT, WIDTH), 9, "u1"))


def _thermal(drive: Drive) -> None:
    drive.image("/thermal/image_raw", 1001, "16UC1", depth_mm(29_500))


def _grey16(drive: Drive) -> None:
    drive.image("/flir/image", 1001, "mono16", depth_mm(29_500))


def _unknown_encoding(drive: Drive) -> None:
    drive.image("/side/image_raw", 1001, "16SC3", np.zeros((HEIGHT, WIDTH, 3), "<i2"))


def _video(drive: Drive) -> None:
    drive.compressed("/side/image_raw/ffmpeg", 1001, "h264", b"\0\0\0\1")


def _no_camera(drive: Drive) -> None:
    drive.camera("/webcam/camera_info", 1001, k=[0.0] * 9)


def _other_depth(drive: Drive) -> None:
    drive.image("/side/depth/image_raw", 1001, "16UC1", depth_mm())  # nobody describes it


@pytest.mark.parametrize(
    ("spoil", "warning"),
    [
        (_infrared, "infrared"), (_thermal, "infrared"), (_grey16, "mono16 on a topic"),
        (_unknown_encoding, "16SC3"), (_video, "h264"), (_no_camera, ""),
        (_other_depth, "CameraInfo"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)  # fmt: skip
def test_a_topic_that_cannot_be_used_is_left_out_and_named(
    tmp_path: Path, spoil: Callable[[Drive], None], warning: str
) -> None:
    drive = Drive()
    spoil(drive)
    good_topics(drive)
    view, warnings = seen(drive, tmp_path)
    assert isinstance(view, Frame)
    assert view.depth_m[20, 20] == pytest.approx(0.7)
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert any(warning in one for one in warnings) is bool(warning)


def test_the_reasons_are_told_where_nothing_is_left(tmp_path: Path) -> None:
    drive = Drive()
    _grey16(drive)
    with pytest.raises(CloudFormatError, match="/flir/image: left out: mono16"):
        seen(drive, tmp_path)


def test_depth_may_come_before_its_camera_is_described(tmp_path: Path) -> None:
    drive = Drive()
    drive.image("/camera/depth/image_raw", 1000, "16UC1", depth_mm())
    drive.camera("/camera/depth/camera_info", 1500)
    view, _ = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(0.7)


def test_a_fisheye_is_straightened(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", d=[0.1, 0.0, 0.0, 0.0], model="equidistant")
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm())
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[24, 32] == pytest.approx(0.7)
    assert not warnings


def test_recordings_of_the_realsense_sdk_are_read_with_their_unit(tmp_path: Path) -> None:
    drive = Drive()
    sensor = "/device_0/sensor_0"
    drive.add(f"{sensor}/option/Depth_Units/value", "std_msgs/msg/Float32", 1000, 0.0005)
    drive.camera(f"{sensor}/Depth_0/info/camera_info", 1001)
    drive.image(f"{sensor}/Depth_0/image/data", 1002, "mono16", depth_mm(1400))
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(0.7)
    assert not warnings


def test_compressed_depth_of_floats_is_read_and_a_doubtful_unit_is_said(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info")
    # value = a / depth + b: 101 is 100 / 1 m + 1
    header = struct.pack("<iff", 0, 100.0, 1.0)
    stored = cv2.imencode(".png", np.full((HEIGHT, WIDTH), 101, np.uint16))[1].tobytes()
    form = "32FC1; compressedDepth"
    drive.compressed("/camera/depth/image_raw/compressedDepth", 1005, form, header + stored)
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(1.0)
    assert not warnings
    far = Drive()
    far.camera("/camera/depth/camera_info")
    far.image("/camera/depth/image_raw", 1005, "32FC1", np.full((HEIGHT, WIDTH), 70, "<f4"))
    _, warnings = seen(far, tmp_path / "far")
    assert ["in another unit?" in one for one in warnings] == [True]


@pytest.mark.parametrize("steps", [70, 7_000])
def test_depth_in_centimetres_or_tenths_of_a_millimetre_is_doubted(
    tmp_path: Path, steps: int
) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info")
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm(steps))
    _, warnings = seen(drive, tmp_path)
    assert ["in another unit?" in one for one in warnings] == [True]


@pytest.mark.parametrize(
    ("frame", "lift_m", "said"),
    [
        ("camera_depth_optical_frame", 0.0, []),
        ("base_link", 0.0, ["in the frame base_link, which has z up"]),
        ("velodyne", -0.75, ["of the points lie behind the camera"]),
    ],
)
def test_a_cloud_that_is_in_no_cameras_frame_is_doubted(
    tmp_path: Path, frame: str, lift_m: float, said: list[str]
) -> None:
    drive = Drive()
    make = drive.store.types["sensor_msgs/msg/PointField"]
    fields = [make(axis, 4 * k, 7, 1) for k, axis in enumerate("xyz")]
    points = np.random.default_rng(4).uniform(0.5, 1.0, (400, 3)).astype("<f4")
    points[:, 2] += np.float32(lift_m)
    data = np.frombuffer(points.tobytes(), "u1")
    drive.add(
        "/points", "sensor_msgs/msg/PointCloud2", 1000, 1, 400, fields, False, 12, 4800, data, True
    )
    drive.messages[-1][1].header.frame_id = frame
    view, warnings = seen(drive, tmp_path)
    assert len(view.positions) == 400
    assert [any(part in one for one in warnings) for part in said] == [True] * len(warnings)


def test_a_number_that_stands_for_nothing_is_no_wall_and_that_is_said(tmp_path: Path) -> None:
    drive = Drive()
    depth = depth_mm()
    depth[:, 40:] = 10_000
    drive.camera("/camera/depth/camera_info")
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth)
    view, warnings = seen(drive, tmp_path)
    assert not view.depth_m[:, 40:].any()
    assert ["exactly 10 m" in one for one in warnings] == [True]


def test_deep_colours_of_a_recording_have_one_scale_and_it_is_said(tmp_path: Path) -> None:
    drive = Drive()
    for number, brightest in enumerate((900, 3_600, 800)):
        picture = np.full((HEIGHT, WIDTH, 3), 400, "<u2")
        picture[:4, :4] = brightest
        drive.image("/webcam/image_raw", 1001 + number, "rgb16", picture)
    warnings: list[str] = []
    views = list(views_of(drive.save(tmp_path / "drive"), warn=warnings.append))
    # 12 bits hold 3,600: 400 of 4,095 is 25 of 255 in each, also in the ones that 10 would hold.
    assert [view.rgb[20, 20].tolist() for view in views] == [[25, 25, 25]] * 3
    assert ["12 are taken" in one for one in warnings] == [True]


def test_an_encoding_that_is_not_read_is_not_called_a_drawing(tmp_path: Path) -> None:
    drive = Drive()
    good_topics(drive)
    drive.image("/wrist/depth/image_raw", 1006, "32SC1", np.full((HEIGHT, WIDTH), 700, "<i4"))
    view, warnings = seen(drive, tmp_path)
    assert isinstance(view, Frame)
    assert [one for one in warnings if "32SC1 is not read as depth" in one]


def test_a_recording_without_depth_gives_its_photographs(tmp_path: Path) -> None:
    drive = Drive()
    drive.image("/webcam/image_raw", 1001, "yuv422_yuy2", np.full((HEIGHT, WIDTH, 2), 128, "u1"))
    view, warnings = seen(drive, tmp_path)
    assert isinstance(view, Photo)
    assert not warnings


def frames(drive: Drive, topic: str, frame_id: str) -> None:
    """Give the messages of a topic another frame."""
    types = drive.store.types
    for name, message, _ in drive.messages:
        if name == topic:
            message.header = types["std_msgs/msg/Header"](message.header.stamp, frame_id)


def static_transform(drive: Drive, parent: str, child: str, x_m: float) -> None:
    types = drive.store.types
    place = types["geometry_msgs/msg/Vector3"](x_m, 0.0, 0.0)
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    transform = types["geometry_msgs/msg/Transform"](place, turn)
    stamp = types["builtin_interfaces/msg/Time"](1, 0)
    header = types["std_msgs/msg/Header"](stamp, parent)
    stamped = types["geometry_msgs/msg/TransformStamped"](header, child, transform)
    drive.messages.append(("/tf_static", types["tf2_msgs/msg/TFMessage"]([stamped]), 1))


def test_colour_of_another_camera_is_never_laid_over_depth(tmp_path: Path) -> None:
    drive = Drive()
    good_topics(drive)
    # Nearer in time than the depth's own colour.
    other = np.full((HEIGHT, WIDTH, 3), 250, "u1")
    drive.image("/wrist/color/image_raw", 1006, "rgb8", other)
    frames(drive, "/wrist/color/image_raw", "wrist")
    view, warnings = seen(drive, tmp_path)
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert ["another camera" in one for one in warnings] == [True]


def two_places(tmp_path: Path, *, is_told: bool) -> tuple[Any, list[str]]:
    """Return a view whose colour, with a red column, was taken 7 cm to the right of depth."""
    drive = Drive()
    drive.camera("/camera/depth/camera_info")
    drive.camera("/camera/color/camera_info")
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm())
    picture = np.zeros((HEIGHT, WIDTH, 3), "u1")
    picture[:, 24:27] = (200, 0, 0)
    drive.image("/camera/color/image_raw", 1006, "rgb8", picture)
    for topic in ("/camera/color/image_raw", "/camera/color/camera_info"):
        frames(drive, topic, "colour_optical")
    if is_told:
        static_transform(drive, "optical", "colour_optical", 0.07)
    return seen(drive, tmp_path)


def test_static_transforms_lay_colour_over_depth(tmp_path: Path) -> None:
    view, warnings = two_places(tmp_path, is_told=True)
    # 60 px of focal length times 7 cm over 70 cm are 6 px.
    assert view.rgb[20, 31].tolist() == [200, 0, 0]
    assert view.rgb[20, 25].tolist() == [0, 0, 0]
    assert not warnings


def test_colour_whose_place_nobody_tells_is_said_to_be_taken_for_registered(tmp_path: Path) -> None:
    view, warnings = two_places(tmp_path, is_told=False)
    assert view.rgb[20, 25].tolist() == [200, 0, 0]
    assert ["taken for seen from one place" in one for one in warnings] == [True]


def test_depth_laid_over_colour_is_preferred_to_that_of_the_sensor(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info")
    drive.image("/camera/depth/image_rect_raw", 1005, "16UC1", depth_mm(710))
    # It lies in the picture of colour, whose description is the only one.
    drive.camera("/camera/color/camera_info", k=[90.0, 0, 31.5, 0, 90, 23.5, 0, 0, 1])
    drive.image("/camera/aligned_depth_to_color/image_raw", 1007, "16UC1", depth_mm(700))
    drive.image("/camera/color/image_raw", 1010, "rgb8", np.full((HEIGHT, WIDTH, 3), 80, "u1"))
    view, warnings = seen(drive, tmp_path)
    assert view.depth_m[20, 20] == pytest.approx(0.7)
    assert view.intrinsics.fx == 90.0
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert not warnings


@pytest.mark.parametrize(
    ("topic", "encoding"),
    [("/camera/confidence/image_rect_raw", "mono8"), ("/camera/disparity", "32FC1")],
)
def test_confidence_and_disparity_are_neither_depth_nor_colour(
    tmp_path: Path, topic: str, encoding: str
) -> None:
    drive = Drive()
    pixels = np.full((HEIGHT, WIDTH), 3, "<f4" if encoding == "32FC1" else "u1")
    drive.image(topic, 1006, encoding, pixels)
    good_topics(drive)
    view, warnings = seen(drive, tmp_path)
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert any("neither depth nor colour" in one for one in warnings)
    alone = Drive()
    alone.camera("/camera/camera_info")
    alone.image(topic, 1006, encoding, pixels)
    with pytest.raises(CloudFormatError, match="neither depth nor colour"):
        seen(alone, tmp_path / "alone")


def test_a_picture_of_eight_bits_on_a_topic_of_depth_is_no_colour(tmp_path: Path) -> None:
    drive = Drive()
    drawn = cv2.imencode(".jpg", np.full((HEIGHT, WIDTH, 3), 9, "u1"))[1].tobytes()
    drive.compressed("/camera/depth/image_raw/compressed", 1003, "jpeg", drawn)
    good_topics(drive)
    view, warnings = seen(drive, tmp_path)
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert ["drawing of depth" in one for one in warnings] == [True]


def test_depth_whose_topic_does_not_say_so_is_said_to_be_taken_for_it(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/flir/camera_info")
    drive.image("/flir/image_raw", 1006, "16UC1", depth_mm(3000))
    _, warnings = seen(drive, tmp_path)
    assert ["taken for depth" in one for one in warnings] == [True]


@pytest.mark.parametrize(
    ("bins", "region", "fx", "cx"),
    [(2, (0, 0, 0, 0), 60.0, 31.5), (0, (10, 20, HEIGHT, WIDTH), 120.0, 53.5)],
    ids=["binned", "cut out"],
)
def test_an_image_of_a_part_of_the_sensor_has_the_camera_of_that_part(
    tmp_path: Path, bins: int, region: tuple[int, int, int, int], fx: float, cx: float
) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", k=[120.0, 0, 63.5, 0, 120, 47.5, 0, 0, 1])
    info = drive.messages[-1][1]
    info.width, info.height = 2 * WIDTH, 2 * HEIGHT
    info.binning_x = info.binning_y = bins
    left, top, down, across = region
    make = drive.store.types["sensor_msgs/msg/RegionOfInterest"]
    info.roi = make(left, top, down, across, bool(down))
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm())
    view, _ = seen(drive, tmp_path)
    assert (view.intrinsics.fx, view.intrinsics.cx) == (fx, cx)


@pytest.mark.parametrize("topic", ["/camera/depth/ir_image", "/camera/depth_ir/image_raw"])
def test_infrared_in_the_name_space_of_depth_is_no_depth(tmp_path: Path, topic: str) -> None:
    drive = Drive()
    drive.camera(topic.rpartition("/")[0] + "/camera_info")
    drive.image(topic, 1004, "mono16", depth_mm(3_000))
    with pytest.raises(CloudFormatError, match="infrared"):
        seen(drive, tmp_path)


@pytest.mark.parametrize(
    "topic", ["/camera/depth/image_rect_raw", "/camera/aligned_depth_to_color/image_raw"]
)
def test_drawn_depth_is_no_photograph(tmp_path: Path, topic: str) -> None:
    drive = Drive()
    drive.image(topic, 1001, "rgb8", np.full((HEIGHT, WIDTH, 3), 9, "u1"))
    drive.image("/camera/color/image_raw", 1015, "rgb8", np.full((HEIGHT, WIDTH, 3), 80, "u1"))
    view, warnings = seen(drive, tmp_path)
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert ["drawing of depth" in one for one in warnings] == [True]


def test_colour_of_a_camera_called_depth_is_colour(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/depth_camera/depth/camera_info")
    drive.image("/depth_camera/depth/image_raw", 1005, "16UC1", depth_mm())
    drive.image("/depth_camera/image_raw", 1006, "rgb8", np.full((HEIGHT, WIDTH, 3), 80, "u1"))
    view, warnings = seen(drive, tmp_path)
    assert view.rgb[20, 20].tolist() == [80, 80, 80]
    assert not warnings


def test_a_rectified_image_whose_camera_has_no_p_is_named(tmp_path: Path) -> None:
    drive = Drive()
    drive.camera("/camera/depth_rectified/camera_info", d=BENT)
    drive.image("/camera/depth_rectified/image", 1005, "16UC1", depth_mm())
    view, warnings = seen(drive, tmp_path)
    assert (view.depth_m == view.depth_m[0, 0]).all()
    assert ["has no P" in one for one in warnings] == [True]


@pytest.mark.parametrize(
    ("k", "words"),
    [
        ([0.9, 0, 0.5, 0, 1.2, 0.5, 0, 0, 1], "are they in px"),
        ([6e7, 0, 31.5, 0, 6e7, 23.5, 0, 0, 1], "are they in px"),
        ([60.0, 0, 0, 0, 61, 0, 31.5, 23.5, 1], "row by row"),
    ],
)
def test_a_camera_that_is_not_described_row_by_row_in_pixels_is_refused(
    tmp_path: Path, k: Any, words: str
) -> None:
    drive = Drive()
    drive.camera("/camera/depth/camera_info", k=k)
    drive.image("/camera/depth/image_raw", 1005, "16UC1", depth_mm())
    with pytest.raises(CloudFormatError, match=words):
        seen(drive, tmp_path)
