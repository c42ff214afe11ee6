"""Report of a run with generated hands: the factory's promises that it would make."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simulate.study.declaration import Report, Results, Table
from simulate.study.quality.promise_fit import fit_promises, tried_grasps

__all__ = ["describe_fit"]


def describe_fit(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    """Return the fitted maps, and how much hands differ from them."""
    try:
        fitted = fit_promises(tried_grasps(results))
    except ValueError as error:
        return Report({"seed": settings["seed"]}, lines=[f"nothing was fitted: {error}"])
    fits = {score: fit.to_json() for score, fit in fitted.items()}
    columns = ("number", *fits)
    rows = [(name, *(f"{fit[name]:.3f}" for fit in fits.values())) for name in fits["lift"]]
    figures = {"seed": settings["seed"], "fits": fits}
    table = Table("Promises fitted over generated hands", columns, rows)
    return Report(figures, [table], more={"results": list(results)})
