"""PCD (Point Cloud Library): ascii, binary and binary_compressed, fields x y z and rgb or rgba."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from features.codec.limits import CloudFormatError, Limits
from features.codec.table import Table, cloud_from_fields, read_text_rows
from features.codec.types import Cloud
from features.geometry import transform

__all__ = ["is_pcd", "read_pcd", "write_pcd"]

_MAX_HEADER = 65_536
_FRAME = "#frame_id"
_KEYS = (
    "VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT",
    "POINTS",
)  # fmt: skip
_AT_ORIGIN = (0, 0, 0, 1, 0, 0, 0)
_KINDS = {"F": "f", "U": "u", "I": "i"}


def is_pcd(data: bytes) -> bool:
    """Whether bytes begin like a PCD file: comments and blank lines, then a line of its header.

    Examples
    --------
    >>> is_pcd(b"# made by hand\\n\\nFIELDS x y z\\n"), is_pcd(b"a poem\\n")
    (True, False)
    """
    if data.startswith(b"# .PCD"):
        return True
    for line in data[:_MAX_HEADER].split(b"\n"):
        words = line.split()
        if words and not words[0].startswith(b"#"):
            return words[0].decode("ascii", "replace") in _KEYS
    return False


def read_pcd(data: bytes, limits: Limits) -> Cloud:
    """Return the points of a PCD file; an organised one keeps its rows.

    VIEWPOINT is the pose of the sensor from which the points were measured: they are returned in
    the frame in which that pose is given. It is mostly the identity.

    Raises
    ------
    CloudFormatError
        When the header does not read, or the data end too early.
    """
    header, body = _read_header(data)
    fields = _layout(header)
    count = _count(header)
    limits.check_points(count)
    kind = header["DATA"][0].lower()
    if kind == "ascii":
        table = read_text_rows(data[body:], count, fields, "PCD")
    elif kind == "binary":
        table = _rows(data[body:], count, fields)
    elif kind == "binary_compressed":
        table = _columns(data[body:], count, fields, limits)
    else:
        raise CloudFormatError(f"PCD: unknown DATA {kind!r}")
    cloud = cloud_from_fields(table, "PCD", _shape(header, count))
    frame_id = " ".join(header.get(_FRAME, []))
    viewpoint = _viewpoint(header)
    if viewpoint is None:
        return replace(cloud, frame_id=frame_id)
    # Points of a PCD file are in the sensor's frame; VIEWPOINT says where that stood.
    positions = np.asarray(transform(viewpoint, cloud.positions), np.float32)
    return replace(cloud, positions=positions, frame_id=frame_id, viewpoint=viewpoint)


def _viewpoint(header: dict[str, list[str]]) -> NDArray[np.float64] | None:
    """Return VIEWPOINT (tx ty tz qw qx qy qz) as a pose (4, 4), m; None for the identity."""
    words = header.get("VIEWPOINT", [])
    if not words:
        return None
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (7,) or not np.isfinite(numbers).all() or not np.any(numbers[3:]):
        raise CloudFormatError(
            f"PCD: VIEWPOINT must be seven numbers, got {' '.join(words)[:80]!r}"
        )
    if np.array_equal(numbers, _AT_ORIGIN):
        return None
    pose = np.eye(4)
    # The file has w first, scipy takes it last.
    pose[:3, :3] = Rotation.from_quat(numbers[[4, 5, 6, 3]]).as_matrix()
    pose[:3, 3] = numbers[:3]
    return pose


def _shape(header: dict[str, list[str]], count: int) -> tuple[int, ...]:
    """Return height and width of an organised cloud, else nothing."""
    if "WIDTH" not in header or "HEIGHT" not in header:
        return ()
    width, height = _whole(header, "WIDTH"), _whole(header, "HEIGHT")
    if height > 1 and width * height != count:
        raise CloudFormatError(f"PCD: WIDTH {width} and HEIGHT {height}, but POINTS {count}")
    return (height, width) if height > 1 else ()


def write_pcd(table: Table, shape: tuple[int, int], frame_id: str = "") -> bytes:
    """Return named columns as a binary PCD file.

    Parameters
    ----------
    table
        Of columns of one length.
    shape
        Height and width; height 1 = unorganised.
    frame_id
        Kept in a comment, which the format has no field for.
    """
    layout = np.dtype([(name, column.dtype.newbyteorder("<")) for name, column in table.items()])
    rows = np.zeros(shape[0] * shape[1], layout)
    for name, column in table.items():
        rows[name] = column
    kinds = [layout[name] for name in table]
    head = [
        *([f"{_FRAME} {frame_id}"] if frame_id.isprintable() and frame_id else []),
        "VERSION .7",
        "FIELDS " + " ".join(table),
        "SIZE " + " ".join(str(kind.itemsize) for kind in kinds),
        "TYPE " + " ".join(kind.kind.upper() for kind in kinds),
        "COUNT " + " ".join("1" for _ in kinds),
        f"WIDTH {shape[1]}",
        f"HEIGHT {shape[0]}",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(rows)}",
        "DATA binary",
    ]
    return ("# .PCD v0.7\n" + "\n".join(head) + "\n").encode("utf-8", "replace") + rows.tobytes()


def _read_header(data: bytes) -> tuple[dict[str, list[str]], int]:
    """Return the header's words by key, and where the data begin."""
    header: dict[str, list[str]] = {}
    offset = 0
    while offset < min(len(data), _MAX_HEADER):
        end = data.find(b"\n", offset)
        if end < 0:
            break
        words = data[offset:end].decode("utf-8", "replace").split()
        offset = end + 1
        if words and words[0] == _FRAME:
            header[_FRAME] = words[1:]
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
            if words[0] == "DATA" and words[1:]:
                return header, offset
    raise CloudFormatError("PCD: the header has no DATA line")


def _count(header: dict[str, list[str]]) -> int:
    """Return the number of points; files of the first versions say only WIDTH and HEIGHT."""
    if "POINTS" in header or "WIDTH" not in header:
        return _whole(header, "POINTS")
    return _whole(header, "WIDTH") * (_whole(header, "HEIGHT") if "HEIGHT" in header else 1)


def _whole(header: dict[str, list[str]], key: str) -> int:
    words = header.get(key, [])
    if len(words) != 1 or not words[0].isdigit():
        raise CloudFormatError(f"PCD: {key} must be one whole number, got {words}")
    return int(words[0])


def _layout(header: dict[str, list[str]]) -> list[tuple[str, str]]:
    """Return the fields as (name, numpy type), counts above one spread out."""
    names = header.get("FIELDS", header.get("COLUMNS", []))
    sizes, kinds = header.get("SIZE", []), header.get("TYPE", [])
    counts = header.get("COUNT", ["1"] * len(names))
    if not names or not len(names) == len(sizes) == len(kinds) == len(counts):
        raise CloudFormatError("PCD: FIELDS, SIZE, TYPE and COUNT differ in length")
    fields: list[tuple[str, str]] = []
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        code = _KINDS.get(kind, "") + size
        if code not in ("f4", "f8", "u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8"):
            raise CloudFormatError(f"PCD: field {name} of TYPE {kind} and SIZE {size}")
        if not count.isdigit() or not 1 <= int(count) <= 1_024:
            raise CloudFormatError(f"PCD: field {name} of COUNT {count}")
        # The Point Cloud Library calls every padding _, and a layout of numpy has no two fields of
        # one name.
        several = int(count) > 1 or name == "_"
        for _ in range(int(count)):
            fields.append((f"{name}#{len(fields)}" if several else name, code))
    if len({name for name, _ in fields}) != len(fields):
        raise CloudFormatError("PCD: a field stands twice")
    return fields


def _rows(body: bytes, count: int, fields: list[tuple[str, str]]) -> Table:
    layout = np.dtype([(name, "<" + code) for name, code in fields])
    if len(body) < count * layout.itemsize:
        raise CloudFormatError(f"PCD: cut off; the header promises {count} points")
    packed = np.frombuffer(body, layout, count)
    return {name: packed[name] for name, _ in fields}


def _columns(body: bytes, count: int, fields: list[tuple[str, str]], limits: Limits) -> Table:
    if len(body) < 8:
        raise CloudFormatError("PCD: cut off before the compressed data")
    stored, size = struct.unpack_from("<II", body)
    limits.check_decoded(size, stored, "PCD")
    if len(body) < 8 + stored:
        raise CloudFormatError("PCD: cut off within the compressed data")
    raw = _lzf(body[8 : 8 + stored], size)
    table, offset = {}, 0
    for name, code in fields:
        column = np.dtype("<" + code)
        if offset + count * column.itemsize > len(raw):
            raise CloudFormatError(f"PCD: cut off; the header promises {count} points")
        table[name] = np.frombuffer(raw, column, count, offset)
        offset += count * column.itemsize
    return table


def _lzf(data: bytes, size: int) -> bytes:
    """Unpack LibLZF: runs of literals, and copies of what came before."""
    out = bytearray()
    position = 0
    try:
        while position < len(data):
            control = data[position]
            position += 1
            if control < 32:
                out += data[position : position + control + 1]
                position += control + 1
            else:
                length = control >> 5
                if length == 7:
                    length += data[position]
                    position += 1
                start = len(out) - ((control & 31) << 8) - data[position] - 1
                position += 1
                if start < 0:
                    raise CloudFormatError("PCD: the compressed data point before their beginning")
                # Byte by byte, for a copy may read what it has just written: that is how LZF
                # repeats a pattern.
                for index in range(start, start + length + 2):
                    out.append(out[index])
            # Ended at once: a few bytes can unpack to gigabytes.
            if len(out) > size:
                break
    except IndexError:
        raise CloudFormatError("PCD: the compressed data end too early") from None
    if len(out) != size:
        raise CloudFormatError(f"PCD: unpacks to {len(out)} bytes, not {size}")
    return bytes(out)
