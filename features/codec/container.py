"""The container ``RTKC``: a header, then sections, each with its length and CRC-32.

Little-endian::

    0   magic "RTKC"            8   length of the JSON header
    4   version                 12  JSON header, UTF-8
    5   kind                    ..  sections: type u8, codec u8, 0 u16, stored u32, raw u32, CRC u32
    6   flags

Unknown section types are skipped, unknown versions refused. Points are packed with zstd.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import zstandard

from features.codec.limits import CloudFormatError, Limits

__all__ = [
    "CODEC_JPEG",
    "CODEC_PNG",
    "CODEC_ZSTD",
    "KIND_CLOUD",
    "KIND_FRAME",
    "KIND_OCTREE",
    "MAGIC",
    "Container",
    "Section",
    "compress",
    "expand",
    "pack",
    "unpack",
]

MAGIC = b"RTKC"
VERSION = 1
KIND_FRAME, KIND_CLOUD, KIND_OCTREE = 1, 2, 3
FLAG_COLOUR, FLAG_MASK, FLAG_ORDER = 1, 2, 4
_FLAGS = FLAG_COLOUR | FLAG_MASK | FLAG_ORDER

SECTION_DEPTH, SECTION_COLOUR, SECTION_MASK = 1, 2, 3
SECTION_POSITIONS, SECTION_COLOURS, SECTION_OCTREE = 4, 5, 6
CODEC_PNG, CODEC_JPEG, CODEC_ZSTD = 1, 2, 3

_PROMISED = {FLAG_COLOUR: {SECTION_COLOUR, SECTION_COLOURS}, FLAG_MASK: {SECTION_MASK}}

_HEAD = struct.Struct("<4sBBHI")
_SECTION = struct.Struct("<BBHIII")
_MAX_JSON = 4_096
_LEVEL = 3
_WINDOW = 64 * 2**20


@dataclass(frozen=True)
class Section:
    """One section: codec, bytes as stored, length after unpacking."""

    codec: int
    stored: bytes
    raw_length: int


@dataclass(frozen=True)
class Container:
    """Header and sections as :func:`unpack` returns them.

    Parameters
    ----------
    kind
        :data:`KIND_FRAME`, :data:`KIND_CLOUD` or :data:`KIND_OCTREE`.
    header
        Numbers and names of the JSON header.
    sections
        By type.
    """

    kind: int
    flags: int
    header: Mapping[str, Any]
    sections: Mapping[int, Section]

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number of the header."""
        value = self.header.get(key, default)
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not math.isfinite(value)
        ):
            raise CloudFormatError(f"header: {key} must be a finite number, got {value!r}")
        return float(value)

    def integer(self, key: str, default: int | None = None) -> int:
        """Return a non-negative whole number of the header."""
        value = self.header.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise CloudFormatError(f"header: {key} must be a whole number >= 0, got {value!r}")
        return value

    def text(self, key: str) -> str:
        """Return a text of the header, empty when absent."""
        value = self.header.get(key, "")
        if not isinstance(value, str):
            raise CloudFormatError(f"header: {key} must be text, got {value!r}")
        return value

    def section(self, kind: int, name: str) -> Section:
        """Return a section that must be there."""
        if kind not in self.sections:
            raise CloudFormatError(f"the {name} section is missing")
        return self.sections[kind]


def pack(
    kind: int, flags: int, header: Mapping[str, Any], sections: Mapping[int, Section]
) -> bytes:
    """Return the container's bytes; the same content gives the same bytes."""
    text = json.dumps(header, separators=(",", ":"), sort_keys=True, allow_nan=False).encode()
    if len(text) > _MAX_JSON:
        raise ValueError(f"the header takes {len(text)} bytes; at most {_MAX_JSON} fit")
    parts = [_HEAD.pack(MAGIC, VERSION, kind, flags, len(text)), text]
    for number, section in sorted(sections.items()):
        parts.append(
            _SECTION.pack(
                number,
                section.codec,
                0,
                len(section.stored),
                section.raw_length,
                zlib.crc32(section.stored),
            )
        )
        parts.append(section.stored)
    return b"".join(parts)


def unpack(data: bytes, limits: Limits) -> Container:
    """Read a container, checking every length and digest before it is believed.

    Raises
    ------
    CloudFormatError
        Naming the offset and the field.
    """
    limits.check_stored(len(data))
    if len(data) < _HEAD.size:
        raise CloudFormatError(f"cut off after {len(data)} bytes, within the header")
    magic, version, kind, flags, length = _HEAD.unpack_from(data)
    if magic != MAGIC:
        raise CloudFormatError(f"not a container: starts with {data[:8].hex(' ')}")
    if version != VERSION:
        raise CloudFormatError(f"container of version {version}; this reader knows {VERSION}")
    if kind not in (KIND_FRAME, KIND_CLOUD, KIND_OCTREE) or flags & ~_FLAGS:
        raise CloudFormatError(f"offset 5: unknown kind {kind} or flags {flags:#x}")
    end = _HEAD.size + length
    if length > _MAX_JSON or end > len(data):
        raise CloudFormatError(f"offset 8: a header of {length} bytes does not fit")
    header = _read_header(data[_HEAD.size : end])
    sections = _read_sections(data, end)
    for flag, promised in _PROMISED.items():
        if flags & flag and not promised & sections.keys():
            raise CloudFormatError("cut off: a section that the flags promise is missing")
    return Container(kind, flags, header, sections)


def _read_header(text: bytes) -> dict[str, Any]:
    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len({key for key, _ in pairs}) != len(pairs):
            raise CloudFormatError("header: a key stands twice")
        return dict(pairs)

    try:
        header = json.loads(text.decode("utf-8"), object_pairs_hook=unique)
    except CloudFormatError:
        raise
    except (ValueError, RecursionError) as error:
        raise CloudFormatError(f"header: not JSON ({error})") from None
    if not isinstance(header, dict):
        raise CloudFormatError("header: not an object")
    return header


def _read_sections(data: bytes, offset: int) -> dict[int, Section]:
    sections: dict[int, Section] = {}
    while offset < len(data):
        if offset + _SECTION.size > len(data):
            raise CloudFormatError(f"offset {offset}: cut off within a section's head")
        number, codec, reserved, stored, raw, crc = _SECTION.unpack_from(data, offset)
        offset += _SECTION.size
        if reserved or stored > len(data) - offset:
            raise CloudFormatError(f"offset {offset}: a section of {stored} bytes does not fit")
        if number in sections:
            raise CloudFormatError(f"offset {offset}: section {number} stands twice")
        content = data[offset : offset + stored]
        if zlib.crc32(content) != crc:
            raise CloudFormatError(f"offset {offset}: section {number} is damaged (CRC-32)")
        sections[number] = Section(codec, content, raw)
        offset += stored
    return sections


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
