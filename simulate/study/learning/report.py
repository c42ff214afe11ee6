"""Report of the learners: attempts to first success, first tries, first half against second."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.env import MAX_ATTEMPTS
from simulate.grasping.record import is_counted
from simulate.study.chart import Line, line_chart
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import mean_interval
from simulate.study.learning.learners import FAILED, LEARNERS, Learner, replay

__all__ = [
    "COLUMNS",
    "learning_rows",
    "outcome_study",
    "summarise_learning",
]

COLUMNS = ("grasps", "learner", "attempts", "first try", "first half", "second half", "difference")
_WINDOW = 10


def outcome_study(
    objects: int,
    seed: int,
    proposed: int = 3,
    blind: int = 6,
    preset: str = "faithful",
    orders: int = 20,
) -> Study:
    """Return the study of the outcomes of proposed and blind grasps of each object.

    If none of a source holds, more are tried, up to a learner's maximum number of attempts. In the
    report, learners meet the objects in a number of ``orders``.
    """
    return Study(
        "outcomes of proposed and blind grasps",
        "simulate.study.learning.outcomes:outcome_trial",
        {
            "seed": seed,
            "proposed": proposed,
            "blind": blind,
            "most": MAX_ATTEMPTS,
            "preset": preset,
        },
        objects,
        partial(_describe, orders),
    )


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
            if any(a["source"] == learner.source and is_counted(a["reason"]) for a in r["arms"])
        ]  # fmt: skip
        order, attempts = replay(objects, learner, seeds)
        figures.append({"learner": learner.name, "grasps": learner.source,
                        "objects": len(objects), **_figures(order, attempts),
                        "by_kind_seen": _by_kind_seen(objects, order, attempts)})  # fmt: skip
        curves[f"{learner.source}: {learner.name}"] = attempts.mean(axis=0)
    return {"seeds": len(seeds), "learners": figures, "grasps": _base_rates(results)}, curves


def _base_rates(results: Results) -> dict[str, Any]:
    """Return how often the grasps of each source hold, independent of the learner."""
    rates = {}
    for source in ("geometry", "blind"):
        arms = [a for r in results for a in r["arms"] if a["source"] == source]
        tried = [a["reason"] == "ok" for a in arms if is_counted(a["reason"])]
        rates[source] = {"drawn": len(arms), "tried": len(tried), "held": sum(tried)}
    return rates


def _figures(order: NDArray[np.intp], attempts: NDArray[np.int64]) -> dict[str, Any]:
    """Return means over all encounters; the change has its interval over orders and objects."""
    by_object, is_late = _by_object(order, attempts)
    early, late = attempts[~_is_late_place(attempts)], attempts[_is_late_place(attempts)]
    return {
        "attempts": mean_interval(by_object.mean(axis=0)),
        "first_try": mean_interval((by_object == 1).mean(axis=0)),
        "never_held": float((attempts >= FAILED).mean()),
        "first_half": float(early.mean()) if len(early) else None,
        "second_half": float(late.mean()),
        "second_less_first": _change(by_object, is_late),
    }


def _change(attempts: NDArray[np.float64], is_late: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the extra attempts of objects that come late; None without any for both halves."""
    change = _late_less_early(attempts, is_late)
    if np.isnan(change):
        return {"mean": None, "interval95": None}
    low, high = _over_orders_and_objects(attempts, is_late)
    return {"mean": round(change, 4), "interval95": [round(low, 4), round(high, 4)]}


def _by_object(
    order: NDArray[np.intp], attempts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return attempts by order and object, and whether the object came in the second half."""
    by_object = np.empty(attempts.shape)
    is_late = np.empty(attempts.shape, bool)
    np.put_along_axis(by_object, order, attempts, axis=1)
    np.put_along_axis(is_late, order, _is_late_place(attempts), axis=1)
    return by_object, is_late


def _is_late_place(attempts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which positions of the orders, (s, n), are in the second half."""
    n = attempts.shape[1]
    return np.broadcast_to(np.arange(n) >= n // 2, attempts.shape)


def _late_less_early(attempts: NDArray[np.float64], is_late: NDArray[np.bool_]) -> float:
    """Return the mean difference between an object's attempts when it comes late and early.

    The comparison is made object by object, so that a hard one that came late more often does not
    bias it. Objects that never came early, or never late, are ignored; NaN without any.
    """
    lates, n = is_late.sum(axis=0), len(is_late)
    both = (lates > 0) & (lates < n)
    if not both.any():
        return float("nan")
    late = (attempts * is_late).sum(axis=0)[both] / lates[both]
    early = (attempts * ~is_late).sum(axis=0)[both] / (n - lates[both])
    return float((late - early).mean())


def _over_orders_and_objects(
    attempts: NDArray[np.float64], is_late: NDArray[np.bool_], draws: int = 1000
) -> tuple[float, float]:
    """Return the 95 % interval, resampling orders and objects at once (Owen 2007: pigeonhole).

    Orders are drawn by pairs, as they were made: an object comes late in one order of a pair.
    """
    rng = np.random.default_rng(0)
    orders, n = attempts.shape
    pairs = [np.arange(k, min(k + 2, orders)) for k in range(0, orders, 2)]
    values = []
    for _ in range(draws):
        drawn = np.concatenate([pairs[k] for k in rng.integers(0, len(pairs), len(pairs))])
        picked = np.ix_(drawn, rng.integers(0, n, n))
        values.append(_late_less_early(attempts[picked], is_late[picked]))
    low, high = np.nanpercentile(values, [2.5, 97.5])
    return float(low), float(high)


def _by_kind_seen(
    objects: Results, order: NDArray[np.intp], attempts: NDArray[np.int64], draws: int = 500
) -> list[dict[str, Any]]:
    """Return the share of first tries that held, by the number of the kind seen before.

    Each object is measured against its own mean, so that whether a hard one came early in few
    orders counts little. Intervals are over orders and objects at once, as those of the change.
    """
    kinds = np.unique([str(product["kind"]) for product in objects], return_inverse=True)[1]
    met = kinds[order]
    seen = np.empty(met.shape, np.intp)
    for kind in range(kinds.max() + 1):
        here = met == kind
        seen[here] = (np.cumsum(here, axis=1) - 1)[here]
    by_object, before = np.empty(met.shape), np.empty(met.shape, np.intp)
    np.put_along_axis(by_object, order, (attempts == 1).astype(float), axis=1)
    np.put_along_axis(before, order, seen, axis=1)
    most = int(np.bincount(kinds).min())
    where = np.stack([before == k for k in range(most)]).astype(float)
    held = where * by_object
    orders, n = met.shape

    def shares(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
        usual = rows @ by_object / rows.sum()
        with np.errstate(invalid="ignore"):
            above = ((rows @ held - (rows @ where) * usual) @ columns) / (rows @ where @ columns)
        return np.asarray(usual @ columns / columns.sum() + above)

    rng = np.random.default_rng(0)
    drawn = [
        shares(
            *(np.bincount(rng.integers(0, m, m), minlength=m).astype(float) for m in (orders, n))
        )
        for _ in range(draws)
    ]
    low, high = np.nanpercentile(drawn, [2.5, 97.5], axis=0)
    value = shares(np.ones(orders), np.ones(n))
    return [
        {
            "seen": k,
            "first_try": round(float(value[k]), 4),
            "interval95": [round(float(low[k]), 4), round(float(high[k]), 4)],
        }
        for k in range(most)
    ]


def learning_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    return [
        (
            str(figures["grasps"]),
            str(figures["learner"]),
            _show(figures["attempts"]),
            _show(figures["first_try"]),
            "-" if figures["first_half"] is None else f"{figures['first_half']:.2f}",
            f"{figures['second_half']:.2f}",
            _show(figures["second_less_first"]),
        )
        for figures in summary["learners"]
    ]


def _show(mean: Mapping[str, Any]) -> str:
    if mean["mean"] is None:
        return "-"
    low, high = mean["interval95"]
    return f"{mean['mean']:.2f} [{low:.2f}, {high:.2f}]"


def _describe(orders: int, results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    seed = int(settings["seed"])
    figures, curves = summarise_learning(results, [seed + k for k in range(orders)])
    summary = {"seed": seed, "objects": len(results), **figures}
    pictures = []
    for source, title in (("geometry", "Grasps proposed by geometry"), ("blind", "Blind grasps")):
        lines = [
            _line(name.partition(": ")[2], curve)
            for name, curve in curves.items()
            if name.startswith(source) and len(curve) >= _WINDOW
        ]
        if lines:
            pictures.append(f"{source}.png")
            line_chart(
                folder / pictures[-1], title, "objects met",
                f"attempts to first success, mean of {orders} orders", lines,
            )  # fmt: skip
        kinds = [
            _kind_line(learner) for learner in summary["learners"]
            if learner["grasps"] == source and len(learner["by_kind_seen"]) > 1
        ]  # fmt: skip
        if kinds:
            pictures.append(f"{source}-kinds.png")
            line_chart(
                folder / pictures[-1], title,
                "objects of the kind met before", "first tries that held", kinds,
            )  # fmt: skip
    return Report(
        summary,
        [Table("Attempts to first success", COLUMNS, learning_rows(summary))],
        [f"grasps that hold, over all choices: {json.dumps(summary['grasps'])}"],
        pictures=pictures,
    )


def _line(name: str, curve: NDArray[np.float64]) -> Line:
    smooth = np.convolve(curve, np.ones(_WINDOW) / _WINDOW, mode="valid")
    return Line(name, (np.arange(len(smooth)) + _WINDOW).tolist(), smooth.tolist())


def _kind_line(figures: Mapping[str, Any]) -> Line:
    """Return first tries by objects of the kind met before; with a band where it is the bandit."""
    points = figures["by_kind_seen"]
    is_ours = str(figures["learner"]).startswith("bandit")
    return Line(
        str(figures["learner"]),
        [p["seen"] for p in points],
        [p["first_try"] for p in points],
        [p["interval95"][0] for p in points] if is_ours else None,
        [p["interval95"][1] for p in points] if is_ours else None,
    )
