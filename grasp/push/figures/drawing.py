"""A plain writer of SVG drawings: a frame in the data's unit, and shapes added to it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["Canvas"]


class Canvas:
    """A drawing of ``width`` px that shows a box of the plane, y upwards.

    Parameters
    ----------
    low, high : (2,)
        Corners of the box.

    Examples
    --------
    >>> canvas = Canvas((0, 0), (2, 1), width=200, margin=0)
    >>> canvas.dot((1, 0.5), "red")
    >>> 'cx="100.0" cy="50.0"' in canvas.svg()
    True
    """

    def __init__(
        self, low: ArrayLike, high: ArrayLike, width: int = 640, margin: int = 24,
        height: int | None = None, title: str = "",
    ) -> None:  # fmt: skip
        self._low = np.asarray(low, dtype=np.float64)
        span = np.maximum(np.asarray(high, dtype=np.float64) - self._low, 1e-12)
        inner = width - 2 * margin
        if height is None:
            self._scale = np.full(2, inner / span[0])
            height = round(inner * span[1] / span[0]) + 2 * margin
        else:
            self._scale = np.array([inner, height - 2 * margin]) / span
        self._size = (width, height)
        self._margin = margin
        self._parts: list[str] = []
        if title:
            self._parts.append(_text(margin, margin * 0.7, title, "start", 13))

    def _px(self, points: ArrayLike) -> list[tuple[float, float]]:
        at = (np.atleast_2d(np.asarray(points, np.float64)) - self._low) * self._scale
        return [(self._margin + x, self._size[1] - self._margin - y) for x, y in at]

    def polygon(self, ring: ArrayLike, stroke: str = "#222", fill: str = "none",
                width: float = 1.5, opacity: float = 1.0) -> None:  # fmt: skip
        """Add a closed outline."""
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in self._px(ring))
        self._parts.append(
            f'<polygon points="{points}" fill="{fill}" stroke="{stroke}" '
            f'stroke-width="{width}" opacity="{opacity}"/>'
        )

    def part(self, ring: ArrayLike, holes: Sequence[ArrayLike] = (), fill: str = "#eee") -> None:
        """Add a part: its outline (n, 2), and its holes (m, 2) as white within it."""
        self.polygon(ring, "#222", fill, 2)
        for hole in holes:
            self.polygon(hole, "#222", "white", 1)

    def line(self, points: ArrayLike, stroke: str = "#222", width: float = 1.5,
             dash: str = "") -> None:  # fmt: skip
        """Add an open line."""
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in self._px(points))
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self._parts.append(
            f'<polyline points="{text}" fill="none" stroke="{stroke}" '
            f'stroke-width="{width}"{dashed}/>'
        )

    def dot(self, point: ArrayLike, fill: str = "#222", radius_px: float = 2.5) -> None:
        """Add a dot of a size in pixels."""
        for x, y in self._px(point):
            self._parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius_px}" fill="{fill}"/>')

    def ring(self, point: ArrayLike, radius: float, stroke: str = "#d62728") -> None:
        """Add a circle of a radius in the data's unit."""
        (x, y) = self._px(point)[0]
        size = radius * float(self._scale[0])
        self._parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}" fill="none" stroke="{stroke}"/>'
        )

    def text(self, point: ArrayLike, words: str, anchor: str = "middle", size: int = 11,
             fill: str = "#222") -> None:  # fmt: skip
        """Add words at a point."""
        (x, y) = self._px(point)[0]
        self._parts.append(_text(x, y, words, anchor, size, fill))

    def key(self, entries: Mapping[str, str], unit: str = "") -> None:
        """Explain colours below the drawing, after a bar of a round length in the data's unit."""
        length = _round_length(0.25 * self._size[0] / float(self._scale[0]))
        bar = length * float(self._scale[0])
        x, y = self._margin, self._size[1] + 4
        self._parts.append(
            f'<path d="M{x},{y - 4}v8M{x},{y}h{bar:.1f}m0,-4v8" stroke="#222" fill="none"/>'
        )
        words = f"{length:g} {unit}" if unit else f"{length:g}, unit of the part"
        self._parts.append(_text(x + bar + 6, y + 4, words, "start", 11))
        for k, (words, colour) in enumerate(entries.items()):
            below = y + 18 * (k + 1)
            self._parts.append(
                f'<rect x="{x}" y="{below - 5}" width="14" height="10" fill="{colour}"/>'
            )
            self._parts.append(_text(x + 20, below + 4, words, "start", 11))
        self._size = (self._size[0], y + 18 * len(entries) + 20)

    def svg(self) -> str:
        """Return the document."""
        width, height = self._size
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
            f'viewBox="0 0 {width} {height}">\n'
            f'<rect width="{width}" height="{height}" fill="white"/>\n'
            + "\n".join(self._parts)
            + "\n</svg>\n"
        )


def _round_length(about: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most ``about``.

    >>> _round_length(0.37), _round_length(6.0)
    (0.2, 5.0)
    """
    ten = 10.0 ** math.floor(math.log10(about))
    return next(step * ten for step in (5.0, 2.0, 1.0) if step * ten <= about * (1 + 1e-9))


def _text(x: float, y: float, words: str, anchor: str, size: int, fill: str = "#222") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-family="sans-serif" font-size="{size}" '
        f'text-anchor="{anchor}" fill="{fill}">{escape(words)}</text>'
    )
