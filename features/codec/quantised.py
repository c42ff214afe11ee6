"""Functions shared by the lattice codecs: validation, header, colours, conversion, Morton order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec.container import SECTION_COLOURS, Container, expand
from features.codec.limits import CloudFormatError, Limits
from features.codec.types import Cloud
from features.geometry import FloatArray, UInt8Array

__all__ = [
    "MORTON_BITS",
    "Lattice",
    "cells_from_morton",
    "checked_cloud",
    "cloud_header",
    "morton_code",
    "read_lattice",
]

MORTON_BITS = 21
"""Bits of each coordinate in a 64-bit code."""

_MAX_COORDINATE_M = 1_000.0


def checked_cloud(
    points: FloatArray, colours: UInt8Array | None, step_m: float
) -> tuple[NDArray[np.float64], UInt8Array | None]:
    """Return the finite points (n, 3), m and their colours.

    Raises
    ------
    ValueError
        Wrong shape or dtype, or a step that is not positive.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"expected points of shape (n, 3) in m, got {points.shape}")
    if colours is not None and (colours.dtype != np.uint8 or colours.shape != points.shape):
        raise ValueError(
            f"expected uint8 colours of shape {points.shape}, got {colours.dtype} {colours.shape}"
        )
    if not (np.isfinite(step_m) and step_m > 0):
        raise ValueError(f"the step must be positive, got {step_m} m")
    finite = np.isfinite(points[:, 0]) & np.isfinite(points[:, 1]) & np.isfinite(points[:, 2])
    if not finite.all():
        points, colours = points[finite], None if colours is None else colours[finite]
    # Axis by axis in memory, as all that follows goes along one axis at a time.
    return np.asarray(points, np.float64, order="F"), colours


def cloud_header(
    count: int, step_m: float, origin: FloatArray, frame_id: str, stamp_s: float
) -> dict[str, Any]:
    """Return the JSON header of a cloud on a lattice."""
    return {
        "points": count,
        "step_m": step_m,
        "origin_m": [float(v) for v in origin],
        "frame_id": frame_id,
        "stamp": stamp_s,
    }


@dataclass(frozen=True)
class Lattice:
    """Origin and cell size of a quantised cloud.

    Parameters
    ----------
    count
        Of points.
    step_m
        Edge of a cell.
    origin : (3,), m
        Of the cell (0, 0, 0).
    """

    count: int
    step_m: float
    origin: NDArray[np.float64]
    frame_id: str
    stamp_s: float

    def colours(self, container: Container, limits: Limits) -> UInt8Array | None:
        """Return the colours (count, 3) of a container, or None when it has none."""
        if SECTION_COLOURS not in container.sections:
            return None
        raw = expand(container.sections[SECTION_COLOURS], "colours", limits)
        if len(raw) != 3 * self.count:
            raise CloudFormatError(f"colours: {len(raw)} bytes are not {self.count} colours")
        from features.codec.differences import add_up_colours

        colours = np.empty((self.count, 3), np.uint8)
        add_up_colours(np.frombuffer(raw, np.uint8).reshape(3, self.count), colours)
        return colours

    def cloud(self, cells: NDArray[Any], colours: UInt8Array | None) -> Cloud:
        """Return the cloud of cells (count, 3), which need not be whole numbers."""
        places = cells * self.step_m + self.origin
        _check_extent(np.abs(places).max(initial=0.0))
        return Cloud(places.astype(np.float32), colours, self.frame_id, self.stamp_s)

    def cloud_of(self, planes: UInt8Array, colours: UInt8Array | None) -> Cloud:
        """Return the cloud whose cells differ from one to the next by (3, width, count) bytes."""
        from features.codec.differences import add_up_positions

        positions = np.empty((self.count, 3), np.float32)
        _check_extent(add_up_positions(planes, self.step_m, self.origin, positions))
        return Cloud(positions, colours, self.frame_id, self.stamp_s)


def _check_extent(most_m: float) -> None:
    if not most_m <= _MAX_COORDINATE_M:  # true of NaN too
        raise CloudFormatError(f"positions: a point lies beyond {_MAX_COORDINATE_M:.0f} m")


def read_lattice(container: Container, limits: Limits) -> Lattice:
    """Return the lattice of a container's header.

    Raises
    ------
    CloudFormatError
        When the header does not describe one.
    """
    count = container.integer("points")
    limits.check_points(count)
    step = container.number("step_m")
    origin = container.header.get("origin_m", [0.0, 0.0, 0.0])
    if step <= 0 or not _is_point(origin):
        raise CloudFormatError("header: step_m must be positive and origin_m three finite numbers")
    return Lattice(
        count, step, np.array(origin, np.float64), container.text("frame_id"),
        container.number("stamp", 0.0),
    )  # fmt: skip


def _is_point(value: object) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
        and bool(np.isfinite(value).all())
    )


def morton_code(cells: NDArray[np.integer]) -> NDArray[np.uint64]:
    """Return the codes (n,) of cells (n, 3) in 0..2^21 - 1; x has the lowest bit.

    >>> morton_code(np.array([[1, 0, 0], [0, 1, 0], [3, 0, 1]])).tolist()
    [1, 2, 13]
    """
    wide = np.asarray(cells).astype(np.uint64)
    code = np.zeros(len(wide), np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            taken = (wide[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= taken << np.uint64(3 * bit + axis)
    return code


def cells_from_morton(code: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the cells (n, 3) of codes (n,).

    >>> cells_from_morton(np.array([13], np.uint64)).tolist()
    [[3, 0, 1]]
    """
    cells = np.zeros((len(code), 3), np.int64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            taken = (code >> np.uint64(3 * bit + axis)) & np.uint64(1)
            cells[:, axis] |= (taken << np.uint64(bit)).astype(np.int64)
    return cells
