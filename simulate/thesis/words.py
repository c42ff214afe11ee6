"""Figures and verdicts as words, the same in terminal, page and Markdown."""

from __future__ import annotations

from simulate.thesis.result import Compared

__all__ = ["VERDICTS", "cells", "number"]

VERDICTS = {
    "reproduced": "our interval holds the thesis's figure, or both agree within the tolerance",
    "better": "ours is better by more than that",
    "worse": "ours is worse by more than that",
    "different": "they differ, and neither way is better",
    "too few to tell": "our interval holds the thesis's figure, and nearly any other",
    "not compared": "the thesis gives no figure",
    "failed": "the run broke",
    "done differently": "no run: ours is another thing, and it says which",
    "not applicable": "no run, and it says why",
}
"""What each verdict says."""


def number(value: float | None) -> str:
    """Return a figure with three significant digits.

    >>> [number(v) for v in (None, 0.0012345, 12.0, 1592.0, 0.5)]
    ['-', '0.00123', '12', '1592', '0.5']
    """
    if value is None:
        return "-"
    if value == int(value) and abs(value) < 1e6:
        return str(int(value))
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def cells(row: Compared) -> tuple[str, str, str, str]:
    """Return what is measured, ours with its interval, the thesis's, and the verdict."""
    unit = f" {row.unit}" if row.unit else ""
    ours = number(row.ours) + (unit if row.ours is not None else "")
    if row.interval is not None and row.ours is not None:
        ours += f" [{number(row.interval[0])}, {number(row.interval[1])}]"
    theirs = number(row.theirs) + (unit if row.theirs is not None else "")
    return row.what, ours, theirs, row.verdict
