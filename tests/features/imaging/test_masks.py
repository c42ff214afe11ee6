"""Masks and boxes that other tools made."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from features.codec import CloudFormatError
from features.imaging.masks import (
    box_mask,
    decode_rle,
    encode_rle,
    fit_labels,
    labels_from_annotations,
    labels_from_png,
    read_labels,
)


def compressed(counts):
    """Write counts as COCO's own library does: 5 bits a character, differences from the third."""
    text = ""
    for k, count in enumerate(counts):
        value = count - counts[k - 2] if k > 2 else count
        more = True
        while more:
            digit = value & 31
            value >>= 5
            more = value != (-1 if digit & 16 else 0)
            text += chr(48 + (digit | 32 if more else digit))
    return text


def blob():
    mask = np.zeros((60, 80), np.uint8)
    cv2.ellipse(mask, (40, 30), (20, 12), 30, 0, 360, 1, -1)
    mask[5:9, 3:70] = 1
    return mask > 0


def test_run_lengths_come_back_as_the_mask_they_were_made_from():
    mask = blob()
    told = encode_rle(mask)
    assert np.array_equal(decode_rle(told), mask)
    packed = {"size": told["size"], "counts": compressed(told["counts"])}
    assert np.array_equal(decode_rle(packed), mask)
    as_bytes = {**packed, "counts": packed["counts"].encode()}
    assert np.array_equal(decode_rle(as_bytes), mask)


@pytest.mark.parametrize(
    ("rle", "words"),
    [
        ({"size": [2, 3], "counts": [1, 2]}, "make 3 px"),
        ({"size": [2, 3], "counts": [-1, 7]}, "negative"),
        ({"size": [2], "counts": [6]}, "size must be"),
        ({"size": [2, 3], "counts": "\x01"}, "no digit"),
        ({"size": [2, 3], "counts": chr(48 + 40)}, "cut off"),
        ({"size": [10**6, 10**6], "counts": [10**12]}, "px"),
        ({"size": [2, 3], "counts": None}, "list of whole numbers"),
    ],
)
def test_damaged_run_lengths_are_refused(rle, words):
    with pytest.raises(CloudFormatError, match=words):
        decode_rle(rle)


def test_a_png_gives_labels_by_grey_value_and_by_colour():
    labels = np.zeros((20, 30), np.uint16)
    labels[2:8, 3:9], labels[10:15, 5:20] = 7, 300
    data = cv2.imencode(".png", labels)[1].tobytes()
    assert np.array_equal(labels_from_png(data), labels)
    painted = np.zeros((20, 30, 3), np.uint8)
    painted[2:8, 3:9], painted[10:15, 5:20] = (0, 0, 255), (0, 255, 0)
    found = labels_from_png(cv2.imencode(".png", painted)[1].tobytes())
    assert sorted(np.unique(found)) == [0, 1, 2]
    assert np.array_equal(found > 0, labels > 0)


def test_annotations_of_every_kind_become_labels():
    mask = blob()
    entries = [
        {"segmentation": encode_rle(mask)},
        {"segmentation": [[10, 40, 30, 40, 30, 55, 10, 55]]},
        {"bbox": [60, 40, 10, 10]},
    ]
    labels = read_labels(json.dumps({"annotations": entries}).encode(), mask.shape)
    assert np.array_equal(labels == 1, mask & (labels < 2))
    assert labels[50, 20] == 2
    assert labels[45, 65] == 3
    with pytest.raises(CloudFormatError, match="size of the image"):
        labels_from_annotations(entries[1])
    with pytest.raises(CloudFormatError, match="neither segmentation nor bbox"):
        labels_from_annotations([{"id": 3}], mask.shape)


@pytest.mark.parametrize(
    "entry",
    [
        {"bbox": None},
        {"bbox": {}},
        {"bbox": [0, 0, "a", 1]},
        {"bbox": [0, 0, 10**400, 1]},
        {"segmentation": [{}]},
        {"segmentation": [[1, 2, 3, 4, 5, None]]},
        {"segmentation": [[1, 2, 3, 4, 5, 10**400]]},
        {"size": [2, 2], "counts": [10**30]},
    ],
)
def test_numbers_of_annotations_that_are_none_are_refused(entry):
    with pytest.raises(CloudFormatError):
        labels_from_annotations([entry], (20, 30))


def test_annotations_may_begin_with_white_space_or_a_byte_order_mark():
    for start in (b"\n ", b"\xef\xbb\xbf"):
        assert read_labels(start + b'{"bbox": [0, 0, 3, 3]}', (10, 12)).sum() == 9


def test_boxes_are_clipped_and_those_outside_refused():
    assert box_mask([-5, 2, 10, 4], (20, 30)).sum() == 5 * 4
    with pytest.raises(CloudFormatError, match="outside"):
        box_mask([40, 2, 10, 4], (20, 30))
    with pytest.raises(CloudFormatError, match="left, top"):
        box_mask([1, 2, 0, 4], (20, 30))


def test_labels_follow_an_image_that_was_reduced_and_no_other():
    labels = np.zeros((40, 60), np.int32)
    labels[10:20, 20:40] = 3
    assert (fit_labels(labels, (20, 30)) == 3).sum() == 5 * 10
    with pytest.raises(CloudFormatError, match="the image"):
        fit_labels(labels, (40, 90))
