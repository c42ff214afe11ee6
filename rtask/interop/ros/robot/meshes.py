"""Mesh files that a robot's model names: where they lie in an environment of ROS, their triangles.

STL, OBJ and Collada are read here with numpy alone, because the node of ROS 2 has nothing else.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np

from rtask.errors import DataError
from rtask.interop.ros.scene.shapes import MAX_TRIANGLES, Floats
from rtask.ros_packages import in_packages, workspace_folders

__all__ = ["MeshFiles", "read_mesh"]

_MAX_BYTES = 100 * 2**20
_STL_HEAD, _STL_TRIANGLE = 84, 50
_MAX_DEPTH = 64


class MeshFiles:
    """Finds the files of ``package://`` and ``file://`` in an environment.

    Parameters
    ----------
    variables
        Of the environment; those of this process by default.

    Examples
    --------
    >>> MeshFiles({"AMENT_PREFIX_PATH": "/nowhere"}).find("package://nao/hand.stl") is None
    True
    """

    def __init__(self, variables: Mapping[str, str] | None = None) -> None:
        self._folders = workspace_folders(variables)

    def find(self, uri: str) -> Path | None:
        """Return the file that a model means, or None if it is not in this environment."""
        for written in dict.fromkeys((uri, unquote(uri))):
            scheme, separator, inside = written.partition("://")
            if scheme == "file" or not separator:
                path = Path(inside if separator else written)
                if path.is_absolute() and path.is_file():
                    return path
            elif scheme == "package":
                in_package = next(self._in_packages(inside), None)
                if in_package is not None:
                    return in_package
        return None

    def _in_packages(self, inside: str) -> Iterator[Path]:
        # A model is heard from anybody in the network: it names nothing outside of packages.
        if ".." not in Path(inside).parts:
            yield from (path for path in in_packages(inside, self._folders) if path.is_file())


def read_mesh(path: Path, scale: Floats | None = None) -> Floats:
    """Return the triangles (n, 3, 3) of a mesh file, m, in the frame of its link's shape.

    As in ROS, the axis that Collada calls up is passed over, and its unit is not.

    Parameters
    ----------
    scale : (3,) or None
        Of the URDF.

    Raises
    ------
    DataError
        It is of another format, is damaged or too large, or has no triangle.
    """
    readers = {".stl": _stl, ".obj": _obj, ".dae": _collada}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise DataError(f"{path}: expected {', '.join(readers)}")
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise DataError(f"{path}: larger than {_MAX_BYTES >> 20} MiB")
        corners = reader(path.read_bytes())
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from error
    except (ValueError, IndexError, KeyError, TypeError, ElementTree.ParseError) as error:
        raise DataError(f"{path}: no mesh that can be read: {error}") from error
    if not 0 < len(corners) <= MAX_TRIANGLES:
        raise DataError(f"{path}: {len(corners)} triangles; expected 1 to {MAX_TRIANGLES}")
    scaled = corners * (np.ones(3) if scale is None else scale)
    if not np.isfinite(scaled).all():
        raise DataError(f"{path}: a vertex is not finite")
    return np.asarray(scaled, dtype=np.float64)


def _stl(data: bytes) -> Floats:
    count = int.from_bytes(data[80:84], "little")
    # Binary files may begin with "solid" as well: their length tells.
    if len(data) >= _STL_HEAD + _STL_TRIANGLE * count and (count or len(data) == _STL_HEAD):
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        return np.frombuffer(data, kind, count, _STL_HEAD)["corners"].astype(np.float64)
    rows = [line.split()[1:4] for line in data.splitlines() if line.strip().startswith(b"vertex")]
    return np.array(rows, dtype=np.float64).reshape(-1, 3, 3)


def _obj(data: bytes) -> Floats:
    vertices, faces = [], []
    for line in data.splitlines():
        head, *words = line.split() or [b""]
        if head == b"v":
            vertices.append([float(word) for word in words[:3]])
        elif head == b"f":
            numbers = [int(word.partition(b"/")[0]) for word in words]
            corners = [k - 1 if k > 0 else len(vertices) + k for k in numbers]
            faces += [[corners[0], *pair] for pair in itertools.pairwise(corners[1:])]
    return _corners(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64))


def _corners(vertices: Floats, faces: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> Floats:
    if not len(faces):
        return np.zeros((0, 3, 3))
    if faces.min() < 0:
        raise ValueError("a face names no vertex")
    return np.asarray(vertices.reshape(-1, 3)[faces.reshape(-1, 3)])


class _Collada:
    """The geometries of a Collada document, and the nodes that show them."""

    def __init__(self, data: bytes) -> None:
        if b"<!ENTITY" in data:
            raise ValueError("it declares entities")
        self.root = ElementTree.fromstring(data)
        for element in self.root.iter():
            element.tag = element.tag.rpartition("}")[2]
        self._by_id = {each.get("id"): each for each in self.root.iter() if each.get("id")}

    def named(self, reference: str | None) -> ElementTree.Element:
        return self._by_id[(reference or "").lstrip("#")]

    def triangles(self, geometry: ElementTree.Element) -> Floats:
        parts = [np.zeros((0, 3, 3))]
        for group in geometry.iter():
            if group.tag in ("triangles", "polylist", "polygons"):
                parts.append(self._group(group))
        return np.concatenate(parts)

    def _group(self, group: ElementTree.Element) -> Floats:
        inputs = group.findall("input")
        width = 1 + max(int(each.get("offset", "0")) for each in inputs)
        [of_vertices] = [each for each in inputs if each.get("semantic") == "VERTEX"]
        vertices = self._positions(of_vertices.get("source"))
        column = int(of_vertices.get("offset", "0"))
        lists = [
            np.array((p.text or "").split(), dtype=np.int64).reshape(-1, width)[:, column]
            for p in group.iter("p")
        ]
        if group.tag == "triangles":
            return _corners(vertices, np.concatenate(lists).reshape(-1, 3))
        counts = group.find("vcount")
        if counts is not None:
            ends = np.cumsum(np.array((counts.text or "").split(), dtype=np.int64))
            lists = np.split(lists[0], ends[:-1])
        fans = [[face[0], *pair] for face in lists for pair in itertools.pairwise(face[1:])]
        return _corners(vertices, np.array(fans, dtype=np.int64))

    def _positions(self, vertices: str | None) -> Floats:
        for given in self.named(vertices).findall("input"):
            if given.get("semantic") == "POSITION":
                source = self.named(given.get("source"))
                accessor = source.find("technique_common/accessor")
                stride = int(accessor.get("stride", "3")) if accessor is not None else 3
                values = np.array((source.findtext("float_array") or "").split(), dtype=np.float64)
                return np.asarray(values.reshape(-1, stride)[:, :3])
        raise ValueError("vertices without positions")

    def shown(self, node: ElementTree.Element, pose: Floats, depth: int = 0) -> Iterator[Floats]:
        """Yield the triangles that a node and those in it show, in the frame of the scene."""
        if depth > _MAX_DEPTH:
            raise ValueError("nodes in nodes without end")
        for part in node:
            if part.tag in ("matrix", "translate", "rotate", "scale"):
                pose = pose @ _moved(part.tag, np.array((part.text or "").split(), np.float64))
            elif part.tag == "instance_geometry":
                corners = self.triangles(self.named(part.get("url")))
                yield corners @ pose[:3, :3].T + pose[:3, 3]
            elif part.tag == "node":
                yield from self.shown(part, pose, depth + 1)
            elif part.tag == "instance_node":
                yield from self.shown(self.named(part.get("url")), pose, depth + 1)


def _moved(kind: str, values: Floats) -> Floats:
    made = np.eye(4)
    if kind == "matrix":
        return values.reshape(4, 4)
    if kind == "translate":
        made[:3, 3] = values
    elif kind == "scale":
        made[:3, :3] = np.diag(values)
    else:
        axis, angle = values[:3] / np.linalg.norm(values[:3]), math.radians(values[3])
        x, y, z = axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        made[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return made


def _collada(data: bytes) -> Floats:
    document = _Collada(data)
    unit = document.root.find("asset/unit")
    meters = float(unit.get("meter", "1")) if unit is not None else 1.0
    parts = [np.zeros((0, 3, 3))]
    instance = document.root.find("scene/instance_visual_scene")
    if instance is None:  # geometries alone
        parts += [document.triangles(each) for each in document.root.iter("geometry")]
    else:
        parts += document.shown(document.named(instance.get("url")), np.eye(4))
    return np.concatenate(parts) * meters
