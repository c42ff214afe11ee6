"""Named columns of numbers, as point files hold them, turned into a cloud."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import CloudFormatError
from features.codec.types import Cloud

__all__ = ["Table", "as_eight_bits", "cloud_from_fields", "read_text_rows", "split_colour"]

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
        channels = np.stack([table[channel] for channel in colour_names], axis=-1)
        colours = as_eight_bits(channels)[finite]
    places = None if finite.all() else np.flatnonzero(finite)
    return Cloud(positions, colours, shape=whole, places=places)


def as_eight_bits(channels: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours (n, 3) as 0 to 255, whatever scale they were written in.

    No format says the scale, so the largest number does: shares of one, 8 bits or 16. A file of
    numbers up to one in floats is shares, for no scene is as dark as 1 of 255.

    Examples
    --------
    >>> as_eight_bits(np.array([[1.0, 0.2, 0.0]])).tolist()
    [[255, 51, 0]]
    >>> as_eight_bits(np.array([[200.0, 51.0, 0.0]])).tolist()
    [[200, 51, 0]]
    >>> as_eight_bits(np.array([[65535, 13107, 0]], np.uint16)).tolist()
    [[255, 51, 0]]
    """
    if channels.dtype == np.uint8:
        return np.asarray(channels, np.uint8)
    values = np.nan_to_num(channels.astype(np.float64), posinf=0.0, neginf=0.0)
    largest = values.max(initial=0.0)
    if largest > 255:
        values = values / 257
    elif channels.dtype.kind == "f" and largest <= 1:
        values = values * 255
    return np.rint(np.clip(values, 0, 255)).astype(np.uint8)


def split_colour(table: Table) -> None:
    """Replace a packed ``rgb`` or ``rgba`` field (uint32, or the same bits as float) by r, g, b."""
    for name in ("rgb", "rgba"):
        if name in table and table[name].dtype.itemsize == 4:
            packed = np.ascontiguousarray(table.pop(name)).view(np.uint32)
            for channel, shift in (("r", 16), ("g", 8), ("b", 0)):
                table[channel] = ((packed >> shift) & 255).astype(np.uint8)
