"""Depth as the transport ``compressedDepth`` of ROS sends it: PNG or RVL behind a header.

``compressed_depth_image_transport``: twelve bytes come before the picture, an enumeration and two
float32 of the quantisation. Of ``16UC1`` the numbers are millimetres; of ``32FC1`` they are inverse
depth, ``value = a / depth + b``. RVL is run-length coding of the differences of 16-bit depth
(Wilson 2017, "Fast lossless depth image compression").
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.image_header import image_size
from features.codec.limits import CloudFormatError, Limits
from features.depth import depth_of_metres, depth_of_steps

__all__ = ["decode_compressed_depth", "decode_rvl", "has_constants", "is_compressed_depth"]

_HEADER = struct.Struct("<iff")
_SIZE = struct.Struct("<ii")
_PNG = b"\x89PNG"
_MOST_NIBBLES = 9
"""Of a number of RVL: three bits each, so that the longest run of an image fits."""
_MOST_VALUE = 65_535


def is_compressed_depth(message: Mapping[str, Any]) -> bool:
    """Whether a ``sensor_msgs/CompressedImage`` says that it holds compressed depth."""
    return "compresseddepth" in str(message.get("format", "")).lower()


def has_constants(header: bytes) -> bool:
    """Whether the bytes before a picture hold the constants of inverse depth.

    Examples
    --------
    >>> has_constants(_HEADER.pack(0, 100.0, 1.0)), has_constants(bytes(12))
    (True, False)
    """
    if len(header) != _HEADER.size:
        return False
    _, a, b = _HEADER.unpack(header)
    return bool(np.isfinite(a) and np.isfinite(b) and 1e-3 < a < 1e6)


def decode_compressed_depth(
    format_text: str,
    data: bytes,
    limits: Limits | None = None,
    say: Callable[[str], None] | None = None,
) -> NDArray[np.float32]:
    """Return the depth (h, w), m, of a message of ``compressedDepth``; 0 = missing.

    Parameters
    ----------
    format_text
        Of the message, such as ``32FC1; compressedDepth png``.
    data
        Of the message, header included. Without a header, as some drivers send it, a PNG of
        ``16UC1`` is read; one of ``32FC1`` cannot be.
    say
        Called with a sentence for numbers that are taken for not measured.

    Raises
    ------
    CloudFormatError
        The encoding is neither ``16UC1`` nor ``32FC1``, or the bytes are damaged.
    """
    limits = limits or Limits()
    encoding = format_text.partition(";")[0].strip()
    if encoding not in ("16UC1", "32FC1", "mono16"):
        raise CloudFormatError(f"compressedDepth: encoding {encoding!r} is not depth")
    has_header = not data.startswith(_PNG)
    if has_header and len(data) < _HEADER.size:
        raise CloudFormatError("compressedDepth: cut off within its header")
    _, a, b = _HEADER.unpack_from(data) if has_header else (0, 0.0, 0.0)
    stored = data[_HEADER.size :] if has_header else data
    values = _decode_png(stored, limits) if stored.startswith(_PNG) else decode_rvl(stored, limits)
    if encoding != "32FC1":
        return depth_of_steps(values, say=say)
    if not (np.isfinite(a) and np.isfinite(b) and a > 0):
        raise CloudFormatError(
            f"compressedDepth: 32FC1 without the constants of its inverse depth ({a:g}, {b:g})"
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(values > 0, a / (values.astype(np.float64) - b), 0)
    return depth_of_metres(np.asarray(depth, np.float32), say)


def _decode_png(data: bytes, limits: Limits) -> NDArray[np.uint16]:
    limits.check_image(*image_size(data))
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise CloudFormatError(f"compressedDepth: the PNG does not decode ({error.err})") from None
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise CloudFormatError("compressedDepth: the picture is no PNG of 16 bits and one channel")
    return np.asarray(pixels, np.uint16)


def decode_rvl(data: bytes, limits: Limits | None = None) -> NDArray[np.uint16]:
    """Return the values (h, w) of an RVL stream that begins with its width and height.

    Examples
    --------
    >>> decode_rvl(bytes.fromhex("02000000 02000000 0000e122")).tolist()
    [[0, 0], [7, 7]]

    Raises
    ------
    CloudFormatError
        The stream ends before its last pixel, or declares a size beyond the limits.
    """
    limits = limits or Limits()
    if len(data) < _SIZE.size:
        raise CloudFormatError("RVL: cut off before its size")
    width, height = _SIZE.unpack_from(data)
    if width < 1 or height < 1:
        raise CloudFormatError(f"RVL: an image of {width}x{height} px")
    limits.check_image(width, height)
    words = np.frombuffer(data[_SIZE.size : len(data) // 4 * 4], "<u4")
    # A word holds eight nibbles, the highest first.
    shifts = np.arange(28, -1, -4, dtype=np.uint32)
    nibbles = ((words[:, None] >> shifts) & 15).astype(np.uint8).ravel()
    numbers = _variable_lengths(nibbles)
    return _expand(numbers, width * height).reshape(height, width)


def _variable_lengths(nibbles: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the numbers of nibbles: three bits each; the fourth says that more follow."""
    ends = np.flatnonzero(nibbles < 8)
    starts = np.concatenate(([0], ends[:-1] + 1)) if len(ends) else ends
    numbers = np.zeros(len(ends), np.int64)
    lengths = ends - starts + 1
    longest = int(lengths.max(initial=0))
    if longest > _MOST_NIBBLES:
        raise CloudFormatError(f"RVL: a number of {longest} nibbles")
    for place in range(longest):
        has = lengths > place
        numbers[has] |= (nibbles[starts[has] + place].astype(np.int64) & 7) << (3 * place)
    return numbers


def _expand(numbers: NDArray[np.int64], count: int) -> NDArray[np.uint16]:
    """Return the pixels of runs: how many are zero, how many follow, and their differences."""
    out = np.zeros(count, np.uint16)
    at, pixel, previous = 0, 0, 0
    while pixel < count:
        if at + 1 >= len(numbers):
            raise CloudFormatError("RVL: the stream ends before its last pixel")
        zeros, others = int(numbers[at]), int(numbers[at + 1])
        at += 2
        pixel += zeros
        if pixel + others > count or at + others > len(numbers):
            raise CloudFormatError("RVL: a run reaches beyond the image")
        coded = numbers[at : at + others]
        values = previous + np.cumsum((coded >> 1) ^ -(coded & 1))
        if others and not 0 <= values.min() <= values.max() <= _MOST_VALUE:
            raise CloudFormatError("RVL: a value that does not fit into 16 bits")
        out[pixel : pixel + others] = values
        if others:
            previous = int(values[-1])
        elif not zeros:
            raise CloudFormatError("RVL: a run of nothing")
        at, pixel = at + others, pixel + others
    return out
