"""Report of the arm's push grasps: shares with intervals, beside what the thesis had."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import share
from simulate.study.pushes.picture import draw_pushes
from simulate.study.pushes.plug import PUBLISHED, chosen
from simulate.study.pushes.trial import planned

__all__ = ["COLUMNS", "push_rows", "push_study", "summarise_pushes"]

COLUMNS = (
    "grasp", "thesis Q*", "closed", "ours Q*", "plug held", "and flat", "printed held", "and flat",
    "95 % interval",
)  # fmt: skip


def push_study(trials: int, prints: int, seed: int, preset: str, com: float | None = None) -> Study:
    """Return the study: of each grasp ``trials`` with the plug and ``prints`` printed parts.

    Parameters
    ----------
    com
        Where the plug's centre of mass truly is; see :func:`simulate.study.pushes.plug.plug`.
    """
    settings: dict[str, Any] = {
        "seed": seed, "preset": preset, "trials": trials, "prints": prints,
        **({} if com is None else {"com": com}),
    }  # fmt: skip
    return Study("push grasps of Object M", "simulate.study.pushes.trial:push_trial", settings,
                 len(PUBLISHED) * (trials + prints), _describe)  # fmt: skip


def summarise_pushes(results: Results, seed: int, preset: str) -> dict[str, Any]:
    """Return the figures as JSON data.

    ``quality`` is the lower bound on the probability of force closure that was planned, on which
    the printed parts check: it is drawn from the same distribution, with an exact hand.
    """
    plan, _, jaw, stroke = planned(seed, preset)
    analysis = plan.analysis
    grasps = []
    for which, (index, published) in enumerate(
        zip(chosen(plan, jaw, stroke), PUBLISHED, strict=True)
    ):
        mine = [r for r in results if r["grasp"] == which]
        entry: dict[str, Any] = {
            "thesis": {"quality": published[0] / 100, "closed": published[1], "of": 5},
            "quality": round(float(analysis.quality[index]), 4),
            "lower_95": round(float(analysis.lower_95[index]), 4),
            "contact_m": np.round(plan.grasps.contacts[index], 4).tolist(),
            "angle_deg": round(float(np.degrees(plan.grasps.angles[index])), 1),
        }
        for name, made in (("plug", False), ("printed", True)):
            some = [r for r in mine if r["printed"] is made]
            entry[name] = {
                "held": share(sum(r["held"] for r in some), len(some)),
                "flat": share(sum(r["held"] and r["flat"] for r in some), len(some)),
                "reasons": dict(Counter(r["reason"] for r in some).most_common()),
            }
        grasps.append(entry)
    return {
        "part": {"vertices": len(plan.part.vertices), "radius_m": round(plan.part.radius, 4)},
        "candidates": len(plan.grasps),
        "grasps": grasps,
    }


def push_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    rows: list[tuple[str, ...]] = []
    for number, grasp in enumerate(summary["grasps"], 1):
        thesis, plug, made = grasp["thesis"], grasp["plug"], grasp["printed"]
        low, high = made["flat"]["interval95"]
        rows.append((
            str(number), f"{100 * thesis['quality']:.1f}", f"{thesis['closed']} of {thesis['of']}",
            f"{100 * grasp['quality']:.1f}", _count(plug["held"]), _count(plug["flat"]),
            _count(made["held"]), _count(made["flat"]), f"{low:.2f} to {high:.2f}",
        ))  # fmt: skip
    return rows


def _count(count: Mapping[str, Any]) -> str:
    return f"{count['hits']} of {count['n']}"


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    seed, preset = int(settings["seed"]), str(settings["preset"])
    summary = {"seed": seed, **summarise_pushes(results, seed, preset)}
    draw_pushes(folder / "grasps.png", seed, preset)
    return Report(
        summary,
        [Table("Push grasps of Object M, carried out", COLUMNS, push_rows(summary))],
        more={"results": list(results)},
        pictures=["grasps.png"],
    )
