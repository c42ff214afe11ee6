"""Reading whatever a robot sends: the format is found from the first bytes, never from a name."""

from __future__ import annotations

import zlib

import zstandard

from features.codec.cloud import read_cloud
from features.codec.container import KIND_FRAME, KIND_OCTREE, MAGIC, unpack
from features.codec.frame import read_frame
from features.codec.image_header import is_image
from features.codec.limits import CloudFormatError, Limits, UnknownFormatError
from features.codec.octree import read_octree
from features.codec.pcd import is_pcd, read_pcd
from features.codec.ply import read_ply
from features.codec.types import Cloud
from features.geometry import Frame

__all__ = ["decode"]

_ZSTD = b"\x28\xb5\x2f\xfd"


def decode(data: bytes, limits: Limits | None = None) -> Frame | Cloud:
    """Return the frame or cloud that the bytes hold.

    Understands the project's own container, PLY and PCD, each also inside one layer of zstd or
    zlib.

    Raises
    ------
    CloudFormatError
        With the first bytes when it is none of these, else what is wrong with it.
    """
    limits = limits or Limits()
    limits.check_stored(len(data))
    inner = _unwrap(data, limits)
    if inner is not None:
        if _unwrap_kind(inner):
            raise CloudFormatError("compressed twice; one layer is accepted")
        data = inner
    return _read(data, limits)


def _read(data: bytes, limits: Limits) -> Frame | Cloud:
    if data.startswith(MAGIC):
        container = unpack(data, limits)
        if container.kind == KIND_FRAME:
            return read_frame(container, limits)
        if container.kind == KIND_OCTREE:
            return read_octree(container, limits)
        return read_cloud(container, limits)
    if data.startswith((b"ply\n", b"ply\r")):
        return read_ply(data, limits)
    if is_pcd(data):
        return read_pcd(data, limits)
    if is_image(data):
        raise CloudFormatError("an image, not a cloud: send it as `image`, the cloud as `data`")
    if data.startswith(b"DRACO"):
        raise CloudFormatError("Draco: its decoder knows no limits; send RTKC, PLY or PCD")
    if not data:
        raise UnknownFormatError("not a point cloud: no bytes at all")
    raise UnknownFormatError(f"not a point cloud: starts with {data[:8].hex(' ')}")


def _unwrap_kind(data: bytes) -> str:
    if data.startswith(_ZSTD):
        return "zstd"
    if len(data) > 2 and data[0] == 0x78 and (data[0] * 256 + data[1]) % 31 == 0:
        return "zlib"
    return ""


def _unwrap(data: bytes, limits: Limits) -> bytes | None:
    """Return what a zstd or zlib layer holds, None when there is no such layer."""
    kind = _unwrap_kind(data)
    if kind == "zstd":
        return _unwrap_zstd(data, limits)
    if kind == "zlib":
        reader = zlib.decompressobj()
        try:
            raw = reader.decompress(data, limits.decoded_bytes + 1)
        except zlib.error as error:
            raise CloudFormatError(f"zlib: does not unpack ({error})") from None
        limits.check_decoded(len(raw), len(data), "zlib")
        if not reader.eof or reader.unused_data:
            raise CloudFormatError("zlib: cut off, or followed by something else")
        return raw
    return None


def _unwrap_zstd(data: bytes, limits: Limits) -> bytes:
    try:
        size = zstandard.frame_content_size(data)
        if size < 0:
            raise CloudFormatError("zstd: the frame does not say its size")
        limits.check_decoded(size, len(data), "zstd")
        reader = zstandard.ZstdDecompressor(max_window_size=64 * 2**20).decompressobj()
        raw = reader.decompress(data)
    except zstandard.ZstdError as error:
        raise CloudFormatError(f"zstd: does not unpack ({error})") from None
    if len(raw) != size or reader.unused_data:
        raise CloudFormatError("zstd: cut off, or followed by something else")
    return raw
