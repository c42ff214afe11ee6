"""Named columns of numbers, as point files hold them, turned into a cloud."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import CloudFormatError
from features.codec.types import Cloud

__all__ = ["Table", "cloud_from_fields", "read_text_rows"]

Table = dict[str, NDArray[Any]]

_MAX_COORDINATE_M = 1_000.0


def read_text_rows(body: bytes, count: int, fields: list[tuple[str, str]], name: str) -> Table:
    """Read ``count`` rows of numbers separated by white space.

    Raises
    ------
    CloudFormatError
        Naming the row that does not read.
    """
    if count * 2 * len(fields) > len(body) + 1:
        raise CloudFormatError(f"{name}: cut off; the header promises {count} points")
    lines = body.decode("ascii", "replace").split("\n", count)[:count]
    values = np.zeros((count, len(fields)))
    for row, line in enumerate(lines):
        words = line.split()
        try:
            values[row] = [float(word) for word in words]
        except ValueError:
            raise CloudFormatError(
                f"{name}: row {row + 1} is not {len(fields)} numbers: {line[:60]!r}"
            ) from None
    if len(lines) < count:
        raise CloudFormatError(f"{name}: cut off; the header promises {count} points")
    table: Table = {}
    for index, (field, code) in enumerate(fields):
        column = values[:, index]
        with np.errstate(invalid="ignore"):
            table[field] = column.astype(code)
    return table


def cloud_from_fields(
    table: Table, colour_names: tuple[str, str, str], name: str, shape: tuple[int, ...] = ()
) -> Cloud:
    """Return the cloud of columns x, y, z and, where there, colours; drops what is not finite.

    Parameters
    ----------
    shape
        Rows and columns of an organised cloud.
    """
    missing = [axis for axis in "xyz" if axis not in table]
    if missing:
        raise CloudFormatError(f"{name}: no field {', '.join(missing)}")
    with np.errstate(over="ignore", invalid="ignore"):
        positions = np.stack([table[axis].astype(np.float32) for axis in "xyz"], axis=-1)
    finite = np.isfinite(positions).all(axis=1)
    whole, positions = shape or (len(positions),), positions[finite]
    if positions.size and np.abs(positions).max() > _MAX_COORDINATE_M:
        raise CloudFormatError(f"{name}: a point lies beyond {_MAX_COORDINATE_M:.0f} m")
    colours = None
    if all(channel in table for channel in colour_names):
        channels = [table[channel] for channel in colour_names]
        if any(channel.dtype != np.uint8 for channel in channels):
            raise CloudFormatError(f"{name}: colours must be 8-bit whole numbers")
        colours = np.stack(channels, axis=-1)[finite]
    places = None if finite.all() else np.flatnonzero(finite)
    return Cloud(positions, colours, shape=whole, places=places)
