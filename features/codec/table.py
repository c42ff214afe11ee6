"""Named columns of numbers, as point files hold them, turned into a cloud."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import CloudFormatError
from features.codec.types import Cloud

__all__ = ["COLOURS", "Table", "cloud_from_fields", "colours_of", "read_text_rows"]

Table = dict[str, NDArray[Any]]

COLOURS = (
    ("r", "g", "b"),
    ("red", "green", "blue"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("ambient_red", "ambient_green", "ambient_blue"),
)
"""Names of the columns of colours in files and messages, in small letters."""
_PACKED = ("rgb", "rgba")

_MAX_COORDINATE_M = 1_000.0
_MANY_AT_ORIGIN = 10


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


def cloud_from_fields(table: Table, name: str, shape: tuple[int, ...] = ()) -> Cloud:
    """Return the cloud of columns x, y, z and, where there, colours; drops what is not finite.

    Names may be written in capital letters.

    Parameters
    ----------
    shape
        Rows and columns of an organised cloud, which loses what lies at its origin too; so does
        any of which many points do.
    """
    table = {column.lower(): values for column, values in table.items()}
    missing = [axis for axis in "xyz" if axis not in table]
    if missing:
        raise CloudFormatError(f"{name}: no field {', '.join(missing)}")
    with np.errstate(over="ignore", invalid="ignore"):
        positions = np.stack([table[axis].astype(np.float32) for axis in "xyz"], axis=-1)
    finite = np.isfinite(positions).all(axis=1)
    is_away = positions.any(axis=1)
    # Nothing is measured where the camera stands: some write that for what they did not see. A
    # model of a thing may have one point at its origin, and not many.
    if shape or np.count_nonzero(~is_away) >= max(_MANY_AT_ORIGIN, 0.01 * len(positions)):
        finite &= is_away
    whole, positions = shape or (len(positions),), positions[finite]
    if positions.size and np.abs(positions).max() > _MAX_COORDINATE_M:
        raise CloudFormatError(
            f"{name}: a point lies beyond {_MAX_COORDINATE_M:.0f} m: is it in another unit, or are "
            "its bytes in another order?"
        )
    colours = colours_of(table)
    if colours is not None:
        colours = colours[finite]
    places = None if finite.all() else np.flatnonzero(finite)
    return Cloud(positions, colours, shape=whole, places=places)


def colours_of(table: Table) -> NDArray[np.uint8] | None:
    """Return the colours (n, 3) of columns by their names in small letters; None if there are none.

    They are numbers of one scale in three columns, see :data:`COLOURS`, or packed into one, ``rgb``
    or ``rgba``: 0xRRGGBB as a whole number, or its bits as a float (Point Cloud Library).

    Examples
    --------
    >>> colours_of({"rgb": np.array([0x0A0B0C], np.uint32).view(np.float32)}).tolist()
    [[10, 11, 12]]
    >>> colours_of({"rgb": np.array([4.210752e6], np.float32)}).tolist()
    [[64, 64, 64]]
    """
    for name in _PACKED:
        if name in table:
            numbers = _whole_numbers(table[name])
            if numbers is not None:
                channels = [numbers >> shift & 255 for shift in (16, 8, 0)]
                return np.stack(channels, axis=-1).astype(np.uint8)
    for names in COLOURS:
        if set(names) <= table.keys():
            return _as_eight_bits(np.stack([table[channel] for channel in names], axis=-1))
    return None


def _whole_numbers(packed: NDArray[Any]) -> NDArray[np.uint32] | None:
    """Return packed colours as whole numbers; None where a column is no such.

    The float whose bits are a colour lies below 1e-37, or is negative or none at all where alpha is
    set. So floats that are all whole are the numbers themselves, as older programs wrote them.
    """
    if packed.dtype.kind in "iu" and packed.dtype.itemsize >= 4:
        return np.asarray(packed.astype(np.int64) & 0xFFFFFFFF, np.uint32)
    if packed.dtype.kind != "f":
        return None
    with np.errstate(invalid="ignore"):
        is_whole = (packed >= 0) & (packed < 2**24) & (packed == np.floor(packed))
    if is_whole.all():
        return packed.astype(np.uint32)
    if packed.dtype.itemsize != 4:
        return None
    native = np.ascontiguousarray(packed.astype(packed.dtype.newbyteorder("=")))
    return native.view(np.uint32)


def _as_eight_bits(channels: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours (n, 3) as 0 to 255, whatever scale they were written in.

    No format says the scale, so the largest number does: shares of one, 8 bits or 16. Either scale
    may be exceeded by a little, where colours were interpolated; no scene is as dark as 2 of 255.

    Examples
    --------
    >>> _as_eight_bits(np.array([[1.02, 0.2, 0.0]])).tolist()
    [[255, 51, 0]]
    >>> _as_eight_bits(np.array([[256.0, 51.0, 0.0]])).tolist()
    [[255, 51, 0]]
    >>> _as_eight_bits(np.array([[65535, 13107, 0]], np.uint16)).tolist()
    [[255, 51, 0]]
    """
    if channels.dtype == np.uint8:
        return np.asarray(channels, np.uint8)
    values = np.nan_to_num(channels.astype(np.float64), posinf=0.0, neginf=0.0)
    largest = values.max(initial=0.0)
    if largest > 2 * 255:
        values = values / 257
    elif channels.dtype.kind == "f" and largest <= 2:
        values = values * 255
    return np.rint(np.clip(values, 0, 255)).astype(np.uint8)
