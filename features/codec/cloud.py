"""Unorganised clouds: integers of one step, differences, byte planes, zstd."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.codec.container import (
    FLAG_COLOUR,
    FLAG_ORDER,
    KIND_CLOUD,
    SECTION_COLOURS,
    SECTION_POSITIONS,
    Container,
    Section,
    compress,
    expand,
    pack,
)
from features.codec.limits import CloudFormatError, Limits
from features.codec.quantised import (
    MORTON_BITS,
    checked_cloud,
    cloud_header,
    morton_code,
    read_lattice,
)
from features.codec.types import Cloud
from features.geometry import FloatArray, UInt8Array

__all__ = ["encode_cloud", "read_cloud"]

_MAX_EXTENT_STEPS = 2**31


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
    cleaned, rgb = checked_cloud(points, colours, step_m)
    origin = cleaned.min(axis=0) if len(cleaned) else np.zeros(3)
    steps = np.subtract(cleaned, origin)
    steps /= step_m
    np.rint(steps, out=steps)
    if steps.size and steps.max() >= _MAX_EXTENT_STEPS:
        raise ValueError(f"the cloud spans {steps.max():.0f} steps of {step_m} m; use a larger one")
    grid = steps.astype(np.int64)
    if not keep_order:
        top = int(grid.max()) if grid.size else 0
        coarse = grid >> max(top.bit_length() - MORTON_BITS, 0)
        order = np.argsort(morton_code(coarse), kind="stable")
        grid, rgb = grid[order], None if rgb is None else rgb[order]
    sections = {}
    if len(grid):
        sections[SECTION_POSITIONS] = _position_section(grid)
        if rgb is not None:
            planes = np.ascontiguousarray(rgb.T)
            planes[:, 1:] -= planes[:, :-1].copy()
            sections[SECTION_COLOURS] = compress(planes.tobytes())
    header = cloud_header(len(grid), step_m, origin, frame_id, stamp_s)
    flags = (FLAG_COLOUR if SECTION_COLOURS in sections else 0) | (FLAG_ORDER if keep_order else 0)
    return pack(KIND_CLOUD, flags, header, sections)


def _position_section(grid: NDArray[np.int64]) -> Section:
    """Return the differences of lattice points (n, 3), their bytes apart by significance."""
    axes = grid.T.copy()
    axes[:, 1:] -= grid.T[:, :-1]
    zigzag = (axes << 1) ^ (axes >> 63)
    width = 2 if zigzag.max() < 2**16 else 8
    planes = np.empty((3, width, len(grid)), np.uint8)
    for k in range(width):
        planes[:, k] = zigzag >> 8 * k
    return compress(planes.tobytes())


def read_cloud(container: Container, limits: Limits) -> Cloud:
    """Return the cloud of a container.

    Raises
    ------
    CloudFormatError
        When header and sections do not make a cloud.
    """
    lattice = read_lattice(container, limits)
    count = lattice.count
    if count == 0:
        return lattice.cloud(np.zeros((0, 3)), None)
    raw = expand(container.section(SECTION_POSITIONS, "positions"), "positions", limits)
    width, rest = divmod(len(raw), 3 * count)
    if rest or width not in (2, 8):
        raise CloudFormatError(f"positions: {len(raw)} bytes are not {count} points")
    planes = np.frombuffer(raw, np.uint8).reshape(3, width, count)
    return lattice.cloud_of(planes, lattice.colours(container, limits))
