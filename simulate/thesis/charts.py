"""Charts of an entry's figures, for entries whose run draws nothing of its own."""

from __future__ import annotations

from collections.abc import Iterable

from grasp.charts import Figures, figure_chart
from simulate.thesis.entry import Entry
from simulate.thesis.result import Result

__all__ = ["pictures_of"]

_MAX_ROWS = 24
"""Figures in one chart; more would not be read."""


def pictures_of(entry: Entry, result: Result) -> dict[str, str | bytes]:
    """Return the pictures of a run, or charts of its figures, one for each unit.

    A single figure without interval or another one beside it is no chart.
    """
    if result.pictures:
        return dict(result.pictures)
    by_unit: dict[str, list[Figures]] = {}
    for row in result.rows:
        if row.ours is not None:
            figures = Figures(row.what, row.ours, row.interval, row.theirs)
            by_unit.setdefault(row.unit, []).append(figures)
    return {
        _caption(unit, number): figure_chart(part, entry.shows, unit or "share or number")
        for unit, rows in by_unit.items()
        if len(rows) > 1 or rows[0].interval is not None or rows[0].theirs is not None
        for number, part in enumerate(_parts(rows))
    }


def _parts(rows: list[Figures]) -> Iterable[list[Figures]]:
    return (rows[first : first + _MAX_ROWS] for first in range(0, len(rows), _MAX_ROWS))


def _caption(unit: str, number: int) -> str:
    words = f"figures in {unit}" if unit else "shares and numbers"
    return f"{words}, {number + 1}" if number else words
