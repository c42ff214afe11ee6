"""Outlines from DXF drawings, parsed by ezdxf (AutoCAD DXF reference).

Only this file imports ezdxf. What it cannot bound is bounded here: the file's size, the number of
entities after blocks are inserted, and the depth of blocks within blocks.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp.arrays import FloatArray
from grasp.push.inputs.curves import Complex, flatten
from grasp.push.inputs.rings import joined

if TYPE_CHECKING:
    from ezdxf.document import Drawing
    from ezdxf.entities.spline import Spline
    from ezdxf.path import Path

__all__ = ["MAX_BYTES", "DxfOutlines", "rings_from_dxf"]

MAX_BYTES = 16 * 1024 * 1024
"""Parsing takes some 40 bytes of memory and 1 us for each byte of the file."""

_MAX_ENTITIES = 100_000
_MAX_INSERTS = 1_000
_MAX_DEPTH = 20
_MAX_DEGREE = 25
_TOLERANCE = 5e-4
_UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 8: "uin", 9: "mil", 13: "um", 14: "dm"}
_SUBCLASSES = {"LWPOLYLINE": "AcDbPolyline", "ELLIPSE": "AcDbEllipse", "SPLINE": "AcDbSpline"}
_COMMON_CODES = frozenset({"5", "330", "67", "8", "6", "62", "48", "60", "370", "420", "440"})
"""Codes of what all entities have, such as their layers; they come before the subclass's own."""

_OUTLINES = frozenset({"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE"})

# What ezdxf corrects or ignores is no news to callers, who see the outline.
logging.getLogger("ezdxf").addHandler(logging.NullHandler())


@dataclass(frozen=True)
class DxfOutlines:
    """Closed outlines of a drawing.

    Parameters
    ----------
    rings : each (n, 2)
        In the drawing's unit.
    unit
        Such as "mm"; "" where the drawing does not state it.
    gap
        Length of the straight line that closes an open outline, in the drawing's unit; 0 when the
        drawing closes its outlines itself.
    hidden
        How many entities were left out because they or their layers are hidden.
    """

    rings: list[FloatArray]
    unit: str = ""
    gap: float = 0.0
    hidden: int = 0


def rings_from_dxf(text: str) -> DxfOutlines:
    """Return the closed outlines of an ASCII DXF drawing.

    Read are closed LWPOLYLINE and POLYLINE with bulges, CIRCLE, closed ELLIPSE and SPLINE, and
    what open ones, LINE and ARC join to end to end; also inside blocks. Open outlines are closed
    by a straight line only when nothing else is closed. Layers that are off or frozen, invisible
    entities and the paper space do not count.

    Raises
    ------
    ValueError
        When it is no ASCII DXF, or an entity is incomplete.
    """
    from ezdxf.filemanagement import read
    from ezdxf.lldxf.const import DXFError

    if len(text) > MAX_BYTES:
        raise ValueError(f"the DXF drawing is larger than {MAX_BYTES // 2**20} MB")
    try:
        document = read(io.StringIO(_with_subclasses(text)))
        visible = _Visible(document)
        curves = [ring for entity in visible if (ring := _polyline(entity))]
    except (DXFError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ValueError(f"no DXF: {' '.join(str(error).split())}") from error
    rings = [line for line, closed in curves if closed and len(line) > 2]
    chains = list(joined([line for line, closed in curves if not closed and len(line) > 1]))
    rings += [chain for chain, closed in chains if closed]
    gap = 0.0
    if not rings:
        rings = [chain for chain, _ in chains if len(chain) > 2]
        gap = max((float(np.hypot(*(chain[0] - chain[-1]))) for chain in rings), default=0.0)
    # ezdxf assumes a unit where the drawing has none.
    unit = _UNITS.get(document.units, "") if "$INSUNITS" in text else ""
    return DxfOutlines(rings, unit, gap, visible.hidden)


def _with_subclasses(text: str) -> str:
    """Add the version and the subclass markers that plain writers omit and ezdxf requires."""
    rows = [row.strip() for row in text.splitlines()]
    if "AcDb" in text or not _SUBCLASSES.keys() & set(rows):
        return text
    version = ["0", "SECTION", "2", "HEADER", "9", "$ACADVER", "1", "AC1015", "0", "ENDSEC"]
    out = [] if "$ACADVER" in text else version
    subclass = ""
    for code, value in zip(rows[::2], rows[1::2], strict=False):
        if subclass and code not in _COMMON_CODES:
            out += ["100", subclass]
            subclass = ""
        out += [code, value]
        if code == "0" and value in _SUBCLASSES:
            out += ["100", "AcDbEntity"]
            subclass = _SUBCLASSES[value]
    return "\n".join([*out, ""]).replace("\nAC1009\n", "\nAC1015\n", 1)


class _Visible:
    """Entities of a drawing's model space that can be seen, blocks resolved."""

    def __init__(self, document: Drawing) -> None:
        self._document = document
        self._off, self._frozen = set[str](), set[str]()
        for layer in document.layers:
            name = layer.dxf.name.casefold()
            self._off.update([name] if layer.is_off() else [])
            self._frozen.update([name] if layer.is_frozen() else [])
        self._seen = self._inserted = 0
        self.hidden = 0

    def __iter__(self) -> Iterator[Any]:
        return self._of(self._document.modelspace(), "0", 0)

    def _of(self, entities: Iterable[Any], block_layer: str, depth: int) -> Iterator[Any]:
        if depth > _MAX_DEPTH:
            raise ValueError(f"blocks are nested more than {_MAX_DEPTH} deep, or in a circle")
        for entity in entities:
            self._seen += 1
            if self._seen > _MAX_ENTITIES:
                raise ValueError(f"more than {_MAX_ENTITIES} entities, counted in every block")
            # Layer 0 inside a block is the layer on which the block was inserted.
            layer = entity.dxf.get("layer", "0").casefold()
            layer = block_layer if layer == "0" and depth else layer
            if entity.dxf.get("invisible", 0) or layer in self._frozen:
                self.hidden += 1
            elif entity.dxftype() == "INSERT":
                # What a block draws on layers of its own is seen although the insert's is off.
                self._inserted += entity.mcount
                if self._inserted > _MAX_INSERTS:
                    raise ValueError(f"blocks are inserted more than {_MAX_INSERTS} times")
                for copy in entity.multi_insert() if entity.mcount > 1 else (entity,):
                    yield from self._of(copy.virtual_entities(), layer, depth + 1)
            elif entity.dxftype() not in _OUTLINES:
                continue
            elif layer in self._off:
                self.hidden += 1
            else:
                yield entity


def _polyline(entity: Any) -> tuple[FloatArray, bool] | None:
    """Return an entity's points (n, 2) and whether they close; None for meshes."""
    from ezdxf.path import make_path

    kind = entity.dxftype()
    if kind == "SPLINE":
        return _spline(entity)
    if kind in ("CIRCLE", "ARC") and not entity.dxf.hasattr("radius"):
        raise ValueError(f"{kind} without a radius")
    if kind == "POLYLINE":
        if entity.is_polygon_mesh or entity.is_poly_face_mesh:
            return None
        # Control points of a fitted curve (flag 16) are not on it.
        entity.vertices[:] = [v for v in entity.vertices if not v.dxf.get("flags", 0) & 16]
    path = make_path(entity)
    points = _flattened(path, kind)
    closed = kind == "CIRCLE" or (kind != "LINE" and path.is_closed)
    if kind in ("LWPOLYLINE", "POLYLINE"):
        closed = bool(entity.is_closed)
    return points, closed


def _flattened(path: Path, kind: str) -> FloatArray:
    around = _plane(path.control_vertices(), kind)
    extent = float(np.ptp(around, axis=0).max()) if len(around) else 0.0
    if extent == 0.0:
        return around[:1]
    return _plane(path.flattening(_TOLERANCE * extent), kind)


def _plane(points: Iterable[Any], kind: str) -> FloatArray:
    """Return points seen from above, (n, 2), repeated neighbours left out."""
    flat = np.array([(p.x, p.y) for p in points], dtype=np.float64).reshape(-1, 2)
    if not np.isfinite(flat).all():
        raise ValueError(f"a coordinate of a {kind} is no finite number")
    differs = np.any(np.diff(flat, axis=0) != 0, axis=1)
    return flat[np.concatenate([[True], differs])] if len(flat) else flat


def _spline(entity: Spline) -> tuple[FloatArray, bool]:
    """Return a B-spline, rational where it has weights; one through fit points without knots.

    ezdxf's own evaluation leaves the domain of splines whose knots are not clamped.
    """
    from scipy.interpolate import BSpline, make_interp_spline

    controls = np.array([(p[0], p[1]) for p in entity.control_points]).reshape(-1, 2)
    degree, knots = int(entity.dxf.degree), np.array(entity.knots, dtype=np.float64)
    if len(controls) == 0:
        fit = np.array([(p[0], p[1]) for p in entity.fit_points]).reshape(-1, 2)
        if len(fit) < 2:
            raise ValueError("SPLINE without points")
        steps = np.hypot(*np.diff(fit, axis=0).T)
        if np.any(steps == 0):
            raise ValueError("SPLINE with repeated fit points")
        places = np.concatenate([[0.0], np.cumsum(steps)])
        spline = make_interp_spline(places, fit, k=min(3, len(fit) - 1))
        low, high, spans = 0.0, float(places[-1]), len(fit)
    else:
        fits = len(knots) == len(controls) + degree + 1 and not np.any(np.diff(knots) < 0)
        if not (1 <= degree <= _MAX_DEGREE and fits):
            raise ValueError("SPLINE whose knots do not fit its control points")
        given = np.array(entity.weights, dtype=np.float64)
        weights = given if len(given) == len(controls) else np.ones(len(controls))
        spline = BSpline(knots, np.column_stack([controls * weights[:, None], weights]), degree)
        low, high, spans = float(knots[degree]), float(knots[-degree - 1]), len(controls)

    def at(t: FloatArray) -> Complex:
        p = np.asarray(spline(low + t * (high - low)))
        if p.shape[1] == 3:
            p = p[:, :2] / p[:, 2:]
        return np.asarray(p[:, 0] + 1j * p[:, 1])

    ends = at(np.array([0.0, 1.0]))
    if not np.isfinite(ends).all():
        raise ValueError("a coordinate of a SPLINE is no finite number")
    meets = abs(ends[1] - ends[0]) <= 1e-9 * (1.0 + abs(ends[0]))
    (points,) = flatten([[(at, max(4, 2 * spans))]])
    return points, bool(entity.closed) or bool(meets)
