"""Binary glTF 2.0 of a scene.

Boxes and surfaces of things are triangles, with what nobody has seen of a surface in grey; axes of
frames and grippers of grasps are lines; each node carries its IRI, its kind and what else is known
of it in ``extras``. Above the root frame, in which z is up, stands a node that turns it into glTF's
axes, where y is up (glTF 2.0, 3.4).
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.world.scene.nodes import (
    AXIS_M,
    Scene,
    SceneNode,
    SceneSurface,
    box_corners,
    grasp_lines,
    region_lines,
    wall_boxes,
)

__all__ = ["glb"]

_MAGIC, _VERSION, _JSON, _BIN = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
_FLOAT, _VERTICES = 5126, 34962
_LINES, _TRIANGLES = 1, 4
_GLTF_FROM_ROOT = np.array(
    [(1.0, 0, 0, 0), (0, 0, 1.0, 0), (0, -1.0, 0, 0), (0, 0, 0, 1.0)]
)  # fmt: skip
_RED, _GREEN, _BLUE = (0.76, 0.25, 0.05), (0.08, 0.5, 0.24), (0.11, 0.31, 0.85)
_THING, _DOUBTFUL, _GRASP = (0.55, 0.65, 0.8), (0.75, 0.75, 0.75), (0.85, 0.55, 0.1)
_PLACE = (0.72, 0.62, 0.5)
_UNSEEN = (0.62, 0.62, 0.62)
# Faces as corners of a box in the order of `box_corners`, counter-clockwise from outside.
_FACES = np.array([
    (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3),
])  # fmt: skip
_NORMALS = np.array([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)])


def glb(scene: Scene) -> bytes:
    """Return a scene as the bytes of a ``.glb`` file.

    Examples
    --------
    >>> glb(Scene(0.0, ()))[:4]
    b'glTF'
    """
    document = _Document()
    root = {"name": "z up", "matrix": _column_major(_GLTF_FROM_ROOT),
            "extras": {"time": scene.time_s, "root": scene.root}}  # fmt: skip
    nodes: list[dict[str, Any]] = [root]
    for node in scene.nodes:
        above = nodes[0 if node.parent is None else node.parent + 1]
        above.setdefault("children", []).append(len(nodes))
        nodes.append(document.node(node))
    return document.packed(nodes)


class _Document:
    """Meshes, accessors and bytes of one file; equal meshes are stored once."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []
        self._mesh_of: dict[object, int] = {}
        self._material_of: dict[tuple[float, ...], int] = {}

    def node(self, node: SceneNode) -> dict[str, Any]:
        """Return a node of a scene as one of glTF."""
        extras = {"iri": node.iri, "kind": node.kind, **node.facts}
        made: dict[str, Any] = {
            "name": node.label, "matrix": _column_major(node.parent_from_node), "extras": extras,
        }  # fmt: skip
        mesh = self._mesh(node)
        return made if mesh is None else {**made, "mesh": mesh}

    def packed(self, nodes: list[dict[str, Any]]) -> bytes:
        """Return the file: a header, the JSON and the binary chunk (glTF 2.0, 4.4)."""
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "RTASK"},
            "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        }  # fmt: skip
        if self._bytes:  # empty lists are not valid
            document |= {
                "meshes": self._meshes, "materials": self._materials,
                "accessors": self._accessors, "bufferViews": self._views,
                "buffers": [{"byteLength": len(self._bytes)}],
            }  # fmt: skip
        text = json.dumps(document, ensure_ascii=False, allow_nan=False).encode()
        chunks = _chunk(_JSON, text, b" ")
        if self._bytes:
            chunks += _chunk(_BIN, bytes(self._bytes), b"\0")
        return struct.pack("<III", _MAGIC, _VERSION, 12 + len(chunks)) + chunks

    def _mesh(self, node: SceneNode) -> int | None:
        key: object
        if node.kind == "frame":
            key, build = "axes", self._axes
        elif node.kind == "grasp":
            key, build = ("grasp", node.opening_m), lambda: self._grasp(node.opening_m)
        elif node.surface is not None:
            surface, colour = node.surface, _colour(node)
            key, build = (id(surface), colour), lambda: self._surface(surface, colour)
        elif node.region_m is not None:
            region = node.region_m
            key, build = ("region", region), lambda: self._region(region)
        elif node.size_m is not None:
            size, colour = node.size_m, _colour(node)
            boxes = wall_boxes(size) if node.kind == "place" else [box_corners(size)]
            key, build = (node.kind, size, colour), lambda: self._boxes(boxes, colour)
        else:
            return None
        if key not in self._mesh_of:
            self._meshes.append({"name": node.kind, "primitives": build()})
            self._mesh_of[key] = len(self._meshes) - 1
        return self._mesh_of[key]

    def _axes(self) -> list[dict[str, Any]]:
        ends = AXIS_M * np.eye(3)
        return [
            self._primitive(np.array([np.zeros(3), end]), _LINES, colour)
            for end, colour in zip(ends, (_RED, _GREEN, _BLUE), strict=True)
        ]

    def _grasp(self, opening_m: float) -> list[dict[str, Any]]:
        return [self._primitive(grasp_lines(opening_m).reshape(-1, 3), _LINES, _GRASP)]

    def _region(self, size_m: tuple[float, float, float]) -> list[dict[str, Any]]:
        return [self._primitive(region_lines(size_m).reshape(-1, 3), _LINES, _DOUBTFUL)]

    def _surface(self, surface: SceneSurface, colour: tuple[float, ...]) -> list[dict[str, Any]]:
        """Return what was seen of a surface, and what was filled in, in grey."""
        corners = surface.vertices[surface.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(across, axis=1)
        normals = across / np.maximum(length, 1e-15)[:, None]
        return [
            self._primitive(
                corners[part].reshape(-1, 3), _TRIANGLES, look, np.repeat(normals[part], 3, axis=0)
            )
            for part, look in (
                (surface.seen_faces & (length > 0), colour),
                (~surface.seen_faces & (length > 0), _UNSEEN),
            )
            if part.any()
        ]

    def _boxes(
        self, boxes: list[NDArray[np.float64]], colour: tuple[float, ...]
    ) -> list[dict[str, Any]]:
        corners = np.concatenate([box[_FACES] for box in boxes])
        triangles = corners[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        normals = np.tile(np.repeat(_NORMALS, 6, axis=0), (len(boxes), 1))
        return [self._primitive(triangles, _TRIANGLES, colour, normals)]

    def _primitive(
        self,
        points: NDArray[np.float64],
        mode: int,
        colour: tuple[float, ...],
        normals: NDArray[np.floating[Any]] | NDArray[np.int_] | None = None,
    ) -> dict[str, Any]:
        attributes = {"POSITION": self._accessor(points, with_bounds=True)}
        if normals is not None:
            attributes["NORMAL"] = self._accessor(normals)
        return {"attributes": attributes, "mode": mode, "material": self._material(colour)}

    def _accessor(self, rows: NDArray[Any], with_bounds: bool = False) -> int:
        stored = np.ascontiguousarray(rows, "<f4")
        view = {"buffer": 0, "byteOffset": len(self._bytes), "byteLength": stored.nbytes,
                "target": _VERTICES}  # fmt: skip
        self._bytes += stored.tobytes()
        self._views.append(view)
        accessor = {"bufferView": len(self._views) - 1, "componentType": _FLOAT,
                    "count": len(stored), "type": "VEC3"}  # fmt: skip
        if with_bounds:
            bounds = {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
            accessor |= bounds
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def _material(self, colour: tuple[float, ...]) -> int:
        if colour not in self._material_of:
            look = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0}
            self._materials.append({"pbrMetallicRoughness": look})
            self._material_of[colour] = len(self._materials) - 1
        return self._material_of[colour]


def _colour(node: SceneNode) -> tuple[float, ...]:
    if node.kind == "place":
        return _PLACE
    return _THING if float(node.facts.get("stillThere", 1.0)) >= 0.5 else _DOUBTFUL


def _column_major(pose: NDArray[np.float64]) -> list[float]:
    return [float(value) for value in pose.T.ravel()]


def _chunk(kind: int, data: bytes, padding: bytes) -> bytes:
    data += padding * (-len(data) % 4)
    return struct.pack("<II", len(data), kind) + data
