"""Files and messages of cameras and other programs, in the spellings that occur."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from features.codec import CloudFormatError, decode
from features.codec.compressed_depth import decode_compressed_depth, decode_rvl
from features.codec.image_header import image_size
from features.codec.ros import image_bytes, pcd_from_point_cloud, pixels_of_image
from features.imaging.doubts import implausible_cloud
from features.imaging.photo import read_photo
from features.imaging.pictures import depth_of_message
from features.imaging.selection import view_of_photo

DEPTH_M = np.linspace(0.5, 1.5, 12, dtype=np.float32).reshape(3, 4)


def _png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


_SMALL = _png(np.ones((2, 2), np.uint16))


def _inverse(depth_m: np.ndarray, a: float = 1_000.0, b: float = -10.0) -> bytes:
    """Return depth as compressed_depth_image_transport writes 32FC1: a / depth + b, 0 = missing."""
    values = np.where(depth_m > 0, np.rint(a / np.maximum(depth_m, 1e-9) + b), 0)
    return struct.pack("<iff", 0, a, b) + _png(values.astype(np.uint16))


def test_compressed_depth_of_floats_is_inverse_depth() -> None:
    depth = DEPTH_M.copy()
    depth[1, 2] = 0
    message = {"format": "32FC1; compressedDepth png", "data": _inverse(depth)}
    read = depth_of_message(message, is_depth_topic=False)
    # A step of the quantisation is depth squared / a: 2.25 mm at 1.5 m, half of it at most.
    assert np.allclose(read, depth, atol=0.0012)
    assert read[1, 2] == 0


def test_compressed_depth_of_whole_numbers_is_millimetres() -> None:
    stored = struct.pack("<iff", 0, 0.0, 0.0) + _png((DEPTH_M * 1000).astype(np.uint16))
    read = decode_compressed_depth("16UC1; compressedDepth", stored)
    assert np.allclose(read, DEPTH_M, atol=0.001)


@pytest.mark.parametrize(
    ("text", "data", "why"),
    [
        ("32FC1; compressedDepth", _png(np.ones((2, 2), np.uint16)), "inverse depth"),
        ("32FC1; compressedDepth", struct.pack("<iff", 0, np.nan, 0) + _SMALL, "inverse depth"),
        ("rgb8; compressedDepth", b"\0" * 20, "is not depth"),
        ("16UC1; compressedDepth", b"\0" * 5, "cut off within its header"),
        ("16UC1; compressedDepth", b"\0" * 12 + _png(np.ones((2, 2), np.uint8)), "no PNG of 16"),
    ],
)
def test_compressed_depth_that_cannot_be_told_is_refused(text: str, data: bytes, why: str) -> None:
    with pytest.raises(CloudFormatError, match=why):
        decode_compressed_depth(text, data)


def _rvl(image: np.ndarray) -> bytes:
    """Write RVL (Wilson 2017): runs of zeros and of differences, numbers in nibbles."""
    flat = [int(value) for value in image.ravel()]
    nibbles: list[int] = []

    def put(number: int) -> None:
        while True:
            number, low = number >> 3, number & 7
            nibbles.append(low | (8 if number else 0))
            if not number:
                return

    at, before = 0, 0
    while at < len(flat):
        start = at
        while at < len(flat) and flat[at] == 0:
            at += 1
        put(at - start)
        end = at
        while end < len(flat) and flat[end]:
            end += 1
        put(end - at)
        for value in flat[at:end]:
            step = value - before
            put(2 * step if step >= 0 else -2 * step - 1)
            before = value
        at = end
    nibbles += [0] * (-len(nibbles) % 8)
    digits = "".join(f"{nibble:x}" for nibble in nibbles)
    words = [int(digits[k : k + 8], 16) for k in range(0, len(digits), 8)]
    return struct.pack(f"<ii{len(words)}I", *image.shape[::-1], *words)


def test_rvl_depth_comes_back_exactly_and_its_truncations_are_refused() -> None:
    depth = np.random.default_rng(4).integers(0, 9_000, (9, 13)).astype(np.uint16)
    depth[depth < 3_000] = 0
    stored = _rvl(depth)
    assert np.array_equal(decode_rvl(stored), depth)
    assert np.array_equal(decode_rvl(_rvl(depth * 0)), depth * 0)
    for length in range(0, len(stored) - 8, 4):
        with pytest.raises(CloudFormatError, match="RVL"):
            decode_rvl(stored[:length])


def test_inverse_depth_behind_the_camera_is_no_measurement() -> None:
    stored = struct.pack("<iff", 0, 100.0, 2_000.0) + _png(np.full((2, 3), 1_000, np.uint16))
    assert not decode_compressed_depth("32FC1; compressedDepth", stored).any()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        # Two values after no zeros: 70,000 and one less; then -1 and one less.
        ((0x028CB9A4, 0x10000000), "fit into 16 bits"),
        ((0x02110000,), "fit into 16 bits"),
        ((0x02FFFFFF, 0xFFFFFFF1), "nibbles"),
    ],
)
def test_rvl_beyond_16_bits_is_damaged_and_not_wrapped(words: tuple[int, ...], why: str) -> None:
    with pytest.raises(CloudFormatError, match=why):
        decode_rvl(struct.pack(f"<ii{len(words)}I", 2, 1, *words))


@pytest.mark.parametrize(
    ("encoding", "is_depth_topic", "is_depth"),
    [("mono16", True, True), ("mono16", False, False), ("16UC1", False, True)],
)
def test_grey_of_16_bits_is_depth_only_where_something_says_so(
    encoding: str, is_depth_topic: bool, is_depth: bool
) -> None:
    data = np.full((2, 3), 900, "<u2").tobytes()
    message = {"height": 2, "width": 3, "encoding": encoding, "step": 6, "data": data}
    read = depth_of_message(message, is_depth_topic)
    assert (read is not None) is is_depth


def _bayer(rgb: np.ndarray, first_row: str, second_row: str) -> np.ndarray:
    mosaic = np.zeros(rgb.shape[:2], np.uint8)
    for row, letters in enumerate((first_row, second_row)):
        for column, letter in enumerate(letters):
            mosaic[row::2, column::2] = rgb[row::2, column::2, "rgb".index(letter)]
    return mosaic


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_become_colours(pattern: str) -> None:
    rgb = np.full((8, 8, 3), (200, 60, 20), np.uint8)
    data = _bayer(rgb, pattern[:2], pattern[2:]).tobytes()
    message = {"height": 8, "width": 8, "encoding": f"bayer_{pattern}8", "step": 8, "data": data}
    assert pixels_of_image(message)[4, 4].tolist() == [200, 60, 20]


@pytest.mark.parametrize(("encoding", "luma"), [("yuv422", 1), ("yuv422_yuy2", 0)])
def test_yuv_becomes_colours(encoding: str, luma: int) -> None:
    rows = np.full((4, 4, 2), 128, np.uint8)
    rows[..., luma] = 235  # white of ITU-R BT.601; OpenCV rounds by at most two
    message = {"height": 4, "width": 4, "encoding": encoding, "step": 8, "data": rows.tobytes()}
    assert pixels_of_image(message).min() >= 253


@pytest.mark.parametrize(
    ("kind", "code", "scale"), [("f4", 7, 255), ("f4", 7, 1), ("u1", 2, 1), ("u4", 6, 1)]
)
def test_a_point_cloud_with_colours_in_three_fields_keeps_them(
    kind: str, code: int, scale: int
) -> None:
    formats = ["<f4"] * 3 + [f"<{kind}"] * 3
    offsets = [0, 4, 8, 12, 16, 20]
    layout = np.dtype({"names": list("xyzrgb"), "formats": formats, "offsets": offsets,
                       "itemsize": 24})  # fmt: skip
    rows = np.zeros(2, layout)
    rows["z"] = 0.7
    for channel, value in zip("rgb", (255, 51, 0), strict=True):
        rows[channel] = value / scale
    fields = [
        {"name": name, "offset": offset, "datatype": 7 if name in "xyz" else code, "count": 1}
        for name, offset in zip("xyzrgb", offsets, strict=True)
    ]
    message = {"height": 1, "width": 2, "fields": fields, "point_step": 24, "row_step": 48,
               "data": rows.tobytes()}  # fmt: skip
    assert decode(pcd_from_point_cloud(message)).colours.tolist() == [[255, 51, 0]] * 2


@pytest.mark.parametrize(
    ("names", "kind", "scale"),
    [
        ("red green blue", "float", 1), ("red green blue", "uchar", 255),
        ("r g b", "float", 255), ("red green blue", "ushort", 65_535),
        ("diffuse_red diffuse_green diffuse_blue", "int", 255),
    ],
)  # fmt: skip
def test_colours_of_a_ply_are_read_in_whatever_scale(names: str, kind: str, scale: int) -> None:
    properties = "".join(f"property {kind} {name}\n" for name in names.split())
    head = "ply\nformat ascii 1.0\nelement vertex 1\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    row = " ".join(str(value if kind == "float" else int(value)) for value in (scale, scale / 5, 0))
    cloud = decode(f"{head}{properties}end_header\n1 2 3 {row}\n".encode())
    assert cloud.colours.tolist() == [[255, 51, 0]]


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_the_lines_of_a_ply_may_end_with_cr_alone(order: str) -> None:
    head = f"ply\rformat {order} 1.0\relement vertex 2\r"
    head += "".join(f"property float {name}\r" for name in "xyz") + "end_header\r"
    # The bytes of the binary numbers hold a CR of their own.
    places = np.array([[1, 2, 3], np.frombuffer(b"\r\0\x80?" * 3, "<f4")], np.float32)
    text = "".join(" ".join(repr(float(x)) for x in row) + "\r" for row in places)
    body = text.encode() if order == "ascii" else places.tobytes()
    assert np.array_equal(decode(head.encode() + body).points(), places)


@pytest.mark.parametrize(
    ("field", "packed"),
    [("F 4", "4.210752e+06"), ("F 4", "5.90052e-39"), ("U 8", "4210752"), ("I 4", "4210752")],
)
def test_packed_colours_of_a_pcd_are_whole_numbers_or_their_bits(field: str, packed: str) -> None:
    kind, size = field.split()
    head = f"FIELDS x y z rgb\nSIZE 4 4 4 {size}\nTYPE F F F {kind}\nCOUNT 1 1 1 1\nWIDTH 1\n"
    cloud = decode(f"{head}HEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 3 {packed}\n".encode())
    assert np.abs(cloud.colours.astype(int) - 64).max() <= 1  # of the bits, five digits are written


@pytest.mark.parametrize("largest", [1.0001, 1.02, 255.0, 256.0])
def test_a_scale_of_colours_exceeded_by_a_little_darkens_nothing(largest: float) -> None:
    half = 0.5 if largest < 2 else 127.5
    head = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(
        f"property float {name}\n" for name in ("x", "y", "z", "Red", "Green", "Blue")
    )
    text = f"{head}comment ends at end_header\nend_header\n1 2 3 {largest} {half} 0\n"
    cloud = decode(text.encode())
    assert cloud.colours[0, 0] == 255
    assert abs(int(cloud.colours[0, 1]) - 128) <= 1


@pytest.mark.parametrize(("kind", "row"), [("F", "1 .2 0"), ("U", "255 51 0")])
def test_a_pcd_may_have_colours_in_three_fields(kind: str, row: str) -> None:
    text = (
        f"FIELDS x y z r g b\nSIZE 4 4 4 4 4 4\nTYPE F F F {kind} {kind} {kind}\nWIDTH 1\n"
        f"DATA ASCII\n1 2 3 {row}\n"
    )
    assert decode(text.encode()).colours.tolist() == [[255, 51, 0]]


def test_the_padding_of_the_point_cloud_library_is_passed_over() -> None:
    head = (
        "VERSION 0.7\nFIELDS x y z _ rgb _ normal\nSIZE 4 4 4 1 4 1 4\nTYPE F F F U U U F\n"
        "COUNT 1 1 1 4 1 12 3\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA binary\n"
    )
    body = struct.pack("<3f4xI12x3f", 1, 2, 3, 0xFF3300, 0, 0, 1)
    cloud = decode(head.encode() + body)
    assert cloud.positions.tolist() == [[1, 2, 3]]
    assert cloud.colours.tolist() == [[255, 51, 0]]


def test_the_old_compressed_rgb_has_red_and_blue_exchanged() -> None:
    # compressed_image_transport once gave RGB to an encoder of BGR, and said so in the format.
    data = _png(np.full((4, 4, 3), (200, 60, 20), np.uint8))
    for form, wanted in (
        ("rgb8; png compressed rgb8", [200, 60, 20]), ("rgb8; png compressed bgr8", [20, 60, 200]),
        ("png", [20, 60, 200]),
    ):  # fmt: skip
        read = read_photo(image_bytes({"format": form, "data": data}))
        assert read.rgb[1, 1].tolist() == wanted


@pytest.mark.parametrize(
    ("encoding", "pixel"),
    [("rgb16", (51_400, 15_420, 5_140)), ("bgra16", (5_140, 15_420, 51_400, 9))],
)
def test_colours_of_16_bits_become_8(encoding: str, pixel: tuple[int, ...]) -> None:
    data = np.full((2, 2, len(pixel)), pixel, "<u2").tobytes()
    message = {"height": 2, "width": 2, "encoding": encoding, "step": 0, "data": data}
    assert pixels_of_image(message)[1, 1].tolist() == [200, 60, 20]


@pytest.mark.parametrize(("bits", "stored"), [(10, 800), (12, 3_200), (14, 12_800)])
@pytest.mark.parametrize("encoding", ["rgb16", "bayer_rggb16"])
def test_colours_in_the_lowest_of_16_bits_are_not_black(
    encoding: str, bits: int, stored: int
) -> None:
    channels = 3 if encoding == "rgb16" else 1
    data = np.full((4, 4, channels), stored, "<u2")
    data[0, 0] = 2**bits - 1
    message = {
        "height": 4, "width": 4, "encoding": encoding, "step": 0, "data": data.tobytes()
    }  # fmt: skip
    assert pixels_of_image(message)[3, 3].tolist() == [200, 200, 200]


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("16UC1", np.array([[700, 65_535], [0, 700]], ">u2")),
        ("16SC1", np.array([[700, -1], [0, 700]], ">i2")),
        ("64FC1", np.array([[0.7, np.nan], [-np.inf, 0.7]], ">f8")),
    ],
)
def test_what_cameras_write_for_no_measurement_is_no_wall(
    encoding: str, pixels: np.ndarray
) -> None:
    message = {
        "height": 2, "width": 2, "encoding": encoding, "is_bigendian": 1, "step": 0,
        "data": pixels.tobytes(),
    }  # fmt: skip
    depth_m = depth_of_message(message, is_depth_topic=True)
    assert depth_m is not None
    assert depth_m.tolist() == pytest.approx(np.array([[0.7, 0], [0, 0.7]]), abs=1e-6)


def test_the_largest_number_of_compressed_depth_is_no_measurement() -> None:
    data = struct.pack("<iff", 0, 0, 0) + _png(np.array([[700, 65_535]], np.uint16))
    depth_m = decode_compressed_depth("16UC1; compressedDepth png", data)
    assert depth_m[0].tolist() == pytest.approx([0.7, 0])


def test_points_of_an_organised_file_at_its_viewpoint_were_not_measured() -> None:
    head = PCD.replace("WIDTH 1", "WIDTH 2").replace("HEIGHT 1", "HEIGHT 2")
    rows = head.format("VIEWPOINT 0 0 5 1 0 0 0\n").replace("POINTS 1", "POINTS 4")[:-6]
    cloud = decode((rows + "1 2 3\n0 0 0\nnan 0 1\n0 0 1\n").encode())
    assert cloud.positions.tolist() == [[1, 2, 8], [0, 0, 6]]
    assert cloud.is_organised


def test_points_of_a_cloud_at_its_origin_were_not_measured() -> None:
    points = np.array([[0.1, 0, 0.7], [0, 0, 0], [0, 0.2, 0.7]], "<f4")
    fields = [{"name": axis, "offset": 4 * k, "datatype": 7} for k, axis in enumerate("xyz")]
    message = {
        "height": 1, "width": 3, "fields": fields, "point_step": 12, "data": points.tobytes()
    }  # fmt: skip
    assert decode(pcd_from_point_cloud(message)).positions.tolist() == points[::2].tolist()


PCD = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\n{}POINTS 1\nDATA ascii\n1 2 3\n"


@pytest.mark.parametrize("start", ["# by hand\n", "\n# .PCD v0.5\n\n", "", "VERSION 0.7\n"])
def test_a_pcd_begins_with_any_comment_or_none(start: str) -> None:
    assert decode((start + PCD.format("")).encode()).positions.tolist() == [[1, 2, 3]]


def test_the_viewpoint_of_a_pcd_is_applied() -> None:
    half = np.sqrt(0.5)  # a quarter turn about z: x becomes y
    text = PCD.format(f"VIEWPOINT 10 0 0 {half} 0 0 {half}\n")
    # float32 holds 12 to 1e-6.
    assert np.allclose(decode(text.encode()).positions, [[8, 1, 3]], atol=1e-5)
    with pytest.raises(CloudFormatError, match="VIEWPOINT"):
        decode(PCD.format("VIEWPOINT 0 0 0 0 0 0 0\n").encode())


@pytest.mark.parametrize(
    "names", ["red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue"]
)
@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_a_ply_may_have_float_colours_lists_and_elements_before(names: str, order: str) -> None:
    colours = "".join(f"property float {name}\n" for name in names.split())
    head = (
        f"ply\nformat {order} 1.0\nelement extra 1\nproperty list uchar int ids\n"
        "element vertex 2\nproperty float x\nproperty list uchar int seen_by\nproperty float y\n"
        f"property float z\n{colours}end_header\n"
    )
    if order == "ascii":
        body = b"2 5 6\n1 3 7 8 9 2 3 1 .2 0\n4 0 5 6 1 .2 0\n"
    else:
        body = struct.pack("<Bii", 2, 5, 6)
        body += struct.pack("<fBiiifffff", 1, 3, 7, 8, 9, 2, 3, 1, 0.2, 0)
        body += struct.pack("<fBfffff", 4, 0, 5, 6, 1, 0.2, 0)
    cloud = decode(head.encode() + body)
    assert cloud.positions.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.colours.tolist() == [[255, 51, 0]] * 2
    with pytest.raises(CloudFormatError, match="PLY"):
        decode((head.encode() + body)[:-6])


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".webp", ".bmp", ".tiff"])
def test_pictures_of_each_format_are_read_within_bounds(suffix: str) -> None:
    image = np.full((30, 40, 3), (20, 60, 200), np.uint8)
    data = cv2.imencode(suffix, image)[1].tobytes()
    assert image_size(data) == (40, 30)
    # JPEG and WebP round colours.
    assert np.abs(read_photo(data).rgb.astype(int) - (200, 60, 20)).max() <= 6
    with pytest.raises(CloudFormatError):
        image_size(data[:12])


def test_fill_bytes_of_a_jpeg_and_a_tail_of_a_png_are_no_damage() -> None:
    image = np.full((8, 8, 3), 90, np.uint8)
    jpeg = cv2.imencode(".jpg", image)[1].tobytes()
    assert read_photo(jpeg[:2] + b"\xff\xff" + jpeg[2:]).rgb.shape == (8, 8, 3)
    assert read_photo(_png(image) + b"a note").rgb.shape == (8, 8, 3)


@pytest.mark.parametrize("suffix", [".png", ".webp", ".tiff", ".bmp"])
def test_transparent_pixels_are_no_part_of_the_object(suffix: str) -> None:
    image = np.random.default_rng(1).integers(0, 255, (60, 80, 4)).astype(np.uint8)
    image[..., 3] = 0
    image[10:50, 20:60, 3] = 255
    options = [cv2.IMWRITE_WEBP_QUALITY, 101] if suffix == ".webp" else []
    photo = read_photo(cv2.imencode(suffix, image, options)[1].tobytes())
    assert photo.opaque is not None
    assert photo.opaque.sum() == 40 * 40
    assert not photo.rgb[~photo.opaque].any()
    _, labels = view_of_photo(photo)
    assert np.array_equal(labels > 0, photo.opaque)


def test_a_cut_out_picture_is_turned_upright_with_its_mask() -> None:
    image = np.zeros((40, 60, 4), np.uint8)
    image[5:12, 20:50] = (10, 20, 200, 255)
    exif = b"MM\0*\0\0\0\x08" + struct.pack(">HHHIHHI", 1, 0x112, 3, 1, 6, 0, 0)
    kinds, parts = [cv2.IMAGE_METADATA_EXIF], [np.frombuffer(exif, np.uint8)]
    data = cv2.imencodeWithMetadata(".png", image, kinds, parts)[1].tobytes()
    photo = read_photo(data)
    # Orientation 6: to be turned by a quarter to the right.
    assert photo.opaque is not None
    assert np.array_equal(photo.opaque, np.rot90(image[..., 3] > 0, 3))
    assert photo.full_size == (40, 60)
    assert photo.rgb[photo.opaque][0].tolist() == [200, 20, 10]


def test_a_grey_that_a_png_declares_transparent_is_cut_away() -> None:
    grey = np.full((9, 9), 90, np.uint8)
    grey[2:5, 2:5] = 7
    data = _png(grey)
    chunk = b"tRNS" + struct.pack(">H", 7)
    chunk = struct.pack(">I", 2) + chunk + struct.pack(">I", zlib.crc32(chunk))
    at = data.index(b"IDAT") - 4
    photo = read_photo(data[:at] + chunk + data[at:])
    assert photo.opaque is not None
    assert np.array_equal(~photo.opaque, grey == 7)


def test_the_transparency_of_a_grey_tiff_is_not_passed_over() -> None:
    # Grey and alpha of 2 x 1 px: entries of width, height, bits, compression, meaning, strips.
    pixels = bytes((10, 255, 20, 0))
    entries = [(256, 2), (257, 1), (258, 8), (259, 1), (262, 1), (273, 8), (277, 2), (278, 1),
               (279, 4), (338, 2)]  # fmt: skip
    table = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in entries)
    directory = struct.pack("<H", len(entries)) + table + bytes(4)
    with pytest.raises(CloudFormatError, match="transparency"):
        read_photo(b"II*\0" + struct.pack("<I", 12) + pixels + directory)


def test_pictures_that_show_nothing_are_refused() -> None:
    with pytest.raises(CloudFormatError, match="every pixel"):
        read_photo(_png(np.zeros((4, 4, 4), np.uint8)))
    deep = np.full((4, 4), 900, np.uint16)
    # The last one is grey with alpha of 16 bits, whose pixels would be black in 8.
    rows = b"".join(b"\0" + row.tobytes() for row in np.dstack([deep, deep]).astype(">u2"))
    with_alpha = _png(np.zeros((4, 4), np.uint8))[:8] + b"".join(
        struct.pack(">I", len(part)) + kind + part + struct.pack(">I", zlib.crc32(kind + part))
        for kind, part in (
            (b"IHDR", struct.pack(">IIBBBBB", 4, 4, 16, 4, 0, 0, 0)),
            (b"IDAT", zlib.compress(rows)),
            (b"IEND", b""),
        )
    )
    pictures = [cv2.imencode(suffix, deep)[1].tobytes() for suffix in (".png", ".tiff")]
    for picture in (*pictures, with_alpha):
        with pytest.raises(CloudFormatError, match="depth or infrared"):
            read_photo(picture)


def test_a_cloud_in_millimetres_is_doubted() -> None:
    cloud = np.random.default_rng(2).uniform(-0.5, 0.5, (200, 3)).astype(np.float32)
    assert not implausible_cloud(cloud + np.float32(40))  # far off in a map, yet together
    assert "another unit" in implausible_cloud(cloud * 1000)
