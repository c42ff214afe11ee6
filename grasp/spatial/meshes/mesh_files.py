"""Triangle meshes from files: STL (text, binary), Wavefront OBJ, PLY (text, binary)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.meshes.mesh import Mesh, as_mesh

__all__ = ["MESH_ENDINGS", "has_faces", "mesh_from_ply", "read_mesh"]

MESH_ENDINGS = (".stl", ".obj", ".ply")

_MAX_BYTES = 256 * 1024 * 1024
_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Surface = tuple[FloatArray, IntArray]


def read_mesh(path: Path, scale: float = 1.0) -> Mesh:
    """Return the cleaned mesh of a file.

    Parameters
    ----------
    path
        Ending in one of :data:`MESH_ENDINGS`.
    scale
        Metres per unit of the file.

    Raises
    ------
    ValueError
        When the ending is unknown or the file is not what its ending says.
    """
    ending = path.suffix.lower()
    if ending not in MESH_ENDINGS:
        raise ValueError(f"{path.name}: a mesh ends in {', '.join(MESH_ENDINGS)}")
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path.name} is larger than {_MAX_BYTES // 2**20} MB")
    data = path.read_bytes()
    read = {".stl": _stl, ".obj": _obj, ".ply": _ply}[ending]
    try:
        vertices, faces = read(data)
    except (IndexError, KeyError, UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"{path.name} is no {ending[1:].upper()} mesh: {error}") from error
    return as_mesh(vertices, faces, scale)


def mesh_from_ply(data: bytes) -> Mesh:
    """Return the cleaned mesh of a PLY file's bytes, in metres; ValueError where it is none."""
    try:
        return as_mesh(*_ply(data))
    except (IndexError, KeyError, UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"these bytes are no PLY mesh: {error}") from error


def has_faces(path: Path) -> bool:
    """Tell whether a PLY file holds faces: else it is a cloud."""
    with path.open("rb") as file:
        head = file.read(4096).split(b"end_header")[0].decode("ascii", "replace")
    counts = [line.split() for line in head.splitlines() if line.startswith("element face")]
    return any(len(words) == 3 and words[2] not in ("0",) for words in counts)


def _fan(polygons: list[list[int]]) -> IntArray:
    """Return triangles of polygons."""
    triangles = [
        (ring[0], ring[k], ring[k + 1]) for ring in polygons for k in range(1, len(ring) - 1)
    ]
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _stl(data: bytes) -> Surface:
    count = int(np.frombuffer(data[80:84], "<u4")[0]) if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        corners = np.frombuffer(data, record, count, 84)["corners"].reshape(-1, 3)
    else:
        lines = data.decode("ascii").split("\n")
        if not lines[0].lstrip().startswith("solid"):
            raise ValueError("neither text nor of a binary file's length")
        rows = [line.split()[1:4] for line in lines if line.lstrip().startswith("vertex")]
        corners = np.array(rows, dtype=np.float64).reshape(-1, 3)
    if len(corners) % 3:
        raise ValueError(f"{len(corners)} corners make no triangles")
    return corners.astype(np.float64), np.arange(len(corners), dtype=np.int64).reshape(-1, 3)


def _obj(data: bytes) -> Surface:
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] == "f":
            ring = [int(word.split("/")[0]) for word in words[1:]]
            # Negative numbers count from the latest vertex.
            polygons.append([k - 1 if k > 0 else len(vertices) + k for k in ring])
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), _fan(polygons)


def _ply(data: bytes) -> Surface:
    head, mark, body = data.partition(b"end_header")
    if not (head.startswith(b"ply") and mark):
        raise ValueError("no header")
    body = body[body.index(b"\n") + 1 :]
    elements, kind = _ply_header(head.decode("ascii"))
    if kind == "ascii":
        return _ply_text(body.decode("ascii").split(), elements)
    return _ply_binary(body, elements, "<" if kind == "binary_little_endian" else ">")


Property = tuple[str, tuple[str, ...]]
Element = tuple[str, int, list[Property]]


def _ply_header(head: str) -> tuple[list[Element], str]:
    elements: list[Element] = []
    kind = ""
    for line in head.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            kind = words[1]
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            types = tuple(_PLY_TYPES[word] for word in words[1:-1] if word != "list")
            elements[-1][2].append((words[-1], types))
    if kind not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise ValueError(f"unknown format {kind!r}")
    return elements, kind


def _ply_text(words: list[str], elements: list[Element]) -> Surface:
    at = 0
    vertices, polygons = np.empty((0, 3)), []
    for name, count, properties in elements:
        if name == "vertex":
            width = len(properties)
            table = np.array(words[at : at + count * width], np.float64).reshape(count, width)
            names = [p for p, _ in properties]
            vertices = table[:, [names.index(axis) for axis in "xyz"]]
            at += count * width
            continue
        for _ in range(count):
            for key, types in properties:
                length = int(words[at]) if len(types) == 2 else 1
                at += len(types) == 2
                if key.startswith("vertex_ind"):
                    polygons.append([int(word) for word in words[at : at + length]])
                at += length
    return vertices, _fan(polygons)


def _ply_binary(body: bytes, elements: list[Element], order: str) -> Surface:
    at = 0
    vertices, polygons = np.empty((0, 3)), []
    for name, count, properties in elements:
        if all(len(types) == 1 for _, types in properties):
            record = np.dtype([(key, order + types[0]) for key, types in properties])
            table = np.frombuffer(body, record, count, at)
            if name == "vertex":
                vertices = np.stack([table[axis] for axis in "xyz"], axis=1).astype(np.float64)
            at += count * record.itemsize
            continue
        for _ in range(count):
            for key, types in properties:
                length = 1
                if len(types) == 2:
                    length = int(np.frombuffer(body, order + types[0], 1, at)[0])
                    at += np.dtype(types[0]).itemsize
                values = np.frombuffer(body, order + types[-1], length, at)
                if key.startswith("vertex_ind"):
                    polygons.append(values.astype(np.int64).tolist())
                at += length * np.dtype(types[-1]).itemsize
    return vertices, _fan(polygons)
