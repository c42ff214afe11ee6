"""Figures and verdicts as words, the same in terminal, page and Markdown."""

from __future__ import annotations

from collections.abc import Iterable

from simulate.thesis.entry import Entry
from simulate.thesis.result import Compared
from simulate.thesis.running import Outcome, machine

__all__ = [
    "COLUMNS", "VERDICTS", "cells", "distinct", "machine_words", "number", "tolerances",
    "worse_rows",
]  # fmt: skip

COLUMNS = ("what", "ours [95 %]", "thesis", "verdict", "measured on")
"""Of :func:`cells`."""

VERDICTS = {
    "reproduced": "our interval holds the thesis's figure, or both agree within the tolerance",
    "better": "ours is better by more than that",
    "worse": "ours is worse by more than that",
    "different": "they differ, and neither way is better",
    "too few to tell": "our interval holds the thesis's figure, and nearly any other",
    "not compared": "the thesis gives no figure",
    "failed": "the run broke",
    "built": "no run: it does what the thesis tells in words, and the entry says where",
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


def cells(row: Compared, outcome: Outcome) -> tuple[str, ...]:
    """Return the columns of a row; the last names stand-ins, and sizes that are smaller."""
    unit = f" {row.unit}" if row.unit else ""
    ours = number(row.ours) + (unit if row.ours is not None else "")
    if row.interval is not None and row.ours is not None:
        ours += f" [{number(row.interval[0])}, {number(row.interval[1])}]"
    theirs = number(row.theirs) + (unit if row.theirs is not None else "")
    return row.what, ours, theirs, row.verdict, _measured_on(outcome)


def _measured_on(outcome: Outcome) -> str:
    result = outcome.result
    assert result is not None  # it has rows
    parts = (result.stand_in or outcome.entry.stand_in, "smaller" if result.is_smaller else "")
    return ", ".join(part for part in parts if part) or "-"


def machine_words() -> str:
    """Return what times depend on: processor, cores, load now, Python."""
    here = machine()
    return (
        f"{here['cores']} cores of {here['processor']}, load {here['load']}, "
        f"Python {here['python']}"
    )


def tolerances(rows: Iterable[Compared]) -> list[str]:
    """Return a sentence for each tolerance that rows were judged by, and its reason."""
    return [
        f"{row.what}: tolerance {number(row.tolerance)}: {row.reason}"
        for row in rows
        if row.tolerance
    ]


def distinct(outcomes: Iterable[Outcome]) -> list[Outcome]:
    """Return the first outcome of each run: several entries may show one."""
    first: dict[str, Outcome] = {}
    for outcome in outcomes:
        if outcome.result is not None:
            first.setdefault(outcome.entry.run, outcome)
    return list(first.values())


def worse_rows(outcomes: Iterable[Outcome]) -> list[tuple[Entry, Compared]]:
    """Return every figure that is worse than the thesis's."""
    return [
        (outcome.entry, row)
        for outcome in distinct(outcomes)
        for row in (outcome.result.rows if outcome.result else ())
        if row.verdict == "worse"
    ]
