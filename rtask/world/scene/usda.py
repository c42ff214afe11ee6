"""OpenUSD text (``.usda``) of a scene.

Each node is an ``Xform`` with its IRI and kind as attributes ``rtask:iri`` and ``rtask:kind`` and
its name as ``displayName``; below it, a ``Mesh`` draws a thing's surface or box, and
``BasisCurves`` draw the axes of a frame and the gripper of a grasp. Metres, z up.
"""

from __future__ import annotations

import datetime as dt
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from rtask.world.scene.nodes import (
    AXIS_M,
    Fact,
    Scene,
    SceneNode,
    SceneSurface,
    box_corners,
    grasp_lines,
    region_lines,
    wall_boxes,
)

__all__ = ["usda"]

_INDENT = "    "
_NO_IDENTIFIER = re.compile(r"[^A-Za-z0-9_]+")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
_FACES = (0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3)
"""Corners of the faces of a box, in the order of `box_corners`, counter-clockwise from outside."""
_COLOURS = {
    "frame": (0.4, 0.4, 0.4), "grasp": (0.85, 0.55, 0.1), "thing": (0.55, 0.65, 0.8),
    "place": (0.72, 0.62, 0.5),
}  # fmt: skip
_UNSEEN = (0.62, 0.62, 0.62)


def usda(scene: Scene) -> str:
    """Return a scene as OpenUSD text.

    Examples
    --------
    >>> usda(Scene(0.0, ())).splitlines()[0]
    '#usda 1.0'
    """
    time = dt.datetime.fromtimestamp(scene.time_s, dt.UTC).isoformat(timespec="milliseconds")
    children: defaultdict[int | None, list[int]] = defaultdict(list)
    for number, node in enumerate(scene.nodes):
        children[node.parent].append(number)
    lines = [
        "#usda 1.0", "(", '    defaultPrim = "world"', "    metersPerUnit = 1",
        '    upAxis = "Z"', f"    customLayerData = {{ string rtaskTime = {_quoted(time)} }}",
        ")", "", 'def Xform "world"', "{",
    ]  # fmt: skip
    lines += _children(scene.nodes, children, None, 1)
    return "\n".join([*lines, "}", ""])


def _children(
    nodes: tuple[SceneNode, ...],
    children: dict[int | None, list[int]],
    parent: int | None,
    depth: int,
) -> Iterator[str]:
    """Yield the lines of the nodes below one; names are unique among siblings."""
    used = {"shape"}
    for number in children.get(parent, ()):
        node = nodes[number]
        name = _free_name(node, used)
        pad = _INDENT * depth
        yield f'{pad}def Xform "{name}" ('
        yield f"{pad}{_INDENT}displayName = {_quoted(node.label)}"
        yield f"{pad})"
        yield f"{pad}{{"
        yield from (f"{pad}{_INDENT}{line}" for line in _attributes(node))
        yield from (f"{pad}{_INDENT}{line}" for line in _shape(node))
        yield from _children(nodes, children, number, depth + 1)
        yield f"{pad}}}"


def _free_name(node: SceneNode, used: set[str]) -> str:
    base = _NO_IDENTIFIER.sub("_", node.label).strip("_") or node.kind
    base = f"_{base}" if base[0].isdigit() else base
    name, number = base, 1
    while name in used:
        number += 1
        name = f"{base}_{number}"
    used.add(name)
    return name


def _attributes(node: SceneNode) -> Iterator[str]:
    rows = ", ".join(_tuple(row) for row in node.parent_from_node.T)  # USD multiplies row vectors
    yield f"matrix4d xformOp:transform = ( {rows} )"
    yield 'uniform token[] xformOpOrder = ["xformOp:transform"]'
    facts: dict[str, Fact] = {"iri": node.iri, "kind": node.kind, **node.facts}
    for name, value in facts.items():
        kind = "string" if isinstance(value, str) else "double"
        stored = _quoted(value) if isinstance(value, str) else repr(float(value))
        yield f"custom {kind} rtask:{name} = {stored}"


def _shape(node: SceneNode) -> list[str]:
    if node.kind == "robot":
        return []
    colour = f"color3f[] primvars:displayColor = [{_tuple(_COLOURS[node.kind])}]"
    if node.kind == "frame":
        axes = np.array([[np.zeros(3), end] for end in AXIS_M * np.eye(3)])
        return _curves(axes, colour)
    if node.kind == "grasp":
        return _curves(grasp_lines(node.opening_m), colour)
    if node.surface is not None:
        return _surface(node.surface, _COLOURS[node.kind])
    if node.region_m is not None:
        grey = f"color3f[] primvars:displayColor = [{_tuple(_UNSEEN)}]"
        return _curves(region_lines(node.region_m), grey)
    if node.size_m is None:
        return []
    is_place = node.kind == "place"
    boxes = wall_boxes(node.size_m) if is_place else [box_corners(node.size_m)]
    corners = np.concatenate(boxes)
    faces = [corner + 8 * number for number in range(len(boxes)) for corner in _FACES]
    bounds = _points(np.array([corners.min(axis=0), corners.max(axis=0)]))
    return [
        'def Mesh "shape"', "{",
        f"{_INDENT}float3[] extent = [{bounds}]",
        f"{_INDENT}int[] faceVertexCounts = [{', '.join(['4'] * (6 * len(boxes)))}]",
        f"{_INDENT}int[] faceVertexIndices = [{', '.join(map(str, faces))}]",
        f"{_INDENT}point3f[] points = [{_points(corners)}]",
        f'{_INDENT}uniform token subdivisionScheme = "none"', f"{_INDENT}{colour}", "}",
    ]  # fmt: skip


def _surface(surface: SceneSurface, colour: tuple[float, float, float]) -> list[str]:
    """Return a mesh with a colour for each face: grey for what nobody has seen."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    colours = ", ".join(_tuple(colour if seen else _UNSEEN) for seen in surface.seen_faces)
    return [
        'def Mesh "shape"', "{",
        f"{_INDENT}float3[] extent = [{_points(np.array([low, high]))}]",
        f"{_INDENT}int[] faceVertexCounts = [{', '.join('3' for _ in surface.faces)}]",
        f"{_INDENT}int[] faceVertexIndices = [{', '.join(map(str, surface.faces.ravel()))}]",
        f"{_INDENT}point3f[] points = [{_points(surface.vertices.round(6))}]",
        f'{_INDENT}uniform token subdivisionScheme = "none"',
        f"{_INDENT}color3f[] primvars:displayColor = [{colours}] (interpolation = \"uniform\")",
        "}",
    ]  # fmt: skip


def _curves(lines: NDArray[np.float64], colour: str) -> list[str]:
    counts = ", ".join("2" for _ in lines)
    return [
        'def BasisCurves "shape"', "{", f'{_INDENT}uniform token type = "linear"',
        f"{_INDENT}int[] curveVertexCounts = [{counts}]",
        f"{_INDENT}point3f[] points = [{_points(lines.reshape(-1, 3))}]",
        f'{_INDENT}float[] widths = [0.002] (interpolation = "constant")',
        f"{_INDENT}{colour}", "}",
    ]  # fmt: skip


def _points(points: NDArray[np.float64]) -> str:
    return ", ".join(_tuple(point) for point in points)


def _tuple(values: Iterable[float]) -> str:
    return f"({', '.join(repr(float(value)) for value in values)})"


def _quoted(text: str) -> str:
    """Return a string literal: JSON's short escapes are those of USD, which has no ``\\u``."""
    return json.dumps(_CONTROL.sub(" ", text), ensure_ascii=False)
