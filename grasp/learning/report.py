"""A comparison as tables and curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from grasp.charts import curve_chart
from grasp.learning.comparison import Result
from grasp.learning.metrics import Life, Measure, attempts, bootstrap, difference, first_try, regret

__all__ = ["curves_svg", "table", "text"]

DRAWS = 1000
_COLUMNS = ("attempts", "first_try", "first_third", "last_third", "last_third_first_try", "unseen")
_THESIS = ("quadrants", "TEXPLORE")
_OURS = ("candidates", "default, good and graph")


def table(results: Sequence[Result], draws: int = DRAWS) -> list[dict[str, Any]]:
    """Return one row a contender, JSON-able.

    Returns
    -------
    Of each column the value, its 95 % interval and the earlier measurement: attempts to the first
    success over all objects, share of first tries that held, attempts at the first and the last
    third of the objects, first tries at the last third, attempts at families never met.
    """
    rows = []
    for result in results:
        third = max(len(result.lives[0].objects) // 3, 1)
        first = [life.part(slice(0, third)) for life in result.lives]
        last = [life.part(slice(-third, None)) for life in result.lives]
        measured = (
            bootstrap(result.lives, attempts, draws),
            bootstrap(result.lives, first_try, draws),
            bootstrap(first, attempts, draws),
            bootstrap(last, attempts, draws),
            bootstrap(last, first_try, draws),
            bootstrap(result.unseen, attempts, draws) if result.unseen else None,
        )
        reference = (*result.row.reference, *(None,) * len(_COLUMNS))
        rows.append(
            {
                "name": result.row.name,
                "group": result.row.group,
                "regret": float(np.mean([regret(life)[-1] for life in result.lives])),
                **{
                    column: None if here is None else _cell(here, there)
                    for column, here, there in zip(_COLUMNS, measured, reference, strict=False)
                },
            }
        )
    return rows


def _cell(here: Measure, there: float | None) -> dict[str, Any]:
    return {"value": here.value, "low": here.low, "high": here.high, "earlier": there}


def text(results: Sequence[Result], draws: int = DRAWS) -> list[str]:
    """Return the comparison in lines: ours / measured earlier, the interval, and the regret."""
    lines = []
    group = ""
    for row in table(results, draws):
        if row["group"] != group:
            group = row["group"]
            lines.append(f"{group:32s}  attempts    95 %           first try   first third "
                         "last third  first try   unseen       regret")  # fmt: skip
        cells = [_shown(row[column]) for column in _COLUMNS]
        interval = f"{row['attempts']['low']:.2f} to {row['attempts']['high']:.2f}"
        lines.append(
            f"{row['name']:32s}  {cells[0]:11s} {interval:14s} "
            f"{'  '.join(f'{cell:10s}' for cell in cells[1:])}  {row['regret']:6.1f}"
        )
    return lines + _side_by_side(results, draws)


def _shown(cell: dict[str, Any] | None) -> str:
    if cell is None:
        return "-"
    earlier = "" if cell["earlier"] is None else f" / {cell['earlier']:.2f}"
    return f"{cell['value']:.2f}{earlier}"


def _side_by_side(results: Sequence[Result], draws: int) -> list[str]:
    """Return the thesis's learner beside the default one."""
    by_name = {(result.row.group, result.row.name): result.lives for result in results}
    thesis, ours = by_name.get(_THESIS), by_name.get(_OURS)
    if thesis is None or ours is None:
        return []
    return [
        "",
        f"{'thesis / default':32s}  {'thesis':22s} {'default':22s} {'less, or more':24s} ratio",
        _pair("attempts to the first success", thesis, ours, draws, "attempts"),
        _pair("first tries that held", thesis, ours, draws, "first try"),
    ]


def _pair(name: str, thesis: Sequence[Life], ours: Sequence[Life], draws: int, what: str) -> str:
    measure = attempts if what == "attempts" else first_try
    a, b = bootstrap(thesis, measure, draws), bootstrap(ours, measure, draws)
    apart = difference(ours, thesis, measure, draws)
    ratio = a.value / b.value if what == "attempts" else b.value / a.value
    return f"{name:32s}  {a!s:22s} {b!s:22s} {apart!s:24s} {ratio:.1f}"


def curves_svg(results: Sequence[Result], window: int = 12) -> str:
    """Return attempts to the first success over the objects met, as a running mean, as SVG."""
    curves = {}
    for result in results:
        mean = np.mean([life.attempts for life in result.lives], axis=0)
        width = min(window, len(mean))
        curves[f"{result.row.group[0].upper()}: {result.row.name}"] = np.convolve(
            mean, np.ones(width) / width, mode="valid"
        )
    met = np.arange(len(next(iter(curves.values())))) + min(window, len(mean))
    # A learner that always succeeds at once still needs an axis.
    top = max(2.0, *(float(curve.max()) for curve in curves.values()))
    return curve_chart(met, curves, "Attempts to the first success", "objects met", (1.0, top))
