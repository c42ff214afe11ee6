"""PLY (Turk 1994): vertices with x y z, optional red green blue, range grid; faces are skipped."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from features.codec.limits import CloudFormatError, Limits
from features.codec.table import Table, cloud_from_fields, read_text_rows
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

    A range grid (Turk 1994) or the camera of the Point Cloud Library makes an organised cloud.
    Colours are numbers of 8 or 16 bits, shares of one, or packed into one ``rgb``; lists within a
    vertex are skipped.

    Raises
    ------
    CloudFormatError
        When the header does not read, or the file ends before its last vertex.
    """
    data = _with_line_feeds(data)
    end = data.find(b"\nend_header", 0, _MAX_HEADER) + 1
    body = data.find(b"\n", end) + 1
    if end == 0 or body == 0:
        raise CloudFormatError("PLY: the header has no end")
    header = _read_header(data[:end].decode("ascii", "replace"))
    limits.check_points(header.count)
    rows = data[_start_of_vertices(header, data, body, limits) :]
    table, rest = _vertices(header, rows)
    shape, places = _organisation(header, rest, limits)
    count = header.count
    if places is None:
        return cloud_from_fields(table, "PLY", shape)
    cloud = cloud_from_fields(table, "PLY")
    numbers = np.arange(count) if cloud.places is None else cloud.places
    seats = np.full(count, -1, np.int64)
    seats[places[places >= 0]] = np.flatnonzero(places >= 0)
    of = seats[numbers]
    if (of < 0).any():
        raise CloudFormatError("PLY: a vertex has no place in the range grid")
    return replace(cloud, shape=shape, places=of)


def _with_line_feeds(data: bytes) -> bytes:
    """Return a file whose lines end with CR alone, as old Macintosh programs wrote, with LF."""
    first = data.find(b"\r")
    if first < 0 or b"\n" in data[: first + 2]:
        return data
    end = data.find(b"\rend_header\r", 0, _MAX_HEADER) + len(b"\rend_header\r")
    head, body = data[:end].replace(b"\r", b"\n"), data[end:]
    # Numbers of a binary body may hold the byte of CR.
    return head + (body.replace(b"\r", b"\n") if b"\nformat ascii " in head else body)


def _vertices(header: _Header, rows: bytes) -> tuple[Table, bytes]:
    """Return the columns of the vertices, and the bytes after the last one."""
    count, rest = header.count, b""
    fields = [(name, kind) for name, kind in header.fields if kind]
    if header.order == "":
        lines = rows.split(b"\n", count)
        if header.lists:
            rows = b"\n".join(_without_lists(line, header) for line in lines[:count]) + b"\n"
        rest = lines[count] if len(lines) > count else b""
        return read_text_rows(rows, count, fields, "PLY"), rest
    if header.lists:
        rows, rest = _rows_without_lists(header, rows)
    layout = np.dtype([(name, header.order + kind) for name, kind in fields])
    if len(rows) < count * layout.itemsize:
        raise CloudFormatError(f"PLY: cut off; the header promises {count} vertices")
    packed: NDArray[np.void] = np.frombuffer(rows, layout, count)
    table: Table = {name: packed[name] for name, _ in fields}
    return table, rest or rows[count * layout.itemsize :]


def _without_lists(line: bytes, header: _Header) -> bytes:
    words, plain, at = line.split(), [], 0
    for name, kind in header.fields:
        if at >= len(words):
            raise CloudFormatError(f"PLY: the vertex {line[:60]!r} lacks {name}")
        if kind:
            plain.append(words[at])
            at += 1
        else:
            at += 1 + (int(words[at]) if words[at].isdigit() else len(words))
    return b" ".join(plain)


def _rows_without_lists(header: _Header, rows: bytes) -> tuple[bytes, bytes]:
    """Return the fixed parts of the vertices joined, and the bytes after the last one."""
    out, at = bytearray(), 0
    for _ in range(header.count):
        for name, kind in header.fields:
            start = at
            if kind:
                at += np.dtype(kind).itemsize
                out += rows[start:at]
            else:
                at = _end_of_list(header.order, header.lists[name], rows, at)
        if at > len(rows):
            raise CloudFormatError(f"PLY: cut off; the header promises {header.count} vertices")
    return bytes(out), rows[at:]


def _end_of_list(order: str, kinds: tuple[str, str], rows: bytes, at: int) -> int:
    """Return where a list ends that begins at an offset: its length, then so many items."""
    counts, items = np.dtype(order + kinds[0]), np.dtype(order + kinds[1])
    if at + counts.itemsize > len(rows):
        raise CloudFormatError("PLY: cut off within a list")
    length = int(np.frombuffer(rows, counts, 1, at)[0])
    if length < 0:
        raise CloudFormatError("PLY: a list of a negative length")
    return at + counts.itemsize + length * items.itemsize


def _start_of_vertices(header: _Header, data: bytes, body: int, limits: Limits) -> int:
    """Return the offset of the first vertex, behind the elements that come before."""
    at = body
    for count, properties in header.before:
        limits.check_points(count)
        has_lists = any(kinds[0] for kinds in properties)
        if header.order and not has_lists:
            at += count * sum(np.dtype(kinds[1]).itemsize for kinds in properties)
            continue
        for _ in range(count):
            if header.order == "":
                at = data.find(b"\n", at) + 1 or len(data) + 1
                continue
            for kinds in properties:
                at = (
                    _end_of_list(header.order, kinds, data, at)
                    if kinds[0]
                    else at + np.dtype(kinds[1]).itemsize
                )
    if at > len(data):
        raise CloudFormatError("PLY: cut off before the vertices")
    return at


def _organisation(
    header: _Header, rest: bytes, limits: Limits
) -> tuple[tuple[int, ...], NDArray[np.int64] | None]:
    """Return height and width, and the vertex of each cell where a grid says it; -1 = none."""
    columns, rows = header.columns, header.rows
    if header.after == "camera":
        columns, rows = _viewport(header, rest)
    if columns < 1 or rows < 2:
        return (), None
    limits.check_points(columns * rows)
    if header.after != "range_grid":
        return ((rows, columns), None) if columns * rows == header.count else ((), None)
    return (rows, columns), _range_grid(header, rest, columns * rows)


def _viewport(header: _Header, rest: bytes) -> tuple[int, int]:
    """Return viewportx and viewporty of the element camera, 0 when they are not to be read."""
    names = [name for name, _ in header.after_fields]
    if not {"viewportx", "viewporty"} <= set(names):
        return 0, 0
    try:
        if header.order == "":
            values = dict(zip(names, rest.split(b"\n", 1)[0].split(), strict=True))
            return int(values["viewportx"]), int(values["viewporty"])
        layout = np.dtype([(name, header.order + kind) for name, kind in header.after_fields])
        camera = np.frombuffer(rest, layout, 1)[0]
        return int(camera["viewportx"]), int(camera["viewporty"])
    except (ValueError, TypeError):
        return 0, 0


def _range_grid(header: _Header, rest: bytes, cells: int) -> NDArray[np.int64]:
    """Return the vertex of each cell: lists of no index or of one."""
    places = np.full(cells, -1, np.int64)
    wrong = CloudFormatError("PLY: the range grid does not read")
    if header.order == "":
        lines = rest.split(b"\n", cells)[:cells]
        if len(lines) < cells:
            raise wrong
        for cell, line in enumerate(lines):
            words = line.split()
            if len(words) not in (1, 2) or words[0] != (b"1" if len(words) == 2 else b"0"):
                raise wrong
            if len(words) == 2:
                places[cell] = int(words[1]) if words[1].isdigit() else -2
    else:
        index, at = np.dtype(header.order + "i4"), 0
        for cell in range(cells):
            if at >= len(rest) or rest[at] > 1:
                raise wrong
            if rest[at]:
                if at + 5 > len(rest):
                    raise wrong
                places[cell] = np.frombuffer(rest, index, 1, at + 1)[0]
            at += 1 + 4 * rest[at]
    taken = places[places != -1]
    if taken.size and (taken.min() < 0 or taken.max() >= header.count):
        raise wrong
    return places


@dataclass
class _Header:
    """Byte order ('' = text), number and fields of vertices, grid, and the elements around them.

    A field without a type is a list, with its types in ``lists``. ``before`` has the elements
    before the vertices: how many, and the types of their properties.
    """

    order: str = "?"
    count: int = -1
    fields: list[tuple[str, str]] = field(default_factory=list)
    lists: dict[str, tuple[str, str]] = field(default_factory=dict)
    before: list[tuple[int, list[tuple[str, str]]]] = field(default_factory=list)
    columns: int = 0
    rows: int = 0
    after: str = ""
    after_fields: list[tuple[str, str]] = field(default_factory=list)
    element: str = ""

    def take(self, words: list[str]) -> bool:
        """Take a line of the header in; return whether it is one that is understood."""
        match words:
            case [] | ["comment", *_]:
                return True
            case ["obj_info", *_]:
                self._take_info(words)
                return True
            case ["format", name, _]:
                self.order = _ORDERS.get(name, "")
                return name in _ORDERS
            case ["element", *_]:
                self._take_element(words)
                return True
            case ["property", *_]:
                return self._take_property(words)
        return False

    def _take_info(self, words: list[str]) -> None:
        """Take the size of a range grid, which programs for laser scanners write here."""
        if len(words) == 3 and words[2].isdigit():
            if words[1] == "num_cols":
                self.columns = int(words[2])
            elif words[1] == "num_rows":
                self.rows = int(words[2])

    def _take_element(self, words: list[str]) -> None:
        if len(words) != 3 or not words[2].isdigit():
            return
        if self.count < 0 and words[1] != "vertex":
            self.before.append((int(words[2]), []))
        if words[1] == "vertex":
            self.count = int(words[2])
        elif self.element == "vertex":
            self.after = words[1]
        self.element = words[1]

    def _take_property(self, words: list[str]) -> bool:
        """Take a field: what stands before and in the vertices must be read to find its end.

        What comes behind is never needed but for the element after them, so it may be anything.
        """
        if self.element == "vertex" or self.count < 0:
            kinds = _property(words)
            if kinds is None or self.element == "":
                return False
            if self.element != "vertex":
                self.before[-1][1].append(kinds)
                return True
            self.fields.append((words[-1], "" if kinds[0] else kinds[1]))
            if kinds[0]:
                self.lists[words[-1]] = kinds
        elif self.element == self.after and len(words) == 3:
            self.after_fields.append((words[2], _TYPES.get(words[1], "i4")))
        return True


def _read_header(text: str) -> _Header:
    header = _Header()
    for line in text.split("\n")[1:]:
        if not header.take(line.split()):
            raise CloudFormatError(f"PLY: cannot read {line.strip()!r}")
    names = {name for name, _ in header.fields}
    if header.order == "?" or header.count < 0 or len(names) != len(header.fields):
        raise CloudFormatError("PLY: the header names no format, no vertices, or a field twice")
    return header


def _property(words: list[str]) -> tuple[str, str] | None:
    """Return the types of a property's count and items; the first is empty where it is no list."""
    if len(words) == 3 and words[1] in _TYPES:
        return "", _TYPES[words[1]]
    if len(words) == 5 and words[1] == "list" and {words[2], words[3]} <= _TYPES.keys():
        return _TYPES[words[2]], _TYPES[words[3]]
    return None
