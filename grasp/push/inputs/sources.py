"""Outlines of parts from files: JSON, SVG, DXF, images, and point clouds.

Every reader returns an outline (n, 2) in the file's own unit, not yet checked; `read_outline` picks
the reader by the file's ending and simplifies what is too dense to plan on.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp.arrays import FloatArray
from grasp.push.inputs.contours import rings_from_image
from grasp.push.inputs.dxf import DxfOutlines, rings_from_dxf
from grasp.push.inputs.rings import PartRings, outline_and_holes
from grasp.push.inputs.svg import rings_from_svg
from grasp.push.perturb import Tolerance
from grasp.push.polygon import MAX_VERTICES, as_part, as_polygon, plate_centroid, simplify

__all__ = [
    "CLOUD_ENDINGS",
    "Outline",
    "outline_from_cloud",
    "outline_from_json",
    "read_cloud",
    "read_outline",
    "without_details",
]

CLOUD_ENDINGS = (".pcd", ".ply", ".npy", ".xyz")
_IMAGE_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_MAX_BYTES = 64 * 1024 * 1024
_NPY = b"\x93NUMPY"
_HEAD_BYTES = 65_536
_PLY_COUNT = re.compile(rb"^element\s+vertex\s+(\d+)", re.MULTILINE)
_PCD_COUNT = re.compile(rb"^POINTS\s+(\d+)", re.MULTILINE)
_POINT_BYTES, _COMPRESSED = 3, 300
"""Of a point at least: three numbers of a byte; LZF makes at most some 260 of one byte."""


@dataclass(frozen=True)
class Outline:
    """Part as read from a file.

    Parameters
    ----------
    polygon : (n, 2)
        Checked, counter-clockwise.
    com : (2,) or None
        The file's, or that of a plate of even thickness with holes; None for the centroid.
    read
        How many vertices the file had.
    note
        What was done to them, for people.
    height
        Of a cloud over its support, in its unit; 0 for other files.
    holes
        Each (m, 2), counter-clockwise. Jaws do not reach into them; they move the centre of mass.
    unit
        Of every length, where the file states it.
    """

    polygon: FloatArray
    com: FloatArray | None = None
    read: int = 0
    note: str = ""
    height: float = 0.0
    holes: tuple[FloatArray, ...] = ()
    unit: str = ""


def read_outline(path: Path, max_vertices: int = MAX_VERTICES, part: int = 1) -> Outline:
    """Return the outline of a part from a file.

    Parameters
    ----------
    part
        Which one of several in a drawing or an image, counted from 1, the largest.

    Raises
    ------
    ValueError
        When the ending is unknown, the file is no such file, it has no such part, or its outline
        makes no polygon.
    """
    ending = path.suffix.lower()
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path.name} is larger than {_MAX_BYTES // 2**20} MB")
    com: FloatArray | None = None
    height, unit = 0.0, ""
    notes: list[str] = []
    if ending == ".json":
        ring, com, holes = outline_from_json(_text(path, "JSON"))
        rings = PartRings(ring, holes)
    elif ending == ".svg":
        rings_read, unit = rings_from_svg(_text(path, "SVG"))
        rings = outline_and_holes(rings_read, "SVG", part)
    elif ending == ".dxf":
        drawing = rings_from_dxf(path.read_text("utf-8", errors="replace"))
        notes = _dxf_notes(drawing)
        rings, unit = outline_and_holes(drawing.rings, _dxf_name(drawing), part), drawing.unit
    elif ending in _IMAGE_ENDINGS:
        rings, unit = outline_and_holes(rings_from_image(path.read_bytes()), "image", part), "px"
    elif ending in CLOUD_ENDINGS:
        ring, height = outline_from_cloud(read_cloud(path))
        rings = PartRings(ring, ())
    else:
        endings = (".json", ".svg", ".dxf", *_IMAGE_ENDINGS, *CLOUD_ENDINGS)
        raise ValueError(f"no outline can be read from {path.name}; known: {' '.join(endings)}")
    if part != 1 and len(rings.outline) and ending in (".json", *CLOUD_ENDINGS):
        raise ValueError(f"part {part}: a file {ending} holds one part")
    dense = len(rings.outline) > max_vertices
    polygon = simplify(rings.outline, max_vertices) if dense else as_polygon(rings.outline)
    if rings.holes and com is None:
        com = plate_centroid(polygon, rings.holes)
    read = len(rings.outline)
    remarks = [f"simplified from {read} to {len(polygon)} vertices"] if dense else []
    remarks += [*notes, *_notes(rings, part), *([f"lengths in {unit}"] if unit else [])]
    return Outline(polygon, com, read, "; ".join(remarks), height, rings.holes, unit)


def _notes(rings: PartRings, part: int) -> list[str]:
    """Return what people should know about the holes, and about what was left out."""
    notes = []
    if rings.others:
        parts = "another part was" if rings.others == 1 else f"{rings.others} other parts were"
        notes.append(f"{parts} left out: this is part {part} of {rings.others + 1} by size")
    if rings.holes:
        holes = len(rings.holes)
        notes.append(f"{holes} hole{'s'[: holes > 1]}: they move the centre of mass only")
    return notes


def _dxf_notes(drawing: DxfOutlines) -> list[str]:
    notes = []
    if drawing.gap:
        unit = f" {drawing.unit}" if drawing.unit else ""
        notes.append(f"the outline is open: a straight line of {drawing.gap:.4g}{unit} closes it")
    if drawing.hidden:
        notes.append(f"{drawing.hidden} hidden {_entities(drawing.hidden)} left out")
    return notes


def _dxf_name(drawing: DxfOutlines) -> str:
    """Return how an error names the drawing."""
    if not drawing.hidden:
        return "DXF"
    return f"DXF ({drawing.hidden} {_entities(drawing.hidden)} on hidden layers left out)"


def _entities(count: int) -> str:
    return "entity" if count == 1 else "entities"


def without_details(
    outline: Outline, vertex_std: float | None = None, correlated: bool = False
) -> Outline:
    """Return an outline without details that the deviation of its vertices hides.

    A rounded corner drawn by many vertices that each deviate by more than their distance crosses
    itself in every perturbation. The centre of mass stays that of the whole outline.

    Parameters
    ----------
    vertex_std
        Standard deviation of a vertex; by default that of `Tolerance`.
    correlated
        Vertices deviate as in a smooth warp, which crosses nothing: the outline may be off by a
        quarter of a deviation instead of half a one.
    """
    part = as_part(outline.polygon, outline.com)
    spread = Tolerance.default(part).vertex_std if vertex_std is None else vertex_std
    extent = float(np.ptp(part.vertices, axis=0).max())
    share = 0.25 if correlated else 0.5
    polygon = simplify(part.vertices, len(part.vertices), share * float(spread) / extent)
    if len(polygon) == len(part.vertices):
        return outline
    off = "a quarter of" if correlated else "half"
    count = f"simplified from {outline.read} to {len(polygon)} vertices"
    comment = f"{count}, none of the rest off by more than {off} a deviation of {spread:.3g}"
    notes = [words for words in outline.note.split("; ") if words and "simplified" not in words]
    return replace(outline, polygon=polygon, com=part.com, note="; ".join([comment, *notes]))


def outline_from_json(
    text: str,
) -> tuple[FloatArray, FloatArray | None, tuple[FloatArray, ...]]:
    """Return outline, centre of mass and holes of a part in JSON.

    ``[[x, y], ..]`` or ``{"polygon": [[x, y], ..], "com": [x, y], "holes": [[[x, y], ..], ..]}``.

    >>> outline_from_json('{"polygon": [[0, 0], [1, 0], [0, 1]], "com": [0.3, 0.3]}')[1].tolist()
    [0.3, 0.3]
    """
    try:
        data: Any = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"no JSON: {error}") from error
    com: Any = None
    given: Any = []
    if isinstance(data, dict):
        com, given = data.get("com"), data.get("holes") or []
        data = data.get("polygon", data.get("vertices"))
    if not isinstance(data, list):
        raise ValueError('a part in JSON is [[x, y], ..] or {"polygon": [[x, y], ..]}')
    try:
        ring = np.array(data, dtype=np.float64)
        mass = None if com is None else np.array(com, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError("vertices and centre of mass are pairs of numbers") from error
    if not isinstance(given, list):
        raise ValueError("holes are a list of polygons")
    if not given:
        return ring, mass, ()
    read_holes = [as_polygon(hole) for hole in given]
    outline, holes, _ = outline_and_holes([as_polygon(ring), *read_holes], "JSON")
    if len(holes) < len(read_holes):
        raise ValueError("holes lie inside the outline and apart from one another")
    return outline, mass, holes


def _text(path: Path, kind: str) -> str:
    try:
        return path.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"no {kind}: byte {error.start} is no UTF-8 text") from error


def read_cloud(path: Path) -> FloatArray:
    """Return the points (n, 3) of a file: .npy, .xyz (text), .pcd or .ply.

    Raises
    ------
    ValueError
        When it is another kind of file, or holds no points.
    """
    ending = path.suffix.lower()
    if ending not in CLOUD_ENDINGS:
        raise ValueError(f"{path.name} is no point cloud; those are {', '.join(CLOUD_ENDINGS)}")
    try:
        if ending == ".npy":
            points = _load_numbers(path)
        elif ending == ".xyz":
            points = np.loadtxt(path, ndmin=2)
        else:
            import open3d

            _check_count(path)
            with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
                points = np.asarray(open3d.io.read_point_cloud(path).points)
            if len(points) == 0:
                raise ValueError("no points could be read")
    except (OSError, ValueError, EOFError, MemoryError) as error:
        reason = str(error) or "its points do not fit into memory"
        raise ValueError(f"{path.name} holds no point cloud: {reason}") from error
    if points.ndim < 2 or points.shape[-1] < 3 or not np.issubdtype(points.dtype, np.number):
        raise ValueError(f"a cloud has shape (n, 3), got {points.shape}")
    flat = points.reshape(-1, points.shape[-1])[:, :3].astype(np.float64)
    return np.asarray(flat[np.isfinite(flat).all(axis=1)])


def _load_numbers(path: Path) -> FloatArray:
    """Return the array of a .npy file; its header may state more than the file holds."""
    with path.open("rb") as file:
        if file.read(len(_NPY)) != _NPY:
            raise ValueError("it does not begin as a .npy file does")
    return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))


def _check_count(path: Path) -> None:
    """Refuse a .ply or .pcd file whose header is not one, or states more points than fit.

    The reader would take memory for all of them before it reads the first.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    is_ply = path.suffix.lower() == ".ply"
    if is_ply and not head.startswith(b"ply"):
        raise ValueError("it does not begin with ply")
    stated = re.search(_PLY_COUNT if is_ply else _PCD_COUNT, head)
    if stated is None:
        raise ValueError("its header does not state how many points there are")
    each = 1 / _COMPRESSED if b"binary_compressed" in head else _POINT_BYTES
    size = path.stat().st_size
    if int(stated[1]) * each > size:
        raise ValueError(f"its header states {int(stated[1])} points, the file has {size} bytes")


def outline_from_cloud(points: FloatArray) -> tuple[FloatArray, float]:
    """Return footprint (n, 2) and height of a segmented object's cloud, z up from its support.

    Parameters
    ----------
    points : (n, 3), m

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
    # As fine as the density of points allows, so that a fold of the outline stays a fold.
    cell = max(size / 200, 2.0 * math.sqrt(float(np.prod(spans)) / len(cloud)))
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
