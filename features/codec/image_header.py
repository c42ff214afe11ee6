"""Size and transparency of pictures from their headers, before a decoder is trusted with them.

PNG (W3C), JPEG (ITU T.81), WebP (RFC 9649), BMP (Windows bitmap) and TIFF 6.0.
"""

from __future__ import annotations

import struct

from features.codec.limits import CloudFormatError, UnknownFormatError

__all__ = [
    "bits_of",
    "has_alpha",
    "image_size",
    "is_cut_off",
    "is_deep_grey",
    "is_grey_of_floats",
    "is_half_floats",
    "is_image",
    "more_pictures",
    "orientation_of",
    "stored_orientation",
    "transparent_grey",
]

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND\xaeB`\x82"
_JPEG = b"\xff\xd8"
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_SOF_MARKERS = frozenset({0xC0, 0xC1, 0xC2})
_STANDALONE = frozenset({0x01, *range(0xD0, 0xD9)})
_MAX_TIFF_ENTRIES = 256
_WIDTH, _HEIGHT, _BITS, _MEANING, _ORIENTATION, _SAMPLES = 256, 257, 258, 262, 274, 277
_NUMBERS, _FLOATS = 339, 3
_SUBFILE, _REDUCED_OR_MASK = 254, 5
_MAX_PICTURES = 10_000
_WEBP_ANIMATION = 2
_TIFF_RGB = 2
_PNG_GREY = (0, 4)
"""Colour types of PNG (11.2.1): grey, and grey with alpha."""
_BMP_ALPHA_MASK = 66
"""Offset of the mask of alpha in headers of 56 bytes and more."""
_FORMATS = "PNG, JPEG, WebP, BMP or TIFF"


def is_image(data: bytes) -> bool:
    """Whether bytes begin like a picture of one of these formats.

    Examples
    --------
    >>> is_image(b"II*\\0"), is_image(b"ply\\n")
    (True, False)
    """
    return (
        data.startswith((_PNG[:4], _JPEG + b"\xff", b"BM")) or _is_webp(data) or data[:4] in _TIFF
    )


def image_size(data: bytes) -> tuple[int, int]:
    """Return (width, height), px.

    Raises
    ------
    UnknownFormatError
        When it is none of these formats.
    CloudFormatError
        When it is cut off before the size.
    """
    if data.startswith(_PNG):
        if len(data) < 33 or data[12:16] != b"IHDR":
            raise CloudFormatError("PNG cut off within its header")
        width, height = struct.unpack_from(">II", data, 16)
        return int(width), int(height)
    if data.startswith(_JPEG):
        return _jpeg_size(data)
    try:
        if _is_webp(data):
            return _webp_size(data)
        if data.startswith(b"BM"):
            return _bmp_size(data)
        if data[:4] in _TIFF:
            entries = _tiff_entries(data)
            return entries[_WIDTH], entries[_HEIGHT]
    except (struct.error, KeyError):
        raise CloudFormatError("the picture is cut off before its size") from None
    raise UnknownFormatError(f"no {_FORMATS}: starts with {data[:8].hex(' ')}")


def is_cut_off(data: bytes) -> bool:
    """Whether a PNG lacks its end; what follows the end is no part of it (PNG, 5.6)."""
    return data.startswith(_PNG[:4]) and _PNG_END not in data


def bits_of(data: bytes) -> int:
    """Return the bits of a channel of a PNG or TIFF; 8 for other formats."""
    if data.startswith(_PNG) and len(data) > 24:
        return data[24]
    return _tiff_number(data, _BITS, 1) if data[:4] in _TIFF else 8


def is_deep_grey(data: bytes) -> bool:
    """Whether a PNG or TIFF is grey with 16 bits: depth or infrared, and no photograph."""
    if data.startswith(_PNG):
        return bits_of(data) == 16 and data[25] in _PNG_GREY
    return data[:4] in _TIFF and bits_of(data) == 16 and _tiff_number(data, _SAMPLES, 1) == 1


def is_grey_of_floats(data: bytes) -> bool:
    """Whether a TIFF has one number with decimals a pixel (SampleFormat 3): depth, mostly in m."""
    return (
        data[:4] in _TIFF
        and _tiff_number(data, _NUMBERS, 1) == _FLOATS
        and _tiff_number(data, _SAMPLES, 1) == 1
    )


def is_half_floats(data: bytes) -> bool:
    """Whether a TIFF has numbers of 16 bits with decimals, which OpenCV does not decode."""
    return data[:4] in _TIFF and bits_of(data) == 16 and _tiff_number(data, _NUMBERS, 1) == _FLOATS


def more_pictures(data: bytes) -> str:
    """Return a sentence where a file holds several pictures, of which the first is read.

    An animated PNG (third edition, 4.9) or WebP (RFC 9649, 2.7.1.1), and a TIFF of several pages
    (TIFF 6.0, section 2), where previews and masks of a page count for nothing.
    """
    if data.startswith(_PNG):
        control = _png_chunk(data[: max(data.find(b"IDAT"), 0)], b"acTL")
        count = int.from_bytes(control[:4], "big")
    elif _is_webp(data):
        count = _webp_frames(data)
    else:
        count = _tiff_pages(data) if data[:4] in _TIFF else 1
    return "" if count < 2 else f"it holds {count} pictures, of which the first is read"


def has_alpha(data: bytes) -> bool:
    """Whether a picture says that some of its pixels may be transparent; JPEG cannot."""
    if data.startswith(_PNG) and len(data) > 25:
        return data[25] in (4, 6) or b"tRNS" in data[: data.find(b"IDAT")]
    if data[:4] in _TIFF:
        samples = {_TIFF_RGB: 4, 0: 2, 1: 2}.get(_tiff_number(data, _MEANING, 0))
        return _tiff_number(data, _SAMPLES, 1) == samples
    if data.startswith(b"BM"):
        return (
            len(data) > _BMP_ALPHA_MASK + 4
            and int.from_bytes(data[14:18], "little") >= 56
            and any(data[_BMP_ALPHA_MASK : _BMP_ALPHA_MASK + 4])
        )
    if not _is_webp(data) or len(data) < 25:
        return False
    kind = data[12:16]
    if kind == b"VP8X":
        return bool(data[20] & 0x10)
    return kind == b"VP8L" and bool(data[24] & 0x10)


def transparent_grey(data: bytes) -> int | None:
    """Return the grey that a PNG of 8 bits declares transparent (PNG, 11.3.2.1), if any."""
    at = data.find(b"tRNS", 0, max(data.find(b"IDAT"), 0))
    if not data.startswith(_PNG) or at < 0 or bits_of(data) != 8 or data[25] != 0:
        return None
    return data[at + 5]


def orientation_of(exif: bytes) -> int:
    """Return the orientation that EXIF data or a TIFF say, 1 to 8; 1 = upright, or not said."""
    orientation = _tiff_number(exif, _ORIENTATION, 1) if exif[:4] in _TIFF else 1
    return orientation if 1 <= orientation <= 8 else 1


def stored_orientation(data: bytes) -> int:
    """Return the orientation that a JPEG, PNG or TIFF says of itself; 1 = upright, or not said.

    In the marker APP1 (Exif 2.3, 4.7.2), the chunk eXIf (PNG, third edition, 11.3.4.5), or the
    directory of the TIFF.
    """
    if data[:4] in _TIFF:
        return orientation_of(data)
    if data.startswith(_PNG):
        return orientation_of(_png_chunk(data, b"eXIf"))
    return orientation_of(_jpeg_exif(data)) if data.startswith(_JPEG) else 1


def _png_chunk(data: bytes, kind: bytes) -> bytes:
    """Return what a chunk of a PNG holds; nothing where there is none."""
    offset = len(_PNG)
    while offset + 8 <= len(data):
        length = int.from_bytes(data[offset : offset + 4], "big")
        if data[offset + 4 : offset + 8] == kind:
            return data[offset + 8 : offset + 8 + length]
        offset += 12 + length
    return b""


def _jpeg_exif(data: bytes) -> bytes:
    """Return the EXIF data of a JPEG, which begin as a TIFF does; nothing where there are none."""
    offset = 2
    while offset + 4 <= len(data) and data[offset] == 0xFF:
        marker = data[offset + 1]
        if marker in _SOF_MARKERS or marker == 0xDA:
            break
        if marker == 0xFF or marker in _STANDALONE:
            offset += 1 if marker == 0xFF else 2
            continue
        length = int.from_bytes(data[offset + 2 : offset + 4], "big")
        part = data[offset + 4 : offset + 2 + length]
        if marker == 0xE1 and part.startswith(b"Exif\0\0"):
            return part[6:]
        offset += 2 + length
    return b""


def _is_webp(data: bytes) -> bool:
    return data[:4] == b"RIFF" and data[8:12] == b"WEBP"


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """Walk the markers up to the start of frame (ITU T.81, B.2); FF may fill up before one."""
    offset = 2
    while offset + 9 <= len(data):
        if data[offset] != 0xFF:
            raise CloudFormatError(f"JPEG: no marker at offset {offset}")
        marker = data[offset + 1]
        if marker == 0xFF:
            offset += 1
        elif marker in _SOF_MARKERS:
            height, width = struct.unpack_from(">HH", data, offset + 5)
            return int(width), int(height)
        elif marker in _STANDALONE:
            offset += 2
        else:
            offset += 2 + struct.unpack_from(">H", data, offset + 2)[0]
    raise CloudFormatError("JPEG cut off before its size")


def _webp_size(data: bytes) -> tuple[int, int]:
    kind = data[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (packed,) = struct.unpack_from("<I", data, 21)
        return (packed & 0x3FFF) + 1, (packed >> 14 & 0x3FFF) + 1
    low_w, high_w, low_h, high_h = struct.unpack_from("<HBHB", data, 24)
    return (low_w | high_w << 16) + 1, (low_h | high_h << 16) + 1


def _webp_frames(data: bytes) -> int:
    """Return the number of chunks ANMF of an animation; 1 for a still picture."""
    if data[12:16] != b"VP8X" or len(data) < 30 or not data[20] & _WEBP_ANIMATION:
        return 1
    count, offset = 0, 12
    while offset + 8 <= len(data):
        count += data[offset : offset + 4] == b"ANMF"
        length = int.from_bytes(data[offset + 4 : offset + 8], "little")
        offset += 8 + length + length % 2
    return count


def _tiff_pages(data: bytes) -> int:
    """Return the number of directories that are pages; a chain may be damaged, or run in a ring."""
    order, pages, seen = _TIFF[data[:4]], 0, set[int]()
    try:
        (start,) = struct.unpack_from(order + "I", data, 4)
        while start and start not in seen and len(seen) < _MAX_PICTURES:
            seen.add(start)
            pages += not _entries_at(data, order, start).get(_SUBFILE, 0) & _REDUCED_OR_MASK
            (count,) = struct.unpack_from(order + "H", data, start)
            (start,) = struct.unpack_from(order + "I", data, start + 2 + 12 * count)
    except struct.error:
        pass
    return pages


def _bmp_size(data: bytes) -> tuple[int, int]:
    if struct.unpack_from("<I", data, 14)[0] == 12:
        width, height = struct.unpack_from("<HH", data, 18)
    else:
        width, height = struct.unpack_from("<ii", data, 18)
    return int(width), abs(int(height))


def _tiff_number(data: bytes, tag: int, otherwise: int) -> int:
    """Return a number of a TIFF; another one where it is not said, or where the file is damaged."""
    try:
        return _tiff_entries(data).get(tag, otherwise)
    except struct.error:
        return otherwise


def _tiff_entries(data: bytes) -> dict[int, int]:
    """Return the whole numbers of the first directory by their tags (TIFF 6.0, section 2)."""
    order = _TIFF[data[:4]]
    (start,) = struct.unpack_from(order + "I", data, 4)
    return _entries_at(data, order, start)


def _entries_at(data: bytes, order: str, start: int) -> dict[int, int]:
    """Return the whole numbers of the directory at an offset."""
    (count,) = struct.unpack_from(order + "H", data, start)
    entries = {}
    for k in range(min(count, _MAX_TIFF_ENTRIES)):
        at = start + 2 + 12 * k
        tag, kind, values = struct.unpack_from(order + "HHI", data, at)
        code, size = {3: ("H", 2), 4: ("I", 4)}.get(kind, ("", 0))
        if not code:
            continue
        if values * size > 4:
            (at_value,) = struct.unpack_from(order + "I", data, at + 8)
        else:
            at_value = at + 8
        (entries[tag],) = struct.unpack_from(order + code, data, at_value)
    return entries
