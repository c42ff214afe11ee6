"""Clouds and images of ROS messages, as rosbridge sends them in JSON or CBOR.

``sensor_msgs/PointCloud2`` becomes a PCD file, ``sensor_msgs/CompressedImage`` its bytes and
``sensor_msgs/Image`` a PNG, so that all further reading is one and the same.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.compressed_depth import (
    decode_compressed_depth,
    has_constants,
    is_compressed_depth,
)
from features.codec.image_header import image_size
from features.codec.image_header import is_image as is_picture
from features.codec.limits import CloudFormatError, Limits
from features.codec.pcd import write_pcd
from features.codec.table import COLOURS, Table, colours_of
from features.depth import depth_of_metres

__all__ = [
    "DEPTH_ENCODINGS",
    "ColourScale",
    "deep_colours",
    "image_bytes",
    "is_image",
    "is_point_cloud",
    "pcd_from_point_cloud",
    "pixels_of_image",
    "raw_data",
]

_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
# Encodings that OpenCV turns into RGB (sensor_msgs/image_encodings.h); a Bayer pattern is named by
# its first row in ROS, by its second in OpenCV.
_CONVERTED = {
    "yuv422": ("u1", 2, cv2.COLOR_YUV2RGB_UYVY), "uyvy": ("u1", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": ("u1", 2, cv2.COLOR_YUV2RGB_YUY2), "yuyv": ("u1", 2, cv2.COLOR_YUV2RGB_YUY2),
    **{
        f"bayer_{pattern}{bits}": (code, 1, conversion)
        for bits, code in ((8, "u1"), (16, "u2"))
        for pattern, conversion in (
            ("rggb", cv2.COLOR_BayerBG2RGB), ("bggr", cv2.COLOR_BayerRG2RGB),
            ("gbrg", cv2.COLOR_BayerGR2RGB), ("grbg", cv2.COLOR_BayerGB2RGB),
        )
    },
}  # fmt: skip
_ENCODINGS = {
    "rgb8": ("u1", 3), "bgr8": ("u1", 3), "rgba8": ("u1", 4), "bgra8": ("u1", 4),
    "rgb16": ("u2", 3), "bgr16": ("u2", 3), "rgba16": ("u2", 4), "bgra16": ("u2", 4),
    "mono8": ("u1", 1), "8UC1": ("u1", 1), "8UC3": ("u1", 3), "8UC4": ("u1", 4),
    "16UC3": ("u2", 3), "16UC4": ("u2", 4),
    "mono16": ("u2", 1), "16UC1": ("u2", 1), "16SC1": ("i2", 1), "32FC1": ("f4", 1),
    "64FC1": ("f8", 1),
}  # fmt: skip
DEPTH_ENCODINGS = ("16UC1", "16SC1", "32FC1", "64FC1")
"""Encodings that hold depth and no colour: mm in whole numbers, m in others (REP 118)."""
_COLOUR_BITS = (10, 12, 14, 16)
"""Of sensors whose numbers lie in 16 bits, many of them in the lowest; no encoding says it."""
_REVERSED = ("bgr", "8UC", "16UC")
"""Encodings whose channels are blue, green, red; OpenCV orders those without names so."""
_PNG = b"\x89PNG"
_POINT_FIELDS = {*"xyz", "rgb", "rgba", *(name for names in COLOURS for name in names)}


@dataclass
class ColourScale:
    """The bits that the colours of one camera use of 16, by its brightest picture so far.

    By a scale of its own a dark picture would look as bright as the others of its recording.
    """

    bits: int = 0

    def bits_for(self, largest: int) -> int:
        """Return the bits of a picture of that largest number, and of all that come after it.

        Examples
        --------
        >>> scale = ColourScale()
        >>> scale.bits_for(3_000), scale.bits_for(900)
        (12, 12)
        """
        self.bits = max(self.bits, next(bits for bits in _COLOUR_BITS if largest < 2**bits))
        return self.bits


def deep_colours(message: Mapping[str, Any]) -> int:
    """Return the largest number of an Image whose colours lie in 16 bits; 0 if they do not.

    Raises
    ------
    CloudFormatError
        The parts of the message do not fit together.
    """
    encoding = str(message.get("encoding"))
    code, channels = (_CONVERTED.get(encoding) or _ENCODINGS.get(encoding) or ("", 0))[:2]
    if code != "u2" or (channels == 1 and encoding not in _CONVERTED):
        return 0
    return int(_stored_pixels(message, encoding, Limits()).max())


def is_point_cloud(message: Any) -> bool:
    """Tell whether a message is a ``sensor_msgs/PointCloud2``."""
    return isinstance(message, Mapping) and {"fields", "point_step", "data"} <= set(message)


def is_image(message: Any) -> bool:
    """Tell whether a message is a ``sensor_msgs/CompressedImage`` or ``sensor_msgs/Image``."""
    is_mapping = isinstance(message, Mapping) and "data" in message
    return is_mapping and ("format" in message or {"encoding", "step"} <= set(message))


def pcd_from_point_cloud(message: Mapping[str, Any], limits: Limits | None = None) -> bytes:
    """Return a ``sensor_msgs/PointCloud2`` as a PCD file with x, y, z and, where there, colour.

    Raises
    ------
    CloudFormatError
        When the parts of the message do not fit together.
    """
    limits = limits or Limits()
    height, width = _whole(message, "height"), _whole(message, "width")
    step, row = _whole(message, "point_step"), _whole(message, "row_step", 0)
    limits.check_points(height * width)
    data = raw_data(message, limits)
    row = row or width * step
    if step < 1 or row < width * step or len(data) < (height - 1) * row + width * step:
        raise CloudFormatError(
            f"PointCloud2: {len(data)} bytes are not {height} rows of {width} points of {step}"
        )
    layout = _layout(message, step)
    names = layout.names or ()
    if row == width * step:
        rows = np.frombuffer(data, layout, height * width)
    else:
        rows = np.concatenate([np.frombuffer(data, layout, width, k * row) for k in range(height)])
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise CloudFormatError(f"PointCloud2: no field {', '.join(missing)}")
    table: Table = {axis: rows[axis].astype("<f4") for axis in "xyz"}
    # Nothing is measured where the sensor stands: cameras write that for what they did not see.
    is_missing = (table["x"] == 0) & (table["y"] == 0) & (table["z"] == 0)
    for axis in "xyz":
        table[axis][is_missing] = np.nan
    colours = colours_of({name: rows[name] for name in names})
    if colours is not None:
        red, green, blue = colours.astype("<u4").T
        table["rgb"] = (red << 16 | green << 8 | blue).astype("<u4")
    header = message.get("header")
    frame_id = header.get("frame_id", "") if isinstance(header, Mapping) else ""
    return write_pcd(table, (height, width), str(frame_id))


def _layout(message: Mapping[str, Any], step: int) -> np.dtype[Any]:
    order = ">" if message.get("is_bigendian") else "<"
    names, formats, offsets = [], [], []
    fields = message["fields"]
    if not isinstance(fields, list | tuple):
        raise CloudFormatError("PointCloud2: fields must be a list")
    for field in fields:
        if not isinstance(field, Mapping):
            raise CloudFormatError(f"PointCloud2: unknown field {field!r:.80}")
        kind, offset = _KINDS.get(field.get("datatype", 0)), field.get("offset", 0)
        if kind is None or type(offset) is not int or "name" not in field:
            raise CloudFormatError(f"PointCloud2: unknown field {field!r:.80}")
        name = str(field["name"]).lower()
        # One field of three or four bytes is as good as as many fields.
        is_three = name in ("rgb", "rgba") and kind == "u1" and field.get("count") in (3, 4)
        parts = "rgb" if is_three else [name]
        if offset < 0 or offset + int(kind[1]) * len(parts) > step:
            raise CloudFormatError(f"PointCloud2: field {field['name']} lies outside the point")
        for place, part in enumerate(parts):
            if part in _POINT_FIELDS:
                names.append(part)
                formats.append(order + kind)
                offsets.append(offset + place)
    try:
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})
    except ValueError as error:
        raise CloudFormatError(f"PointCloud2: {error}") from None


def image_bytes(
    message: Mapping[str, Any], limits: Limits | None = None, scale: ColourScale | None = None
) -> bytes:
    """Return the picture of a CompressedImage as it came, or that of an Image as PNG.

    Parameters
    ----------
    scale
        As of :func:`pixels_of_image`.

    Raises
    ------
    CloudFormatError
        When it is of another format, or its parts do not fit together.
    """
    limits = limits or Limits()
    if "encoding" not in message:
        data = raw_data(message, limits)
        if is_compressed_depth(message):
            return _png(_millimetres(decode_compressed_depth(str(message["format"]), data, limits)))
        # Transports put a header before the picture of compressedDepth.
        at = data.find(_PNG, 0, 64)
        image = data if is_picture(data) or at < 0 else data[at:]
        if image is not data and has_constants(data[:at]):
            raise CloudFormatError(
                f"CompressedImage: inverse depth by its header, but the format "
                f"{message.get('format')!r} does not say compressedDepth of 32FC1"
            )
        if not is_picture(image):
            raise CloudFormatError(
                f"CompressedImage: format {message.get('format')!r} is no picture (JPEG, PNG, "
                "WebP, BMP, TIFF)"
            )
        return _true_colours(image, str(message.get("format")), limits)
    pixels = pixels_of_image(message, limits, scale)
    if pixels.dtype == np.float32:
        pixels = _millimetres(depth_of_metres(pixels))
    return _png(pixels[..., ::-1] if pixels.ndim == 3 else pixels)


def _true_colours(image: bytes, format_text: str, limits: Limits) -> bytes:
    """Return a picture as it looks: the old ``compressed rgb8`` stored red and blue exchanged.

    ``compressed_image_transport`` gave RGB to an encoder that expects BGR; its subscriber, like
    this, tells from the format.
    """
    if "compressed rgb" not in format_text:
        return image
    limits.check_image(*image_size(image))
    try:
        pixels = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR)
    except cv2.error as error:
        raise CloudFormatError(f"the image does not decode ({error.err})") from None
    if pixels is None:
        raise CloudFormatError("the image does not decode")
    return _png(pixels[..., ::-1])


def _millimetres(depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    return np.rint(np.clip(depth_m * 1000, 0, 65_535)).astype(np.uint16)


def _png(pixels: NDArray[Any]) -> bytes:
    done, data = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not done:
        raise CloudFormatError("Image: cannot be written as PNG")
    return data.tobytes()


def pixels_of_image(
    message: Mapping[str, Any], limits: Limits | None = None, scale: ColourScale | None = None
) -> NDArray[Any]:
    """Return the pixels of a ``sensor_msgs/Image``: RGB (h, w, 3), else (h, w).

    Depth is uint16 in mm or float32 in m (REP 118). Colours of 16 bits are brought to 8 by the
    fewest bits that a sensor has and that hold the largest of them.

    Parameters
    ----------
    scale
        Of the camera, where more than one of its pictures is read: all that hold.

    Raises
    ------
    CloudFormatError
        When the encoding is not known, or the bytes are too few.
    """
    limits = limits or Limits()
    encoding = str(message.get("encoding"))
    if encoding not in _ENCODINGS and encoding not in _CONVERTED:
        readable = ", ".join((*_ENCODINGS, *_CONVERTED))
        raise CloudFormatError(f"Image: encoding {encoding!r} is not known; one of {readable}")
    conversion = _CONVERTED.get(encoding)
    pixels = _stored_pixels(message, encoding, limits)
    height, width, channels = pixels.shape
    code = pixels.dtype.str[1:]
    if code == "u2" and (conversion is not None or channels > 1):
        bits = (scale or ColourScale()).bits_for(int(pixels.max()))
        pixels = (pixels >> (bits - 8)).astype(np.uint8)
    elif code == "i2":  # the largest of its type is none, as that of 16UC1
        is_measured = (pixels > 0) & (pixels < np.iinfo(np.int16).max)
        pixels = np.where(is_measured, pixels, 0).astype(np.uint16)
    elif code == "f8":
        pixels = pixels.astype(np.float32)
    if conversion is not None:
        if width % 2 or (channels == 1 and height % 2):
            raise CloudFormatError(f"Image: {encoding} of {width}x{height} px; sides must be even")
        return np.asarray(cv2.cvtColor(pixels, conversion[2]), dtype=np.uint8)
    if channels == 1:
        return pixels[..., 0]
    pixels = pixels[..., :3]
    return pixels[..., ::-1].copy() if encoding.startswith(_REVERSED) else pixels.copy()


def _stored_pixels(message: Mapping[str, Any], encoding: str, limits: Limits) -> NDArray[Any]:
    """Return the numbers (h, w, channels) of an Image of a known encoding, as they are stored."""
    code, channels = (_CONVERTED.get(encoding) or _ENCODINGS[encoding])[:2]
    height, width = _whole(message, "height"), _whole(message, "width")
    limits.check_image(width, height)
    kind = np.dtype((">" if message.get("is_bigendian") else "<") + code)
    used = width * channels * kind.itemsize
    step = _whole(message, "step", 0) or used
    data = raw_data(message, limits)
    if step < used or height < 1 or width < 1 or len(data) < (height - 1) * step + used:
        raise CloudFormatError(f"Image: {len(data)} bytes are not {width}x{height} of {encoding}")
    rows = np.frombuffer(data.ljust(height * step, b"\0"), np.uint8, height * step)
    pixels = rows.reshape(height, step)[:, :used].copy().view(kind)
    return pixels.astype(kind.newbyteorder("=")).reshape(height, width, channels)


def raw_data(message: Mapping[str, Any], limits: Limits | None = None) -> bytes:
    """Return the member ``data`` of a message: bytes, or base64 text or a list of numbers of JSON.

    Raises
    ------
    CloudFormatError
        When it is none of these, or larger than the limits allow.
    """
    limits = limits or Limits()
    data = message["data"]
    if isinstance(data, str):
        try:
            data = base64.b64decode(data, validate=True)
        except (binascii.Error, ValueError) as error:
            raise CloudFormatError(f"data: not base64: {error}") from None
    elif isinstance(data, list | tuple):
        try:
            data = bytes(data)
        except (TypeError, ValueError) as error:
            raise CloudFormatError(f"data: not bytes: {error}") from None
    elif isinstance(data, np.ndarray):
        data = data.tobytes()
    elif not isinstance(data, bytes | bytearray | memoryview):
        raise CloudFormatError("data: base64 text or bytes are expected")
    limits.check_decoded(len(data), len(data), "data")
    return bytes(data)


def _whole(message: Mapping[str, Any], key: str, default: int | None = None) -> int:
    value = message.get(key, default)
    if type(value) is not int or value < 0 or value > 2**31:
        raise CloudFormatError(f"{key}: a whole number is expected, got {value!r:.40}")
    return value
