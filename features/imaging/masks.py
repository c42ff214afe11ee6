"""Masks and boxes that other tools made: label images, COCO run lengths, polygons, boxes.

Formats of COCO (Lin et al. 2014): a run-length encoding counts pixels column by column, zeros
first; its compressed form writes the counts as text, six bits a character.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.image_header import image_size
from features.codec.limits import CloudFormatError, Limits

__all__ = [
    "box_mask",
    "decode_rle",
    "encode_rle",
    "fit_labels",
    "labels_from_annotations",
    "labels_from_png",
    "read_labels",
]

_MAX_LABELS = 10_000


def labels_from_png(data: bytes) -> NDArray[np.int32]:
    """Return the label image (h, w) of a PNG; 0 = no object.

    Grey values are the labels. Of a coloured PNG each colour is one, black is none.

    Raises
    ------
    CloudFormatError
        When the bytes are no image, or one beyond the limits.
    """
    Limits().check_image(*image_size(data))
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise CloudFormatError(f"the mask does not decode ({error.err})") from None
    if image is None:
        raise CloudFormatError("the mask does not decode")
    if image.ndim == 2:
        return np.asarray(image, dtype=np.int32)
    # A colour is a label: tools that show masks to people paint them.
    wide = image[..., :3].astype(np.int64)
    number = wide[..., 2] << 16 | wide[..., 1] << 8 | wide[..., 0]
    colours, of = np.unique(number, return_inverse=True)
    # Lossy compression makes a new colour of nearly every pixel along an outline.
    if len(colours) > _MAX_LABELS:
        raise CloudFormatError(f"a mask of {len(colours)} colours; save it without compression")
    ranks = np.cumsum(colours > 0) * (colours > 0)
    return np.asarray(ranks[of].reshape(number.shape), dtype=np.int32)


def decode_rle(rle: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Return the mask (h, w) of a COCO run-length encoding.

    Parameters
    ----------
    rle
        ``{"size": [h, w], "counts": ...}``; counts as a list, or compressed as text or bytes.

    Raises
    ------
    CloudFormatError
        When size and counts do not fit, or the mask is beyond the limits.

    Examples
    --------
    >>> decode_rle({"size": [2, 3], "counts": [1, 2, 3]}).astype(int).tolist()
    [[0, 1, 0], [1, 0, 0]]
    """
    size, counts = rle.get("size"), rle.get("counts")
    if not (
        isinstance(size, Sequence)
        and len(size) == 2
        and all(isinstance(n, int) and not isinstance(n, bool) and n > 0 for n in size)
    ):
        raise CloudFormatError(f"RLE: size must be [height, width], got {size!r}")
    height, width = size
    Limits().check_image(width, height)
    if isinstance(counts, str | bytes):
        counts = _uncompressed(counts, height * width)
    elif not (isinstance(counts, Sequence) and all(type(n) is int for n in counts)):
        raise CloudFormatError("RLE: counts must be a list of whole numbers, or text")
    if counts and not 0 <= min(counts) <= max(counts) <= height * width:
        raise CloudFormatError("RLE: a count is negative or larger than the image")
    runs = np.array(counts, np.int64)
    if runs.sum() != height * width:
        raise CloudFormatError(f"RLE: the counts make {runs.sum()} px, not {height}x{width}")
    values = (np.arange(len(runs)) % 2).astype(bool)
    # COCO counts down the columns, as Matlab stores images.
    return np.repeat(values, runs).reshape(width, height).T.copy()


def _uncompressed(text: str | bytes, most: int) -> list[int]:
    """Return the counts of compressed text: base 32 digits, lowest first, then differences."""
    data = text.encode("ascii", "replace") if isinstance(text, str) else text
    counts: list[int] = []
    value = shift = 0
    for byte in data:
        digit = byte - 48
        if not 0 <= digit < 64 or shift > 30:
            raise CloudFormatError("RLE: the counts hold a character that is no digit of them")
        value |= (digit & 31) << shift
        shift += 5
        if digit & 32:
            continue
        # The sign of a difference is the highest bit of its last digit.
        if digit & 16:
            value -= 1 << shift
        counts.append(value + counts[-2] if len(counts) > 2 else value)
        if len(counts) > most + 1:
            raise CloudFormatError("RLE: more counts than pixels")
        value = shift = 0
    if shift:
        raise CloudFormatError("RLE: the counts are cut off")
    return counts


def encode_rle(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Return a mask (h, w) as an uncompressed COCO run-length encoding.

    Examples
    --------
    >>> encode_rle(np.array([[0, 1, 0], [1, 0, 0]], bool))
    {'size': [2, 3], 'counts': [1, 2, 3]}
    """
    flat = np.concatenate([[False], np.asarray(mask, bool).T.ravel()])
    starts = np.flatnonzero(flat[1:] != flat[:-1])
    runs = np.diff(np.concatenate([[0], starts, [mask.size]]))
    return {"size": [int(n) for n in mask.shape], "counts": runs.astype(int).tolist()}


def box_mask(box: Sequence[float], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the mask (h, w) of a box [left, top, width, height], px, as COCO writes it.

    Raises
    ------
    CloudFormatError
        When it is no box, or lies outside the image.
    """
    values = _finite_numbers(box)
    if len(values) != 4 or (values[2:] <= 0).any():
        raise CloudFormatError(f"a box is [left, top, width, height] in px, got {box!r:.80}")
    height, width = shape
    low = np.clip(np.floor(values[:2]), 0, (width, height)).astype(int)
    high = np.clip(np.ceil(values[:2] + values[2:]), 0, (width, height)).astype(int)
    if (high <= low).any():
        raise CloudFormatError(f"the box {list(box)} lies outside the image of {width}x{height} px")
    mask = np.zeros(shape, bool)
    mask[low[1] : high[1], low[0] : high[0]] = True
    return mask


def _finite_numbers(values: Any) -> NDArray[np.float64]:
    """Return what a document gives as a list of finite numbers (n,); empty if it is none."""
    try:
        numbers = np.asarray(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
    return numbers if numbers.ndim == 1 and np.isfinite(numbers).all() else np.empty(0)


def labels_from_annotations(
    document: Any, shape: tuple[int, int] | None = None
) -> NDArray[np.int32]:
    """Return the label image (h, w) of COCO annotations, numbered in their order from 1.

    Parameters
    ----------
    document
        A run-length encoding, an annotation with ``segmentation`` or ``bbox``, a list of either, or
        a document with ``annotations``. Later ones lie over earlier ones.
    shape
        Height and width of the image, which polygons and boxes do not say.

    Raises
    ------
    CloudFormatError
        When an entry is none of these, or sizes differ.
    """
    entries = document.get("annotations", [document]) if isinstance(document, dict) else document
    if not isinstance(entries, list) or not entries or len(entries) > _MAX_LABELS:
        raise CloudFormatError("expected COCO annotations: a list of masks or boxes")
    labels: NDArray[np.int32] | None = None
    for number, entry in enumerate(entries, start=1):
        if not isinstance(entry, dict):
            raise CloudFormatError(f"annotation {number}: expected an object, got {entry!r:.60}")
        mask = _annotated(entry, shape, number)
        if labels is None:
            labels = np.zeros(mask.shape, np.int32)
        if mask.shape != labels.shape:
            raise CloudFormatError(f"annotation {number}: {mask.shape}, not {labels.shape} px")
        labels[mask] = number
    assert labels is not None
    return labels


def _annotated(
    entry: dict[str, Any], shape: tuple[int, int] | None, number: int
) -> NDArray[np.bool_]:
    what = entry.get("segmentation", entry if "counts" in entry else None)
    if isinstance(what, dict):
        return decode_rle(what)
    if shape is None:
        raise CloudFormatError(f"annotation {number}: the size of the image is not known")
    if isinstance(what, list) and what:
        outlines = []
        for polygon in what:
            points = _finite_numbers(polygon)
            if len(points) < 6 or len(points) % 2:
                raise CloudFormatError(f"annotation {number}: a polygon is [x1, y1, x2, y2, ...]")
            # Beyond that the conversion to int32 would wrap around, and draw elsewhere.
            outlines.append(np.rint(np.clip(points, -1e6, 1e6)).astype(np.int32).reshape(-1, 2))
        drawn = np.zeros(shape, np.uint8)
        cv2.fillPoly(drawn, outlines, 1)
        return drawn > 0
    if "bbox" in entry:
        return box_mask(entry["bbox"], shape)
    raise CloudFormatError(f"annotation {number}: neither segmentation nor bbox")


def read_labels(data: bytes, shape: tuple[int, int] | None = None) -> NDArray[np.int32]:
    """Return the label image of a file: PNG labels or COCO JSON.

    Raises
    ------
    CloudFormatError
        When it is neither, or damaged.
    """
    if data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"["):
        try:
            document = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise CloudFormatError(f"not JSON: {error}") from None
        return labels_from_annotations(document, shape)
    return labels_from_png(data)


def fit_labels(labels: NDArray[np.int32], shape: tuple[int, int]) -> NDArray[np.int32]:
    """Return labels at the size (h, w) of an image that was reduced.

    Raises
    ------
    CloudFormatError
        When the sides differ in more than their scale: the mask is of another image.
    """
    if labels.shape == shape:
        return labels
    down, across = labels.shape[0] / shape[0], labels.shape[1] / shape[1]
    if abs(down / across - 1) > 0.02:
        raise CloudFormatError(
            f"the mask is {labels.shape[1]}x{labels.shape[0]} px, the image {shape[1]}x{shape[0]}"
        )
    scaled = cv2.resize(labels, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST)
    return np.asarray(scaled, dtype=np.int32)
