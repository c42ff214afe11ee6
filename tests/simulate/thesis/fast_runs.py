"""Each run of the theses' report in its fast form; a module a thesis, so that they run at once."""

from __future__ import annotations

from simulate.thesis import registry
from simulate.thesis.result import Setting

__all__ = ["fast_run_gives_what_it_promises", "runs_of"]


def runs_of(thesis: str) -> list[str]:
    """Return the names of the runs of a thesis, or of what neither thesis has."""
    return sorted({entry.run for entry in registry.ENTRIES if entry.run and entry.thesis == thesis})


def fast_run_gives_what_it_promises(run: str) -> None:
    """Assert that a run gives figures or pictures, and the thesis's figures where it compares."""
    entry = next(entry for entry in registry.ENTRIES if entry.run == run)
    result = entry.call(Setting(fast=True, seed=0))
    assert result.rows or result.pictures
    if entry.state == "compared":
        assert any(row.theirs is not None for row in result.rows)
