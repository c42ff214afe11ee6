"""Outlines of parts from files: JSON, SVG, DXF, images, and point clouds.

Every reader returns an outline (n, 2) in the file's own unit, not yet checked; `read_outline` picks
the reader by the file's ending and simplifies what is too dense to plan on.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from grasp.push.polygon import FloatArray, as_polygon, simplify

__all__ = [
    "CLOUD_ENDINGS",
    "Outline",
    "outline_from_cloud",
    "outline_from_dxf",
    "outline_from_image",
    "outline_from_json",
    "outline_from_svg",
    "read_cloud",
    "read_outline",
]

CLOUD_ENDINGS = (".pcd", ".ply", ".npy", ".xyz")
_IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_MAX_BYTES = 64 * 1024 * 1024
_CURVE_STEPS = 16
_PLANNED_VERTICES = 64


@dataclass(frozen=True)
class Outline:
    """What a file says of a part.

    Parameters
    ----------
    polygon : (n, 2)
        Checked, counter-clockwise.
    com : (2,) or None
        Where the file gives a centre of mass.
    read
        How many vertices the file had.
    note
        What was done to them, for people.
    height
        Of a cloud over its support, in its unit; 0 for other files.
    """

    polygon: FloatArray
    com: FloatArray | None = None
    read: int = 0
    note: str = ""
    height: float = 0.0


def read_outline(path: Path, max_vertices: int = _PLANNED_VERTICES) -> Outline:
    """Return the outline of a part from a file.

    Raises
    ------
    ValueError
        When the ending is unknown, the file is no such file, or its outline makes no polygon.
    """
    ending = path.suffix.lower()
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path.name} is larger than {_MAX_BYTES // 2**20} MB")
    com, height = None, 0.0
    if ending == ".json":
        ring, com = outline_from_json(path.read_text("utf-8"))
    elif ending == ".svg":
        ring = outline_from_svg(path.read_text("utf-8"))
    elif ending == ".dxf":
        ring = outline_from_dxf(path.read_text("utf-8", errors="replace"))
    elif ending in _IMAGE_ENDINGS:
        ring = outline_from_image(path.read_bytes())
    elif ending in CLOUD_ENDINGS:
        ring, height = outline_from_cloud(read_cloud(path))
    else:
        known = (".json", ".svg", ".dxf", *_IMAGE_ENDINGS, *CLOUD_ENDINGS)
        raise ValueError(f"no outline can be read from {path.name}; known: {' '.join(known)}")
    read = len(ring)
    if read <= max_vertices:
        return Outline(as_polygon(ring), com, read, "", height)
    polygon = simplify(ring, max_vertices)
    note = f"simplified from {read} to {len(polygon)} vertices"
    return Outline(polygon, com, read, note, height)


def outline_from_json(text: str) -> tuple[FloatArray, FloatArray | None]:
    """Return outline and centre of mass of ``[[x, y], ..]`` or ``{"polygon": .., "com": ..}``.

    >>> outline_from_json('{"polygon": [[0, 0], [1, 0], [0, 1]], "com": [0.3, 0.3]}')[1].tolist()
    [0.3, 0.3]
    """
    try:
        data: Any = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"no JSON: {error}") from error
    com = None
    if isinstance(data, dict):
        com = data.get("com")
        data = data.get("polygon", data.get("vertices"))
        if data is None:
            raise ValueError('a part in JSON is [[x, y], ..] or {"polygon": [[x, y], ..]}')
    try:
        ring = np.array(data, dtype=np.float64)
        mass = None if com is None else np.array(com, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError("vertices and centre of mass are pairs of numbers") from error
    return ring, mass


def _largest(rings: list[FloatArray], what: str) -> FloatArray:
    """Return the ring that encloses most."""
    rings = [r for r in rings if len(r) >= 3]
    if not rings:
        raise ValueError(f"no closed outline in this {what}")

    def enclosed(ring: FloatArray) -> float:
        x, y = ring.T
        return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))

    return max(rings, key=enclosed)


# SVG


def outline_from_svg(text: str) -> FloatArray:
    """Return the largest closed shape of an SVG document, y upwards; transforms are not applied.

    >>> outline_from_svg('<svg><rect x="1" y="2" width="3" height="1"/></svg>').tolist()
    [[1.0, -2.0], [4.0, -2.0], [4.0, -3.0], [1.0, -3.0]]
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        # Entities can grow without bound; no drawing program needs them for an outline.
        text = re.sub(r"<!DOCTYPE[^\[>]*>", "", text)
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("SVG with entity declarations is refused")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"no SVG: {error}") from error
    rings: list[FloatArray] = []
    for element in root.iter():
        name = str(element.tag).rpartition("}")[2]
        if element.get("transform"):
            raise ValueError("transform attributes are not applied; flatten them in the drawing")
        rings.extend(_svg_shape(name, element))
    ring = _largest(rings, "SVG")
    return np.asarray(ring * (1.0, -1.0))


def _svg_shape(name: str, element: ElementTree.Element) -> Iterator[FloatArray]:
    def number(key: str) -> float:
        found = re.match(r"\s*([-+.\deE]+)", element.get(key, "0"))
        return float(found.group(1)) if found else 0.0

    if name in ("polygon", "polyline"):
        values = _numbers(element.get("points", ""))
        yield np.array(values[: len(values) // 2 * 2]).reshape(-1, 2)
    elif name == "rect":
        x, y, w, h = (number(k) for k in ("x", "y", "width", "height"))
        yield np.array([(x, y), (x + w, y), (x + w, y + h), (x, y + h)])
    elif name in ("circle", "ellipse"):
        rx, ry = (number("r"),) * 2 if name == "circle" else (number("rx"), number("ry"))
        angle = np.arange(48) * (2 * np.pi / 48)
        centre = np.array([number("cx"), number("cy")])
        yield centre + np.column_stack([rx * np.cos(angle), ry * np.sin(angle)])
    elif name == "path":
        yield from _svg_path(element.get("d", ""))


def _numbers(text: str) -> list[float]:
    return [float(v) for v in re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", text)]


_TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}


def _svg_path(d: str) -> Iterator[FloatArray]:
    """Yield the subpaths of path data (SVG 2, 9.3), curves as chords."""
    points: list[complex] = []
    at = handle = start = 0j
    last = ""
    for letter, rest in re.findall(r"([MmLlHhVvCcSsQqTtAaZz])([^MmLlHhVvCcSsQqTtAaZz]*)", d):
        command, base = letter.upper(), letter.islower()
        values = _numbers(rest)
        takes = _TAKES[command]
        groups = [values[i : i + takes] for i in range(0, len(values), takes)] if takes else [[]]
        for k, group in enumerate(groups):
            if len(group) < takes:
                raise ValueError(f"path data: {letter} takes {takes} numbers, got {len(group)}")
            origin = at if base else 0j
            if command == "Z":
                at = start
                continue
            if command == "M" and k == 0:
                yield np.array([(p.real, p.imag) for p in points]).reshape(-1, 2)
                at = start = origin + complex(*group)
                points = [at]
            elif command in "MLHV":
                at = _line_end(command, group, at, base)
                points.append(at)
            elif command == "A":
                end = origin + complex(group[5], group[6])
                points.extend(_arc(at, end, group))
                at = end
            else:
                pairs = [origin + complex(*group[i : i + 2]) for i in range(0, takes, 2)]
                if command in "ST":
                    smooth = last in ("CS" if command == "S" else "QT")
                    pairs.insert(0, 2 * at - handle if smooth else at)
                points.extend(_bezier([at, *pairs]))
                handle, at = pairs[-2], pairs[-1]
            last = command
    yield np.array([(p.real, p.imag) for p in points]).reshape(-1, 2)


def _line_end(command: str, group: list[float], at: complex, relative: bool) -> complex:
    if command == "H":
        return complex(group[0] + (at.real if relative else 0.0), at.imag)
    if command == "V":
        return complex(at.real, group[0] + (at.imag if relative else 0.0))
    return complex(*group) + (at if relative else 0j)


def _bezier(controls: list[complex]) -> list[complex]:
    out = []
    for k in range(1, _CURVE_STEPS + 1):
        t, level = k / _CURVE_STEPS, controls
        while len(level) > 1:
            level = [p + t * (q - p) for p, q in itertools.pairwise(level)]
        out.append(level[0])
    return out


def _arc(start: complex, end: complex, group: list[float]) -> list[complex]:
    """Return points of an elliptical arc (SVG 2, B.2.4)."""
    rx, ry, turn = abs(group[0]), abs(group[1]), complex(math.cos(a := math.radians(group[2])), 0)
    turn += 1j * math.sin(a)
    if rx == 0 or ry == 0 or start == end:
        return [end]
    half = (start - end) / 2 / turn
    x, y = half.real / rx, half.imag / ry
    grow = math.sqrt(max(1.0, x * x + y * y))
    rx, ry, x, y = rx * grow, ry * grow, x / grow, y / grow
    size = math.sqrt(max(0.0, 1.0 / (x * x + y * y) - 1.0))
    if bool(group[3]) == bool(group[4]):
        size = -size
    cx, cy = size * y, -size * x
    first = math.atan2(y - cy, x - cx)
    sweep = math.atan2(-y - cy, -x - cx) - first
    if group[4] and sweep < 0:
        sweep += 2 * math.pi
    elif not group[4] and sweep > 0:
        sweep -= 2 * math.pi
    middle = (start + end) / 2 + complex(cx * rx, cy * ry) * turn
    angles = (first + sweep * k / _CURVE_STEPS for k in range(1, _CURVE_STEPS + 1))
    return [middle + complex(rx * math.cos(t), ry * math.sin(t)) * turn for t in angles]


# DXF


def outline_from_dxf(text: str) -> FloatArray:
    """Return the largest closed outline of an ASCII DXF drawing.

    LWPOLYLINE and POLYLINE with their bulges (arcs), CIRCLE, and LINE and ARC joined at their ends.
    """
    lines = [line.strip() for line in text.splitlines()]
    if len(lines) < 4 or lines[0].startswith("AutoCAD Binary"):
        raise ValueError("no ASCII DXF")
    try:
        tags = [(int(code), value) for code, value in zip(lines[::2], lines[1::2], strict=False)]
        return _largest(list(_dxf_rings(tags)), "DXF")
    except (KeyError, IndexError) as error:
        raise ValueError(f"DXF entity without {error}") from error
    except ValueError as error:
        raise ValueError(f"no DXF: {error}") from error


def _dxf_entities(tags: list[tuple[int, str]]) -> Iterator[tuple[str, list[tuple[int, str]]]]:
    name, inside = "", False
    found: list[tuple[int, str]] = []
    for code, value in tags:
        if code == 2 and name == "SECTION":
            inside = value == "ENTITIES"
        if code == 0:
            if inside and name:
                yield name, found
            name, found = value, []
        else:
            found.append((code, value))


def _dxf_rings(tags: list[tuple[int, str]]) -> Iterator[FloatArray]:
    loose: list[FloatArray] = []
    poly: list[tuple[float, float, float]] | None = None
    for name, found in _dxf_entities(tags):
        first: dict[int, str] = {}
        for code, value in found:
            first.setdefault(code, value)
        if name == "LWPOLYLINE":
            yield _bulged(_lw_vertices(found))
        elif name == "POLYLINE":
            poly = []
        elif name == "VERTEX" and poly is not None:
            poly.append((float(first[10]), float(first[20]), float(first.get(42, 0))))
        elif name == "SEQEND" and poly is not None:
            yield _bulged(poly)
            poly = None
        elif name in ("CIRCLE", "ARC"):
            low, high = float(first.get(50, 0)), float(first.get(51, 360))
            span = (high - low) % 360 or 360.0
            steps = max(2, math.ceil(48 * span / 360))
            angle = np.radians(low + span * np.arange(steps + 1) / steps)
            centre = np.array([float(first[10]), float(first[20])])
            line = centre + float(first[40]) * np.column_stack([np.cos(angle), np.sin(angle)])
            if name == "CIRCLE":
                yield line[:-1]
            else:
                loose.append(line)
        elif name == "LINE":
            values = [float(first[c]) for c in (10, 20, 11, 21)]
            loose.append(np.array(values).reshape(2, 2))
    yield from _joined(loose)


def _lw_vertices(found: list[tuple[int, str]]) -> list[tuple[float, float, float]]:
    out: list[list[float]] = []
    for code, value in found:
        if code == 10:
            out.append([float(value), 0.0, 0.0])
        elif code == 20 and out:
            out[-1][1] = float(value)
        elif code == 42 and out:
            out[-1][2] = float(value)
    return [(x, y, b) for x, y, b in out]


def _bulged(vertices: list[tuple[float, float, float]]) -> FloatArray:
    """Return a closed polyline with arcs as chords; bulge = tan(sweep / 4)."""
    out: list[complex] = []
    for (x, y, bulge), (p, q, _) in zip(vertices, vertices[1:] + vertices[:1], strict=True):
        start, end = complex(x, y), complex(p, q)
        out.append(start)
        if bulge and start != end:
            sweep = 4 * math.atan(bulge)
            centre = (start + end) / 2 + 1j * (end - start) / 2 / math.tan(sweep / 2)
            turns = (sweep * k / _CURVE_STEPS for k in range(1, _CURVE_STEPS))
            out.extend(centre + (start - centre) * complex(math.cos(t), math.sin(t)) for t in turns)
    return np.array([(p.real, p.imag) for p in out]).reshape(-1, 2)


def _joined(pieces: list[FloatArray]) -> Iterator[FloatArray]:
    """Join polylines end to end into closed rings."""
    if not pieces:
        return
    every = np.vstack(pieces)
    near = 1e-6 * float(np.ptp(every, axis=0).max() or 1.0)
    left = list(pieces)
    while left:
        chain = left.pop()
        grown = True
        while grown and np.abs(chain[0] - chain[-1]).max() > near:
            grown = False
            for i, piece in enumerate(left):
                for line in (piece, piece[::-1]):
                    if np.abs(line[0] - chain[-1]).max() <= near:
                        chain, grown = np.vstack([chain, line[1:]]), True
                        break
                if grown:
                    del left[i]
                    break
        if len(chain) > 3 and np.abs(chain[0] - chain[-1]).max() <= near:
            yield chain[:-1]


# Images


def outline_from_image(data: bytes | NDArray[np.uint8]) -> FloatArray:
    """Return the contour of the one object before a plain background, pixels, y upwards.

    Kehoe 2014, 3.7: the part is imaged on a board and contoured. The object is what differs from
    the border of the image.

    Parameters
    ----------
    data
        An encoded image, or pixels (h, w) or (h, w, 3) uint8.
    """
    import cv2

    if isinstance(data, bytes):
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
        if decoded is None:
            raise ValueError("no image that can be decoded")
        pixels = np.asarray(decoded)
    else:
        pixels = np.asarray(data)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[:, :, None], 3, axis=2)
    if pixels.ndim != 3 or min(pixels.shape[:2]) < 8:
        raise ValueError(f"an image of at least 8 x 8 pixels is needed, got {pixels.shape}")
    border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    apart = np.abs(pixels.astype(np.int16) - np.median(border, axis=0)).max(axis=2)
    _, mask = cv2.threshold(apart.astype(np.uint8), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    if apart.max() < 16:
        raise ValueError("nothing stands out from the image's border")
    mask = np.pad(np.asarray(mask), 1)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    ring = max(contours, key=cv2.contourArea)[:, 0, :].astype(np.float64) - 1.0
    if len(ring) < 8:
        raise ValueError("nothing large enough stands out from the image's border")
    return np.asarray(ring * (1.0, -1.0))


# Clouds


def read_cloud(path: Path) -> FloatArray:
    """Return the points (n, 3) of a file: .npy, .xyz (text), .pcd or .ply."""
    ending = path.suffix.lower()
    try:
        if ending == ".npy":
            points = np.load(path, allow_pickle=False)
        elif ending == ".xyz":
            points = np.loadtxt(path, ndmin=2)
        else:
            import open3d

            points = np.asarray(open3d.io.read_point_cloud(path).points)
    except (OSError, ValueError, EOFError) as error:
        raise ValueError(f"{path.name} holds no point cloud: {error}") from error
    if points.ndim < 2 or points.shape[-1] < 3 or not np.issubdtype(points.dtype, np.number):
        raise ValueError(f"a cloud has shape (n, 3), got {points.shape}")
    flat = points.reshape(-1, points.shape[-1])[:, :3].astype(np.float64)
    return np.asarray(flat[np.isfinite(flat).all(axis=1)])


def outline_from_cloud(points: FloatArray, cell_m: float | None = None) -> tuple[FloatArray, float]:
    """Return footprint (n, 2) and height of a segmented object's cloud, z up from its support.

    Parameters
    ----------
    points : (n, 3), m
    cell_m
        Of the grid on which the footprint is drawn; by default what the density of points allows,
        so that a fold of the outline stays a fold.

    Raises
    ------
    ValueError
        When there are too few points or they lie on a line.
    """
    import cv2

    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise ValueError(f"a cloud has shape (n, 3), got {cloud.shape}")
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    if len(cloud) < 10:
        raise ValueError(f"a footprint needs ten finite points, got {len(cloud)}")
    flat = cloud[:, :2]
    low = flat.min(axis=0)
    spans = np.ptp(flat, axis=0)
    spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    if spread[0] <= 0 or spread[1] < 1e-3 * spread[0]:
        raise ValueError("the cloud's points lie on a line seen from above: it has no footprint")
    height = float(np.quantile(cloud[:, 2], 0.99) - cloud[:, 2].min())
    size = float(spans.max())
    cell = cell_m or max(size / 200, 2.0 * math.sqrt(float(np.prod(spans)) / len(cloud)))
    shape = np.minimum(np.ceil(spans / cell).astype(int) + 8, 2048)
    image = np.zeros((shape[1], shape[0]), np.uint8)
    at = np.minimum(((flat - low) / cell).astype(int) + 4, shape - 1)
    image[at[:, 1], at[:, 0]] = 255
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    closed = cv2.morphologyEx(image, cv2.MORPH_CLOSE, kernel, iterations=2)
    # Walls alone are seen of many objects: what they enclose belongs to the footprint.
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    if len(largest) < 4 or cv2.contourArea(largest) < 4:
        return np.asarray(cv2.convexHull(flat.astype(np.float32))[:, 0, :], np.float64), height
    ring = low + (largest[:, 0, :] - 4 + 0.5) * cell
    return np.asarray(simplify(ring, 32, 1.5 * cell / size)), height
