"""Illustrations: labels over an image, matches between two views, a pose over an image."""

from __future__ import annotations

import colorsys

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray, Intrinsics, UInt8Array, points_from_depth

__all__ = [
    "box_corners",
    "draw_box",
    "draw_labels",
    "draw_matches",
    "draw_model",
    "picture_of_cloud",
    "shade",
]

_GOLDEN = 0.61803398875
_EDGES = ((0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7),
          (6, 7))  # fmt: skip
_AXIS_COLOURS = ((230, 60, 50), (60, 190, 70), (60, 100, 240))
_MAX_DOTS = 300
_MAX_LINES = 40
_GREEN, _GREY, _RED = (70, 220, 90), (150, 150, 150), (240, 50, 40)


def colour_of(number: int) -> tuple[int, int, int]:
    """Return a colour for a label; neighbours differ.

    >>> colour_of(1) != colour_of(2)
    True
    """
    red, green, blue = colorsys.hsv_to_rgb((number * _GOLDEN) % 1.0, 0.75, 1.0)
    return int(255 * red), int(255 * green), int(255 * blue)


def draw_labels(
    image: UInt8Array, labels: NDArray[np.int32], names: dict[int, str] | None = None
) -> UInt8Array:
    """Tint every segment, outline it and write its number or name beside it.

    Parameters
    ----------
    image : (h, w, 3) uint8 RGB
    labels : (h, w) int32
        0 = no object.
    names
        Text by label; default: the number.

    Examples
    --------
    >>> labels = np.zeros((40, 40), np.int32); labels[10:30, 10:30] = 1
    >>> draw_labels(np.zeros((40, 40, 3), np.uint8), labels).any()
    np.True_
    """
    if image.shape != (*labels.shape, 3):
        raise ValueError(f"image {image.shape} and labels {labels.shape} do not fit together")
    shown = image.copy()
    for number in np.unique(labels[labels > 0]).tolist():
        mask = labels == number
        colour = colour_of(number)
        shown[mask] = (0.55 * shown[mask] + 0.45 * np.array(colour)).astype(np.uint8)
        outline, _ = cv2.findContours(
            mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(shown, outline, -1, colour, 2, cv2.LINE_AA)
    for number in np.unique(labels[labels > 0]).tolist():
        rows, columns = np.nonzero(labels == number)
        _write(shown, (names or {}).get(number, str(number)), columns.min(), rows.min() - 4)
    return shown


def draw_matches(
    left: UInt8Array,
    right: UInt8Array,
    places: tuple[FloatArray, FloatArray],
    agreed: NDArray[np.bool_],
    title: str = "",
    differs: tuple[float, float, float, float] | None = None,
) -> UInt8Array:
    """Put two views side by side and mark matched places; those that agree are green.

    Of each sort so many are joined by a line, spread over the object, that it stays visible.

    Parameters
    ----------
    left, right : (h, w, 3) uint8 RGB
    places : two (n, 2) float, px
        Of each view.
    agreed : (n,) bool
    title
        One line above.
    differs
        Left, top, width and height, px, of a region of the first view to mark in red: the second
        shows something else there.
    """
    scale = [max(1.0, 360 / max(side.shape[0], 1)) for side in (left, right)]
    sides = [
        cv2.resize(side, None, fx=s, fy=s, interpolation=cv2.INTER_CUBIC)
        for side, s in zip((left, right), scale, strict=True)
    ]
    height = max(side.shape[0] for side in sides) + 24
    shown = np.full((height, sides[0].shape[1] + sides[1].shape[1] + 12, 3), 32, np.uint8)
    offsets = (0, sides[0].shape[1] + 12)
    for side, x in zip(sides, offsets, strict=True):
        shown[24 : 24 + side.shape[0], x : x + side.shape[1]] = side
    here, there = (
        np.rint(np.asarray(p)[:, :2] * s + (x, 24)).astype(int)
        for p, s, x in zip(places, scale, offsets, strict=True)
    )
    for colour, chosen in ((_GREY, ~agreed), (_GREEN, agreed)):
        rows = np.flatnonzero(chosen)
        rows = rows[np.argsort(here[rows, 1], kind="stable")]
        for k in rows[:: -(-len(rows) // _MAX_LINES) or 1].tolist():
            cv2.line(shown, here[k].tolist(), there[k].tolist(), colour, 1, cv2.LINE_AA)
        for place in (*here[rows], *there[rows]):
            cv2.circle(shown, place.tolist(), 2, colour, -1, cv2.LINE_AA)
    if differs is not None:
        x, y, wide, high = (round(scale[0] * value) for value in differs)
        cv2.rectangle(shown, (x, y + 24), (x + wide, y + high + 24), _RED, 2, cv2.LINE_AA)
    _write(shown, title, 4, 16)
    return shown


def draw_box(
    image: UInt8Array,
    intrinsics: Intrinsics,
    camera_from_box: FloatArray,
    half_extent: FloatArray,
    origin_px: tuple[int, int] = (0, 0),
) -> UInt8Array:
    """Draw a posed box with its axes (x red, y green, z blue) over an image.

    Parameters
    ----------
    image : (h, w, 3) uint8 RGB
    intrinsics
        Of the full image, of which pixel ``origin_px`` is the first shown.
    camera_from_box : (4, 4) float, m
    half_extent : (3,) float, m
    """
    shown = image.copy()
    pixels = _project(box_corners(camera_from_box, half_extent), intrinsics, origin_px)
    for a, b in _EDGES:
        _segment(shown, pixels[a], pixels[b], (255, 220, 60))
    tips = np.vstack([np.zeros(3), np.diag(half_extent)])
    axes = _project(
        tips @ camera_from_box[:3, :3].T + camera_from_box[:3, 3], intrinsics, origin_px
    )
    for k, colour in enumerate(_AXIS_COLOURS, start=1):
        _segment(shown, axes[0], axes[k], colour, 2)
    return shown


def draw_model(
    image: UInt8Array,
    intrinsics: Intrinsics,
    camera_from_object: FloatArray,
    cloud: FloatArray,
    origin_px: tuple[int, int] = (0, 0),
) -> UInt8Array:
    """Dot the visible side of a posed model over an image, near light and far dark, with its axes.

    Parameters
    ----------
    image : (h, w, 3) uint8 RGB
    intrinsics, origin_px
        As in :func:`draw_box`.
    camera_from_object : (4, 4) float, m
    cloud : (n, 6) float
        Places (m) and outward normals of the model, in the object's frame.
    """
    shown = image.copy()
    if len(cloud) == 0:
        return shown
    places = cloud[:, :3] @ camera_from_object[:3, :3].T + camera_from_object[:3, 3]
    normals = cloud[:, 3:] @ camera_from_object[:3, :3].T
    places = places[np.einsum("ni,ni->n", places, normals) < 0].astype(np.float64)
    reach = float(np.ptp(cloud[:, :3], axis=0).max()) / 2
    order = np.argsort(-places[:, 2], kind="stable")[:: max(len(places) // _MAX_DOTS, 1)]
    pixels = _project(places[order], intrinsics, origin_px)
    depth = places[order, 2]
    share = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-6) if len(depth) else depth
    for (u, v), far in zip(pixels.tolist(), share.tolist(), strict=True):
        if np.isfinite(u) and np.isfinite(v) and abs(u) < 1e5 and abs(v) < 1e5:
            colour = (int(255 - 90 * far), int(210 - 120 * far), 60)
            cv2.circle(shown, (round(u), round(v)), 1, colour, -1, cv2.LINE_AA)
    tips = np.vstack([np.zeros(3), reach * np.eye(3)])
    axes = _project(
        tips @ camera_from_object[:3, :3].T + camera_from_object[:3, 3], intrinsics, origin_px
    )
    for k, colour in enumerate(_AXIS_COLOURS, start=1):
        _segment(shown, axes[0], axes[k], colour, 2)
    return shown


def box_corners(camera_from_box: FloatArray, half_extent: FloatArray) -> NDArray[np.float64]:
    """Return the corners (8, 3) of a posed box, m."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    corners: NDArray[np.float64] = (
        signs * np.asarray(half_extent) @ camera_from_box[:3, :3].T + camera_from_box[:3, 3]
    )
    return corners


def shade(depth_m: FloatArray, intrinsics: Intrinsics) -> UInt8Array:
    """Return a picture (h, w, 3) of a depth image without colours: surfaces lit from the camera."""
    points = points_from_depth(depth_m, intrinsics)
    if min(depth_m.shape) < 2:
        return np.full((*depth_m.shape, 3), 20, np.uint8)  # no slope, as where depth is missing
    across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normals = np.cross(across, down)
    length = np.linalg.norm(normals, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        facing = np.abs(normals[..., 2]) / length
    grey = np.nan_to_num(40 + 200 * facing, nan=20.0).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def picture_of_cloud(
    points: FloatArray,
    colours: UInt8Array | None,
    labels: NDArray[np.int32],
    size: tuple[int, int] = (640, 480),
) -> tuple[UInt8Array, NDArray[np.int32]]:
    """Return an image (h, w, 3) and a label image (h, w) of a cloud, seen from its origin.

    Parameters
    ----------
    points : (n, 3) float, m, optical frame
    colours : (n, 3) uint8 RGB or None
    labels : (n,) int32
    """
    width, height = size
    image, drawn = np.full((height, width, 3), 20, np.uint8), np.zeros((height, width), np.int32)
    usable = np.isfinite(points).all(axis=1)
    usable &= np.where(usable, points[:, 2], 0) > 1e-3
    rays = points[usable, :2] / points[usable, 2:]
    if len(rays) == 0:
        return image, drawn
    low, high = np.percentile(rays, [0.5, 99.5], axis=0)
    focal = 0.95 * float(min(np.array(size) / np.maximum(high - low, 1e-6)))
    pixels = np.rint((rays - (low + high) / 2) * focal + np.array(size) / 2).astype(int)
    inside = ((pixels >= 0) & (pixels < np.array(size) - 1)).all(axis=1)
    depth = points[usable][inside, 2]
    far_first = np.argsort(-depth, kind="stable")
    numbers = np.flatnonzero(usable)[inside][far_first]
    tone = np.interp(depth, np.percentile(depth, [2, 98]), (230, 60)).astype(np.uint8)[far_first]
    ink = np.repeat(tone[:, None], 3, axis=1) if colours is None else colours[numbers]
    columns, rows = pixels[inside][far_first].T
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        image[rows + dy, columns + dx] = ink
        drawn[rows + dy, columns + dx] = labels[numbers]
    return image, drawn


def _project(
    points: NDArray[np.float64], camera: Intrinsics, origin_px: tuple[int, int]
) -> NDArray[np.float64]:
    z = np.where(points[:, 2] > 1e-3, points[:, 2], np.nan)
    u = camera.fx * points[:, 0] / z + camera.cx - origin_px[0]
    v = camera.fy * points[:, 1] / z + camera.cy - origin_px[1]
    return np.stack([u, v], axis=1)


def _segment(
    image: UInt8Array,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    colour: tuple[int, int, int],
    width: int = 1,
) -> None:
    ends = np.stack([a, b])
    if np.isfinite(ends).all() and np.abs(ends).max() < 1e5:
        first, second = np.rint(ends).astype(int).tolist()
        cv2.line(image, first, second, colour, width, cv2.LINE_AA)


def _write(image: UInt8Array, text: str, x: int, y: int) -> None:
    width = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)[0][0]
    x, y = max(min(int(x), image.shape[1] - width - 2), 2), max(int(y), 12)
    # The outline is the text itself, moved: bolder letters would be wider.
    around = [(u, v) for u in (-1, 0, 1) for v in (-1, 0, 1) if u or v]
    for (u, v), colour in [*((step, (0, 0, 0)) for step in around), ((0, 0), (255, 255, 255))]:
        cv2.putText(
            image, text, (x + u, y + v), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA
        )
