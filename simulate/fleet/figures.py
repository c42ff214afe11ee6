"""Figures of a fleet: the n-th robot against the first, on common and on own products."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rtask.kb.durability.settings import write_durably
from simulate.demo.products import by_product
from simulate.demo.report import attempts_to_success
from simulate.fleet.assignment import FleetPlan
from simulate.study.chart import Bar, bar_chart
from simulate.study.intervals import bootstrap, mean_interval, share

__all__ = [
    "COLUMNS",
    "fleet_figures",
    "fleet_rows",
    "objects_tried",
    "recognised_products",
    "score_identities",
    "sharing_gain",
    "write_fleet_report",
]

COLUMNS = (
    "robot", "objects", "tried", "held", "attempts", "first try", "attempts, common",
    "attempts, own", "recognised", "false", "from memory",
)  # fmt: skip

Met = Mapping[str, Any]


def recognised_products(robots: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the product that each object of the graph stands for, by the object's IRI.

    It is the one from which the object was first created. An object that was reported through the
    outbox has an IRI that its robot never learned, and is not among them.
    """
    products: dict[str, str] = {}
    for robot in robots:
        for met in _encounters(robot):
            if not met["recognised"] and met["object_iri"]:
                products.setdefault(met["object_iri"], met["product"])
    return products


def score_identities(done: Mapping[str, Any]) -> dict[str, tuple[int, int]]:
    """Return for each robot how many objects it recognised correctly and falsely."""
    products = recognised_products(done["robots"])
    counts = {}
    for robot in done["robots"]:
        recognised = [met for met in _encounters(robot) if met["recognised"]]
        scored = [met for met in recognised if met["recognised"] in products or not met["product"]]
        right = sum(products.get(met["recognised"]) == met["product"] != "" for met in scored)
        counts[robot["name"]] = (right, len(scored) - right)
    return counts


def _encounters(robot: Mapping[str, Any]) -> list[Met]:
    return [met for table in robot["tables"] for met in table]


def objects_tried(robot: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return one entry for each product that was tried in reach."""
    met = by_product(_encounters(robot))
    return [m for m in met if m["product"] and m["in_reach"] and m["tries"]]


def fleet_figures(done: Mapping[str, Any], plan: FleetPlan) -> dict[str, Any]:
    """Return the figures of each robot and the difference of the last from the first.

    Attempts are physical ones up to the first success
    (:func:`simulate.demo.report.attempts_to_success`). The robots before have encountered the
    common products, and nobody else a robot's own.
    """
    cap = int(done["settings"]["max_attempts"])
    identities = score_identities(done)
    robots = []
    for robot in done["robots"]:
        objects = objects_tried(robot)
        right, false = identities[robot["name"]]
        common = [m for m in objects if plan.is_common(m["product"])]
        own = [m for m in objects if not plan.is_common(m["product"])]
        robots.append(
            {
                "name": robot["name"],
                "lost": robot["lost"],
                "undelivered": robot["undelivered"],
                "objects": len({m["product"] for m in _encounters(robot)} - {""}),
                "tried": len(objects),
                "held": share(sum(m["held"] for m in objects), len(objects)),
                "attempts": mean_interval([attempts_to_success(m, cap) for m in objects]),
                "first_try": share(sum(m["tries_to_success"] == 1 for m in objects), len(objects)),
                "attempts_common": mean_interval([attempts_to_success(m, cap) for m in common]),
                "first_try_common": share(
                    sum(m["tries_to_success"] == 1 for m in common), len(common)
                ),
                "attempts_own": mean_interval([attempts_to_success(m, cap) for m in own]),
                "recognised": right,
                "false_identities": false,
                "from_memory": sum(
                    m["attempts"][0]["source"] == "memory" for m in objects if m["attempts"]
                ),
            }
        )
    return {"robots": robots, "last_less_first": _last_less_first(done, plan, cap)}


def _last_less_first(done: Mapping[str, Any], plan: FleetPlan, cap: int) -> dict[str, Any] | None:
    """Return the difference in attempts on the common products, paired by product."""
    if len(done["robots"]) < 2:
        return None
    first, last = (
        {m["product"]: attempts_to_success(m, cap) for m in objects_tried(done["robots"][i])}
        for i in (0, -1)
    )
    both = sorted(name for name in first.keys() & last.keys() if plan.is_common(name))
    return _change([last[name] - first[name] for name in both])


def _change(differences: Sequence[int]) -> dict[str, Any]:
    """Return a mean difference in attempts with its interval."""
    change = np.array(differences, dtype=np.float64)
    if not len(change):
        return {"products": 0, "attempts": None, "interval95": None}
    low, high = bootstrap(lambda i: float(change[i].mean()), len(change))
    return {
        "products": len(change),
        "attempts": round(float(change.mean()), 4),
        "interval95": [round(low, 4), round(high, 4)],
    }


def sharing_gain(
    shared: Mapping[str, Any], alone: Mapping[str, Any], plan: FleetPlan
) -> dict[str, Any]:
    """Return the difference in attempts that sharing makes for all robots but the first.

    Both times the same robots encounter the same products on the same tables; the common ones are
    compared, robot by robot and product by product.
    """
    cap = int(shared["settings"]["max_attempts"])
    differences = []
    for together, separate in zip(shared["robots"][1:], alone["robots"][1:], strict=True):
        with_others = {m["product"]: attempts_to_success(m, cap) for m in objects_tried(together)}
        without = {m["product"]: attempts_to_success(m, cap) for m in objects_tried(separate)}
        both = sorted(n for n in with_others.keys() & without.keys() if plan.is_common(n))
        differences += [with_others[name] - without[name] for name in both]
    return _change(differences)


def fleet_rows(figures: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    return [
        (
            f"{r['name']}{' (lost)' if r['lost'] else ''}",
            str(r["objects"]),
            str(r["tried"]),
            f"{r['held']['hits']}/{r['held']['n']}",
            _mean(r["attempts"]),
            f"{r['first_try']['hits']}/{r['first_try']['n']}",
            _mean(r["attempts_common"]),
            _mean(r["attempts_own"]),
            str(r["recognised"]),
            str(r["false_identities"]),
            str(r["from_memory"]),
        )
        for r in figures["robots"]
    ]


def _mean(value: Mapping[str, Any]) -> str:
    if value["mean"] is None:
        return "-"
    low, high = value["interval95"]
    return f"{value['mean']:.2f} [{low:.2f}, {high:.2f}]"


def write_fleet_report(
    folder: Path, runs: Sequence[tuple[str, Mapping[str, Any], Mapping[str, Any]]]
) -> None:
    """Write ``report.json`` and ``attempts.png`` of several runs, each (name, done, figures)."""
    folder.mkdir(parents=True, exist_ok=True)
    report = {name: {**figures, "done": done} for name, done, figures in runs}
    write_durably(folder / "report.json", json.dumps(report, indent=1) + "\n")
    bars = [
        Bar(f"{r['name']} {which}", name, value["mean"], *value["interval95"])
        for name, _, figures in runs
        for r in figures["robots"]
        for which, value in (("common", r["attempts_common"]), ("own", r["attempts_own"]))
        if value["mean"] is not None
    ]
    if bars:
        bar_chart(folder / "attempts.png", "Attempts to first success", "attempts", bars)
