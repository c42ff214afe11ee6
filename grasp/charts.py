"""Charts as SVG documents: curves over a common axis, and tables of shades.

Matplotlib is imported when the first chart is drawn, and without its global figures.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["curve_chart", "heat_map"]

_SIZE_IN = (8.0, 4.8)
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
