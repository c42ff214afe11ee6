"""PLY (Turk 1994): vertices with x y z and optional red green blue; faces are skipped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import CloudFormatError, Limits
from features.codec.table import cloud_from_fields, read_text_rows
from features.codec.types import Cloud

__all__ = ["read_ply"]

_MAX_HEADER = 65_536
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


def read_ply(data: bytes, limits: Limits) -> Cloud:
    """Return the vertices of a PLY file.

    Raises
    ------
    CloudFormatError
        When the header does not read, or the file ends before its last vertex.
    """
    end = data.find(b"end_header", 0, _MAX_HEADER)
    body = data.find(b"\n", end) + 1
    if end < 0 or body == 0:
        raise CloudFormatError("PLY: the header has no end")
    order, count, fields = _read_header(data[:end].decode("ascii", "replace"))
    limits.check_points(count)
    if order == "":
        table = read_text_rows(data[body:], count, fields, "PLY")
    else:
        layout = np.dtype([(name, order + kind) for name, kind in fields])
        if len(data) - body < count * layout.itemsize:
            raise CloudFormatError(f"PLY: cut off; the header promises {count} vertices")
        packed: NDArray[np.void] = np.frombuffer(data, layout, count, body)
        table = {name: packed[name] for name, _ in fields}
    return cloud_from_fields(table, ("red", "green", "blue"), "PLY")


def _read_header(text: str) -> tuple[str, int, list[tuple[str, str]]]:
    """Return byte order ('' = text), number of vertices, and their fields as (name, type)."""
    order: str | None = None
    count, fields, element = -1, [], ""
    for line in text.split("\n")[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdigit():
            if element == "" and words[1] != "vertex":
                raise CloudFormatError("PLY: the first element must be the vertices")
            element, count = words[1], int(words[2]) if words[1] == "vertex" else count
        elif words[0] == "property" and element == "vertex":
            if len(words) != 3 or words[1] not in _TYPES:
                raise CloudFormatError(f"PLY: cannot read {line.strip()!r}")
            fields.append((words[2], _TYPES[words[1]]))
        elif words[0] not in ("property", "element"):
            raise CloudFormatError(f"PLY: cannot read {line.strip()!r}")
    if order is None or count < 0 or len({name for name, _ in fields}) != len(fields):
        raise CloudFormatError("PLY: the header names no format, no vertices, or a field twice")
    return order, count, fields
