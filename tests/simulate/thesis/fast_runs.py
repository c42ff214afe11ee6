"""Each run of the theses' report in its fast form; a module a thesis, so that they run at once."""

from __future__ import annotations

import pytest

from simulate.thesis import registry
from simulate.thesis.result import Setting

__all__ = ["fast_run_gives_what_it_promises", "runs_of"]


_DEEP = 4
"""One run of so many is a deep test; the others have the night."""


def runs_of(thesis: str) -> list[object]:
    """Return the names of the runs of a thesis, or of what neither thesis has, with their marks."""
    runs = {entry.run for entry in registry.ENTRIES if entry.run and entry.thesis == thesis}
    return [
        pytest.param(run, marks=() if number % _DEEP == 0 else pytest.mark.night)
        for number, run in enumerate(sorted(runs))
    ]


def fast_run_gives_what_it_promises(run: str) -> None:
    """Assert that a run gives figures or pictures, and the thesis's figures where it compares."""
    entry = next(entry for entry in registry.ENTRIES if entry.run == run)
    result = entry.call(Setting(fast=True, seed=0))
    assert result.rows or result.pictures
    if entry.state == "compared":
        assert any(row.theirs is not None for row in result.rows)
