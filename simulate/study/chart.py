"""Charts as PNG files: lines with bands, and groups of bars with whiskers.

Matplotlib is imported when the first chart is drawn, and without its global state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rtask.errors import UsageError
from simulate.study.intervals import wilson

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Bar", "Line", "bar_chart", "line_chart", "share_bar"]

_SIZE_IN, _DPI = (12.4, 5.6), 100
_PALETTE = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442", "#000000",
)  # fmt: skip
"""Okabe and Ito's colours, which colour-blind readers can tell apart."""
_GROUP_WIDTH = 0.8


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


def share_bar(group: str, name: str, hits: int, n: int) -> Bar:
    """Return the bar of a share with its 95 % interval (Wilson 1927).

    >>> share_bar("cup", "held", 3, 4).value
    0.75
    """
    low, high = wilson(hits, n)
    return Bar(group, name, hits / n if n else 0.0, low, high)


def line_chart(path: Path, title: str, x_label: str, y_label: str, lines: Sequence[Line]) -> None:
    """Draw curves with their bands.

    Parameters
    ----------
    path
        PNG file to write.
    lines
        The curves; colours repeat after the eighth.
    """
    figure, axes = _figure(title, y_label)
    axes.set_xlabel(x_label)
    for number, line in enumerate(lines):
        colour = _PALETTE[number % len(_PALETTE)]
        axes.plot(line.x, line.y, color=colour, linewidth=2, label=line.name)
        if line.low is not None and line.high is not None:
            axes.fill_between(line.x, line.low, line.high, color=colour, alpha=0.18, linewidth=0)
    _legend(axes)
    _save(figure, path)


def bar_chart(path: Path, title: str, y_label: str, bars: Sequence[Bar]) -> None:
    """Draw bars with whiskers in groups, one colour for each name.

    Parameters
    ----------
    path
        PNG file to write.
    bars
        The bars, in the order of their groups.
    """
    figure, axes = _figure(title, y_label)
    groups = list(dict.fromkeys(bar.group for bar in bars))
    names = list(dict.fromkeys(bar.name for bar in bars))
    width = _GROUP_WIDTH / max(len(names), 1)
    for number, name in enumerate(names):
        mine = [bar for bar in bars if bar.name == name]
        offset = (number - (len(names) - 1) / 2) * width
        axes.bar(
            [groups.index(bar.group) + offset for bar in mine],
            [bar.value for bar in mine],
            width,
            yerr=[
                [max(bar.value - bar.low, 0.0) for bar in mine],
                [max(bar.high - bar.value, 0.0) for bar in mine],
            ],
            color=_PALETTE[number % len(_PALETTE)],
            label=name,
        )
    axes.set_ylim(bottom=0.0)
    axes.set_xticks(range(len(groups)), groups)
    if len(names) > 1:
        _legend(axes)
    _save(figure, path)


def _figure(title: str, y_label: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_IN, dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title, loc="left")
    axes.set_ylabel(y_label)
    axes.set_axisbelow(True)
    axes.grid(axis="y", color="0.88")
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _legend(axes: Axes) -> None:
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)


def _save(figure: Figure, path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="png")
    except OSError as error:
        raise UsageError(f"{path}: cannot write the chart: {error.strerror}") from error
