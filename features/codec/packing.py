"""Sections packed with zstd, unpacked only when their size is as promised."""

from __future__ import annotations

import zstandard

from features.codec.container import CODEC_ZSTD, Section
from features.codec.errors import CloudFormatError
from features.codec.limits import Limits

__all__ = ["compress", "expand"]

_LEVEL = 3
_WINDOW = 64 * 2**20


def compress(raw: bytes) -> Section:
    """Return bytes as a packed section."""
    return Section(CODEC_ZSTD, zstandard.ZstdCompressor(level=_LEVEL).compress(raw), len(raw))


def expand(section: Section, name: str, limits: Limits) -> bytes:
    """Unpack a section; the library trusts a frame's own content size, so that is compared first.

    Raises
    ------
    CloudFormatError
        When it is not packed so, does not unpack, or holds another number of bytes than it says.
    """
    if section.codec != CODEC_ZSTD:
        raise CloudFormatError(f"{name}: unknown codec {section.codec}")
    limits.check_decoded(section.raw_length, len(section.stored), name)
    try:
        size = zstandard.frame_content_size(section.stored)
        if size != section.raw_length:
            raise CloudFormatError(
                f"{name}: the zstd frame holds {size} bytes, the section says {section.raw_length}"
            )
        reader = zstandard.ZstdDecompressor(max_window_size=_WINDOW).decompressobj()
        raw = reader.decompress(section.stored)
    except zstandard.ZstdError as error:
        raise CloudFormatError(f"{name}: does not unpack ({error})") from None
    if len(raw) != section.raw_length or reader.unused_data:
        raise CloudFormatError(f"{name}: unpacks to {len(raw)} bytes, not {section.raw_length}")
    return raw
