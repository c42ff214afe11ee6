"""How fast learners learn: attempts to first success, first tries, first half against second."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulate.study.chart import Line, line_chart
from simulate.study.intervals import mean_interval
from simulate.study.learners import FAILED, LEARNERS, Learner, replay
from simulate.study.reasons import UNREACHABLE

__all__ = ["COLUMNS", "learning_rows", "summarise_learning", "write_learning_report"]

COLUMNS = ("grasps", "learner", "attempts", "first try", "first half", "second half", "difference")
_WINDOW = 10

Results = Sequence[Mapping[str, Any]]


def summarise_learning(
    results: Results, seeds: Sequence[int], learners: Sequence[Learner] = LEARNERS
) -> tuple[dict[str, Any], dict[str, NDArray[np.float64]]]:
    """Replay the learners; return the figures, and the mean attempts by place in the order.

    Learners with one source meet the objects that have a grasp of it within the arm's reach.
    """
    figures: list[dict[str, Any]] = []
    curves: dict[str, NDArray[np.float64]] = {}
    for learner in learners:
        objects = [
            r for r in results
            if any(a["source"] == learner.source and a["reason"] != UNREACHABLE for a in r["arms"])
        ]  # fmt: skip
        order, attempts = replay(objects, learner, seeds)
        figures.append({"learner": learner.name, "grasps": learner.source,
                        "objects": len(objects), **_figures(order, attempts)})  # fmt: skip
        curves[f"{learner.source}: {learner.name}"] = attempts.mean(axis=0)
    return {"seeds": len(seeds), "learners": figures, "grasps": _base_rates(results)}, curves


def _base_rates(results: Results) -> dict[str, Any]:
    """Return how often a grasp of each source holds, whoever chooses."""
    rates = {}
    for source in ("geometry", "blind"):
        arms = [a for r in results for a in r["arms"] if a["source"] == source]
        tried = [a["reason"] == "ok" for a in arms if a["reason"] != UNREACHABLE]
        rates[source] = {"drawn": len(arms), "tried": len(tried), "held": sum(tried)}
    return rates


def _figures(order: NDArray[np.intp], attempts: NDArray[np.int64]) -> dict[str, Any]:
    """Return means over all meetings; the change has its interval over seeds and objects."""
    seeds, n = attempts.shape
    late = np.broadcast_to(np.arange(n) >= n // 2, attempts.shape)
    by_object = np.empty((seeds, n))
    is_late = np.empty((seeds, n), bool)
    for row in range(seeds):
        by_object[row, order[row]] = attempts[row]
        is_late[row, order[row]] = late[row]
    change = _late_less_early(by_object, is_late)
    low, high = _over_seeds_and_objects(by_object, is_late)
    return {
        "attempts": mean_interval(by_object.mean(axis=0)),
        "first_try": mean_interval((by_object == 1).mean(axis=0)),
        "never_held": float((attempts >= FAILED).mean()),
        "first_half": float(attempts[~late].mean()) if n > 1 else None,
        "second_half": float(attempts[late].mean()),
        "second_less_first": {
            "mean": None if np.isnan(change) else round(change, 4),
            "interval95": [round(low, 4), round(high, 4)],
        },
    }


def _late_less_early(attempts: NDArray[np.float64], is_late: NDArray[np.bool_]) -> float:
    """Return the mean over the second half less that over the first; NaN when one is empty."""
    if is_late.all() or not is_late.any():
        return float("nan")
    return float(attempts[is_late].mean() - attempts[~is_late].mean())


def _over_seeds_and_objects(
    attempts: NDArray[np.float64], is_late: NDArray[np.bool_], draws: int = 1000
) -> tuple[float, float]:
    """Return the 95 % interval, resampling rows and columns at once (Owen 2007: pigeonhole)."""
    rng = np.random.default_rng(0)
    seeds, n = attempts.shape
    values = []
    for _ in range(draws):
        picked = np.ix_(rng.integers(0, seeds, seeds), rng.integers(0, n, n))
        values.append(_late_less_early(attempts[picked], is_late[picked]))
    low, high = np.nanpercentile(values, [2.5, 97.5]) if n > 1 else (np.nan, np.nan)
    return float(low), float(high)


def learning_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    return [
        (
            str(found["grasps"]),
            str(found["learner"]),
            _show(found["attempts"]),
            _show(found["first_try"]),
            "-" if found["first_half"] is None else f"{found['first_half']:.2f}",
            f"{found['second_half']:.2f}",
            _show(found["second_less_first"]),
        )
        for found in summary["learners"]
    ]


def _show(mean: Mapping[str, Any]) -> str:
    if mean["mean"] is None:
        return "-"
    low, high = mean["interval95"]
    return f"{mean['mean']:.2f} [{low:.2f}, {high:.2f}]"


def write_learning_report(folder: Path, results: Results, seed: int, seeds: int) -> dict[str, Any]:
    """Write ``report.json`` and a chart for each kind of grasps; return the figures."""
    figures, curves = summarise_learning(results, [seed + k for k in range(seeds)])
    summary = {"seed": seed, "objects": len(results), **figures}
    (folder / "report.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
    for source in ("geometry", "blind"):
        lines = [
            _line(name.partition(": ")[2], curve)
            for name, curve in curves.items()
            if name.startswith(source) and len(curve) >= _WINDOW
        ]
        if lines:
            line_chart(
                folder / f"{source}.png", f"Grasps by {source}", "objects met",
                f"attempts to first success, mean of {seeds} orders", lines,
            )  # fmt: skip
    return summary


def _line(name: str, curve: NDArray[np.float64]) -> Line:
    smooth = np.convolve(curve, np.ones(_WINDOW) / _WINDOW, mode="valid")
    return Line(name, (np.arange(len(smooth)) + _WINDOW).tolist(), smooth.tolist())
