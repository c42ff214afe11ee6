"""Charts as SVG documents: curves over a common axis, and tables of shades.

Matplotlib is imported when the first chart is drawn, and without its global figures.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Figures", "curve_chart", "figure_chart", "heat_map"]

_SIZE_IN = (8.0, 4.8)
_BAR_IN, _LABEL_WIDTH = 0.32, 64
_SPAN_OF_LOG = 50.0
"""Ratio of the largest to the smallest figure from which the axis is logarithmic."""
_NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))


def curve_chart(
    x: ArrayLike,
    curves: Mapping[str, ArrayLike],
    title: str,
    x_label: str,
    y_range: tuple[float, float],
    y_label: str = "",
) -> str:
    """Return curves over a common x as an SVG document.

    Parameters
    ----------
    x : (n,)
    curves : each (n,)
        By name; those whose name ends with an asterisk are dashed.

    Examples
    --------
    >>> svg = curve_chart([0, 1], {"ours": [0.2, 0.9]}, "Quality", "parts", (0, 1))
    >>> svg[:4], ">ours</text>" in svg
    ('<svg', True)
    """
    figure, axes = _figure(title)
    for name, values in curves.items():
        style = "--" if name.endswith("*") else "-"
        axes.plot(np.asarray(x), np.asarray(values), style, label=name.rstrip("*"))
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_ylim(*y_range)
    axes.grid(color="#ddd", linewidth=0.8)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)
    return _svg(figure)


@dataclass(frozen=True)
class Figures:
    """A figure of ours, its interval, and the one that it is compared with.

    Parameters
    ----------
    name
        What is measured.
    ours, interval, theirs
        In the unit of the chart; None where there is none.
    """

    name: str
    ours: float
    interval: tuple[float, float] | None = None
    theirs: float | None = None


def figure_chart(rows: Sequence[Figures], title: str, unit: str) -> str:
    """Return figures below each other as an SVG document: ours with whiskers, theirs as crosses.

    The axis is logarithmic where the figures span more than a factor of 50.

    Examples
    --------
    >>> svg = figure_chart([Figures("recall", 0.9, (0.8, 0.95), 0.85)], "Recall", "")
    >>> ">recall</text>" in svg, ">theirs</text>" in svg
    (True, True)
    """
    figure, axes = _figure(title)
    figure.set_size_inches(_SIZE_IN[0], 1.2 + _BAR_IN * len(rows))
    lines = range(len(rows))
    ours = [row.ours for row in rows]
    edges = [row.interval or (row.ours, row.ours) for row in rows]
    # An interval of another estimator may leave its figure out, which whiskers cannot show.
    whiskers = [
        [max(value - low, 0.0) for value, (low, _) in zip(ours, edges, strict=True)],
        [max(high - value, 0.0) for value, (_, high) in zip(ours, edges, strict=True)],
    ]
    axes.errorbar(ours, lines, xerr=whiskers, fmt="o", color="#0072b2", capsize=3, label="ours")
    theirs = [(row.theirs, line) for line, row in enumerate(rows) if row.theirs is not None]
    if theirs:
        x, y = zip(*theirs, strict=True)
        axes.plot(x, y, "x", color="#d55e00", markersize=8, label="theirs")
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)
    every = [*ours, *(low for low, _ in edges), *(x for x, _ in theirs)]
    if min(every) > 0 and max(every) > _SPAN_OF_LOG * min(every):
        axes.set_xscale("log")
    elif min(every) >= 0:
        axes.set_xlim(left=0)
    axes.set_yticks(lines, [textwrap.fill(row.name, _LABEL_WIDTH) for row in rows], fontsize=7)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel(unit)
    axes.grid(axis="x", color="#ddd", linewidth=0.8)
    return _svg(figure)


def heat_map(
    values: ArrayLike, x: Sequence[float], y: Sequence[float], title: str, labels: tuple[str, str]
) -> str:
    """Return a table of numbers in 0..1 as shaded squares, black = 1 (Kehoe 2014, Fig. 3.23).

    Parameters
    ----------
    values : (rows, columns)
    x, y
        Names of the columns, left to right, and of the rows, from below.
    labels
        Of both axes.
    """
    table = np.asarray(values, dtype=np.float64)
    figure, axes = _figure(title)
    axes.imshow(table, cmap="Greys", vmin=0.0, vmax=1.0, origin="lower", aspect="auto")
    axes.set_xticks(range(len(x)), [f"{number:.3g}" for number in x])
    axes.set_yticks(range(len(y)), [f"{number:.3g}" for number in y])
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    for (row, column), number in np.ndenumerate(table):
        ink = "white" if number > 0.5 else "black"
        axes.text(column, row, f"{number:.2f}", ha="center", va="center", color=ink, fontsize=8)
    return _svg(figure)


def _figure(title: str) -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(_SIZE_IN, layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title, loc="left", fontsize=11)
    return figure, axes


def _svg(figure: Figure) -> str:
    import matplotlib

    file = io.StringIO()
    # Text stays text, and the same chart gives the same bytes.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "grasp"}):
        figure.savefig(file, format="svg", metadata=_NO_METADATA)
    # Without the declarations of a file, so that a page can hold it.
    return file.getvalue()[file.getvalue().index("<svg") :]
