"""Report of a run with generated hands: the factory's promises that it would make."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simulate.study.declaration import Report, Results, Table
from simulate.study.quality.promise_fit import fit_promises, tried_grasps
from simulate.study.quality.ranks import OUTCOMES

__all__ = ["describe_fit"]


def describe_fit(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    """Return the fitted maps, and how much hands differ from them."""
    fits = {}
    for outcome, score in OUTCOMES.items():
        try:
            fits[score] = fit_promises(tried_grasps(results, outcome, score)).to_json()
        except ValueError as error:
            return Report({"seed": settings["seed"]}, lines=[f"nothing was fitted: {error}"])
    columns = ("number", *fits)
    rows = [(name, *(f"{fit[name]:.3f}" for fit in fits.values())) for name in fits["lift"]]
    figures = {"seed": settings["seed"], "fits": fits}
    table = Table("Promises fitted over generated hands", columns, rows)
    return Report(figures, [table], more={"results": list(results)})
