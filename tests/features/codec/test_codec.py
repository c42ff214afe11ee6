"""Clouds on the wire: exact where promised, refused where damaged."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from features.codec import (
    Cloud,
    CloudFormatError,
    Limits,
    decode,
    encode_cloud,
    encode_frame,
    encode_octree,
    from_wire,
    to_wire,
)
from features.geometry import Frame, Intrinsics

CAMERA = Intrinsics.from_fov(64, 48, 1.2)


def _frame(seed: int = 0, depth_unit: float = 1e-4) -> Frame:
    """Return a smooth scene with holes, depth already on the codec's grid."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:48, :64]
    depth = np.round((0.3 + 0.001 * u + 0.0005 * v) / depth_unit) * depth_unit
    depth[rng.random(depth.shape) < 0.1] = 0
    rgb = np.stack([4 * u % 256, 5 * v % 256, (u + v) % 256], -1).astype(np.uint8)
    return Frame(
        depth.astype(np.float32), CAMERA, rgb, depth > 0.33, frame_id="camera", stamp_s=1.5
    )


def test_depth_mask_and_camera_of_a_frame_come_back_exactly() -> None:
    frame = _frame()
    back = decode(encode_frame(frame))
    assert isinstance(back, Frame)
    # float32 rounding of a multiple of 0.1 mm
    np.testing.assert_allclose(back.depth_m, frame.depth_m, atol=1e-7)
    np.testing.assert_array_equal(back.mask, frame.mask)
    assert (back.intrinsics, back.frame_id, back.stamp_s) == (CAMERA, "camera", 1.5)


def test_colour_is_lossy_but_close() -> None:
    frame = _frame()
    back = decode(encode_frame(frame, quality=95))
    assert isinstance(back, Frame)
    assert back.rgb is not None
    # JPEG subsamples chroma; at quality 95 a smooth picture stays within a few levels on average
    assert np.abs(back.rgb.astype(int) - frame.rgb.astype(int)).mean() < 6


def test_a_crop_gives_the_same_points_as_the_whole_frame() -> None:
    frame = _frame()
    mask = np.zeros((48, 64), bool)
    mask[20:30, 30:45] = True
    back = decode(encode_frame(frame.crop(mask, margin_px=4)))
    points = back.points()
    expected = frame.points()[mask & (frame.depth_m > 0)]
    np.testing.assert_allclose(points[np.isfinite(points[..., 2])], expected, atol=1e-6)


def test_far_depth_is_kept_to_a_millimetre_and_beyond_the_range_refused() -> None:
    frame = Frame(np.full((4, 4), 9.1234, np.float32), Intrinsics(4, 4, 5, 5, 1.5, 1.5))
    back = decode(encode_frame(frame))
    assert isinstance(back, Frame)
    assert abs(float(back.depth_m[0, 0]) - 9.1234) <= 0.0005 + 1e-6
    with pytest.raises(ValueError, match=r"65\.5 m, got 70"):
        encode_frame(Frame(np.full((4, 4), 70, np.float32), Intrinsics(4, 4, 5, 5, 1.5, 1.5)))


@pytest.mark.parametrize("keep_order", [True, False])
def test_a_cloud_comes_back_within_half_a_step(keep_order: bool) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-1, 1, (500, 3))
    colours = rng.integers(0, 256, (500, 3)).astype(np.uint8)
    back = decode(encode_cloud(points, colours, 0.001, keep_order=keep_order))
    assert isinstance(back, Cloud)
    if keep_order:
        assert np.abs(back.positions - points).max() <= 0.0005 + 1e-6
        np.testing.assert_array_equal(back.colours, colours)
    else:
        order = np.lexsort(np.round(back.positions, 3).T)
        assert len(order) == 500
        assert {tuple(c) for c in back.colours} == {tuple(c) for c in colours}


def test_a_cloud_of_seventy_metres_and_identical_points_survive() -> None:
    points = np.array([[0, 0, 0], [70, 0, 0], [70, 0, 0], [0, -70, 35.0]])
    back = decode(encode_cloud(points))
    assert np.abs(back.positions - points).max() <= 0.0005 + 1e-5  # float32 at 70 m


def test_not_finite_points_are_dropped_and_an_empty_cloud_is_one() -> None:
    points = np.array([[np.nan, 0, 0], [0, np.inf, 0], [1, 2, 3.0]])
    assert len(decode(encode_cloud(points))) == 1
    assert len(decode(encode_cloud(np.zeros((0, 3))))) == 0


def test_the_same_input_gives_the_same_bytes() -> None:
    assert encode_frame(_frame()) == encode_frame(_frame())


@pytest.mark.parametrize("wrap", [zlib.compress, zstandard.ZstdCompressor().compress])
def test_one_layer_of_compression_is_opened_and_two_are_refused(wrap) -> None:
    data = encode_frame(_frame())
    assert isinstance(decode(wrap(data)), Frame)
    with pytest.raises(CloudFormatError, match="twice"):
        decode(wrap(wrap(data)))


def test_base64_in_every_spelling() -> None:
    data = bytes(range(256))
    text = to_wire(data)
    assert from_wire(text) == data
    assert from_wire(text.replace("+", "-").replace("/", "_").rstrip("=")) == data
    assert from_wire("\n".join(text[i : i + 60] for i in range(0, len(text), 60))) == data
    assert from_wire(data) == data
    with pytest.raises(CloudFormatError, match="not base64"):
        from_wire("!!!!")


def test_the_payload_printed_in_the_thesis_is_no_cloud() -> None:
    """Gatto 2016, 3.2.4 prints a cut-off payload."""
    with pytest.raises(CloudFormatError, match="not a point cloud: starts with cd ce 69"):
        decode(from_wire("zc5p81H1cO8P+Ksmfdf"))


PLY_HEAD = "ply\nformat {} 1.0\ncomment x\nelement vertex 2\nproperty float x\nproperty float y\n" \
    "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n" \
    "element face 0\nproperty list uchar int vertex_index\nend_header\n"  # fmt: skip


_ROWS = (1, 2, 3, 4, 5, 6, -1, -2, -3, 7, 8, 9)


@pytest.mark.parametrize(
    ("order", "body"),
    [
        ("ascii", b"1 2 3 4 5 6\n-1 -2 -3 7 8 9\n"),
        ("binary_little_endian", struct.pack("<fffBBBfffBBB", *_ROWS)),
        ("binary_big_endian", struct.pack(">fffBBBfffBBB", *_ROWS)),
    ],
)
def test_ply_in_three_forms(order: str, body: bytes) -> None:
    cloud = decode(PLY_HEAD.format(order).encode() + body)
    assert cloud.positions.tolist() == [[1, 2, 3], [-1, -2, -3]]
    assert cloud.colours.tolist() == [[4, 5, 6], [7, 8, 9]]
    with pytest.raises(CloudFormatError, match=r"cut off|not 6 numbers"):
        decode(PLY_HEAD.format(order).encode() + body[:-5])


@pytest.mark.slow
def test_pcd_written_by_another_library(tmp_path) -> None:
    """Open3D writes what PCL reads: all three kinds of data."""
    o3d = pytest.importorskip("open3d")
    points = np.random.default_rng(2).uniform(-1, 1, (200, 3))
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.colors = o3d.utility.Vector3dVector(np.full((200, 3), [1.0, 0.0, 0.5]))
    for ascii_, compressed in ((True, False), (False, False), (False, True)):
        path = tmp_path / f"{ascii_}{compressed}.pcd"
        o3d.io.write_point_cloud(str(path), cloud, write_ascii=ascii_, compressed=compressed)
        back = decode(path.read_bytes())
        np.testing.assert_allclose(back.positions, points, atol=1e-6)
        assert back.colours[0].tolist() in ([255, 0, 127], [255, 0, 128])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no bytes"),
        (b"\x89PNG\r\n\x1a\n", "an image, not a cloud"),
        (b"RTKC\x02\x01\0\0\0\0\0\0", "version 2"),
        (b"RTKC\x01\x01\0\0\xff\xff\xff\xff", "does not fit"),
        (b"hello world", "starts with 68 65 6c 6c"),
    ],
)
def test_what_is_no_cloud_is_named(data: bytes, message: str) -> None:
    with pytest.raises(CloudFormatError, match=message):
        decode(data)


def test_an_unknown_section_is_skipped() -> None:
    data = encode_frame(_frame())
    extra = struct.pack("<BBHIII", 99, 0, 0, 3, 3, zlib.crc32(b"new")) + b"new"
    assert isinstance(decode(data + extra), Frame)


def test_bombs_are_refused_before_they_are_unpacked() -> None:
    bomb = zstandard.ZstdCompressor().compress(b"\0" * 50_000_000)
    with pytest.raises(CloudFormatError, match=r"more than 1000 times|unpack"):
        decode(bomb)
    with pytest.raises(CloudFormatError, match=r"unpack"):
        decode(zlib.compress(b"\0" * 50_000_000), Limits(decoded_bytes=1_000_000))
    with pytest.raises(CloudFormatError, match="at most 10 are accepted"):
        decode(encode_cloud(np.zeros((11, 3))), Limits(points=10))
    with pytest.raises(CloudFormatError, match="px"):
        decode(encode_frame(_frame()), Limits(side_px=10))


def test_every_truncation_is_refused() -> None:
    data = encode_frame(_frame().crop(_frame().depth_m > 0.35))
    for end in range(len(data)):
        with pytest.raises(CloudFormatError):
            decode(data[:end])


_SMALL = [encode_frame(_frame()), encode_cloud(np.random.default_rng(0).random((50, 3)))]


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(_SMALL), st.integers(0, 10**6), st.integers(0, 7))
def test_a_flipped_bit_is_refused_or_harmless(data: bytes, where: int, bit: int) -> None:
    damaged = bytearray(data)
    damaged[where % len(data)] ^= 1 << bit
    try:
        found = decode(bytes(damaged))
    except CloudFormatError:
        return
    assert isinstance(found, Frame | Cloud)


def test_an_octree_keeps_every_occupied_voxel_and_its_mean_colour() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-0.2, 0.2, (2_000, 3))
    colours = rng.integers(0, 256, (2_000, 3)).astype(np.uint8)
    voxel = 0.02
    back = decode(encode_octree(points, colours, voxel))
    assert isinstance(back, Cloud)
    cells = np.floor((points - points.min(axis=0)) / voxel).astype(int)
    found = np.round((back.positions - points.min(axis=0)) / voxel - 0.5).astype(int)
    assert {tuple(c) for c in cells} == {tuple(c) for c in found}
    assert len(found) == len({tuple(c) for c in found})
    assert back.colours is not None
    for cell, colour in zip(found[:20], back.colours[:20], strict=True):
        expected = colours[(cells == cell).all(axis=1)].mean(axis=0)
        np.testing.assert_allclose(colour, expected, atol=0.5001)  # rounded to whole levels


@pytest.mark.parametrize("count", [0, 1, 2])
def test_octrees_of_hardly_any_points(count: int) -> None:
    points = np.arange(3.0 * count).reshape(count, 3)
    back = decode(encode_octree(points, None, 0.001))
    assert len(back) == count
    if count:
        assert np.abs(np.sort(back.positions, axis=0) - points).max() <= 0.0005 + 1e-6


def test_an_octree_that_promises_too_much_is_refused() -> None:
    data = bytearray(encode_octree(np.random.default_rng(0).random((100, 3)), None, 0.01))
    at = bytes(data).find(b'"levels":7')
    assert at > 0
    data[at : at + 10] = b'"levels":9'
    with pytest.raises(CloudFormatError, match="octree"):
        decode(bytes(data))
    with pytest.raises(ValueError, match="use a larger voxel_m"):
        encode_octree(np.array([[0, 0, 0], [70.0, 0, 0]]), None, 1e-5)
    with pytest.raises(CloudFormatError, match="Draco"):
        decode(b"DRACO\x02\x02")


@pytest.mark.parametrize("kind", ["cloud", "octree"])
def test_a_cloud_cut_off_or_changed_anywhere_is_refused_or_read(kind: str) -> None:
    points = np.random.default_rng(5).random((60, 3))
    encode = {"cloud": encode_cloud, "octree": encode_octree}[kind]
    data = encode(points, np.full((60, 3), 7, np.uint8), 0.01)
    for cut in range(len(data)):
        with pytest.raises(CloudFormatError):
            decode(data[:cut])
    rng = np.random.default_rng(6)
    for _ in range(500):
        broken = bytearray(data)
        broken[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        try:
            decode(bytes(broken))
        except CloudFormatError:
            continue


def test_a_frame_without_pixels_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot encode"):
        encode_frame(Frame(np.empty((0, 0), np.float32), Intrinsics(1, 1, 1.0, 1.0, 0.0, 0.0)))
