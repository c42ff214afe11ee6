"""What nothing says is said to be assumed, or refused: cameras, units, orientation, rows."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from features.codec.image_header import stored_orientation
from features.codec.pcd import write_pcd
from features.geometry import Frame
from features.imaging.placed import in_sensor_frame
from rtask.cli.perception.scene_file import read_view
from rtask.cli.perception.view_options import View
from rtask.errors import DataError, RtaskError, UsageError
from rtask.interop.ros.clouds import frame_of_images
from tests.features.imaging.table_seen import BASE_FROM_CAMERA, CAMERA, depth_of_table, in_base
from tests.features.imaging.table_seen import points_of_table as points_seen

HEIGHT, WIDTH = CAMERA.height, CAMERA.width
STEPS = np.rint(1000 * depth_of_table()).astype(np.uint16)
MIDDLE_M = float(np.median(STEPS[STEPS > 0])) / 1000
COLOUR = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
NUMBERS = {"width": WIDTH, "height": HEIGHT, "fx": 140.0, "fy": 140.0, "cx": 79.0, "cy": 60.5}
K = [140.0, 0, 79.0, 0, 140.0, 60.5, 0, 0, 1]


def exif(orientation: int) -> bytes:
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, orientation, 0)
    return b"MM\0*\0\0\0\x08\0\x01" + entry + bytes(4)


def turned_png(image: np.ndarray, orientation: int) -> bytes:
    data = cv2.imencode(".png", image)[1].tobytes()
    chunk = b"eXIf" + exif(orientation)
    framed = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return data[:33] + framed + data[33:]


def turned_jpeg(image: np.ndarray, orientation: int) -> bytes:
    data = cv2.imencode(".jpg", image)[1].tobytes()
    segment = b"Exif\0\0" + exif(orientation)
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + data[2:]


def middle(seen: Any) -> float:
    assert isinstance(seen, Frame)
    return float(np.median(seen.depth_m[seen.depth_m > 0]))


class Files:
    """Reads files as commands do, and keeps what was said."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self._capsys = folder, capsys

    def write(self, name: str, data: bytes | np.ndarray) -> Path:
        file = self.folder / name
        if isinstance(data, bytes):
            file.write_bytes(data)
        else:
            assert cv2.imwrite(str(file), data)
        return file

    def read(self, file: Path, **options: Any) -> tuple[Any, str]:
        seen = read_view(file, View(**options))
        return seen, self._capsys.readouterr().err


@pytest.fixture
def files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Files:
    return Files(tmp_path, capsys)


def test_a_depth_image_that_nothing_describes_says_what_is_assumed(files: Files) -> None:
    file = files.write("depth.png", STEPS)
    seen, said = files.read(file)
    assert seen.intrinsics.fx == pytest.approx(525 / 640 * WIDTH)
    assert "63 degrees across" in said
    assert "steps of 1 mm are taken; --depth-unit says it" in said
    with pytest.raises(UsageError, match=r"depth.png: nothing says which camera"):
        files.read(file, is_stored=True)
    camera = files.write("camera.json", json.dumps(NUMBERS).encode())
    for told in ({"camera": camera}, {"focal": 140.0}):
        seen, said = files.read(file, is_stored=True, depth_unit_m=0.001, **told)
        assert seen.intrinsics.fx == 140.0
        assert said == ""


def test_the_numbers_of_a_camera_of_another_image_are_doubted_in_files_too(files: Files) -> None:
    file = files.write("depth.png", STEPS)
    off = NUMBERS | {"cx": 159.0, "cy": 121.0}
    _, said = files.read(file, camera=files.write("off.json", json.dumps(off).encode()))
    assert "K or P of another size" in said
    rectified = {"width": WIDTH, "height": HEIGHT, "k": K, "d": [0.05, 0, 0, 0, 0]}
    rectified["p"] = [150.0, 0, 79, 0, 0, 150.0, 60, 0, 0, 0, 1, 0]
    _, said = files.read(file, camera=files.write("p.json", json.dumps(rectified).encode()))
    assert "taken for raw and straightened" in said
    binned = {"width": 2 * WIDTH, "height": 2 * HEIGHT, "d": [], "binning_x": 2, "binning_y": 2}
    binned["k"] = [280.0, 0, 158.5, 0, 280.0, 121.5, 0, 0, 1]
    seen, _ = files.read(file, camera=files.write("b.json", json.dumps(binned).encode()))
    assert (seen.intrinsics.fx, seen.intrinsics.cx) == (140.0, 79.0)


@pytest.mark.parametrize(
    ("numbers", "unit_m", "words"),
    [
        (STEPS / np.float32(1000), None, "metres are taken"),
        (STEPS / np.float64(1000), None, "metres are taken"),
        (STEPS.astype(np.float32), 0.001, ""),
        (STEPS.astype(np.int16), 0.001, ""),
    ],
    ids=["float32", "float64", "millimetres of float32", "int16"],
)
def test_a_tiff_of_any_numbers_is_depth(
    files: Files, numbers: np.ndarray, unit_m: float | None, words: str
) -> None:
    seen, said = files.read(files.write("d.tiff", numbers), focal=140.0, depth_unit_m=unit_m)
    assert middle(seen) == pytest.approx(MIDDLE_M, abs=0.001)
    assert words in said
    assert bool(said) is bool(words)


def test_a_tiff_of_32_bits_without_decimals_is_refused(files: Files) -> None:
    with pytest.raises(RtaskError):
        files.read(files.write("d.tiff", STEPS.astype(np.int32)), focal=140.0)


@pytest.mark.parametrize(("of_depth", "of_colour"), [(3, 1), (1, 6), (3, 3), (1, 1)])
def test_an_orientation_that_one_of_two_pictures_says_is_told(
    files: Files, of_depth: int, of_colour: int
) -> None:
    depth = files.write("depth.png", turned_png(STEPS, of_depth))
    colour = files.write("colour.jpg", turned_jpeg(COLOUR, of_colour))
    seen, said = files.read(depth, colour=colour, focal=140.0, depth_unit_m=0.001)
    assert seen.rgb.shape == COLOUR.shape
    assert ("depth.png: its EXIF" in said) is (of_depth != of_colour and of_depth > 1)
    assert ("colour.jpg: its EXIF" in said) is (of_depth != of_colour and of_colour > 1)


def test_an_orientation_is_found_where_formats_keep_it() -> None:
    assert stored_orientation(turned_png(STEPS, 6)) == 6
    assert stored_orientation(turned_jpeg(COLOUR, 8)) == 8
    for data in (turned_png(STEPS, 6), turned_jpeg(COLOUR, 8)):
        for end in range(60):  # cut off anywhere, nothing else is made up
            assert stored_orientation(data[:end]) in (1, stored_orientation(data))


def ply(points: np.ndarray, unit_m: float = 1.0) -> bytes:
    flat = points.reshape(-1, 3)
    rows = (flat[np.isfinite(flat).all(axis=1)] / unit_m).astype("<f4")
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\n{axes}end_header\n"
    return head.encode() + rows.tobytes()


def pcd(points: np.ndarray, shape: tuple[int, int]) -> bytes:
    table = {axis: points[..., k].ravel().astype("<f4") for k, axis in enumerate("xyz")}
    return write_pcd(table, shape)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (ply(points_seen(), 0.001), "another unit"),
        (ply(points_seen(), 0.01), "another unit"),
        (ply(points_seen(), 0.0254), "another unit"),
        (ply(points_seen(), 0.1), "another unit"),
        (ply(in_base(points_seen())), "is z forward"),
        (pcd(points_seen(0), (2 * HEIGHT, WIDTH // 2)), "rows cut elsewhere"),
        (pcd(points_seen(), (WIDTH, HEIGHT)), "taken to be exchanged"),
    ],
    ids=["mm", "cm", "inch", "dm", "base", "other rows", "exchanged"],
)
def test_a_cloud_that_is_not_as_assumed_is_refused_or_said(
    files: Files, data: bytes, words: str
) -> None:
    try:
        said = files.read(files.write("cloud", data))[1]
    except DataError as error:
        said = str(error)
    assert words in said


def image(
    pixels: np.ndarray, encoding: str, stamp_s: int = 10, frame: str = "c", **more: Any
) -> Any:
    rows = np.ascontiguousarray(pixels).reshape(len(pixels), -1).view("u1")
    header = {"frame_id": frame, "stamp": {"sec": stamp_s, "nanosec": 0}}
    message = {"header": header, "height": HEIGHT, "width": WIDTH, "encoding": encoding}
    return message | {"step": rows.shape[1], "data": rows.tobytes()} | more


def info(**more: Any) -> dict[str, Any]:
    message = {"header": {"frame_id": "c"}, "width": WIDTH, "height": HEIGHT, "k": K, "d": []}
    return message | more


def padded(pixels: np.ndarray, to: int) -> dict[str, Any]:
    wide = np.pad(pixels.view("u1").reshape(HEIGHT, -1), ((0, 0), (0, to - 2 * WIDTH)))
    return image(pixels, "16UC1") | {"step": to, "data": wide.tobytes()}


BINNED = info(
    width=2 * WIDTH, height=2 * HEIGHT, k=[280.0, 0, 158.5, 0, 280.0, 121.5, 0, 0, 1],
    binning_x=2, binning_y=2,
)  # fmt: skip
CUT = info(
    width=2 * WIDTH, height=2 * HEIGHT, k=[140.0, 0, 109.0, 0, 140.0, 80.5, 0, 0, 1],
    roi={"x_offset": 30, "y_offset": 20, "width": WIDTH, "height": HEIGHT},
)  # fmt: skip


@pytest.mark.parametrize(
    ("depth", "described"),
    [
        (image(STEPS.astype(">u2"), "16UC1", is_bigendian=1), info()),
        (padded(STEPS, 2 * WIDTH + 64), info()),
        (image(STEPS / 1000.0, "64FC1"), info()),
        (image(STEPS.astype("<i2"), "16SC1"), info()),
        (image(STEPS, "16UC1"), BINNED),
        (image(STEPS, "16UC1"), CUT),
        *((image(STEPS, "16UC1"), info(d=[1e-9] * n)) for n in (4, 5)),
        *(
            (image(STEPS, "16UC1"), info(d=[1e-9] * n, distortion_model="rational_polynomial"))
            for n in (8, 12, 14)
        ),
    ],
)
def test_depth_that_says_how_it_is_meant_is_read_so(
    depth: dict[str, Any], described: dict[str, Any]
) -> None:
    seen = frame_of_images(depth, image(COLOUR, "rgb8"), described)
    assert middle(seen) == pytest.approx(MIDDLE_M, abs=0.002)
    assert seen.intrinsics.fx == pytest.approx(140.0)
    assert seen.intrinsics.cx == pytest.approx(79.0)
    assert not seen.doubts


@pytest.mark.parametrize(
    ("depth", "described", "words"),
    [
        (image(STEPS, "16UC1"), info(k=[140.0, 0, 0, 0, 140.0, 0, 79.0, 60.5, 1]), "row by row"),
        (image(STEPS, "16UC1"), info(k=[140.0, 9, 79, 0, 140.0, 60.5, 0, 0, 1]), "row by row"),
        (image(STEPS, "16UC1"), info(width=WIDTH, height=WIDTH), "it describes 160x160"),
        (image(STEPS, "16UC1"), info(d=[0.1] * 6), "6 coefficients"),
        (image(STEPS, "16UC1"), info(d=[0.1] * 5, distortion_model="equidistant"), "has 4"),
        (image(STEPS, "16UC1"), info(d=[0.1] * 4, distortion_model="omni"), "is not known"),
        (image(STEPS, "16UC1", height=0, width=0, data=b""), info(), "0x0"),
        (image(STEPS, "16UC1", step=100), info(), "are not 160x120"),
        (image(STEPS.astype("<i4"), "32SC1"), info(), "32SC1"),
    ],
)
def test_depth_that_cannot_be_as_described_is_refused(
    depth: dict[str, Any], described: Mapping[str, Any], words: str
) -> None:
    with pytest.raises(DataError, match=words):
        frame_of_images(depth, image(COLOUR, "rgb8"), described)


@pytest.mark.parametrize(
    ("depth", "colour", "words"),
    [
        (image(STEPS, "16UC1"), image(COLOUR, "rgb8", frame="rgb"), "taken for registered"),
        (image(STEPS, "16UC1"), image(COLOUR, "rgb8", 99), "89 s from its depth"),
        (image(STEPS << 3, "16UC1"), image(COLOUR, "rgb8"), "multiple of 8"),
        (image(STEPS.astype(np.float32), "32FC1"), image(COLOUR, "rgb8"), "another unit"),
        (image(STEPS.astype(">u2"), "16UC1"), image(COLOUR, "rgb8"), "is_bigendian wrong"),
    ],
)
def test_depth_and_colour_that_may_not_belong_together_are_doubted(
    depth: dict[str, Any], colour: dict[str, Any], words: str
) -> None:
    said = " ".join(frame_of_images(depth, colour, info()).doubts)
    assert words in said
    if "frame" in words or "registered" in words:
        assert not frame_of_images(depth, colour, info(), is_registered=True).doubts


def placed_pcd(points: np.ndarray) -> bytes:
    """Return a PCD whose VIEWPOINT places the camera of the table."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(BASE_FROM_CAMERA[:3, :3]).as_quat()
    at = " ".join(f"{n:.9g}" for n in (*BASE_FROM_CAMERA[:3, 3], w, x, y, z))
    return pcd(points, points.shape[:2]).replace(
        b"VIEWPOINT 0 0 0 1 0 0 0", f"VIEWPOINT {at}".encode()
    )


def near(points: np.ndarray) -> np.ndarray:
    """Return the points of the box and a little of the table, others as not measured."""
    out = points.copy()
    out[(np.abs(in_base(points)[..., :2]) > 0.1).any(axis=-1)] = np.nan
    return out


@pytest.mark.parametrize("place", [np.copy, in_base], ids=["of the sensor", "placed"])
def test_the_viewpoint_of_one_object_is_applied_once(
    place: Callable[[np.ndarray], np.ndarray],
) -> None:
    from features.codec import decode

    points = near(points_seen())
    seen = in_sensor_frame(decode(placed_pcd(place(points))))  # type: ignore[arg-type]
    want = points[np.isfinite(points).all(axis=-1)]
    assert np.allclose(np.nanmean(seen.positions, axis=0), want.mean(axis=0), atol=1e-4)


def test_a_request_that_says_where_the_sensor_is_counts_instead_of_viewpoint() -> None:
    from rtask.engine.perception.observation import OptionalLook, observe

    data = placed_pcd(near(points_seen()))
    middles = []
    for pose in (None, BASE_FROM_CAMERA):
        seen = observe(OptionalLook(data=data, frame_id="base_link", sensor_pose=pose))
        middles.append(seen.points.mean(axis=0))
    assert np.allclose(middles[0], middles[1], atol=1e-4)
    assert np.allclose(middles[0][:2], 0, atol=0.1)  # at the origin, where the box stands


def test_a_cloud_over_http_is_read_in_the_frame_of_its_camera(compiled_kernels: None) -> None:
    from rtask.services.builtin.segmentation import Segmentation

    service = Segmentation()
    centroids = []
    for points in (points_seen(), in_base(points_seen()), points_seen() * [1, -1, -1]):
        answer = service.segment(pcd(points, points.shape[:2]))
        assert answer.status == "ok"
        centroids.append(answer.objects[0].centroid)
        assert bool(answer.doubts) is (len(centroids) > 1)
    assert np.allclose(centroids[1], centroids[0], atol=0.003)
    assert np.allclose(centroids[2], centroids[0], atol=0.003)
