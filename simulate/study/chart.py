"""Charts as PNG: lines with bands, bars with whiskers. Drawn with OpenCV, which is there anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError

__all__ = ["Bar", "Line", "bar_chart", "line_chart"]

_WIDTH, _HEIGHT = 1240, 560
_LEFT, _RIGHT, _TOP, _BOTTOM = 90, 310, 60, 70
_INK, _GRID = (60, 60, 60), (225, 225, 225)
# Okabe and Ito's palette, told apart by colour-blind people too; BGR.
_COLOURS = (
    (178, 114, 0), (0, 94, 213), (115, 158, 0), (167, 121, 204), (0, 159, 230), (233, 180, 86),
    (66, 228, 240), (0, 0, 0),
)  # fmt: skip
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_STEPS = (1.0, 2.0, 5.0, 10.0)
_MOST_TICKS = 6

Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Line:
    """A curve: x (n,), y (n,), and optionally the lower and upper edge of its band (n,)."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    low: Sequence[float] | None = None
    high: Sequence[float] | None = None


@dataclass(frozen=True)
class Bar:
    """A value with its interval; bars of one group stand together."""

    group: str
    name: str
    value: float
    low: float
    high: float


class _Axes:
    """Where values lie in the picture."""

    def __init__(self, title: str, y_label: str, y: tuple[float, float]) -> None:
        self.image: Image = np.full((_HEIGHT, _WIDTH, 3), 255, np.uint8)
        self.y0, self.y1 = y
        _write(self.image, title, (_LEFT, 32), 0.7)
        _write(self.image, y_label, (_LEFT, 52), 0.45)
        for value in _ticks(self.y0, self.y1):
            row = self.row(value)
            cv2.line(self.image, (_LEFT, row), (_WIDTH - _RIGHT, row), _GRID, 1)
            _write(self.image, f"{value:g}", (_LEFT - 50, row + 5), 0.45)
        base = self.row(self.y0)
        cv2.line(self.image, (_LEFT, base), (_WIDTH - _RIGHT, base), _INK, 1)

    def row(self, value: float) -> int:
        share = (value - self.y0) / (self.y1 - self.y0)
        return round(_HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM))

    def legend(self, names: Sequence[str]) -> None:
        for k, name in enumerate(names):
            at = (_WIDTH - _RIGHT + 25, _TOP + 12 + 22 * k)
            cv2.rectangle(self.image, (at[0], at[1] - 8), (at[0] + 14, at[1] + 2), _colour(k), -1)
            _write(self.image, name, (at[0] + 22, at[1] + 3), 0.45)

    def save(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not cv2.imwrite(str(path), self.image):
            raise UsageError(f"cannot write the picture {path}")


def line_chart(path: Path, title: str, x_label: str, y_label: str, lines: Sequence[Line]) -> None:
    """Draw curves with their bands.

    Parameters
    ----------
    path
        PNG to write.
    lines
        At most eight.
    """
    every = [v for line in lines for side in (line.y, line.low, line.high) if side for v in side]
    xs = [v for line in lines for v in line.x]
    axes = _Axes(title, y_label, _range(every))
    x0, x1 = min(xs), max(max(xs), min(xs) + 1e-9)

    def at(x: float, y: float) -> tuple[int, int]:
        share = (x - x0) / (x1 - x0)
        return round(_LEFT + share * (_WIDTH - _LEFT - _RIGHT)), axes.row(y)

    for k, line in enumerate(lines):
        if line.low and line.high:
            edge = [at(x, y) for x, y in zip(line.x, line.low, strict=True)]
            back = [at(x, y) for x, y in zip(line.x, line.high, strict=True)][::-1]
            veil = axes.image.copy()
            cv2.fillPoly(veil, [np.array(edge + back, np.int32)], _colour(k), cv2.LINE_AA)
            axes.image = np.asarray(cv2.addWeighted(veil, 0.18, axes.image, 0.82, 0), np.uint8)
        points = np.array([at(x, y) for x, y in zip(line.x, line.y, strict=True)], np.int32)
        cv2.polylines(axes.image, [points], False, _colour(k), 2, cv2.LINE_AA)
    for value in _ticks(x0, x1):
        _write(axes.image, f"{value:g}", (at(value, axes.y0)[0] - 8, _HEIGHT - 45), 0.45)
    _write(axes.image, x_label, ((_LEFT + _WIDTH - _RIGHT) // 2 - 60, _HEIGHT - 18), 0.5)
    axes.legend([line.name for line in lines])
    axes.save(path)


def bar_chart(path: Path, title: str, y_label: str, bars: Sequence[Bar]) -> None:
    """Draw bars with whiskers, grouped; one colour a name."""
    groups = list(dict.fromkeys(bar.group for bar in bars))
    names = list(dict.fromkeys(bar.name for bar in bars))
    axes = _Axes(title, y_label, (0.0, _range([0.0, *(bar.high for bar in bars)])[1]))
    room = (_WIDTH - _LEFT - _RIGHT) / len(groups)
    width = 0.8 * room / len(names)
    for bar in bars:
        k, start = names.index(bar.name), _LEFT + groups.index(bar.group) * room + 0.1 * room
        left, right = round(start + k * width), round(start + (k + 1) * width) - 2
        top, base = axes.row(bar.value), axes.row(0.0)
        cv2.rectangle(axes.image, (left, top), (right, base), _colour(k), -1)
        middle = (left + right) // 2
        cv2.line(axes.image, (middle, axes.row(bar.low)), (middle, axes.row(bar.high)), _INK, 2)
    for g, group in enumerate(groups):
        _write(axes.image, group, (round(_LEFT + (g + 0.15) * room), _HEIGHT - 45), 0.45)
    if len(names) > 1:
        axes.legend(names)
    axes.save(path)


def _colour(k: int) -> tuple[int, int, int]:
    return _COLOURS[k % len(_COLOURS)]


def _ticks(low: float, high: float) -> list[float]:
    """Return round numbers between two values, at most seven.

    >>> _ticks(0.0, 1.08)
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    """
    raw = (high - low) / _MOST_TICKS
    scale = 10.0 ** np.floor(np.log10(raw))
    step = next(s * scale for s in _STEPS if s * scale >= raw * (1 - 1e-9))
    first = int(np.ceil(low / step - 1e-9))
    last = int(np.floor(high / step + 1e-9))
    return [round(float(k * step), 10) for k in range(first, last + 1)]


def _range(values: Sequence[float]) -> tuple[float, float]:
    finite = [v for v in values if np.isfinite(v)]
    low, high = min(finite, default=0.0), max(finite, default=1.0)
    spare = 0.08 * (high - low) or 0.5
    return (0.0 if 0 <= low < 0.4 * high else low - spare), high + spare


def _write(image: Image, text: str, at: tuple[int, int], size: float) -> None:
    cv2.putText(image, text, at, _FONT, size, _INK, 1, cv2.LINE_AA)
