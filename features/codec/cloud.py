"""Unorganised clouds: integers of one step, differences, byte planes, zstd."""

from __future__ import annotations

import numpy as np
import zstandard
from numpy.typing import NDArray

from features.codec.container import (
    CODEC_ZSTD,
    FLAG_COLOUR,
    FLAG_ORDER,
    KIND_CLOUD,
    SECTION_COLOURS,
    SECTION_POSITIONS,
    Container,
    Section,
    pack,
)
from features.codec.errors import CloudFormatError
from features.codec.limits import Limits
from features.codec.types import Cloud
from features.geometry import FloatArray, UInt8Array

__all__ = ["encode_cloud", "read_cloud"]

_ZSTD_LEVEL = 3
_MAX_EXTENT_STEPS = 2**31
_MAX_COORDINATE_M = 1_000.0
_MORTON_BITS = 21


def encode_cloud(
    points: FloatArray,
    colours: UInt8Array | None = None,
    step_m: float = 0.001,
    *,
    keep_order: bool = True,
    frame_id: str = "",
    stamp_s: float = 0.0,
) -> bytes:
    """Return a cloud as a container.

    Parameters
    ----------
    points : (n, 3) float, m
        Not finite points are dropped.
    colours : (n, 3) uint8 RGB, or None
    step_m
        Resolution; the error is at most half of it per axis.
    keep_order
        True for a scan, whose neighbours follow each other; False sorts along the Morton curve,
        without which a shuffled cloud does not compress.

    Raises
    ------
    ValueError
        Wrong shape or dtype, or an extent of more than 2^31 steps.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"expected points of shape (n, 3) in m, got {points.shape}")
    if colours is not None and (colours.dtype != np.uint8 or colours.shape != points.shape):
        raise ValueError(
            f"expected uint8 colours of shape {points.shape}, got {colours.dtype} {colours.shape}"
        )
    if not (np.isfinite(step_m) and step_m > 0):
        raise ValueError(f"step_m must be positive, got {step_m}")
    finite = np.isfinite(points).all(axis=1)
    kept = points[finite].astype(np.float64)
    origin = kept.min(axis=0) if len(kept) else np.zeros(3)
    steps = np.round((kept - origin) / step_m)
    if steps.size and steps.max() >= _MAX_EXTENT_STEPS:
        raise ValueError(f"the cloud spans {steps.max():.0f} steps of {step_m} m; use a larger one")
    grid = steps.astype(np.int64)
    rgb = None if colours is None else colours[finite]
    if not keep_order:
        order = np.argsort(_morton(grid), kind="stable")
        grid, rgb = grid[order], None if rgb is None else rgb[order]
    sections = {}
    if len(grid):
        sections[SECTION_POSITIONS] = _position_section(grid)
        if rgb is not None:
            delta = np.diff(rgb, axis=0, prepend=np.zeros((1, 3), np.uint8))
            sections[SECTION_COLOURS] = _compress(delta.T.tobytes())
    header = {
        "points": len(grid),
        "step_m": step_m,
        "origin_m": [float(v) for v in origin],
        "frame_id": frame_id,
        "stamp": stamp_s,
    }
    flags = (FLAG_COLOUR if SECTION_COLOURS in sections else 0) | (FLAG_ORDER if keep_order else 0)
    return pack(KIND_CLOUD, flags, header, sections)


def _position_section(grid: NDArray[np.int64]) -> Section:
    delta = np.diff(grid, axis=0, prepend=np.zeros((1, 3), np.int64))
    zigzag = ((delta << 1) ^ (delta >> 63)).astype(np.uint64)
    width = 2 if zigzag.max() < 2**16 else 8
    packed = zigzag.astype(f"<u{width}")
    planes = packed.T.copy().view(np.uint8).reshape(3, -1, width).transpose(0, 2, 1)
    return _compress(planes.tobytes())


def _compress(raw: bytes) -> Section:
    stored = zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(raw)
    return Section(CODEC_ZSTD, stored, len(raw))


def _morton(grid: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Interleave the 21 highest bits of the coordinates."""
    top = int(grid.max()) if grid.size else 0
    cells = (grid >> max(top.bit_length() - _MORTON_BITS, 0)).astype(np.uint64)
    code = np.zeros(len(grid), np.uint64)
    for bit in range(_MORTON_BITS):
        for axis in range(3):
            taken = (cells[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= taken << np.uint64(3 * bit + axis)
    return code


def read_cloud(container: Container, limits: Limits) -> Cloud:
    """Return the cloud of a container.

    Raises
    ------
    CloudFormatError
        When header and sections do not make a cloud.
    """
    count = container.integer("points")
    limits.check_points(count)
    step = container.number("step_m")
    origin = container.header.get("origin_m", [0.0, 0.0, 0.0])
    if step <= 0 or not _is_point(origin):
        raise CloudFormatError("header: step_m must be positive and origin_m three finite numbers")
    frame_id, stamp_s = container.text("frame_id"), container.number("stamp", 0.0)
    if count == 0:
        return Cloud(np.zeros((0, 3), np.float32), None, frame_id, stamp_s)
    raw = _expand(container.section(SECTION_POSITIONS, "positions"), "positions", limits)
    width, rest = divmod(len(raw), 3 * count)
    if rest or width not in (2, 8):
        raise CloudFormatError(f"positions: {len(raw)} bytes are not {count} points")
    planes = np.frombuffer(raw, np.uint8).reshape(3, width, count).transpose(0, 2, 1)
    packed = np.ascontiguousarray(planes).view(f"<u{width}").reshape(3, count).T.astype(np.uint64)
    delta = (packed >> np.uint64(1)).astype(np.int64) ^ -(packed & np.uint64(1)).astype(np.int64)
    grid = np.cumsum(delta, axis=0)
    positions = grid * step + np.array(origin, dtype=np.float64)
    if not np.isfinite(positions).all() or np.abs(positions).max() > _MAX_COORDINATE_M:
        raise CloudFormatError(f"positions: a point lies beyond {_MAX_COORDINATE_M:.0f} m")
    colours = None
    if SECTION_COLOURS in container.sections:
        raw = _expand(container.sections[SECTION_COLOURS], "colours", limits)
        if len(raw) != 3 * count:
            raise CloudFormatError(f"colours: {len(raw)} bytes are not {count} colours")
        changes = np.frombuffer(raw, np.uint8).reshape(3, count).T
        colours = np.cumsum(changes, axis=0, dtype=np.uint64).astype(np.uint8)
    return Cloud(positions.astype(np.float32), colours, frame_id, stamp_s)


def _is_point(value: object) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
        and bool(np.isfinite(value).all())
    )


def _expand(section: Section, name: str, limits: Limits) -> bytes:
    """Unpack zstd; the library trusts a frame's own content size, so that is compared first."""
    if section.codec != CODEC_ZSTD:
        raise CloudFormatError(f"{name}: unknown codec {section.codec}")
    limits.check_decoded(section.raw_length, len(section.stored), name)
    try:
        size = zstandard.frame_content_size(section.stored)
        if size != section.raw_length:
            raise CloudFormatError(
                f"{name}: the zstd frame holds {size} bytes, the section says {section.raw_length}"
            )
        reader = zstandard.ZstdDecompressor(max_window_size=64 * 2**20).decompressobj()
        raw = reader.decompress(section.stored)
    except zstandard.ZstdError as error:
        raise CloudFormatError(f"{name}: does not unpack ({error})") from None
    if len(raw) != section.raw_length or reader.unused_data:
        raise CloudFormatError(f"{name}: unpacks to {len(raw)} bytes, not {section.raw_length}")
    return raw
