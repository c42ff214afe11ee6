"""Curves of outlines: runs of short turns, drawn smoothly whatever their number of vertices.

A curve reaches the planner as a polygon, more or less fine. Its facets are no flat sides: on them
a round end, which in truth rolls off the jaw, would stand. Between the vertices of a curve the
outline is therefore drawn as arcs once the vertices have been perturbed. Arcs turn by at most
`STEP_DEG` at a vertex, so that what a grasp is worth does not depend on how finely its curve was
given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from grasp.arrays import FloatArray, IntArray

__all__ = ["MAX_TURN_DEG", "STEP_DEG", "Curves", "facets"]

MAX_TURN_DEG = 30.0
"""Largest turn at a vertex of a curve: 13 vertices make a circle, a bevelled corner is no curve."""

STEP_DEG = 2.0
"""Turn at a vertex of a curve as it is drawn."""

_MIN_TURN_RAD, _MIN_CURVE_RAD = 1e-6, math.radians(15.0)
_LONG = 3.0
"""A side this much longer than one beside it is straight: chords of a curve grow by degrees."""


@dataclass(frozen=True)
class Curves:
    """The curves of an outline, and how finely they are drawn.

    Parameters
    ----------
    pieces : (n,) int
        Chords that are drawn for the edge from each vertex; 1 where it is straight.
    drawn_vertices, drawn_facets : (m,) bool
        Vertices of curves, and edges that are facets, in the outline as it is drawn.
    """

    pieces: IntArray
    drawn_vertices: NDArray[np.bool_]
    drawn_facets: NDArray[np.bool_]

    @classmethod
    def of(cls, ring: FloatArray) -> Curves:
        """Find the curves of a counter-clockwise outline (n, 2)."""
        edges = facets(ring)
        vertices = edges | np.roll(edges, 1)
        turns = _turns(ring)
        swept = np.degrees(turns + np.roll(turns, -1)) / 2
        fine = np.maximum(np.ceil(swept / STEP_DEG - 1e-9), 1).astype(np.int64)
        pieces = np.where(edges, fine, 1)
        drawn = np.ones(int(pieces.sum()), np.bool_)
        drawn[np.cumsum(pieces) - pieces] = vertices
        return cls(pieces, drawn, np.repeat(edges, pieces))

    @classmethod
    def none(cls, count: int) -> Curves:
        """Return those of an outline of ``count`` vertices that has none."""
        straight = np.zeros(count, np.bool_)
        return cls(np.ones(count, np.int64), straight, straight)

    def drawn(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return outlines (k, n) with their curves drawn, (k, m) each."""
        x, y = np.ascontiguousarray(x), np.ascontiguousarray(y)
        if len(self.drawn_vertices) == len(self.pieces):
            return x, y
        out = np.empty((2, len(x), len(self.drawn_vertices)))
        _draw(x, y, self.pieces, out[0], out[1])
        return out[0], out[1]


def facets(ring: FloatArray) -> NDArray[np.bool_]:
    """Return which edges of a counter-clockwise outline (n, 2) stand for convex curves, (n,).

    The edge from each vertex to the next: its ends turn left by less than `MAX_TURN_DEG`, it is not
    much longer than the edges beside it, and together with those that follow it turns by 15 degrees
    or more.

    >>> angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    >>> bool(facets(np.column_stack([np.cos(angle), np.sin(angle)])).all())
    True
    >>> bool(facets(np.array([(0.0, 0), (1, 0), (2, 0), (2, 1), (0, 1)])).any())
    False
    """
    turns = _turns(ring)
    gentle = (turns > _MIN_TURN_RAD) & (turns < math.radians(MAX_TURN_DEG))
    lengths = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    beside = np.minimum(np.roll(lengths, 1), np.roll(lengths, -1))
    is_curved = gentle & np.roll(gentle, -1) & (lengths <= _LONG * beside)
    if is_curved.all() or not is_curved.any():
        return np.asarray(is_curved)
    # From an edge that is no facet, so that no curve is cut by the end of the array.
    start = int(np.argmin(is_curved))
    is_curved, turns = np.roll(is_curved, -start), np.roll(turns, -start)
    bounds = np.flatnonzero(np.diff(np.append(is_curved, False).astype(np.int8))) + 1
    for first, last in bounds.reshape(-1, 2):
        swept = float(np.take(turns, range(first, last + 1), mode="wrap").sum())
        is_curved[first:last] = swept >= _MIN_CURVE_RAD
    return np.asarray(np.roll(is_curved, start))


def _turns(ring: FloatArray) -> FloatArray:
    """Return by how much the boundary turns left at each vertex, (n,) rad."""
    after = np.roll(ring, -1, axis=0) - ring
    before = np.roll(after, 1, axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(np.arctan2(cross, (before * after).sum(axis=1)))


@njit(cache=True, nogil=True)
def _draw(x, y, pieces, out_x, out_y):  # type: ignore[no-untyped-def]
    """Write outlines (k, n) with the facets of curves as arcs of so many chords.

    Along a circle the tangent at a vertex shares out its turn between the two chords by their
    lengths. Where a curve ends, the arc is as symmetric as the turn there allows. Between its ends
    an arc bulges from its chord by the cubic that has the tangents' slopes.
    """
    outlines, n = x.shape
    lengths, before, after = np.empty(n), np.empty(n), np.empty(n)
    for k in range(outlines):
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            lengths[i] = math.hypot(x[k, j] - x[k, i], y[k, j] - y[k, i])
        for i in range(n):
            # Angles from the chord before i to the tangent there, and from it to the chord after.
            h, j = (i - 1 if i > 0 else n - 1), (i + 1 if i + 1 < n else 0)
            ax, ay = x[k, i] - x[k, h], y[k, i] - y[k, h]
            bx, by = x[k, j] - x[k, i], y[k, j] - y[k, i]
            turn = min(max(math.atan2(ax * by - ay * bx, ax * bx + ay * by), 0.0), 1.0)
            share = lengths[i] / max(lengths[h] + lengths[i], 1e-300)
            after[i] = turn * share if pieces[h] > 1 else turn
            before[i] = turn - turn * share if pieces[i] > 1 else turn
        at = 0
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            out_x[k, at], out_y[k, at] = x[k, i], y[k, i]
            at += 1
            if pieces[i] == 1:
                continue
            first, last = after[i], before[j]
            if pieces[i - 1 if i > 0 else n - 1] == 1:
                first = min(first, last)
            if pieces[j] == 1:
                last = min(first, last)
            dx, dy = x[k, j] - x[k, i], y[k, j] - y[k, i]
            first, last = math.tan(first), math.tan(last)
            for part in range(1, pieces[i]):
                t = part / pieces[i]
                bulge = first * t * (1 - t) ** 2 + last * t * t * (1 - t)
                out_x[k, at] = x[k, i] + t * dx + bulge * dy
                out_y[k, at] = y[k, i] + t * dy - bulge * dx
                at += 1
