"""Curves of drawings as chords.

A curve is a function of a parameter array in 0..1 that returns points as complex numbers, x + iy.
A piece is a curve and into how many chords it is cut before its straightness is looked at.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray

__all__ = [
    "Complex",
    "Curve",
    "Piece",
    "bezier",
    "ellipse_arc",
    "flatten",
    "line",
    "moved_by",
]

Complex = NDArray[np.complex128]
Curve = Callable[[FloatArray], Complex]
Piece = tuple[Curve, int]

_MAX_CHORDS = 1024
_TOLERANCE = 5e-4


def line(start: complex, end: complex) -> Piece:
    """Return a straight piece."""
    return (lambda t: start + t * (end - start)), 1


def bezier(controls: Sequence[complex]) -> Piece:
    """Return a Bezier curve of any degree (de Casteljau).

    >>> bezier([0, 1j, 1])[0](np.array([0.5])).tolist()
    [(0.25+0.5j)]
    """
    points = list(controls)

    def at(t: FloatArray) -> Complex:
        level = [np.full(len(t), p, np.complex128) for p in points]
        while len(level) > 1:
            level = [p + t * (q - p) for p, q in itertools.pairwise(level)]
        return level[0]

    return at, 4


def ellipse_arc(
    centre: complex, major: complex, minor: complex, first: float, sweep: float
) -> Piece:
    """Return part of an ellipse: centre + major cos a + minor sin a, a from ``first``, rad."""

    def at(t: FloatArray) -> Complex:
        a = first + sweep * t
        return np.asarray(centre + major * np.cos(a) + minor * np.sin(a))

    return at, max(2, math.ceil(8 * abs(sweep) / math.pi))


def moved_by(curve: Curve, frame: FloatArray) -> Curve:
    """Return a curve moved by an affine map (3, 3)."""
    (a, c, e), (b, d, f) = frame[:2]

    def at(t: FloatArray) -> Complex:
        p = curve(t)
        return np.asarray(a * p.real + c * p.imag + e + 1j * (b * p.real + d * p.imag + f))

    return at


def flatten(rings: Sequence[Sequence[Piece]]) -> list[FloatArray]:
    """Return the polylines (n, 2) of pieces that follow one another, repeated points left out.

    No curve is farther from its chords than .05 % of its polyline's extent.
    """
    out = []
    for pieces in rings:
        extent = float(np.ptp(_chords(pieces, math.inf), axis=0).max()) if pieces else 0.0
        out.append(_chords(pieces, _TOLERANCE * extent))
    return out


def _chords(pieces: Sequence[Piece], tolerance: float) -> FloatArray:
    points = [np.zeros(0, np.complex128)]
    for curve, chords in pieces:
        count, straight = chords, chords == 1
        places = curve(np.linspace(0.0, 1.0, count + 1))
        while not straight and count < _MAX_CHORDS:
            finer = curve(np.linspace(0.0, 1.0, 2 * count + 1))
            off = np.abs(finer[1::2] - (finer[:-1:2] + finer[2::2]) / 2)
            straight = bool(off.max() <= tolerance)
            if not straight:
                places, count = finer, 2 * count
        points.append(places)
    joined = np.concatenate(points)
    apart = np.concatenate([[True], np.diff(joined) != 0]) if len(joined) else np.zeros(0, bool)
    corners = joined[apart]
    return np.column_stack([corners.real, corners.imag])
