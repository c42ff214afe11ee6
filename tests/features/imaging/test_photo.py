"""Photographs of any size, and the object in them."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from features.codec import CloudFormatError
from features.codec.image_header import is_half_floats, more_pictures
from features.codec.limits import Limits
from features.geometry import Frame, Intrinsics
from features.imaging.foreground import find_foreground
from features.imaging.photo import read_photo
from features.imaging.selection import chosen_object, frame_of_photo
from rtask.cli.perception.scene_file import read_image
from rtask.errors import DataError


def scene(height=300, width=400):
    """Return a picture of a printed box before a shelf, and the box's mask."""
    rng = np.random.default_rng(1)
    image = cv2.GaussianBlur(rng.integers(60, 120, (height, width, 3)).astype(np.uint8), (0, 0), 3)
    mask = np.zeros((height, width), bool)
    mask[height // 4 : 3 * height // 4, width // 3 : 2 * width // 3] = True
    image[mask] = (190, 60, 40)
    for _ in range(40):
        place = (int(rng.integers(width // 3 + 8, 2 * width // 3 - 8)),
                 int(rng.integers(height // 4 + 8, 3 * height // 4 - 8)))  # fmt: skip
        ink = [int(rng.integers(150, 255)), int(rng.integers(0, 80)), int(rng.integers(0, 80))]
        cv2.circle(image, place, int(rng.integers(2, 7)), ink, -1)
    return image, mask


def jpeg(image):
    return cv2.imencode(".jpg", image[..., ::-1])[1].tobytes()


@pytest.mark.slow
def test_a_large_photograph_is_read_at_a_fraction_of_its_resolution():
    image, _ = scene(3000, 4000)
    photo = read_photo(jpeg(image))
    assert photo.full_size == (4000, 3000)
    assert photo.rgb.shape == (1500, 2000, 3)
    assert photo.scale == 0.5
    assert np.abs(photo.rgb[750, 1000].astype(int) - image[1500, 2000]).max() < 40


def test_an_impossible_size_is_refused_before_anything_is_decoded():
    data = bytearray(cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes())
    data[16:24] = struct.pack(">II", 2**14, 2**14)
    with pytest.raises(CloudFormatError, match="px in all"):
        read_photo(bytes(data))
    with pytest.raises(CloudFormatError, match="no PNG, JPEG"):
        read_photo(b"GIF89a")


def test_the_object_is_told_from_the_background():
    image, mask = scene()
    found = find_foreground(image)
    assert (found & mask).sum() / (found | mask).sum() > 0.9
    assert np.array_equal(found, find_foreground(image))


def test_what_is_held_in_the_middle_is_kept_whole_though_part_of_it_looks_like_the_background():
    rng = np.random.default_rng(3)
    image = cv2.GaussianBlur(rng.integers(60, 120, (400, 300, 3)).astype(np.uint8), (0, 0), 3)
    image[60:170, 80:220], image[230:340, 80:220] = (200, 60, 30), (40, 60, 190)
    mask = np.zeros(image.shape[:2], bool)
    mask[60:340, 80:220] = True
    found = find_foreground(image)
    assert (found & mask).sum() > 0.95 * mask.sum()
    assert (found & ~mask).sum() < 0.1 * mask.sum()


def test_where_nothing_can_be_told_the_whole_box_is_kept():
    plain = np.full((100, 120, 3), 90, np.uint8)
    assert find_foreground(plain, [20, 10, 50, 60]).sum() == 50 * 60


@pytest.mark.slow
def test_a_mask_of_the_full_photograph_fits_the_reduced_one():
    image, mask = scene(3000, 4000)
    labels = np.where(mask, 5, 0).astype(np.int32)
    labels[:200, :200] = 2
    crop = frame_of_photo(read_photo(jpeg(image)), labels, label=5)
    assert max(crop.depth_m.shape) <= 1280
    assert crop.mask is not None
    assert crop.mask.mean() > 0.9
    with pytest.raises(CloudFormatError, match=r"no label 9; it has \[2, 5\]"):
        frame_of_photo(read_photo(jpeg(image)), labels, label=9)


@pytest.mark.usefixtures("compiled_kernels")
def test_a_box_picks_the_segment_inside_it():
    depth = np.full((480, 640), 0.8, np.float32)
    depth[100:180, 100:180] = 0.74
    depth[300:380, 400:480] = 0.74
    frame = Frame(depth, Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5),
                  np.full((480, 640, 3), 99, np.uint8))  # fmt: skip
    crop = chosen_object(frame, box=[390, 290, 100, 100])
    assert crop.mask is not None
    middle = np.argwhere(crop.mask).mean(axis=0) + np.array([crop.y0, crop.x0])
    assert np.abs(middle - (340, 440)).max() < 5


def several(suffix):
    """Return a file of two pictures that differ."""
    pages = [np.full((12, 16, 3), 60, np.uint8), np.full((12, 16, 3), 200, np.uint8)]
    if suffix == ".tif":
        return cv2.imencodemulti(suffix, pages)[1].tobytes()
    animation = cv2.Animation()
    animation.frames, animation.durations = pages, [100, 100]
    return cv2.imencodeanimation(suffix, animation, [])[1].tobytes()


@pytest.mark.parametrize("suffix", [".webp", ".png", ".tif"])
def test_of_several_pictures_the_first_is_read_and_that_is_said(suffix):
    photo = read_photo(several(suffix))
    assert photo.rgb.mean() == pytest.approx(60, abs=3)
    assert photo.doubt == "it holds 2 pictures, of which the first is read"
    assert frame_of_photo(photo, box=[2, 2, 8, 8]).doubts == (photo.doubt,)
    single = read_photo(cv2.imencode(suffix, np.full((12, 16, 3), 60, np.uint8))[1].tobytes())
    assert single.doubt == ""
    assert frame_of_photo(single, box=[2, 2, 8, 8]).doubts == ()


def test_a_ring_of_pages_and_a_preview_are_no_further_pictures():
    tiff = bytearray(cv2.imencode(".tif", np.full((12, 16, 3), 60, np.uint8))[1].tobytes())
    (start,) = struct.unpack_from("<I", tiff, 4)
    (count,) = struct.unpack_from("<H", tiff, start)
    following = start + 2 + 12 * count
    struct.pack_into("<I", tiff, following, start)
    assert more_pictures(bytes(tiff)) == ""
    # NewSubfileType 1: a reduced version of another picture (TIFF 6.0, section 8).
    preview = struct.pack("<HHHIII", 1, 254, 4, 1, 1, 0)
    struct.pack_into("<I", tiff, following, len(tiff))
    assert more_pictures(bytes(tiff) + preview) == ""
    assert more_pictures(bytes(tiff) + preview.replace(b"\xfe\0", b"\xfd\0", 1)) != ""


def test_depth_that_is_repeated_as_colours_is_no_black_photograph():
    depth = np.linspace(500, 1500, 12 * 16).reshape(12, 16).astype(np.uint16)
    for suffix in (".png", ".tif"):
        data = cv2.imencode(suffix, np.dstack([depth] * 3))[1].tobytes()
        with pytest.raises(CloudFormatError, match="depth or infrared saved as colours"):
            read_photo(data)
        coloured = np.dstack([depth * 40, depth * 20, depth * 10])
        assert read_photo(cv2.imencode(suffix, coloured)[1].tobytes()).rgb.max() > 200


def test_a_tiff_of_half_floats_is_refused_before_it_is_decoded(capfd, tmp_path):
    whole = cv2.imencode(".tif", np.ones((12, 16), np.float32))[1].tobytes()
    data = bytearray(whole)
    (start,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, start)
    for at in range(start + 2, start + 2 + 12 * count, 12):
        if struct.unpack_from("<H", data, at) == (258,):  # BitsPerSample
            struct.pack_into("<H", data, at + 8, 16)
    assert not is_half_floats(whole)
    with pytest.raises(CloudFormatError, match="16"):
        read_photo(bytes(data))
    file = tmp_path / "depth.tif"
    file.write_bytes(data)
    with pytest.raises(DataError, match="16-bit numbers with decimals"):
        read_image(file, bytes(data), Limits())
    assert capfd.readouterr().err == ""
