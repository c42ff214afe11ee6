"""Outlines from ASCII DXF drawings (AutoCAD DXF reference)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from grasp.push.inputs.curves import Complex, Piece, arc, ellipse_arc, flatten, line, moved_by
from grasp.push.inputs.rings import joined
from grasp.push.polygon import FloatArray

__all__ = ["rings_from_dxf"]

_UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 8: "uin", 9: "mil", 13: "um", 14: "dm"}
_MOST_BLOCKS = 1000

Tags = list[tuple[int, str]]


@dataclass
class _Entity:
    name: str
    tags: Tags
    vertices: list[_Entity] = field(default_factory=list)

    def number(self, code: int, otherwise: float | None = None) -> float:
        for found, value in self.tags:
            if found == code:
                return _finite(value)
        if otherwise is None:
            raise ValueError(f"{self.name} without code {code}")
        return otherwise

    def all(self, code: int) -> list[float]:
        return [_finite(value) for found, value in self.tags if found == code]

    def text(self, code: int) -> str:
        return next((value for found, value in self.tags if found == code), "")


def _finite(value: str) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value} is no finite number")
    return number


def rings_from_dxf(text: str, tolerance: float | None = None) -> tuple[list[FloatArray], str]:
    """Return the closed outlines (n, 2) of an ASCII DXF drawing and its unit, "" when unstated.

    Closed LWPOLYLINE and POLYLINE with bulges, CIRCLE, closed ELLIPSE and SPLINE, and what open
    ones, LINE and ARC join to end to end; also inside blocks. Open outlines are closed by a
    straight line only when nothing else is closed.

    Parameters
    ----------
    tolerance
        Of curves, in the drawing's unit; by default .05 % of each entity's extent.

    Raises
    ------
    ValueError
        When it is no ASCII DXF, or an entity lacks a number.
    """
    lines = [row.strip() for row in text.splitlines()]
    if len(lines) < 4 or lines[0].startswith("AutoCAD Binary"):
        raise ValueError("no ASCII DXF")
    try:
        tags = [(int(code), value) for code, value in zip(lines[::2], lines[1::2], strict=False)]
        drawing = _Drawing(tags)
        pieces = list(drawing.pieces(drawing.entities, np.eye(3), 0))
    except ValueError as error:
        raise ValueError(f"no DXF: {error}") from error
    outlines = flatten([p for p, _ in pieces], tolerance)
    rings = [r for r, (_, closed) in zip(outlines, pieces, strict=True) if closed and len(r) > 2]
    chains = list(joined([r for r, (_, closed) in zip(outlines, pieces, strict=True)
                          if not closed and len(r) > 1]))  # fmt: skip
    rings += [chain for chain, closed in chains if closed]
    if not rings:
        rings = [chain for chain, _ in chains if len(chain) > 2]
    return rings, drawing.unit


class _Drawing:
    """Entities, blocks and unit of a drawing."""

    def __init__(self, tags: Tags) -> None:
        self.entities: list[_Entity] = []
        self.unit = ""
        self._blocks: dict[str, tuple[_Entity, list[_Entity]]] = {}
        section, block = "", ""
        for entity in _entities(tags):
            if entity.name == "SECTION":
                section = entity.text(2)
                if section == "HEADER":
                    self.unit = _header_unit(entity.tags)
            elif section == "ENTITIES":
                self.entities.append(entity)
            elif section == "BLOCKS" and entity.name == "BLOCK":
                block = entity.text(2)
                self._blocks[block] = (entity, [])
            elif section == "BLOCKS" and block:
                self._blocks[block][1].append(entity)
        self._inserted = 0

    def pieces(
        self, entities: list[_Entity], frame: FloatArray, depth: int
    ) -> Iterator[tuple[list[Piece], bool]]:
        """Yield curves of entities, moved by ``frame`` (3, 3), and whether each is closed."""
        for entity in entities:
            if entity.name == "INSERT":
                yield from self._insert(entity, frame, depth)
                continue
            found = _curves(entity)
            if found is not None:
                pieces, closed = found
                here = frame @ _object_frame(entity)
                yield [(moved_by(curve, here), chords) for curve, chords in pieces], closed

    def _insert(
        self, entity: _Entity, frame: FloatArray, depth: int
    ) -> Iterator[tuple[list[Piece], bool]]:
        name = entity.text(2)
        if name not in self._blocks:
            return
        self._inserted += 1
        if depth > 20 or self._inserted > _MOST_BLOCKS:
            raise ValueError("blocks are inserted too often or in a circle")
        block, inside = self._blocks[name]
        angle = math.radians(entity.number(50, 0.0))
        sx, sy = entity.number(41, 1.0), entity.number(42, 1.0)
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        linear = turn @ np.diag([sx, sy])
        at = np.array([entity.number(10), entity.number(20)])
        base = np.array([block.number(10, 0.0), block.number(20, 0.0)])
        here = np.eye(3)
        here[:2] = np.column_stack([linear, at - linear @ base])
        yield from self.pieces(inside, frame @ _object_frame(entity) @ here, depth + 1)


def _object_frame(entity: _Entity) -> FloatArray:
    """Return the frame of an entity (3, 3): drawn from below, x is mirrored (OCS, code 230)."""
    flat = entity.name not in ("LINE", "ELLIPSE", "SPLINE")
    return np.diag([-1.0 if flat and entity.number(230, 1.0) < 0 else 1.0, 1.0, 1.0])


def _entities(tags: Tags) -> Iterator[_Entity]:
    """Yield entities; the vertices of a POLYLINE belong to it."""
    current: _Entity | None = None
    poly: _Entity | None = None
    for code, value in [*tags, (0, "EOF")]:
        if code != 0:
            if current is not None:
                current.tags.append((code, value))
            continue
        if current is not None:
            if current.name == "VERTEX" and poly is not None:
                poly.vertices.append(current)
            elif current.name == "SEQEND" and poly is not None:
                yield poly
                poly = None
            elif current.name == "POLYLINE":
                poly = current
            else:
                yield current
        current = _Entity(value, [])


def _header_unit(tags: Tags) -> str:
    for (_, name), (_, value) in itertools.pairwise(tags):
        if name == "$INSUNITS":
            return _UNITS.get(int(value), "")
    return ""


def _curves(entity: _Entity) -> tuple[list[Piece], bool] | None:
    """Return the pieces of an entity and whether they close; None for what is no outline."""
    name = entity.name
    if name in ("LWPOLYLINE", "POLYLINE"):
        return _polyline(entity)
    if name == "LINE":
        ends = [complex(entity.number(10), entity.number(20)),
                complex(entity.number(11), entity.number(21))]  # fmt: skip
        return [line(*ends)], False
    if name in ("CIRCLE", "ARC"):
        centre, radius = complex(entity.number(10), entity.number(20)), entity.number(40)
        if name == "CIRCLE":
            return [ellipse_arc(centre, radius, 1j * radius, 0.0, 2 * math.pi)], True
        low, high = math.radians(entity.number(50)), math.radians(entity.number(51))
        sweep = (high - low) % (2 * math.pi) or 2 * math.pi
        return [ellipse_arc(centre, radius, 1j * radius, low, sweep)], False
    if name == "ELLIPSE":
        centre = complex(entity.number(10), entity.number(20))
        major = complex(entity.number(11), entity.number(21))
        minor = 1j * major * entity.number(40) * math.copysign(1.0, entity.number(230, 1.0))
        low, high = entity.number(41, 0.0), entity.number(42, 2 * math.pi)
        sweep = (high - low) % (2 * math.pi) or 2 * math.pi
        return [ellipse_arc(centre, major, minor, low, sweep)], abs(sweep - 2 * math.pi) < 1e-6
    if name == "SPLINE":
        return _spline(entity)
    return None


def _polyline(entity: _Entity) -> tuple[list[Piece], bool] | None:
    corners: list[list[float]] = []
    if entity.name == "POLYLINE":
        # 16 and 64 are meshes; control points of a fitted curve (16 of a vertex) are not on it.
        if int(entity.number(70, 0.0)) & (16 | 64):
            return None
        corners = [
            [v.number(10), v.number(20), v.number(42, 0.0)]
            for v in entity.vertices
            if not int(v.number(70, 0.0)) & 16
        ]
    else:
        for code, value in entity.tags:
            if code == 10:
                corners.append([_finite(value), 0.0, 0.0])
            elif code in (20, 42) and corners:
                corners[-1][1 if code == 20 else 2] = _finite(value)
    points = [(complex(x, y), bulge) for x, y, bulge in corners]
    closed = bool(int(entity.number(70, 0.0)) & 1)
    after = [*points[1:], *(points[:1] if closed else [])]
    return [arc(a, b, bulge) for (a, bulge), (b, _) in zip(points, after, strict=False)], closed


def _spline(entity: _Entity) -> tuple[list[Piece], bool] | None:
    """Return a B-spline, rational where it has weights; one through fit points without knots."""
    from scipy.interpolate import BSpline, make_interp_spline

    xs, ys = entity.all(10), entity.all(20)
    controls = np.array(list(zip(xs, ys, strict=False))).reshape(-1, 2)
    degree, knots = int(entity.number(71, 3.0)), np.array(entity.all(40))
    closed = bool(int(entity.number(70, 0.0)) & 1)
    if len(controls) == 0:
        fit = np.column_stack([entity.all(11), entity.all(21)])
        if len(fit) < 2:
            raise ValueError("SPLINE without points")
        steps = np.hypot(*np.diff(fit, axis=0).T)
        if np.any(steps == 0):
            raise ValueError("SPLINE with repeated fit points")
        places = np.concatenate([[0.0], np.cumsum(steps)])
        spline = make_interp_spline(places, fit, k=min(3, len(fit) - 1))
        low, high, spans = 0.0, float(places[-1]), len(fit)
    else:
        if degree < 1 or len(knots) != len(controls) + degree + 1 or np.any(np.diff(knots) < 0):
            raise ValueError("SPLINE whose knots do not fit its control points")
        given = entity.all(41)
        weights = np.array(given if len(given) == len(controls) else np.ones(len(controls)))
        spline = BSpline(knots, np.column_stack([controls * weights[:, None], weights]), degree)
        low, high, spans = float(knots[degree]), float(knots[-degree - 1]), len(controls)

    def at(t: FloatArray) -> Complex:
        p = np.asarray(spline(low + t * (high - low)))
        if p.shape[1] == 3:
            p = p[:, :2] / p[:, 2:]
        return np.asarray(p[:, 0] + 1j * p[:, 1])

    ends = at(np.array([0.0, 1.0]))
    meets = abs(ends[1] - ends[0]) <= 1e-9 * (1.0 + abs(ends[0]))
    return [(at, max(4, 2 * spans))], closed or bool(meets)
