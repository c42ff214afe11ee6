"""Outlines from ASCII DXF drawings."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from grasp.push.polygon import FloatArray
from grasp.push.svg import largest_ring

__all__ = ["outline_from_dxf"]

_CURVE_STEPS = 16


def outline_from_dxf(text: str) -> FloatArray:
    """Return the largest closed outline of an ASCII DXF drawing.

    LWPOLYLINE and POLYLINE with their bulges (arcs), CIRCLE, and LINE and ARC joined at their ends.
    """
    lines = [line.strip() for line in text.splitlines()]
    if len(lines) < 4 or lines[0].startswith("AutoCAD Binary"):
        raise ValueError("no ASCII DXF")
    try:
        tags = [(int(code), value) for code, value in zip(lines[::2], lines[1::2], strict=False)]
        return largest_ring(list(_dxf_rings(tags)), "DXF")
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
