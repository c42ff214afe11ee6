"""Triangle meshes from files: STL (text, binary), Wavefront OBJ, PLY (text, binary).

Only this file imports trimesh. Files are bounded in size before they are read, and a header that
promises more than the file holds is refused before memory is taken for it.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.meshes.mesh import Mesh, as_mesh

__all__ = ["MESH_ENDINGS", "has_faces", "is_mesh", "mesh_from_bytes", "mesh_from_ply", "read_mesh"]

MESH_ENDINGS = (".stl", ".obj", ".ply")

_MAX_BYTES = 256 * 1024 * 1024
_STL_HEAD, _STL_FACE = 84, 50
_PLY_HEAD = 65_536

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
    return mesh_from_bytes(path.read_bytes(), ending[1:], path.name, scale)


def mesh_from_bytes(data: bytes, kind: str, name: str, scale: float = 1.0) -> Mesh:
    """Return the cleaned mesh of a file's contents; errors as :func:`read_mesh`.

    Parameters
    ----------
    kind
        Ending of the file, without the dot.
    name
        Of the file, for errors.
    """
    if f".{kind}" not in MESH_ENDINGS:
        raise ValueError(f"{name}: a mesh ends in {', '.join(MESH_ENDINGS)}")
    if len(data) > _MAX_BYTES:
        raise ValueError(f"{name} is larger than {_MAX_BYTES // 2**20} MB")
    try:
        vertices, faces = _surface(data, kind)
    except (ArithmeticError, IndexError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{name} is no {kind.upper()} mesh: {error}") from error
    return as_mesh(vertices, faces, scale)


def mesh_from_ply(data: bytes) -> Mesh:
    """Return the cleaned mesh of a PLY file's bytes, in metres; ValueError where it is none."""
    try:
        return as_mesh(*_surface(data, "ply"))
    except (ArithmeticError, IndexError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"these bytes are no PLY mesh: {error}") from error


def is_mesh(path: Path) -> bool:
    """Return whether a file is a triangle mesh, by its name; for PLY files, by their contents."""
    ending = path.suffix.lower()
    if ending not in MESH_ENDINGS or not path.is_file():
        return False
    return ending != ".ply" or has_faces(path)


def has_faces(path: Path) -> bool:
    """Tell whether a PLY file holds faces: else it is a cloud."""
    with path.open("rb") as file:
        head = file.read(4096).split(b"end_header")[0].decode("ascii", "replace")
    counts = [line.split() for line in head.splitlines() if line.startswith("element face")]
    return any(len(words) == 3 and words[2] not in ("0",) for words in counts)


def _surface(data: bytes, kind: str) -> Surface:
    """Return vertices (v, 3) and triangles (f, 3) of a file's bytes, polygons cut into fans."""
    import trimesh

    check = {"stl": _checked_stl, "obj": _checked_obj, "ply": _checked_ply}[kind]
    mesh = trimesh.load_mesh(
        io.BytesIO(check(data)), file_type=kind, process=False, skip_materials=True
    )
    vertices, faces = getattr(mesh, "vertices", ()), getattr(mesh, "faces", ())
    return (
        np.array(vertices, dtype=np.float64).reshape(-1, 3),
        np.array(faces, dtype=np.int64).reshape(-1, 3),
    )


def _checked_stl(data: bytes) -> bytes:
    """Refuse what is neither text nor as long as a binary file says; trimesh reads it as empty."""
    if data.lstrip()[:5] == b"solid" and b"\0" not in data[:_STL_HEAD]:
        text = data.rstrip()
        if not text[text.rfind(b"\n") + 1 :].lstrip().startswith(b"endsolid"):
            raise ValueError("cut off: the last line is not endsolid")
        return data
    if len(data) < _STL_HEAD:
        raise ValueError(
            f"{len(data)} bytes: a binary file has at least {_STL_HEAD}, a text file begins "
            "with solid"
        )
    count = int.from_bytes(data[_STL_HEAD - 4 : _STL_HEAD], "little")
    whole = _STL_HEAD + _STL_FACE * count
    if len(data) != whole:
        state = "cut off" if len(data) < whole else "too long"
        raise ValueError(f"{state}: {count} triangles take {whole} bytes, the file has {len(data)}")
    return data


def _checked_obj(data: bytes) -> bytes:
    """Number vertices from the start: trimesh counts negative numbers from the file's end."""
    if not re.search(rb"^\s*f\b.*\s-", data, re.MULTILINE):
        return data
    rows, vertices = [], 0
    for row in data.splitlines():
        words = row.split()
        vertices += words[:1] == [b"v"]
        if words[:1] == [b"f"]:
            numbers = [int(word.split(b"/")[0]) for word in words[1:]]
            absolute = [n if n > 0 else vertices + n + 1 for n in numbers]
            row = b"f " + b" ".join(b"%d" % n for n in absolute)
        rows.append(row)
    return b"\n".join(rows)


def _checked_ply(data: bytes) -> bytes:
    """Refuse headers that trimesh takes for an empty mesh."""
    head, mark, _ = data[:_PLY_HEAD].partition(b"end_header")
    if not (head.startswith(b"ply") and mark):
        raise ValueError("no header")
    kind = re.search(rb"^format (ascii|binary_little_endian|binary_big_endian) ", head, re.M)
    if kind is None:
        raise ValueError("the header names no known format")
    promised = sum(int(n) for n in re.findall(rb"^element \w+ (\d+)", head, re.M))
    body = data[len(head) + len(mark) :]
    held = body.strip().count(b"\n") + 1 if kind[1] == b"ascii" else len(body)
    if promised > held:
        raise ValueError(f"cut off: the header promises {promised} elements")
    return data
