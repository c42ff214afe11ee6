"""Outlines from SVG documents (SVG 2, chapters 9 and 10)."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np

from grasp.push.polygon import FloatArray

__all__ = ["largest_ring", "outline_from_svg"]

_CURVE_STEPS = 16


def largest_ring(rings: list[FloatArray], what: str) -> FloatArray:
    """Return the ring that encloses most."""
    rings = [r for r in rings if len(r) >= 3]
    if not rings:
        raise ValueError(f"no closed outline in this {what}")

    def enclosed(ring: FloatArray) -> float:
        x, y = ring.T
        return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))

    return max(rings, key=enclosed)


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
    ring = largest_ring(rings, "SVG")
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
