"""Report of the grasping trials: shares by kind and arm, and the reasons of failures."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simulate.grasping.record import phase_of
from simulate.study.chart import Bar, bar_chart
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import mean_interval, share

__all__ = [
    "COLUMNS",
    "grasping_rows",
    "grasping_study",
    "summarise_grasping",
]

COLUMNS = ("group", "objects", "in reach", "held at first", "held", "placed of held", "attempts")
_ERRORS = ("centre_mm", "length_mm", "width_mm", "height_mm")


def grasping_study(
    trials: int,
    seed: int,
    max_attempts: int = 3,
    preset: str = "faithful",
    robot: str = "nao",
) -> Study:
    """Return the study with perception in the loop; kinds alternate, and arms after each round."""
    return Study(
        "grasping with perception in the loop",
        "simulate.study.grasping:grasping_trial",
        {"seed": seed, "max_attempts": max_attempts, "preset": preset, "robot": robot},
        trials,
        _describe,
    )


def summarise_grasping(results: Results) -> dict[str, Any]:
    """Return the figures as JSON data.

    ``held`` counts all objects, whether in reach or not. ``placed_of_held`` refers to the first
    time that an object was held. ``attempts`` are those up to the first success.
    """
    groups: dict[str, list[Mapping[str, Any]]] = {"all": list(results)}
    for result in results:
        groups.setdefault(result["kind"], []).append(result)
        groups.setdefault(f"{result['arm']} arm", []).append(result)
    return {
        "groups": {name: _group(members) for name, members in groups.items()},
        "reasons_of_attempts": _by_phase(
            attempt["reason"] for r in results for attempt in r["attempts"]
        ),
        "reasons_of_objects_not_held": _by_phase(
            result["reason"] for result in results if not result["held"]
        ),
        "reasons_not_placed": _by_phase(
            attempt["place_reason"]
            for result in results
            for attempt in result["attempts"]
            if attempt["held"]
        ),
        "perception_mm": {
            name: mean_interval([abs(r["perceived"][name]) for r in results if r["perceived"]])
            for name in _ERRORS
        },
    }


def _group(members: Results) -> dict[str, Any]:
    n, reached = len(members), [m for m in members if m["in_reach"]]
    first = [m["placed_first"] for m in members if m["placed_first"] is not None]
    return {
        "in_reach": share(len(reached), n),
        "held_first": share(sum(m["held_first"] for m in members), n),
        "held": share(sum(m["held"] for m in members), n),
        "held_in_reach": share(sum(m["held"] for m in reached), len(reached)),
        "placed_of_held": share(sum(first), len(first)),
        "attempts": mean_interval([m["tries_to_success"] for m in members if m["held"]]),
    }


def _by_phase(reasons: Any) -> dict[str, dict[str, int]]:
    counted: dict[str, dict[str, int]] = {}
    for reason, n in sorted(Counter(reasons).items()):
        counted.setdefault(phase_of(reason) or "ok", {})[reason] = n
    return counted


def grasping_rows(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    rows = []
    for name, group in summary["groups"].items():
        cells = (group[key] for key in ("in_reach", "held_first", "held", "placed_of_held"))
        mean = group["attempts"]["mean"]
        rows.append(
            (
                name,
                str(group["held"]["n"]),
                *map(show_share, cells),
                "-" if mean is None else f"{mean:.2f}",
            )
        )
    return rows


def show_share(part: Mapping[str, Any]) -> str:
    """Format a share with its interval.

    >>> show_share({"hits": 9, "n": 10, "share": 0.9, "interval95": [0.596, 0.982]})
    '9/10 90% [60, 98]'
    """
    if not part["n"]:
        return "-"
    low, high = part["interval95"]
    return (
        f"{part['hits']}/{part['n']} {100 * part['share']:.0f}% [{100 * low:.0f}, {100 * high:.0f}]"
    )


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = {"seed": settings["seed"], "trials": len(results), **summarise_grasping(results)}
    bars = [
        Bar(name, what.replace("_", " "), group[what]["share"] or 0.0, *group[what]["interval95"])
        for name, group in summary["groups"].items()
        for what in ("held_first", "held", "placed_of_held")
    ]
    bar_chart(folder / "held.png", "Grasping with perception in the loop", "share", bars)
    return Report(
        summary,
        [Table("Grasping with perception in the loop", COLUMNS, grasping_rows(summary))],
        [
            f"{what.replace('_', ' ')}: {json.dumps(summary[what])}"
            for what in ("reasons_of_attempts", "reasons_of_objects_not_held", "reasons_not_placed")
        ],
        {"results": list(results)},
        pictures=["held.png"],
    )
